"""Whatever is wrong, and whoever wrote it: one line that can be printed, of a length that can be read."""

from __future__ import annotations

import pickle

from hypothesis import example, given
from hypothesis import strategies as st

from executive.errors import LONGEST, DomainError, ExecutiveError, InputError, MissingError, nearest, unregistered

texts = st.text(max_size=30)


@given(texts, st.none() | texts, st.none() | texts)
@example("a\x1b[2J\nb\u2028c\ud800", "x\0y", None)
def test_it_is_one_printable_line(message: str, file: str | None, key: str | None) -> None:
    for kind in (InputError, DomainError):
        error = kind(message, file=file, key=key)
        assert str(error).isprintable()
        assert (error.message, error.file, error.key) == (message, file, key)


@given(st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1), st.integers(0, 200_000))
def test_of_a_long_one_the_middle_is_left_out(end: str, length: int) -> None:
    said = str(InputError(f"begins {'x' * length}{end}", file="some.toml"))
    assert len(said) <= LONGEST
    assert said.startswith("some.toml: begins x"[: 17 + min(length, 1)])
    assert said.endswith(end[-400:])
    assert (" [...] " in said) is (17 + length + len(end) > LONGEST)
    assert " [...] " in said or said == f"some.toml: begins {'x' * length}{end}"


@given(texts, texts)
def test_between_processes_they_stay_what_they_are(message: str, more: str) -> None:
    for error in (
        ExecutiveError(message),
        InputError(message, file=more, key="k"),
        DomainError(message, key=more),
        MissingError(message, command=more),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))
        assert again.exit_code == error.exit_code


def test_the_nearest_name_is_proposed_and_all_are_listed() -> None:
    assert nearest("lemmon", ["milk", "lemon"]) == "did you mean 'lemon'? valid: lemon, milk"
    assert nearest("x", []) == "valid: none"


def test_a_word_that_resembles_none_may_be_of_an_entry_point_that_is_not_installed_yet() -> None:
    known = ["on", "gripping"]
    assert "installed again" in unregistered("relation", "upright", known)
    assert "on" in unregistered("relation", "upright", known)
    typo = unregistered("relation", "griping", known)
    assert "'gripping'" in typo
    assert "installed again" not in typo
