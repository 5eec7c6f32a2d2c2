"""Vision-language checkpoints small enough for a test: real architectures, random weights, a tokenizer made here.

No model hub is asked for anything. A checkpoint is a folder as a hub would hold it (config.json, model.safetensors,
tokenizer, processor, chat template) and is loaded in the same way. The weights are drawn larger than for training, so
that pictures and questions matter: an answer that depended on neither would let every wrong prefix pass.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.executive.s3e.tokenizer import answer_tokens, make_tokenizer

FAMILIES = ("llava-onevision", "smolvlm", "qwen2.5-vl", "fastvlm")
"""What `build` knows, by the names that people call them: models that keep keys and values of every token."""

OTHERS = ("paligemma", "internvl")
"""And models with ways of their own: one that reads the whole prompt in both directions, so that nothing can be
shared, and one whose processor wants a part for videos. ("got-ocr2" is known, too, and cannot be asked.)"""

FORGETTING = ("gemma3", "qwen3.5")
"""And models that do not, in some layers: a sliding window (shorter than any prompt here) and linear attention."""


@dataclass(frozen=True, slots=True)
class Size:
    """How large a model is. `picture` is the side in pixels that its vision tower takes, `patch` that of one patch."""

    width: int = 64
    layers: int = 3
    heads: int = 4
    inner: int = 96
    vision_width: int = 32
    vision_layers: int = 2
    vision_heads: int = 2
    picture: int = 56
    patch: int = 14


TINY = Size()


def build(
    family: str,
    folder: Path,
    *,
    seed: int = 0,
    size: Size = TINY,
    template: str | None = None,
    begin: bool = False,
    splitting: bool = False,
    answering: float = 4.0,
) -> Path:
    """Write a checkpoint of a family into `folder`, and return it.

    Args:
        seed: of the weights; everything else is the same every time.
        template: a chat template (Jinja) instead of the family's own; "" for none at all.
        begin: whether the tokenizer puts a token at the beginning of every text, as Llama's and Gemma's do.
        splitting: whether a picture is also taken in parts (SmolVLM alone).
        answering: how much larger the output rows of yes and no are than those of other tokens, so that a part of the
            probability goes to them; 16 leaves little for anything else.
    """
    import torch
    from transformers.utils import logging as chatter

    maker = _MAKERS[family]
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer = make_tokenizer(begin)
    made = maker(tokenizer, size, splitting)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = made.model()
        draw_weights(model)
        with torch.no_grad():
            for words, gain in ((("yes", "no"), answering), (("true", "false"), 4.0)):
                rows = tokenizer.convert_tokens_to_ids(answer_tokens(*words))
                model.get_output_embeddings().weight[rows] *= gain
    chatter.disable_progress_bar()
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    made.image_processor.save_pretrained(folder)
    (folder / "processor_config.json").write_text(json.dumps(made.processor, indent=2), "utf-8")
    text = _template(made.picture) if template is None else template
    if text:
        (folder / "chat_template.jinja").write_text(text, "utf-8")
    return folder


def draw_weights(model: Any) -> None:
    """Random weights of about the size at which a signal keeps its own. Attention is drawn sharper, so that the last
    token does not see all of a long prompt alike."""
    import torch

    with torch.no_grad():
        for name, weight in model.named_parameters():
            if "dt_bias" in name or "A_log" in name:
                weight.fill_(-1.0)  # of linear attention: a memory of some ten tokens
            if weight.ndim < 2:
                continue
            gain = 2.0 if "q_proj" in name or "k_proj" in name else 1.0
            fan_in = 1 if "embed" in name else math.prod(weight.shape[1:])
            weight.normal_(0.0, gain / math.sqrt(fan_in))


@dataclass(frozen=True, slots=True)
class _Made:
    """A family's parts: what makes the model, what prepares pictures, what processor_config.json says, and what the
    chat template writes where a picture goes."""

    model: Callable[[], Any]
    image_processor: Any
    processor: Mapping[str, Any]
    picture: str = "<image>"


def _llava_onevision(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import (
        LlavaOnevisionConfig,
        LlavaOnevisionForConditionalGeneration,
        LlavaOnevisionImageProcessorPil,
        SiglipVisionConfig,
    )

    side = size.picture
    grid = [[side, side], [side, 2 * side], [2 * side, side], [2 * side, 2 * side]]
    vision = SiglipVisionConfig(**_vision(size), image_size=side, patch_size=size.patch, vision_use_head=False)
    config = LlavaOnevisionConfig(
        vision_config=vision.to_dict(),
        text_config={"model_type": "qwen2", **_language(tokenizer, size)},
        image_token_index=tokenizer.convert_tokens_to_ids("<image>"),
        video_token_index=tokenizer.convert_tokens_to_ids("<video>"),
        image_grid_pinpoints=grid,
    )
    return _Made(
        lambda: LlavaOnevisionForConditionalGeneration(config),
        LlavaOnevisionImageProcessorPil(size={"height": side, "width": side}, image_grid_pinpoints=grid),
        {
            "processor_class": "LlavaOnevisionProcessor",
            "num_image_tokens": (side // size.patch) ** 2,
            "vision_feature_select_strategy": "full",
            "image_token": "<image>",
            "video_token": "<video>",
        },
    )


def _smolvlm(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import SmolVLMConfig, SmolVLMForConditionalGeneration, SmolVLMImageProcessorPil

    side = size.picture
    config = SmolVLMConfig(
        vision_config={**_vision(size), "image_size": side, "patch_size": size.patch},
        text_config={"model_type": "llama", "rms_norm_eps": 1e-5, **_language(tokenizer, size)},
        image_token_id=tokenizer.convert_tokens_to_ids("<image>"),
        scale_factor=2,
    )
    prepare = SmolVLMImageProcessorPil(
        size={"longest_edge": 2 * side}, max_image_size={"longest_edge": side}, do_image_splitting=splitting
    )
    processor = {"processor_class": "SmolVLMProcessor", "image_seq_len": (side // size.patch // 2) ** 2}
    return _Made(lambda: SmolVLMForConditionalGeneration(config), prepare, processor)


def _qwen(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import Qwen2_5_VLConfig, Qwen2_5_VLForConditionalGeneration, Qwen2VLImageProcessorPil

    sections = size.width // size.heads // 2
    config = Qwen2_5_VLConfig(
        vision_config={
            "depth": size.vision_layers,
            "hidden_size": size.vision_width,
            "intermediate_size": 2 * size.vision_width,
            "num_heads": size.vision_heads,
            "patch_size": size.patch,
            "window_size": 4 * size.patch,
            "out_hidden_size": size.width,
            "fullatt_block_indexes": [size.vision_layers - 1],
        },
        text_config={
            **_language(tokenizer, size),
            "rope_parameters": {
                "rope_type": "default",
                "rope_theta": 10_000.0,
                "mrope_section": [sections - 2 * (sections // 3), sections // 3, sections // 3],
            },
        },
        **_marks(tokenizer),
    )
    pixels = size.picture**2
    prepare = Qwen2VLImageProcessorPil(
        patch_size=size.patch, merge_size=2, size={"shortest_edge": pixels // 4, "longest_edge": 2 * pixels}
    )
    return _Made(
        lambda: Qwen2_5_VLForConditionalGeneration(config),
        prepare,
        {"processor_class": "Qwen2_5_VLProcessor"},
        "<|vision_start|><image><|vision_end|>",
    )


def _fastvlm(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import CLIPImageProcessorPil, FastVlmConfig, FastVlmForConditionalGeneration

    side, width = size.picture, size.vision_width
    stride = 16  # of a ResNet with a stem (4) and three stages, the last two of which halve
    side = side // stride * stride
    config = FastVlmConfig(
        vision_config={
            "model_type": "resnet",
            "hidden_size": width,
            "hidden_sizes": [width, width, width],
            "depths": [1, 1, 1],
            "embedding_size": width,
            "layer_type": "basic",
        },
        text_config={"model_type": "qwen2", **_language(tokenizer, size)},
        image_token_index=tokenizer.convert_tokens_to_ids("<image>"),
    )
    return _Made(
        lambda: FastVlmForConditionalGeneration(config),
        CLIPImageProcessorPil(size={"height": side, "width": side}, do_center_crop=False),
        {
            "processor_class": "LlavaProcessor",
            "patch_size": stride,
            "vision_feature_select_strategy": "full",
            "image_token": "<image>",
            "num_additional_image_tokens": 0,
        },
    )


def _gemma(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import Gemma3Config, Gemma3ForConditionalGeneration, Gemma3ImageProcessorPil

    side = size.picture
    config = Gemma3Config(
        vision_config={
            "model_type": "siglip_vision_model",
            **_vision(size),
            "image_size": side,
            "patch_size": size.patch,
            "vision_use_head": False,
        },
        text_config={
            **_language(tokenizer, size),
            "head_dim": size.width // size.heads,
            "query_pre_attn_scalar": size.width // size.heads,
            "sliding_window": 24,
            "layer_types": ["sliding_attention", "full_attention"] * size.layers,
            "num_hidden_layers": 2 * size.layers,
        },
        mm_tokens_per_image=4,
        boi_token_index=tokenizer.convert_tokens_to_ids("<|vision_start|>"),
        eoi_token_index=tokenizer.convert_tokens_to_ids("<|vision_end|>"),
        image_token_index=tokenizer.convert_tokens_to_ids("<image>"),
        tie_word_embeddings=False,
    )
    return _Made(
        lambda: Gemma3ForConditionalGeneration(config),
        Gemma3ImageProcessorPil(size={"height": side, "width": side}),
        {"processor_class": "Gemma3Processor", "image_seq_length": 4},
        "<|vision_start|>",
    )


def _qwen_linear(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import Qwen2VLImageProcessorPil, Qwen3_5Config, Qwen3_5ForConditionalGeneration

    head, pixels = size.width // size.heads, size.picture**2
    sections = head // 2
    config = Qwen3_5Config(
        vision_config={
            "depth": size.vision_layers,
            "hidden_size": size.vision_width,
            "intermediate_size": 2 * size.vision_width,
            "num_heads": size.vision_heads,
            "patch_size": size.patch,
            "out_hidden_size": size.width,
            "num_position_embeddings": 16,
        },
        text_config={
            **_language(tokenizer, size),
            "head_dim": head,
            "num_hidden_layers": 4,
            "layer_types": ["linear_attention", "linear_attention", "linear_attention", "full_attention"],
            "linear_key_head_dim": head,
            "linear_value_head_dim": head,
            "linear_num_key_heads": size.heads // 2,
            "linear_num_value_heads": size.heads,
            "rope_parameters": {
                "rope_type": "default",
                "rope_theta": 10_000.0,
                "partial_rotary_factor": 1.0,
                "mrope_section": [sections - 2 * (sections // 3), sections // 3, sections // 3],
            },
        },
        **_marks(tokenizer),
    )
    prepare = Qwen2VLImageProcessorPil(
        patch_size=size.patch, merge_size=2, size={"shortest_edge": pixels // 4, "longest_edge": 2 * pixels}
    )
    picture = "<|vision_start|><image><|vision_end|>"
    return _Made(
        lambda: Qwen3_5ForConditionalGeneration(config), prepare, {"processor_class": "Qwen3VLProcessor"}, picture
    )


def _paligemma(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    """Reads its whole prompt in both directions; its processor hands out labels for training, too."""
    from transformers import PaliGemmaConfig, PaliGemmaForConditionalGeneration, SiglipImageProcessorPil

    tokenizer.bos_token = "<|endoftext|>"
    side = size.picture
    language = {**_language(tokenizer, size), "head_dim": size.width // size.heads}
    config = PaliGemmaConfig(
        vision_config={
            "model_type": "siglip_vision_model",
            **_vision(size),
            "image_size": side,
            "patch_size": size.patch,
            "projection_dim": size.width,
            "vision_use_head": False,
        },
        text_config={"model_type": "gemma", **language},
        image_token_index=tokenizer.convert_tokens_to_ids("<image>"),
        vocab_size=language["vocab_size"],
        projection_dim=size.width,
        hidden_size=size.width,
        tie_word_embeddings=False,
    )
    prepare = SiglipImageProcessorPil(size={"height": side, "width": side}, image_seq_length=(side // size.patch) ** 2)
    processor = {"processor_class": "PaliGemmaProcessor"}
    return _Made(lambda: PaliGemmaForConditionalGeneration(config), prepare, processor)


def _internvl(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    from transformers import GotOcr2ImageProcessorPil, InternVLConfig, InternVLForConditionalGeneration

    side = size.picture
    tokens = (side // size.patch // 2) ** 2
    config = InternVLConfig(
        vision_config={**_vision(size), "image_size": [side, side], "patch_size": [size.patch, size.patch]},
        text_config={"model_type": "qwen2", **_language(tokenizer, size)},
        image_token_id=tokenizer.convert_tokens_to_ids("<image>"),
        image_seq_length=tokens,
        tie_word_embeddings=False,
    )
    prepare = GotOcr2ImageProcessorPil(size={"height": side, "width": side}, crop_to_patches=splitting)
    processor = {"processor_class": "InternVLProcessor", "image_seq_length": tokens}
    return _Made(lambda: InternVLForConditionalGeneration(config), prepare, processor)


def _got(tokenizer: Any, size: Size, splitting: bool) -> _Made:
    """Reads text off pictures, and is asked nothing."""
    from transformers import GotOcr2Config, GotOcr2ForConditionalGeneration, GotOcr2ImageProcessorPil

    tokenizer.add_special_tokens({"additional_special_tokens": ["<img>", "</img>", "<imgpad>"]})
    side = 4 * size.patch
    config = GotOcr2Config(
        vision_config={
            **_vision(size),
            "output_channels": 16,
            "mlp_dim": size.inner,
            "image_size": side,
            "patch_size": size.patch,
            "window_size": 2,
            "global_attn_indexes": [1],
        },
        text_config={"model_type": "qwen2", **_language(tokenizer, size)},
        image_token_index=tokenizer.convert_tokens_to_ids("<imgpad>"),
        image_seq_length=1,
        tie_word_embeddings=False,
    )
    prepare = GotOcr2ImageProcessorPil(size={"height": side, "width": side})
    processor = {"processor_class": "GotOcr2Processor"}
    return _Made(lambda: GotOcr2ForConditionalGeneration(config), prepare, processor, "<img><imgpad></img>")


_MAKERS: dict[str, Callable[[Any, Size, bool], _Made]] = {
    "llava-onevision": _llava_onevision,
    "smolvlm": _smolvlm,
    "qwen2.5-vl": _qwen,
    "fastvlm": _fastvlm,
    "gemma3": _gemma,
    "qwen3.5": _qwen_linear,
    "paligemma": _paligemma,
    "internvl": _internvl,
    "got-ocr2": _got,
}


def _marks(tokenizer: Any) -> dict[str, int]:
    """What Qwen's configs call the tokens around and of a picture."""
    marks = {
        "image_token_id": "<image>",
        "video_token_id": "<video>",
        "vision_start_token_id": "<|vision_start|>",
        "vision_end_token_id": "<|vision_end|>",
    }
    return {key: int(tokenizer.convert_tokens_to_ids(mark)) for key, mark in marks.items()}


