"""The plan as a graph: a node a step, the latest plans at the bottom, a long plan in several rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import rerun as rr

from executive.trace import phrases
from executive.trace.story.story import Mark, PlanLine, Story
from executive.trace.viewer.blueprint import GRAPH_HEIGHT, GRAPH_WIDTH
from executive.trace.viewer.colours import COLOUR_OF, DIM, SILVER, Colour
from executive.trace.viewer.text_panels import plain, step_label

ROWS, COLUMNS = 3, 10
"""How much is shown at once: rows, and steps in each; fewer where their names are long."""
LETTER, FRAME = 7.0, 10.0
"""How wide a letter and a node's frame are, in the panel's units."""
APART = 170.0
"""How far the nodes of a short row are apart, unless their names are longer, in the panel's units."""
MARGIN, EDGE = 46.0, 6.0
"""From the edge to the middle of a row's first node, and the least from the edge to any node, in the panel's units."""


@dataclass
class Row:
    """Nodes from left to right, each with an arrow to the next: its name, its text, its colour."""

    nodes: list[tuple[str, str, Colour]] = field(default_factory=list)

    def add(self, node: str, label: str, colour: Colour) -> None:
        self.nodes.append((node, plain(label), colour))


def plan_rows(story: Story) -> list[Row]:
    """The last plans of the run with how each step stands: the one that is carried out and, as far as there is room,
    those before it."""
    rows: list[Row] = []
    for plan in reversed(story.plans):
        if len(rows) < ROWS:
            rows = [*_rows(plan, plan is story.plan, ROWS - len(rows)), *rows]
    return rows


def plan_graph(rows: Sequence[Row]) -> tuple[rr.GraphNodes, rr.GraphEdges]:
    """The same as the viewer has it."""
    longest = max((len(line) for row in rows for _, label, _ in row.nodes for line in label.split("\n")), default=1)
    width = LETTER * longest + FRAME
    across = min(_across(width) / max([1, *(len(row.nodes) - 1 for row in rows)]), max(APART, width))
    down = (GRAPH_HEIGHT - 2 * EDGE) / (len(rows) or 1)
    nodes = [node for row in rows for node in row.nodes]
    return (
        rr.GraphNodes(
            [name for name, _, _ in nodes],
            labels=[label for _, label, _ in nodes],
            colors=[colour for _, _, colour in nodes],
            positions=[
                (MARGIN + column * across, EDGE + (number + 0.5) * down)
                for number, row in enumerate(rows)
                for column in range(len(row.nodes))
            ],
            show_labels=True,
        ),
        rr.GraphEdges(
            [(one, other) for row in rows for (one, _, _), (other, _, _) in pairwise(row.nodes)],
            graph_type="directed",
        ),
    )


def _across(width: float) -> float:
    """Return how far the middle of the last node may be from that of the first, where nodes are as wide as that."""
    return GRAPH_WIDTH - MARGIN - max(MARGIN, width / 2 + EDGE)


def _rows(plan: PlanLine, is_current: bool, room: int) -> Sequence[Row]:
    """Return a plan in at most `room` rows. Of one that another took the place of, what was never begun is counted
    alone."""
    lines = plan.lines
    if not is_current:
        lines = lines[: 1 + max((at for at, line in enumerate(lines) if line.mark is not Mark.DROPPED), default=-1)]
    labels = [step_label(line) for line in lines]
    longest = max((len(text) for label in labels for text in label.split("\n")[:3]), default=1)
    width = LETTER * longest + FRAME
    columns = max(1, min(COLUMNS, int(_across(width) / width)))
    rows = []
    for first in range(0, max(1, len(lines)), columns):
        row, last = Row(), min(first + columns, len(lines))
        some = f"\n{first + 1} to {last}" if len(lines) > columns else ""
        row.add(
            f"plan {plan.number}.{first}",
            f"plan {plan.number}\n{phrases.plural(len(plan.lines), 'step')}{some}",
            SILVER,
        )
        for at, line in enumerate(lines[first:last], start=first):
            row.add(f"{plan.number}.{at}", labels[at], COLOUR_OF[line.mark])
        rows.append(row)
    left = len(plan.lines) - len(lines)
    if left:
        rows[-1].add(f"plan {plan.number}.left", f"{phrases.plural(left, 'step')}\nnot begun", DIM)
    if not is_current:
        return rows[-room:]
    settled = sum(line.mark in (Mark.DONE, Mark.SKIPPED) for line in lines)
    first = max(0, min(settled // columns - 1, len(rows) - room))
    return rows[first : first + room]
