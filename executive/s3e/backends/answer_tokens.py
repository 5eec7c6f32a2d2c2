"""Which tokens are an answer: every surface form that is one token, as the paper counts them (Section 4).

Tokenizers differ in what a token is. Each token of the vocabulary is therefore decoded by itself and compared as text:
in one vocabulary " yes" is a token, in another both "yes" and the "yes" that begins a word read the same.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from executive.errors import InputError
from executive.s3e.backends.interface import AnswerWords, Numerals

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class AnswerTokens:
    """The ids whose probabilities are summed for either answer: sorted, not empty, and none of them in both."""

    affirmative: tuple[int, ...]
    negative: tuple[int, ...]


def answer_tokens(tokenizer: Any, words: AnswerWords, vocabulary: int) -> AnswerTokens:
    """The tokens that are one of the answers' surface forms.

    An answer that is no single token in any form is recognised by its forms' first tokens, as far as no form of the
    other answer begins with them or is one of them.

    Args:
        tokenizer: a transformers tokenizer.
        vocabulary: how many tokens the model gives a probability for; ids beyond it are left out.

    Raises:
        InputError: an answer has no usable form at all.
    """
    forms = words.forms()
    names = words.affirmative, words.negative
    whole = [_whole(tokenizer, answer, vocabulary) for answer in forms]
    begun = [_begun(tokenizer, answer, vocabulary) for answer in forms]
    found = []
    for this, other in ((0, 1), (1, 0)):
        tokens = whole[this] - whole[other]
        if not tokens:
            tokens = begun[this] - begun[other] - whole[other]
            if tokens:
                log.info("no form of %r is a token of its own: its forms' first tokens are counted", names[this])
        if not tokens:
            raise InputError(
                f"no token tells the answer {names[this]!r} from {names[other]!r}: this tokenizer has none of the "
                f"forms {', '.join(map(repr, forms[this]))}, and begins both answers alike"
            )
        found.append(tuple(sorted(tokens)))
    return AnswerTokens(*found)


def numeral_tokens(tokenizer: Any, numerals: Numerals, vocabulary: int) -> tuple[tuple[int, ...], ...]:
    """The tokens that are a surface form of each number, from 0 on.

    A number that is no single token in any form is never the answer. Where another number's token may be its beginning
    (`1` of `12`), that token tells nothing and is left out.

    Raises:
        InputError: no number is a token.
    """
    forms = numerals.forms()
    whole = [_whole(tokenizer, each, vocabulary) for each in forms]
    begun = set[int]().union(*(_begun(tokenizer, f, vocabulary) for f, w in zip(forms, whole, strict=True) if not w))
    tokens = tuple(tuple(sorted(each - begun)) for each in whole)
    if not any(tokens):
        raise InputError(f"no number from 0 to {numerals.most} is a token of this tokenizer by itself")
    return tokens


def _whole(tokenizer: Any, forms: Iterable[str], vocabulary: int) -> set[int]:
    """The ids that decode to one of the forms. Only tokens whose name holds the word's letters are decoded; the rest
    of a name is how the tokenizer writes a space."""
    wanted = frozenset(forms)
    bare = {form.strip() for form in wanted}
    names: Mapping[str, int] = tokenizer.get_vocab()
    special = frozenset(tokenizer.all_special_ids)
    return {
        token
        for name, token in names.items()
        if token < vocabulary and token not in special and any(name.endswith(word) for word in bare)
        if tokenizer.decode([token], skip_special_tokens=False, clean_up_tokenization_spaces=False) in wanted
    }


def _begun(tokenizer: Any, forms: Iterable[str], vocabulary: int) -> set[int]:
    """The first token of each form's tokenization, where it says anything (a bare space says nothing)."""
    encoded = (tokenizer.encode(form, add_special_tokens=False) for form in forms)
    special = frozenset(tokenizer.all_special_ids)
    return {
        tokens[0]
        for tokens in encoded
        if tokens and tokens[0] < vocabulary and tokens[0] not in special and tokenizer.decode([tokens[0]]).strip()
    }