def _vision(size: Size) -> dict[str, Any]:
    return {
        "hidden_size": size.vision_width,
        "intermediate_size": 2 * size.vision_width,
        "num_hidden_layers": size.vision_layers,
        "num_attention_heads": size.vision_heads,
    }


def _language(tokenizer: Any, size: Size) -> dict[str, Any]:
    return {
        "vocab_size": len(tokenizer) + 3,  # real checkpoints pad their embeddings, too
        "hidden_size": size.width,
        "intermediate_size": size.inner,
        "num_hidden_layers": size.layers,
        "num_attention_heads": size.heads,
        "num_key_value_heads": size.heads // 2,
        "max_position_embeddings": 4096,
        "bos_token_id": None,
        "eos_token_id": tokenizer.convert_tokens_to_ids("<|im_end|>"),
        "pad_token_id": tokenizer.convert_tokens_to_ids("<|endoftext|>"),
        "tie_word_embeddings": False,
    }


def _template(picture: str) -> str:
    """Turns between <|im_start|> and <|im_end|>, as in ChatML."""
    return (
        "{% for message in messages %}<|im_start|>{{ message['role'] }}\n"
        "{% if message['content'] is string %}{{ message['content'] }}{% else %}"
        "{% for part in message['content'] %}"
        "{% if part['type'] == 'image' %}" + picture + "{% else %}{{ part['text'] }}{% endif %}"
        "{% endfor %}{% endif %}<|im_end|>\n{% endfor %}"
        "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
    )
