"""Laws of expectation, progression and regression."""

from __future__ import annotations

from itertools import product

from hypothesis import given
from hypothesis import strategies as st

from executive.core.compare import compare, progress, reaches, remaining, remaining_plan
from executive.types import Atom, Condition, Effect, Facts, Plan, Step
from tests.fakes import FREE, FakePlanner, at, held, pick, put, steps_of, task

UNIVERSE = [Atom("p", (str(name),)) for name in "abcde"]
partial = st.dictionaries(st.sampled_from(UNIVERSE), st.booleans()).map(Facts)
complete = st.tuples(*(st.booleans() for _ in UNIVERSE)).map(lambda values: Facts(zip(UNIVERSE, values, strict=True)))
small = st.dictionaries(st.sampled_from(UNIVERSE), st.booleans(), max_size=2).map(Facts)
steps = st.lists(st.builds(Step.strips, st.just("do"), st.just(()), small, small), max_size=5)

THINGS = task(["a", "b"], ["p", "q", "r"], Facts({at("a", "q"): True, at("b", "r"): True}))
places = st.sampled_from(["p", "q", "r"])


def carried_out(some: list[Step], state: Facts) -> Facts | None:
    """What holds after the steps, or None when one of them could not be done: the plain meaning of a plan."""
    for step in some:
        if not step.precondition.truth(state):
            return None
        state = progress(state, step)
    return state


@given(partial, partial)
def test_a_verdict_shares_out_the_expectation(expected: Facts, seen: Facts) -> None:
    verdict = compare(expected, seen)
    assert verdict.holds | verdict.violated | verdict.unknown == set(expected)
    assert verdict.satisfied == seen.entails(expected)
    assert verdict.unknown == expected.keys() - seen.keys()
    assert compare(expected, expected).holds == set(expected)


@given(partial, partial)
def test_a_sign_that_is_turned_round_turns_the_verdict_round(expected: Facts, seen: Facts) -> None:
    verdict = compare(expected, seen)
    opposite = compare(Facts({atom: not value for atom, value in expected.items()}), seen)
    assert (opposite.holds, opposite.violated, opposite.unknown) == (verdict.violated, verdict.holds, verdict.unknown)


@given(complete, st.builds(Step.strips, st.just("do"), st.just(()), small, small))
def test_progress_changes_the_effects_alone(state: Facts, step: Step) -> None:
    after = progress(state, step)
    assert after.entails(step.unconditional)
    assert after.without(step.unconditional) == state.without(step.unconditional)


@given(steps, complete, partial)
def test_a_plan_reaches_its_goal_exactly_where_all_of_it_can_be_done(
    some: list[Step], state: Facts, goal: Facts
) -> None:
    end = carried_out(some, state)
    assert reaches(some, state, Condition.of(goal)) == (end is not None and end.entails(goal))


@given(steps, complete, partial)
def test_a_plan_hangs_on_the_atoms_without_which_it_is_open_whether_it_goes_through(
    some: list[Step], state: Facts, goal: Facts
) -> None:
    wanted = Condition.of(goal)
    if not reaches(some, state, wanted):
        return
    view = remaining_plan(pick("a", "p"), some, state, wanted, surprised=False)
    assert view.needed == {atom for atom in state if not reaches(some, state.without([atom]), wanted)}
    assert reaches(some, state.only(view.needed), wanted)


@given(steps, complete, partial)
def test_what_remains_of_a_plan_can_be_done_and_reaches_the_goal(some: list[Step], state: Facts, goal: Facts) -> None:
    left = remaining(some, state, Condition.of(goal))
    if left is None:
        whole = carried_out(some, state)
        assert whole is None or not whole.entails(goal), "a plan that still stands is never given up"
        assert not state.entails(goal), "where the goal holds, nothing is left to do"
    else:
        assert list(left) == sorted(set(left))
        end = carried_out([some[position] for position in left], state)
        assert end is not None
        assert end.entails(goal)


