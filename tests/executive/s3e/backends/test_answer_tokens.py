"""Which tokens count as an answer, in tokenizers of every make."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.errors import InputError
from executive.s3e.backends.answer_tokens import answer_tokens
from executive.s3e.backends.interface import TRUE_FALSE, YES_NO, AnswerWords
from tests.executive.s3e.tokenizer import make_tokenizer

MANY = 10_000


def wrapped(inner: Any, **options: Any) -> Any:
    from transformers import PreTrainedTokenizerFast

    return PreTrainedTokenizerFast(tokenizer_object=inner, **options)


def byte_level(*merged: str) -> Any:
    """A byte-level BPE tokenizer in which exactly these strings are tokens beside the single characters."""
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers

    vocabulary = {character: index for index, character in enumerate(sorted(pre_tokenizers.ByteLevel.alphabet()))}
    merges: list[tuple[str, str]] = []
    for text in merged:
        whole = text.replace(" ", "\u0120")
        for end in range(2, len(whole) + 1):
            pair = whole[: end - 1], whole[end - 1]
            if pair not in merges:
                merges.append(pair)
            vocabulary.setdefault(whole[:end], len(vocabulary))
    inner = Tokenizer(models.BPE(vocabulary, merges))
    inner.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    inner.decoder = decoders.ByteLevel()
    return wrapped(inner)


def word_marks(*words: str) -> Any:
    """A tokenizer of SentencePiece's kind: a mark stands for the space, and every text gets one in front."""
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers

    pieces = [
        ("<unk>", 0.0),
        *((word, -1.0) for word in words),
        *((letter, -9.0) for letter in "\u2581abcdefnoysYESNO"),
    ]
    inner = Tokenizer(models.Unigram(pieces, unk_id=0))
    inner.pre_tokenizer = pre_tokenizers.Metaspace()
    inner.decoder = decoders.Metaspace()
    return wrapped(inner, unk_token="<unk>")


def texts(tokenizer: Any, tokens: tuple[int, ...]) -> set[str]:
    return set(tokenizer.convert_ids_to_tokens(list(tokens)))


def test_every_surface_form_that_is_one_token_counts() -> None:
    tokenizer = make_tokenizer()
    tokens = answer_tokens(tokenizer, YES_NO, MANY)
    assert {tokenizer.decode([token]) for token in tokens.affirmative} == set(YES_NO.forms()[0])
    assert {tokenizer.decode([token]) for token in tokens.negative} == set(YES_NO.forms()[1])
    assert answer_tokens(tokenizer, TRUE_FALSE, MANY) != tokens


def test_a_form_of_several_tokens_is_left_out_where_another_is_one() -> None:
    """The "Y" that "YES" begins with here begins "You" just as well."""
    tokenizer = byte_level("yes", "Yes", " no", "NO")
    tokens = answer_tokens(tokenizer, YES_NO, MANY)
    assert texts(tokenizer, tokens.affirmative) == {"yes", "Yes"}
    assert texts(tokenizer, tokens.negative) == {"\u0120no", "NO", "no"} - {"no"}


def test_longer_words_are_other_words() -> None:
    tokenizer = byte_level("yes", "no", "yesterday", "know", "piano", "No", "Yes.")
    tokens = answer_tokens(tokenizer, YES_NO, MANY)
    assert texts(tokenizer, tokens.affirmative) == {"yes", "Yes"}
    assert texts(tokenizer, tokens.negative) == {"no", "No"}


def test_a_word_with_and_without_its_mark_is_the_same_answer() -> None:
    """What decodes to "yes" by itself is "yes", at a word's beginning or not."""
    tokenizer = word_marks("\u2581yes", "yes", "\u2581No", "No", "\u2581now")
    tokens = answer_tokens(tokenizer, YES_NO, MANY)
    assert texts(tokenizer, tokens.affirmative) == {"\u2581yes", "yes"}
    assert texts(tokenizer, tokens.negative) == {"\u2581No", "No"}


def test_where_no_form_is_a_token_first_tokens_tell_the_answers_apart() -> None:
    tokenizer = byte_level("tr", "fa")
    tokens = answer_tokens(tokenizer, TRUE_FALSE, MANY)
    assert texts(tokenizer, tokens.affirmative) == {"tr", "T"}
    assert texts(tokenizer, tokens.negative) == {"fa", "F"}


def test_a_first_token_that_both_share_is_counted_for_neither() -> None:
    tokenizer = byte_level()
    with pytest.raises(InputError, match="no token tells the answer 'open'"):
        answer_tokens(tokenizer, AnswerWords("open", "opened"), MANY)
    mixed = byte_level("no", "the")
    with pytest.raises(InputError, match="no token tells the answer 'nothing'"):
        answer_tokens(mixed, AnswerWords("no", "nothing"), MANY)
    tokens = answer_tokens(mixed, AnswerWords("no", "the-other"), MANY)
    assert texts(mixed, tokens.affirmative) == {"no"}
    assert texts(mixed, tokens.negative) == {"the", "T"}


def test_a_bare_space_is_no_answer() -> None:
    """ " yes" and " no" both begin with the space, and so does everything else."""
    tokenizer = byte_level()
    tokens = answer_tokens(tokenizer, YES_NO, MANY)
    assert texts(tokenizer, tokens.affirmative) == {"y", "Y"}
    assert texts(tokenizer, tokens.negative) == {"n", "N"}


def test_tokens_that_the_model_has_no_probability_for_are_left_out() -> None:
    tokenizer = byte_level("yes", "no", "Yes", "No")
    limit = tokenizer.convert_tokens_to_ids("Yes")
    tokens = answer_tokens(tokenizer, YES_NO, limit)
    assert texts(tokenizer, tokens.affirmative) == {"yes"}
    assert texts(tokenizer, tokens.negative) == {"no"}


def test_unknown_words_are_no_answer() -> None:
    """Every form becomes <unk> in a vocabulary of other words."""
    from tokenizers import Tokenizer, models, pre_tokenizers

    inner = Tokenizer(models.WordLevel({"<unk>": 0, "the": 1, "lemon": 2}, unk_token="<unk>"))
    inner.pre_tokenizer = pre_tokenizers.Whitespace()
    with pytest.raises(InputError, match="'yes'"):
        answer_tokens(wrapped(inner, unk_token="<unk>"), YES_NO, MANY)


WORDS = st.text(st.sampled_from("yesno"), min_size=1, max_size=4)


@settings(max_examples=60, deadline=None)
@given(st.sets(WORDS, max_size=6), WORDS, WORDS)
def test_no_token_is_ever_counted_for_both(merged: set[str], one: str, another: str) -> None:
    with suppress(InputError):  # which is the right answer for a word and itself
        tokens = answer_tokens(byte_level(*sorted(merged)), AnswerWords(one, another), MANY)
        assert one != another
        assert tokens.affirmative
        assert tokens.negative
        assert set(tokens.affirmative).isdisjoint(tokens.negative)
