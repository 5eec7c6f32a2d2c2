"""Goals and preconditions that are more than literals, effects that depend on conditions, and derived atoms, in whole
runs: what is asked about, what is expected, what is given up and what is said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from executive.core.run_state import RunState
from executive.trace.phrases import why
from executive.types import (
    Atom,
    Compared,
    Condition,
    Decision,
    DecisionKind,
    DerivedRules,
    Effect,
    Facts,
    OutcomeKind,
    Plan,
    Step,
)
from tests.fakes import FLOOR, FREE, FakePlanner, Stage, at, held, pick, put, steps_of, task

NOWHERE = Facts()


def home(thing: str) -> Atom:
    return Atom("home", (thing,))


def stage(
    *conjuncts: str,
    where: dict[str, str],
    derived: bool = False,
    **changes: object,
) -> Stage:
    """A stage whose goal are these conditions. `derived`: a thing is home in q and in r."""
    made = Stage(NOWHERE, where, **changes)  # type: ignore[arg-type]
    rules = {home(thing): Condition.parse(f"at({thing},q) or at({thing},r)") for thing in where} if derived else {}
    made.task = replace(made.task, goal=Condition.parse(*conjuncts), derived=DerivedRules(rules))
    made.planner = FakePlanner(steps_of(made.task), rules=made.task.derived)
    return made


def asked(made: Stage) -> list[Atom]:
    """Every atom that the estimator was asked about."""
    wanted: list[Atom] = []
    estimate = made.estimator.estimate

    def spied(observation, atoms):  # type: ignore[no-untyped-def]
        wanted.extend(atoms)
        return estimate(observation, atoms)

    made.estimator.estimate = spied  # type: ignore[method-assign]
    return wanted


def test_a_goal_with_a_choice_is_reached_either_way() -> None:
    made = stage("at(a,q) or at(a,r)", where={"a": "p"}, script={2: "land r"})
    ended = made.play()
    assert (ended.outcome, ended.unreached, ended.actions) == (OutcomeKind.GOAL_REACHED, (), 2)
    assert ended.replans == 0, "where it landed serves as well"
    compared = [each for each in made.recorder.of(Compared) if each.what == "goal"][-1]
    assert compared.expected == Facts({at("a", "r"): True}), "what made it true is what is told"


def test_what_a_choice_does_not_hang_on_is_no_doubt() -> None:
    unseen = {at("a", place): None for place in "pqr"} | {held("a"): None}
    made = stage("at(a,q) or at(b,r)", where={"a": "p", "b": "r"}, always=unseen)
    ended = made.play()
    assert ended.outcome is OutcomeKind.GOAL_REACHED
    assert ended.goal_seen
    doubtful = stage("at(a,q) or at(a,r)", where={"a": "q", "b": "r"}, always=unseen)
    assert doubtful.play().outcome is not OutcomeKind.GOAL_REACHED, "what was never seen is not claimed"


def test_derived_atoms_are_judged_and_never_asked_about_nor_expected() -> None:
    made = stage("home(a)", "home(b)", where={"a": "p", "b": "r"}, derived=True, script={2: "land r"})
    wanted = asked(made)
    ended = made.play()
    assert (ended.outcome, ended.replans) == (OutcomeKind.GOAL_REACHED, 0)
    assert wanted
    assert {atom.predicate for atom in wanted} <= {"at", "held", "free"}
    effects = [each for each in made.recorder.of(Compared) if each.what == "effects"]
    assert effects
    assert all(atom.predicate != "home" for each in effects for atom in each.expected)


def test_each_conjunct_is_given_up_by_itself_and_named_as_it_is_written() -> None:
    made = stage("home(a)", "at(b,p) or at(b,q)", where={"a": "p", "b": FLOOR}, derived=True)
    ended = made.play()
    assert ended.outcome is OutcomeKind.PARTIAL
    assert ended.unreached == ("at(b,p) or at(b,q)",)
    (given_up,) = (each for each in made.recorder.of(Decision) if each.kind is DecisionKind.GIVE_UP_GOAL)
    assert "giving up at(b,p) or at(b,q), going for home(a)" in why(given_up)


def test_a_derived_goal_that_cannot_be_told_is_looked_at_through_what_it_hangs_on() -> None:
    unseen: Mapping[Atom, None] = {at("a", place): None for place in "qr"}
    made = stage("home(a)", where={"a": "q"}, derived=True, always=unseen)
    wanted = asked(made)
    ended = made.play()
    assert ended.outcome is not OutcomeKind.GOAL_REACHED
    assert home("a") not in wanted
    assert wanted.count(at("a", "q")) > 1


def test_a_step_waits_for_a_precondition_with_a_choice() -> None:
    waiting = replace(pick("a", "p"), precondition=Condition.parse("at(a,p)", "at(b,r) or at(b,p)"))
    made = stage("at(a,q)", where={"a": "p", "b": "q"})
    made.planner = FakePlanner([], [Plan((waiting, put("a", "q")), 2.0, "", 0.0)])
    ended = made.play()
    assert ended.outcome is not OutcomeKind.GOAL_REACHED
    said = [why(each) for each in made.recorder.of(Decision)]
    assert any("pick(a,p) cannot begin: at(b,p) does not hold, at(b,r) does not hold" in text for text in said), said


def test_an_effect_that_depends_on_what_is_unknown_is_not_expected() -> None:
    some = task(["a", "b"], ["p", "q"], Facts({at("a", "q"): True}))
    sweep = Step(
        "sweep", (), Condition.literal(FREE), (Effect(Condition.literal(at("a", "p")), Facts({at("b", "q"): False})),)
    )
    for known, expected in (
        ({FREE: True, at("a", "p"): True, at("b", "q"): True}, False),
        ({FREE: True, at("a", "p"): False, at("b", "q"): True}, True),
        ({FREE: True, at("b", "q"): True}, None),
        ({FREE: True, at("b", "q"): False}, False),
    ):
        run_state = RunState(some, some.goal, Facts(known)).planned(Plan((sweep,), 1.0, "", 0.0), some.goal)
        assert run_state.dispatched().moment.expected.get(at("b", "q")) is expected
