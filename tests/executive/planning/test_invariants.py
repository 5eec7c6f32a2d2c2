"""What a domain states that every state keeps is held against what its actions do."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.app.check import check
from executive.domain import load_domain
from executive.errors import DomainError
from executive.planning.invariants import after, broken, contradicted, model
from executive.planning.mutex_groups import find_mutexes
from executive.types import Atom, Condition, Effect, Facts, Step

DRAWERS = Path(__file__).parents[2] / "domains" / "drawers"
ATOMS = tuple(Atom("p", (name,)) for name in "abcde")

literals = st.builds(Condition.literal, st.sampled_from(ATOMS), st.booleans())
conditions = st.lists(st.lists(literals, min_size=1, max_size=3).map(Condition.any_of), max_size=5).map(
    Condition.all_of
)
facts = st.dictionaries(st.sampled_from(ATOMS), st.booleans(), min_size=1, max_size=3).map(Facts)
steps = st.lists(st.builds(Effect, conditions, facts), max_size=3).map(
    lambda effects: Step("act", (), Condition(), tuple(effects))
)


def every_state() -> list[Facts]:
    return [Facts(zip(ATOMS, values, strict=True)) for values in itertools.product([False, True], repeat=len(ATOMS))]


@given(conditions)
def test_a_condition_has_a_model_exactly_where_a_state_makes_it_true(condition: Condition) -> None:
    found = model(condition)
    assert (found is not None) is any(condition.truth(state) for state in every_state())
    if found is not None:
        assert condition.truth(Facts.closed((), ATOMS) | found)


@given(conditions, steps)
def test_what_has_to_hold_before_is_what_holds_after(condition: Condition, step: Step) -> None:
    before = after(condition, step)
    for state in every_state():
        changed = state | {atom: value for atom, value in step.changes(state).items() if value is not None}
        assert before.truth(state) is condition.truth(changed)


def drawers(folder: Path, name: str, formula: str) -> Path:
    shutil.copytree(DRAWERS, folder / "drawers")
    file = folder / "drawers" / "domain.toml"
    file.write_text(file.read_text() + f'{name} = "{formula}"\n')
    return folder / "drawers"


def test_what_actions_keep_is_proved(tmp_path: Path) -> None:
    folder = drawers(tmp_path, "one-hand", "(forall (?i - item) (imply (holding ?i) (not (hand-empty))))")
    domain = load_domain(folder)
    assert broken(domain.parsed, find_mutexes(domain.parsed).groups) is None
    assert check(str(folder)).groups > 0


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("(forall (?d - drawer) (not (open ?d)))", r"pull\(.*breaks it where"),
        ("(not (hand-empty))", "is contradicted by the :init"),
        ("(and (holding can) (not (holding can)))", "no state at all"),
    ],
)
def test_what_an_action_breaks_is_refused_with_the_action(tmp_path: Path, formula: str, message: str) -> None:
    folder = drawers(tmp_path, "wrong", formula)
    with pytest.raises(DomainError, match=message) as caught:
        check(str(folder))
    assert "invariants.wrong" in (caught.value.key or "")
    assert contradicted(load_domain(DRAWERS).parsed) is None
