"""The story that every view draws from."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from executive.trace.story.story import Mark, Standing, Story
from executive.types import (
    Cause,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    OutcomeKind,
    Payload,
    Plan,
    Reason,
    SkillResult,
    SkillStatus,
    Step,
    Verdict,
)
from tests.executive.trace.strategies import events
from tests.executive.trace.synthetic import pick, place, synthetic_events

FIRST, SECOND, THIRD = pick("lemon", "wood-table"), place("lemon", "white-table"), pick("cereal-box", "wood-table")
CONTINUE = Decision(DecisionKind.CONTINUE, (Cause(Reason.AS_EXPECTED),))


def told(*payloads: Payload) -> Story:
    story = Story()
    for index, payload in enumerate(payloads):
        story.tell(Event(index, float(index), float(index), payload))
    return story


def plan(*steps: Step) -> Plan:
    return Plan(steps, float(len(steps)), "test", 0.0)


def seen(step: Step, wrong: bool = False) -> Compared:
    atoms = frozenset(step.unconditional)
    return Compared("effects", step.unconditional, Verdict(violated=atoms) if wrong else Verdict(holds=atoms), 1)


def marks(story: Story, number: int = -1) -> list[str]:
    return [str(line.mark) for line in story.plans[number].lines]


def test_the_story_of_the_made_up_run() -> None:
    story = told(*(event.payload for event in synthetic_events()))
    assert marks(story, 0) == ["done", "failed", "dropped", "dropped"]
    assert marks(story, 1) == ["done"] * 4
    assert story.plans[0].lines[1].note == "dropped"
    assert story.plans[1].lines[0].attempt == 2
    assert (story.actions, story.looks, story.replans, story.retries, len(story.faults)) == (7, 10, 1, 1, 1)
    assert story.unreached() == ()
    remarks = [str(type(remark).__name__) for remark in story.plans[0].lines[1].remarks]
    assert remarks == ["FaultInjected", "Decision"]


def test_a_step_is_current_until_it_is_seen_or_said_to_be_done() -> None:
    start = (plan(FIRST, SECOND), Dispatched(FIRST, 1, 1, 0))
    done = SkillResult(FIRST, SkillStatus.DONE)
    assert marks(told(*start)) == ["current", "pending"]
    assert marks(told(*start, done)) == ["current", "pending"], "a skill's word alone is not enough"
    assert marks(told(*start, done, seen(FIRST))) == ["done", "pending"]
    assert marks(told(*start, done, seen(FIRST, wrong=True))) == ["failed", "pending"]
    assert marks(told(*start, done, CONTINUE)) == ["done", "pending"], "who does not look goes by what it decides"


def test_a_skill_that_fails_fails_its_step_unless_the_effects_are_seen() -> None:
    start = (plan(FIRST), Dispatched(FIRST, 1, 1, 0), SkillResult(FIRST, SkillStatus.DROPPED, "it fell"))
    assert marks(told(*start)) == ["failed"]
    assert told(*start).plans[0].lines[0].note == "dropped"
    assert marks(told(*start, CONTINUE)) == ["failed"], "going on blindly does not mend it"
    assert marks(told(*start, seen(FIRST))) == ["done"]


def test_a_surprise_elsewhere_does_not_fail_the_step() -> None:
    elsewhere = Facts.parse("on-table(milk-carton,wood-table)")
    verdict = Verdict(holds=frozenset(FIRST.unconditional), violated=frozenset(elsewhere))
    story = told(
        plan(FIRST), Dispatched(FIRST, 1, 1, 0), SkillResult(FIRST, SkillStatus.DONE),
        Compared("effects", FIRST.unconditional | elsewhere, verdict, 1),
    )  # fmt: skip
    assert marks(story) == ["done"]
    assert [line.standing for line in story.atoms()][:2] == [Standing.SURPRISE, Standing.EXPECTED]


def test_steps_that_are_passed_over_are_skipped() -> None:
    story = told(plan(FIRST, SECOND, THIRD), Dispatched(THIRD, 1, 1, 2))
    assert marks(story) == ["skipped", "skipped", "current"]


def test_a_new_plan_drops_what_the_old_one_left() -> None:
    story = told(plan(FIRST, SECOND, THIRD), Dispatched(FIRST, 1, 1, 0), plan(SECOND))
    assert marks(story, 0) == ["failed", "dropped", "dropped"]
    assert marks(story) == ["pending"]


def test_the_end_leaves_nothing_pending() -> None:
    def end(outcome: OutcomeKind) -> list[str]:
        ended = Ended(outcome, (Cause(Reason.GOAL_SEEN),), False, (), 1, 1, 0, 1)
        return marks(told(plan(FIRST, SECOND), Dispatched(FIRST, 1, 1, 0), ended))

    assert end(OutcomeKind.GOAL_REACHED) == ["done", "dropped"]
    assert end(OutcomeKind.INTERRUPTED) == ["failed", "dropped"]


def test_preconditions_are_told_of_the_step_that_they_belong_to() -> None:
    compared = Compared(
        "preconditions", SECOND.precondition.facts, Verdict(holds=frozenset(SECOND.precondition.facts)), 0
    )
    assert told(plan(FIRST, SECOND), compared).compared_step == SECOND


def test_what_comes_between_two_plans_is_told_under_the_second() -> None:
    wait = Decision(DecisionKind.LOOK_AGAIN, (Cause(Reason.WAITING, count=1),))
    story = told(plan(FIRST), Dispatched(FIRST, 1, 1, 0), plan(SECOND), wait)
    assert story.plans[1].remarks == [wait]
    assert told(wait).opening == [wait]


@given(st.lists(events, max_size=30))
def test_any_order_of_events_makes_a_story(some: list[Event]) -> None:
    """Nothing raises, at most one step is current, and after the end none is pending."""
    story = Story()
    for event in some:
        story.tell(event)
        lines = [line for each in story.plans for line in each.lines]
        assert sum(line.mark is Mark.CURRENT for line in lines) <= 1
        if story.ended is event.payload:
            assert all(line.mark not in (Mark.PENDING, Mark.CURRENT) for line in lines)
        story.atoms()
        story.unreached()
