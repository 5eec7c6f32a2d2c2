"""Relaxed plans: what they need, what they bring about, and what they cost."""

from __future__ import annotations

from executive.planning.relaxed import RelaxedTask
from executive.types import ALWAYS, Atom, Condition, DerivedRules, Effect, Facts, Step

A, B, C, D = (Atom(name) for name in "abcd")


def step(name: str, needs: dict[Atom, bool], gives: dict[Atom, bool], cost: float = 1.0) -> Step:
    return Step.strips(name, (), needs, gives, cost)


def closed(*true: Atom) -> Facts:
    return Facts.closed(true, (A, B, C, D))


def test_a_relaxed_plan_has_the_steps_of_a_real_one_and_says_what_it_starts_from() -> None:
    task = RelaxedTask(
        [step("ab", {A: True}, {B: True, A: False}), step("bc", {B: True, D: False}, {C: True})], DerivedRules()
    )
    plan = task.plan(closed(A), Condition.literal(C))
    assert plan is not None
    assert [each.action for each in plan.steps] == ["ab", "bc"]
    assert (plan.cost, sorted(plan.starts_from)) == (2.0, [(A, True), (D, False)])
    assert plan.reaches(Condition.of({A: True, B: True, C: True})), "nothing ceases to be"
    assert plan.reaches(Condition.literal(A, False)), "and it has not been so for a while"
    assert not plan.reaches(Condition.literal(D))
    assert task.plan(closed(), Condition.literal(C)) is None


def test_the_cheaper_way_is_taken_and_a_step_counts_once() -> None:
    ways = [
        step("dear", {}, {B: True}, 5.0),
        step("cheap", {A: True}, {B: True}),
        step("both", {B: True}, {C: True, D: True}),
    ]
    task = RelaxedTask(ways, DerivedRules())
    plan = task.plan(closed(A), Condition.of({C: True, D: True}))
    assert plan is not None
    assert ([each.action for each in plan.steps], plan.cost) == (["cheap", "both"], 2.0)
    other = task.plan(closed(), Condition.literal(C))
    assert other is not None
    assert other.cost == 6.0


def test_alternatives_conditions_of_effects_and_axioms_are_followed() -> None:
    either = Condition.any_of([Condition.literal(A), Condition.literal(B)])
    when = Step("act", (), either, (Effect(ALWAYS, Facts({C: True})), Effect(Condition.literal(A), Facts({D: True}))))
    task = RelaxedTask([when], DerivedRules({Atom("e"): Condition.of({C: True, D: True})}))
    plan = task.plan(closed(A), Condition.literal(Atom("e")))
    assert plan is not None
    assert (len(plan.steps), plan.cost) == (1, 1.0)
    assert task.plan(closed(B), Condition.literal(C)) is not None
    assert task.plan(closed(B), Condition.literal(Atom("e"))) is None, "only one of the effects comes about"


def test_what_holds_already_costs_nothing() -> None:
    plan = RelaxedTask([], DerivedRules()).plan(closed(A), Condition.of({A: True, B: False}))
    assert plan is not None
    assert (plan.steps, plan.cost, sorted(plan.starts_from)) == ((), 0.0, [(A, True), (B, False)])
