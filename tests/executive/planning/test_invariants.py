"""What a domain states that every state keeps is held against what its actions do."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.app.check import check
from executive.app.config import MonitorConfig
from executive.app.monitors import open_monitor
from executive.belief import BayesMonitor
from executive.domain import load_domain
from executive.errors import DomainError
from executive.planning.invariants import after, broken, contradicted, model, survives_accidents
from executive.planning.mutex_groups import find_mutexes
from executive.planning.state_listing import steps as steps_of
from executive.types import Atom, Belief, Condition, Effect, Facts, Step

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


def test_what_an_accident_breaks_is_told_from_what_it_does_not() -> None:
    """What falls is in no place; the hand that held it is empty, as after putting it down."""
    domain = load_domain(DRAWERS)
    moves = tuple(steps_of(domain.parsed))
    (somewhere,) = domain.parsed.invariants.values()
    assert somewhere.conjuncts
    assert not any(survives_accidents(part, moves) for part in somewhere.conjuncts)
    items = sorted({atom.args[0] for atom in domain.task.atoms if atom.predicate == "holding"})
    holding = [Condition.parse(f"holding({item})") for item in items]
    hand = Condition.any_of((Condition.parse("hand-empty"), *holding))
    assert survives_accidents(hand, moves)
    assert not survives_accidents(hand, ()), "no action shows that a hand is empty without what it held"
    assert survives_accidents(Condition.parse("(not on(a,b) or not in(b,c) or in(a,c))"), ())
    assert not survives_accidents(Condition.parse("(in(a,c) or in(a,d))"), ())
    assert not survives_accidents(Condition.parse("(not full(c) or in(a,c))"), ())


def test_what_has_fallen_is_believed_to_be_nowhere_whatever_is_stated() -> None:
    domain = load_domain(DRAWERS)
    monitor = open_monitor(MonitorConfig(), domain, None)
    assert isinstance(monitor, BayesMonitor)
    told = {atom: float(atom.predicate in ("hand-empty", "open")) for atom in domain.task.atoms}
    _, judgement = monitor.looked(monitor.begin(), Belief(0, told), 0)
    about = {atom for atom in domain.task.atoms if "lemon" in atom.args}
    assert judgement.seen.false >= about
    assert not judgement.contradictions
