"""The architecture: a FastVLM of the transformers library, with a ResNet as vision encoder and a small Qwen2 as
decoder.

Both are standard: `AutoModelForImageTextToText.from_pretrained` loads what is saved here without any code of ours. The
initialisation is ours: the projector is trained to map each cell to the negative sum of the word embeddings of what it
shows (lemon, black, table), and the decoder's query and key matrices start as the identity and its negative, so that a
word in a question attends to the cells that show what it names, and not to itself, from the first step.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import nn

from executive.lab.training import tokenizer as words
from executive.lab.training.presets import ModelSize
from executive.s3e.backends.loading import quiet
from executive.s3e.backends.packages import importing

MEAN, STD = 0.55, 0.27
"""The approximate mean and standard deviation of training pixels; the same for each colour, so that grey stays grey."""


THETA = 1e8
"""The base of the rotary embeddings' periods."""


def build(size: ModelSize, tokenizer: Any) -> Any:
    """Makes a FastVlmForConditionalGeneration with the initial weights."""
    with importing():
        from transformers import FastVlmConfig, FastVlmForConditionalGeneration

    config = FastVlmConfig(
        vision_config={
            "model_type": "resnet",
            "num_channels": 3,
            "hidden_size": size.widths[-1],
            "embedding_size": size.stem,
            "hidden_sizes": list(size.widths),
            "depths": list(size.depths),
            "layer_type": "basic",
        },
        text_config={
            "model_type": "qwen2",
            "vocab_size": len(tokenizer),
            "hidden_size": size.hidden,
            "intermediate_size": size.inner,
            "num_hidden_layers": size.layers,
            "num_attention_heads": size.heads,
            "num_key_value_heads": size.heads,
            "max_position_embeddings": 8192,
            # Slow rotations: attention depends on content more than on position.
            "rope_parameters": {"rope_type": "default", "rope_theta": THETA},
            "bos_token_id": None,
            "eos_token_id": tokenizer.eos_token_id,
            "pad_token_id": tokenizer.pad_token_id,
            "tie_word_embeddings": True,
        },
        image_token_index=tokenizer.convert_tokens_to_ids(words.IMAGE),
        image_seq_length=size.cells,
        tie_word_embeddings=True,
    )
    model = FastVlmForConditionalGeneration(config)
    initialise(model, size)
    return model


def initialise(model: Any, size: ModelSize) -> None:
    """Initialises the decoder as described at the head of this module."""
    same = torch.eye(size.hidden)
    decoder = model.model.language_model
    with torch.no_grad():
        nn.init.normal_(decoder.embed_tokens.weight, std=3.0 / math.sqrt(size.hidden))
        for layer in decoder.layers:
            attention = layer.self_attn
            for part, gain in (
                (attention.q_proj, 1.2),
                (attention.k_proj, -1.2),
                (attention.v_proj, 0.5),
                (attention.o_proj, 0.5),
            ):
                part.weight.copy_(gain * same + 0.02 * torch.randn_like(same))


_REACH = 4
"""Tokens to which a layer attends that gathers words: as many as a name has."""

_SHARPNESS, _GATHERED, _SELECTIVE = 3.0, 0.25, 3.0
"""How narrowly a token attends to those before it; how much of them it is added, in standard deviations of a layer's
input; and the gain of queries and keys that tells all of a name from all but a word."""

_FREQUENCIES = range(1, 7)
"""Of the rotations of a head. By the first one, which turns fastest, a token would attend to some far away."""


def gather_words(decoder: Any) -> None:
    """Initialise the decoder's first layer so that each token is added those just before it, whatever they are, and its
    second so that what was gathered attends to the cells that show all of it: an object's name of several words is
    looked up from the first step on.

    Two rotary embeddings differ by angles that grow with their distance; with constant queries and keys the score is
    the sum of the cosines of these angles, which is largest at half of `_REACH`.
    """
    heads, (first_layer, second_layer, *_) = decoder.config.num_attention_heads, decoder.layers
    attention = first_layer.self_attn
    width = attention.q_proj.bias.shape[0] // heads
    strength = math.sqrt(_SHARPNESS * math.sqrt(width))
    with torch.no_grad():
        for part in (attention.q_proj, attention.k_proj):
            part.weight.copy_(0.02 * torch.randn_like(part.weight))
            part.bias.zero_()
        for head in range(heads):
            for number in _FREQUENCIES:
                if number >= width // 2:
                    break
                angle = 0.5 * (_REACH - 1) * THETA ** (-2.0 * number / width)
                first, second = head * width + number, head * width + number + width // 2
                attention.k_proj.bias[first] = strength
                attention.q_proj.bias[first] = strength * math.cos(angle)
                attention.q_proj.bias[second] = -strength * math.sin(angle)
        for part, gain in (
            (attention.v_proj, 1.0),
            (attention.o_proj, _GATHERED),
            (second_layer.self_attn.q_proj, _SELECTIVE),
            (second_layer.self_attn.k_proj, -_SELECTIVE),
            (second_layer.self_attn.v_proj, 1.0),
        ):
            part.weight.copy_(gain * torch.eye(len(part.weight)) + 0.02 * torch.randn_like(part.weight))


def tell_apart(embedding: torch.Tensor, tokens: Sequence[int], heads: int, seed: int) -> None:
    """Make the embeddings of some tokens orthogonal in the part that each head attends by, as long as they were: what
    has all values of a description is then told from what has all but one, from the first step on. Where they are more
    than such a part has dimensions, they stay as they are."""
    generator = torch.Generator().manual_seed(seed)
    width = embedding.shape[1] // heads
    if len(tokens) > width:
        return
    length = embedding.detach().norm(dim=1).mean() / math.sqrt(heads)
    with torch.no_grad():
        for head in range(heads):
            drawn = torch.randn(width, len(tokens), generator=generator)
            embedding[list(tokens), head * width : (head + 1) * width] = length * torch.linalg.qr(drawn).Q.T


def save(model: Any, tokenizer: Any, size: ModelSize, folder: Path) -> None:
    """Writes a checkpoint in the format of model hubs: config, weights in safetensors, tokenizer, processor, template.

    Matrices and kernels are stored in 16 bits, which halves the file and leaves answers as they are to three digits.
    The config says to compute in 32: answers are then the same on every machine.
    """
    with importing():
        from transformers import CLIPImageProcessorPil

    folder.mkdir(parents=True, exist_ok=True)
    with quiet():
        tokenizer.save_pretrained(folder)
        state = {name: value.half() if value.ndim > 1 else value for name, value in model.state_dict().items()}
        model.save_pretrained(folder, state_dict=state)
    square = {"height": size.side, "width": size.side}
    CLIPImageProcessorPil(
        size=square, do_center_crop=False, resample=2, image_mean=[MEAN] * 3, image_std=[STD] * 3, do_convert_rgb=True
    ).save_pretrained(folder)
    described = {
        "processor_class": "LlavaProcessor",
        "patch_size": size.stride,
        "vision_feature_select_strategy": "full",
        "image_token": words.IMAGE,
        "num_additional_image_tokens": 0,
    }
    _write_json(folder / "processor_config.json", described)
    (folder / "chat_template.jinja").write_text(words.TEMPLATE, encoding="utf-8")


def _write_json(file: Path, content: Mapping[str, Any]) -> None:
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
