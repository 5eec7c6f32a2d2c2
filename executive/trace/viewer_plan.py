"""The plan as a graph: a row a plan, a node a step, the latest plans at the bottom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import rerun as rr

from executive.trace.documents import plain, step_label
from executive.trace.story import Mark, PlanLine, StepLine, Story
from executive.trace.viewer_blueprint import GRAPH_HEIGHT, GRAPH_WIDTH
from executive.trace.viewer_colours import COLOUR_OF, WHITE, Colour

ROWS, COLUMNS = 3, 10
"""How much is shown at once: the last plans, and of a longer plan the steps around the current one."""
MARGIN = 46.0
"""From the edge to the middle of a row's first and last node, in the panel's units."""


@dataclass
class _Graph:
    nodes: list[str] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    colours: list[Colour] = field(default_factory=list)
    positions: list[tuple[float, float]] = field(default_factory=list)
    edges: list[tuple[str, str]] = field(default_factory=list)

    def add(self, node: str, label: str, colour: Colour, x: float, y: float) -> None:
        self.nodes.append(node)
        self.labels.append(label)
        self.colours.append(colour)
        self.positions.append((x, y))


def plan_graph(story: Story) -> tuple[rr.GraphNodes, rr.GraphEdges]:
    """The last plans of the run with how each step stands."""
    graph, plans = _Graph(), story.plans[-ROWS:]
    windows = [_window(plan.lines) for plan in plans]
    longest = max((len(window) for _, window, _ in windows), default=0)
    across = min((GRAPH_WIDTH - 2 * MARGIN) / max(longest, 1), 170.0)
    down = GRAPH_HEIGHT / (len(plans) or 1)
    for row, (plan, (before, lines, after)) in enumerate(zip(plans, windows, strict=True)):
        y = (row + 0.5) * down
        previous = f"plan {plan.number}"
        graph.add(previous, _title(plan, before, after), WHITE, MARGIN, y)
        for column, line in enumerate(lines, start=1):
            node = f"{plan.number}.{before + column}"
            graph.add(node, step_label(line), COLOUR_OF[line.mark], MARGIN + column * across, y)
            graph.edges.append((previous, node))
            previous = node
    return (
        rr.GraphNodes(
            graph.nodes, labels=graph.labels, colors=graph.colours, positions=graph.positions, show_labels=True
        ),
        rr.GraphEdges(graph.edges, graph_type="directed"),
    )


def _window(lines: Sequence[StepLine]) -> tuple[int, Sequence[StepLine], int]:
    """How many steps are left out before, the steps to show, and how many are left out after."""
    if len(lines) <= COLUMNS:
        return 0, lines, 0
    settled = sum(line.mark in (Mark.DONE, Mark.SKIPPED) for line in lines)
    first = min(max(0, settled - COLUMNS // 2), len(lines) - COLUMNS)
    return first, lines[first : first + COLUMNS], len(lines) - COLUMNS - first


def _title(plan: PlanLine, before: int, after: int) -> str:
    lines = [f"plan {plan.number}", f"{len(plan.lines)} steps"]
    if before or after:
        lines.append(f"{before + 1} to {len(plan.lines) - after}")
    return plain("\n".join(lines))
