"""The tokenizer of the trained model: a lower-case vocabulary made from all training questions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

END, IMAGE, SYSTEM, USER, ASSISTANT, UNKNOWN = (
    "<|end|>",
    "<image>",
    "<|system|>",
    "<|user|>",
    "<|assistant|>",
    "<|unk|>",
)

SPECIAL = (END, UNKNOWN, IMAGE, SYSTEM, USER, ASSISTANT)
ANSWERS = ("yes", "no", "true", "false")
PICTURES = tuple(f"<|picture{number}|>" for number in range(1, 9))
"""The marker before each picture's tokens, numbered in the order of the pictures."""

TEMPLATE = """\
{%- set shown = namespace(count=0) -%}
{%- for message in messages if message['role'] == 'user' -%}
{%- if message['content'] is not string -%}
{%- for part in message['content'] if part['type'] == 'image' -%}
{%- set shown.count = shown.count + 1 -%}
<|picture{{ [shown.count, 8] | min }}|><image>
{%- endfor -%}
{%- endif -%}
{%- endfor -%}
{%- for message in messages -%}
<|{{ message['role'] }}|>
{%- if message['content'] is string -%}
{{ message['content'] }}
{%- else -%}
{%- for part in message['content'] if part['type'] == 'text' -%}
{{ part['text'] }}
{%- endfor -%}
{%- endif -%}
{%- endfor -%}
{%- if add_generation_prompt -%}<|assistant|>{%- endif -%}
"""
"""Pictures come first, so that the cached states of their tokens do not depend on the text."""


def make_tokenizer(corpus: Iterable[str], size: int = 1536) -> Any:
    """Trains a tokenizer (BPE) on a corpus; unknown words are spelled in letters.

    Words and punctuation are separate tokens; case is ignored.
    """
    from tokenizers import Regex, Tokenizer, models, normalizers, pre_tokenizers, trainers
    from transformers import PreTrainedTokenizerFast

    tokenizer = Tokenizer(models.BPE(unk_token=UNKNOWN))
    tokenizer.normalizer = normalizers.Sequence([normalizers.NFKC(), normalizers.Lowercase()])
    tokenizer.pre_tokenizer = pre_tokenizers.Split(Regex(r"[a-z]+|[0-9]|[^\sa-z0-9]"), "removed", invert=True)
    letters = [chr(code) for code in range(33, 127) if not chr(code).isupper()]
    trainer = trainers.BpeTrainer(
        vocab_size=size, special_tokens=[*SPECIAL, *PICTURES], initial_alphabet=letters, show_progress=False
    )
    answers = " ".join(ANSWERS)
    tokenizer.train_from_iterator([*corpus, *([answers] * 10_000)], trainer)
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        eos_token=END,
        pad_token=END,
        unk_token=UNKNOWN,
        additional_special_tokens=[IMAGE, SYSTEM, USER, ASSISTANT, *PICTURES],
        extra_special_tokens={"image_token": IMAGE},
        clean_up_tokenization_spaces=False,
    )