general = st.recursive(
    small.map(Condition.of),
    lambda inner: st.lists(inner, min_size=1, max_size=2).flatmap(
        lambda parts: st.sampled_from([Condition.all_of(parts), Condition.any_of(parts)])
    ),
    max_leaves=4,
)
formulas = st.lists(
    st.builds(
        Step, st.just("do"), st.just(()), general, st.lists(st.builds(Effect, general, small), max_size=2).map(tuple)
    ),
    max_size=4,
)


@given(formulas, partial, general)
def test_what_is_told_of_a_plan_in_a_partial_state_holds_of_all_that_it_may_be(
    some: list[Step], state: Facts, goal: Condition
) -> None:
    told = reaches(some, state, goal)
    expected = state
    for step in some:
        expected = progress(expected, step)
    for values in product((False, True), repeat=len(UNIVERSE)):
        whole = Facts(dict(zip(UNIVERSE, values, strict=True))) | state
        end = carried_out(some, whole)
        reached = end is not None and goal.truth(end) is True
        assert reached or not told
        assert reaches(some, whole, goal) == reached
        assert end is None or end.entails(expected), "nothing is expected that may come out otherwise"


@given(formulas, complete, general, partial)
def test_what_a_plan_hangs_on_is_enough_to_know(some: list[Step], state: Facts, goal: Condition, seen: Facts) -> None:
    view = remaining_plan(pick("a", "p"), some, state, goal, surprised=True, seen=state.only(seen))
    if view.rest is not None:
        left = [some[position] for position in view.rest]
        assert reaches(left, state.only({*view.needed, *seen}), goal)


@given(places, places)
def test_a_plan_replayed_through_compare_holds(first: str, second: str) -> None:
    state = Facts.closed({at("a", first), at("b", second), FREE}, THINGS.atoms)
    plan = FakePlanner(steps_of(THINGS)).plan(state, THINGS.goal)
    assert isinstance(plan, Plan)
    for step in plan.steps:
        assert step.precondition.truth(state)
        state = progress(state, step)
    assert THINGS.goal.truth(state)


def test_helpful_changes_leave_out_exactly_what_they_did() -> None:
    plan = [pick("a", "p"), put("a", "q"), pick("b", "p"), put("b", "r")]
    both_moved = Facts.closed({at("a", "q"), at("b", "r"), FREE}, THINGS.atoms)
    assert remaining(plan, both_moved, THINGS.goal) == ()
    one_moved = Facts.closed({at("a", "p"), at("b", "r"), FREE}, THINGS.atoms)
    assert remaining(plan, one_moved, THINGS.goal) == (0, 1)
    handed_over = Facts.closed({held("a"), at("b", "p")}, THINGS.atoms)
    assert remaining(plan, handed_over, THINGS.goal) == (1, 2, 3)
    moved_away = Facts.closed({at("a", "r"), at("b", "p"), FREE}, THINGS.atoms)
    assert remaining(plan, moved_away, THINGS.goal) is None


def test_only_a_surprise_is_an_occasion_to_leave_out_steps() -> None:
    detour = [pick("a", "q"), put("a", "q")]
    there = Facts.closed({at("a", "q"), at("b", "r"), FREE}, THINGS.atoms)
    assert remaining_plan(put("b", "r"), detour, there, THINGS.goal, surprised=False).rest == (0, 1)
    assert remaining_plan(put("b", "r"), detour, there, THINGS.goal, surprised=True).rest == ()


def test_the_outlook_names_what_it_hangs_on_and_whether_to_try_again() -> None:
    start = Facts.closed({at("a", "p"), at("b", "r"), FREE}, THINGS.atoms)
    missed = remaining_plan(pick("a", "p"), [put("a", "q")], start, THINGS.goal, surprised=True)
    assert missed.rest is None
    assert missed.repeatable
    assert missed.needed == {held("a"), at("b", "r")}
    gone = Facts.closed({at("b", "r"), FREE}, THINGS.atoms)
    assert not remaining_plan(pick("a", "p"), [put("a", "q")], gone, THINGS.goal, surprised=True).repeatable
