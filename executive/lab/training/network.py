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
from collections.abc import Mapping
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
            "rope_parameters": {"rope_type": "default", "rope_theta": 1e8},
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


def save(model: Any, tokenizer: Any, size: ModelSize, folder: Path) -> None:
    """Writes a checkpoint in the format of model hubs: config, weights in safetensors, tokenizer, processor, template.

    The weights are stored in 32 bits: they are few, and answers are then the same on every machine.
    """
    with importing():
        from transformers import CLIPImageProcessorPil

    folder.mkdir(parents=True, exist_ok=True)
    with quiet():
        tokenizer.save_pretrained(folder)
        model.save_pretrained(folder)
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
