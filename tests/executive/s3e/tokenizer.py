"""A small tokenizer, trained here on a few sentences, with the marks of all families."""

from __future__ import annotations

from typing import Any

WORDS = ("yes", "no", "true", "false")

_SENTENCES = (
    "Is the milk carton on the wooden table?",
    "Is the lemon on the black table? Is the soda can on the white table?",
    "Is the robot gripper holding the bread loaf? Is the gripper of the robot empty?",
    "Are the cereal box and the water bottle on the floor?",
    "A curious human is asking an artificial intelligence assistant yes or no questions.",
    "The assistant answers with one of three responses: YES or NO.",
    "The assistant's response should not include any additional text.",
)


_SPECIAL = (
    "<|endoftext|>",
    "<|im_start|>",
    "<|im_end|>",
    "<image>",
    "<video>",
    "<|vision_start|>",
    "<|vision_end|>",
    "<fake_token_around_image>",
    "<global-img>",
    *(f"<row_{row}_col_{column}>" for row in range(1, 4) for column in range(1, 4)),
)


def make_tokenizer(begin: bool = False) -> Any:
    """A byte-level BPE tokenizer (as of GPT-2, Qwen, SmolVLM) for which every surface form of an answer is a token of
    its own, and so are several newlines. With `begin`, every text gets a token in front, as Llama's and Gemma's do."""
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers, processors, trainers
    from transformers import PreTrainedTokenizerFast

    inner = Tokenizer(models.BPE())
    inner.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    inner.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=700,
        special_tokens=list(_SPECIAL),
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        show_progress=False,
    )
    forms = [form.replace("\u0120", " ") for form in answer_tokens()]
    inner.train_from_iterator([*_SENTENCES, *forms * 20, "\n\n\n\n" * 20], trainer)
    if begin:
        begins = inner.token_to_id("<|endoftext|>")
        inner.post_processor = processors.TemplateProcessing(
            single="<|endoftext|> $A", special_tokens=[("<|endoftext|>", begins)]
        )
    return PreTrainedTokenizerFast(
        tokenizer_object=inner,
        bos_token="<|endoftext|>" if begin else None,
        eos_token="<|im_end|>",
        pad_token="<|endoftext|>",
        padding_side="left",
        extra_special_tokens={
            "image_token": "<image>",
            "video_token": "<video>",
            "fake_image_token": "<fake_token_around_image>",
            "global_image_token": "<global-img>",
            "end_of_utterance_token": "<|im_end|>",
            "boi_token": "<|vision_start|>",
            "eoi_token": "<|vision_end|>",
            "start_image_token": "<|vision_start|>",
            "end_image_token": "<|vision_end|>",
            "context_image_token": "<image>",
        },
    )


def answer_tokens(*words: str) -> list[str]:
    """All surface forms of these answers (without any, of all), as the tokens of `make_tokenizer`."""
    forms = [form for word in words or WORDS for form in (word, word.capitalize(), word.upper())]
    return [space + form for form in forms for space in ("", "\u0120")]  # as byte-level BPE writes a space
