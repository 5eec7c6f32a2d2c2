"""Where a prompt is cut: prefix and suffix together are exactly the prompt's tokens, whatever the tokenizer did."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.s3e.backends.prefix_cache import Beginning, Suffix, UnsupportedError, groups

PICTURE = 0
TOKENS = st.lists(st.integers(1, 4), max_size=8)


def taken(prompt: list[int], each: int) -> list[int]:
    """What a model takes where a picture is so many tokens."""
    return [token for mark in prompt for token in [mark] * (each if mark == PICTURE else 1)]


@given(TOKENS, st.integers(1, 3), TOKENS, TOKENS, TOKENS, TOKENS, st.integers(1, 5))
def test_prefix_and_suffix_are_the_whole_prompt(
    before: list[int], count: int, between: list[int], one: list[int], another: list[int], asked: list[int], each: int
) -> None:
    head = [*before, *[PICTURE] * count, *between]
    prompts = [[*head, *question, 5] for question in (one, another)]
    prompt = [*head, *asked, 5]
    beginning = Beginning.between(prompts[0], prompts[1], taken(prompts[0], each))
    suffix = beginning.suffix(prompt, "")
    assert suffix is not None
    whole = taken(prompt, each)
    assert [*taken(prompts[0], each)[: suffix.shared], *suffix.tokens] == whole
    assert suffix.shared <= beginning.length
    assert suffix.tokens


@given(TOKENS, TOKENS, TOKENS, st.integers(2, 5))
def test_a_prompt_with_another_beginning_has_no_suffix(
    before: list[int], question: list[int], asked: list[int], each: int
) -> None:
    one, another = [7, *before, PICTURE, 8, *question, 5], [7, *before, PICTURE, 8, 9, *question, 5]
    beginning = Beginning.between(one, another, taken(one, each))
    assert beginning.suffix([8, *before, PICTURE, 8, *asked, 5], "Is it?") is None
    assert beginning.suffix([7, *before, 8, *asked, 5], "Is it?") is None


def test_a_question_that_changes_the_end_of_the_beginning_shares_less() -> None:
    """A newline (6) before the question, joined with the one that the question starts with (66)."""
    beginning = Beginning.between([1, PICTURE, 2, 6, 3, 5], [1, PICTURE, 2, 6, 4, 5], [1, *[PICTURE] * 9, 2, 6, 3, 5])
    assert beginning == Beginning((1, PICTURE, 2, 6), 12, 2, True)
    assert beginning.suffix([1, PICTURE, 2, 6, 4, 5], "Is it?") == Suffix(12, (4, 5))
    assert beginning.suffix([1, PICTURE, 2, 66, 4, 5], "Is it?") == Suffix(11, (66, 4, 5))
    assert beginning.suffix([1, PICTURE, 22, 4, 5], "Is it?") == Suffix(10, (22, 4, 5))


def test_what_the_processor_put_before_a_question_may_join_with_it() -> None:
    """Newlines (6) after a picture that are not in the text, as Gemma's processor writes them."""
    beginning = Beginning.between([1, PICTURE, 3, 5], [1, PICTURE, 4, 5], [1, *[PICTURE] * 9, 2, 6, 3, 5])
    assert beginning == Beginning((1, PICTURE), 12, 2, False)
    assert beginning.suffix([1, PICTURE, 4, 5], "Is it?") == Suffix(12, (4, 5))
    assert beginning.suffix([1, PICTURE, 6, 4, 5], "\nIs it?") is None
    assert beginning.suffix([1, PICTURE, 5], "") is None


def test_prompts_that_part_before_the_last_picture_share_nothing() -> None:
    with pytest.raises(UnsupportedError, match="before the last picture"):
        Beginning.between([1, 3, PICTURE, 5], [1, 4, PICTURE, 5], [1, 3, PICTURE, PICTURE, 5])


@given(st.lists(st.integers(1, 9), max_size=20), st.integers(1, 12))
def test_groups_keep_order_and_size(lengths: list[int], most: int) -> None:
    suffixes = [Suffix(index, (0,) * length) for index, length in enumerate(lengths)]
    made = list(groups(suffixes, most))
    assert [suffix for group in made for suffix in group] == suffixes
    for group in made:
        assert len(group) == 1 or sum(len(suffix.tokens) for suffix in group) <= most
    for group, following in itertools.pairwise(made):
        assert sum(len(suffix.tokens) for suffix in group) + len(following[0].tokens) > most
