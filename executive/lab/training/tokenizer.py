"""The eye's tokenizer: words, made from everything that the eye is ever asked in training, in lower case."""

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
"""Before each picture's tokens: which one it is, in the order in which they are shown."""

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
"""Pictures first: what is said of them then changes nothing in what is kept of them."""


def make_tokenizer(corpus: Iterable[str], size: int = 1536) -> Any:
    """A transformers tokenizer whose words are those of a corpus, by frequency; what it does not know it spells.

    Words and marks of punctuation are separate; upper case does not count.
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
