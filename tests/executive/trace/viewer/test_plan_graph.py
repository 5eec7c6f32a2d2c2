"""The plan's panel: every step of a long plan is to be seen, and of former plans what became of them."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from executive.trace.story.story import Mark, PlanLine, StepLine, Story
from executive.trace.viewer.blueprint import GRAPH_HEIGHT, GRAPH_WIDTH
from executive.trace.viewer.plan_graph import COLUMNS, EDGE, FRAME, LETTER, ROWS, plan_graph, plan_rows
from executive.trace.viewer.text_panels import step_label
from executive.types import Plan, Step

STEP = Step.strips("pick", ("lemon",))
DONE, FAILED, DROPPED, PENDING = Mark.DONE, Mark.FAILED, Mark.DROPPED, Mark.PENDING


def graph(*plans: list[Mark]) -> tuple[list[str], list[tuple[float, float]]]:
    """The labels and places of the nodes for plans whose steps stand like this."""
    story = Story()
    for number, marks in enumerate(plans, start=1):
        plan = Plan((STEP,) * len(marks), 1.0, "fake", 0.0)
        story.plans.append(PlanLine(number, [StepLine(STEP, mark) for mark in marks], plan))
    nodes, _ = plan_graph(plan_rows(story))
    assert nodes.labels is not None
    assert nodes.positions is not None
    labels = nodes.labels.as_arrow_array().to_pylist()
    return labels, [tuple(place) for place in nodes.positions.as_arrow_array().to_pylist()]


def test_of_a_plan_of_twelve_steps_all_are_to_be_seen() -> None:
    labels, places = graph([DONE] * 12)
    assert sum("pick" in label for label in labels) == 12
    assert [label for label in labels if "plan" in label] == ["plan 1\n12 steps\n1 to 10", "plan 1\n12 steps\n11 to 12"]
    assert len({y for _, y in places}) == 2


def test_of_a_former_plan_what_was_not_begun_is_counted() -> None:
    labels, _ = graph([DONE, FAILED, *[DROPPED] * 8], [DONE, PENDING])
    assert labels == [
        "plan 1\n10 steps", "✓ pick\nlemon", "✗ pick\nlemon", "8 steps\nnot begun",
        "plan 2\n2 steps", "✓ pick\nlemon", "○ pick\nlemon",
    ]  # fmt: skip


@given(st.lists(st.lists(st.sampled_from(list(Mark)), max_size=70), max_size=6))
def test_whatever_the_plans_are_they_fit(plans: list[list[Mark]]) -> None:
    labels, places = graph(*plans)
    assert all(0 < x < GRAPH_WIDTH and 0 < y < GRAPH_HEIGHT for x, y in places)
    assert len(set(places)) == len(places), "no two are drawn at one place"
    assert len({y for _, y in places}) <= ROWS
    if plans:
        assert f"plan {len(plans)}\n" in "\n".join(labels), "the plan that is carried out is always there"


@given(st.integers(0, 70))
def test_the_step_that_is_next_is_to_be_seen(done: int) -> None:
    labels, _ = graph([*[DONE] * done, Mark.CURRENT, *[PENDING] * (70 - done)])
    assert sum(label.startswith("►") for label in labels) == 1
    assert len(labels) <= ROWS * (COLUMNS + 1)


def test_many_arguments_stand_in_two_lines() -> None:
    def lines(*args: str) -> list[str]:
        return step_label(StepLine(Step.strips("board", args), PENDING)).split("\n")[1:]

    assert lines("milk-carton", "wood-table") == ["milk-carton", "wood-table"]
    assert lines("p2", "slow0-0", "n2", "n0", "n1") == ["p2 slow0-0 n2", "n0 n1"]
    crowded = lines(*(f"block-{number}" for number in range(9)))
    assert len(crowded) == 2
    assert crowded[-1].endswith("...")


def test_long_names_leave_room_for_fewer_steps_in_a_row() -> None:
    step = Step.strips("move-down-slowly", ("elevator-number-one",))
    story = Story()
    story.plans.append(PlanLine(1, [StepLine(step, DONE)] * 9, Plan((step,) * 9, 1.0, "fake", 0.0)))
    nodes, _ = plan_graph(plan_rows(story))
    assert nodes.positions is not None
    places = sorted((y, x) for x, y in nodes.positions.as_arrow_array().to_pylist())
    apart = [right - left for (y, left), (below, right) in pairwise(places) if y == below]
    assert min(apart) > len("elevator-number-one") * LETTER


def test_steps_with_long_names_are_drawn_apart() -> None:
    step = Step.strips("stack", ("large-purple-rubber-cylinder", "large-yellow-metal-cylinder"))
    story = Story()
    plan = Plan((step,) * 10, 1.0, "fake", 0.0)
    story.plans.append(PlanLine(1, [StepLine(step, PENDING) for _ in range(10)], plan))
    nodes, _ = plan_graph(plan_rows(story))
    assert nodes.positions is not None
    across = sorted({round(x, 3) for x, _ in nodes.positions.as_arrow_array().to_pylist()})
    assert min(b - a for a, b in pairwise(across)) >= LETTER * len(step.args[0])


@given(st.integers(1, 40), st.integers(1, 28))
def test_no_box_reaches_the_edge_of_the_panel(steps: int, letters: int) -> None:
    step = Step.strips("a" * letters, ("b",))
    story = Story()
    plan = Plan((step,) * steps, 1.0, "fake", 0.0)
    story.plans.append(PlanLine(1, [StepLine(step, PENDING) for _ in range(steps)], plan))
    nodes, _ = plan_graph(plan_rows(story))
    assert nodes.positions is not None
    assert nodes.labels is not None
    labels = nodes.labels.as_arrow_array().to_pylist()
    for label, (x, y) in zip(labels, nodes.positions.as_arrow_array().to_pylist(), strict=True):
        lines = label.split("\n")
        half = (LETTER * max(map(len, lines)) + FRAME) / 2
        assert EDGE <= x + half <= GRAPH_WIDTH - EDGE
        assert EDGE <= y - 34 < y + 34 <= GRAPH_HEIGHT - EDGE, "four lines are 68 units high"
