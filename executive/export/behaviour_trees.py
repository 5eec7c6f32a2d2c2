"""A plan with its monitoring as a behaviour tree: before each step its precondition is looked for, afterwards its
effects, each a few times, and the step is tried again a few times; at the end the goal is looked for.

What counts is what is seen, not what a skill reports. The tree fails where the loop would make a new plan: a tree is
one plan, and whoever ticks it asks for another one then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from executive.types import Atom, Condition, Facts, Step
from executive.util.extras import needed

EXTRA = "py-trees"


class NodeKind(StrEnum):
    SEQUENCE = "sequence"  # its children in order, going on where it was (with memory)
    FALLBACK = "fallback"  # its children in order, until one succeeds
    RETRY = "retry"  # its one child, up to `attempts` times
    SUCCEED = "succeed"  # its one child, and success whatever that says
    LOOK = "look"  # observe, and estimate what `Holds` is asked about
    HOLDS = "holds"  # whether `atom` is known to be true
    HOLDS_NOT = "holds-not"  # whether `atom` is known to be false
    SKILL = "skill"  # carry out `step`


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a behaviour tree, of our own or of anybody's format."""

    kind: NodeKind
    name: str
    children: tuple[Node, ...] = ()
    attempts: int = 1
    step: Step | None = None
    atom: Atom | None = None

    def walk(self) -> Iterator[Node]:
        """Yield the node and all below it."""
        yield self
        for child in self.children:
            yield from child.walk()


def monitored_tree(
    steps: Iterable[Step],
    goal: Condition,
    state: Mapping[Atom, bool] = Facts(),
    retries: int = 2,
    waits: int = 2,
    looks_again: int = 3,
) -> Node:
    """A plan as a behaviour tree.

    Args:
        state: what holds at first, as far as it is known; conditional effects depend on it, and those of which it
            cannot be told whether they come about are not looked for.
        retries: how often a step is tried beyond the first time.
        waits, looks_again: how often a precondition, and effects or the goal, are looked for beyond the first time.
    """
    now, parts = dict(state), []
    for step in steps:
        changes = step.changes(now)
        expected = Facts({atom: value for atom, value in changes.items() if value is not None})
        before = _looked_for("precondition", step.precondition, waits)
        after = _looked_for("effects", Condition.of(expected), looks_again)
        skill = Node(NodeKind.SUCCEED, f"do {step}", (Node(NodeKind.SKILL, str(step), step=step),))
        monitored = Node(NodeKind.SEQUENCE, f"monitored {step}", (*before, skill, *after))
        parts.append(Node(NodeKind.RETRY, f"try {step}", (monitored,), attempts=retries + 1))
        now = {atom: value for atom, value in {**now, **changes}.items() if value is not None}
    return Node(NodeKind.SEQUENCE, "plan", (*parts, *_looked_for("goal", goal, looks_again)))


def _looked_for(what: str, condition: Condition, again: int) -> tuple[Node, ...]:
    if not condition.conjuncts:
        return ()
    seen = Node(NodeKind.SEQUENCE, what, (Node(NodeKind.LOOK, f"look: {what}"), *map(_condition, condition.conjuncts)))
    return (Node(NodeKind.RETRY, f"wait for {what}", (seen,), attempts=again + 1),)


def _condition(condition: Condition) -> Node:
    parts = [
        Node(NodeKind.HOLDS if value else NodeKind.HOLDS_NOT, str(atom), atom=atom)
        for atom, value in condition.facts.items()
    ]
    parts += [Node(NodeKind.FALLBACK, "or", tuple(map(_condition, choice))) for choice in condition.choices]
    return parts[0] if len(parts) == 1 else Node(NodeKind.SEQUENCE, "and", tuple(parts))


Holds = Callable[[Atom], bool | None]
"""Whether an atom is true by the last look; None where that is not known."""

Carry = Callable[[Step], bool | None]
"""Carries out a step, one tick at a time: whether it succeeded, and None as long as it is at it."""


def py_tree(tree: Node, skills: Mapping[str, Carry], holds: Holds, look: Callable[[], object]) -> Any:
    """The tree as a `py_trees` behaviour, to be ticked.

    Args:
        skills: by the name of the action that each carries out.
        look: observes, so that `holds` answers by what is seen now.

    Raises:
        MissingError: the extra `py-trees` is not installed.
    """
    trees = needed("py_trees", EXTRA, "to build a tree of py_trees")
    status = trees.common.Status

    class Leaf(trees.behaviour.Behaviour):  # type: ignore[name-defined,misc]
        def __init__(self, name: str, tick: Callable[[], bool | None]) -> None:
            super().__init__(name)
            self._tick = tick

        def update(self) -> Any:
            told = self._tick()
            return status.RUNNING if told is None else status.SUCCESS if told else status.FAILURE

    def looked() -> bool:
        look()
        return True

    def built(node: Node) -> Any:
        children = [built(child) for child in node.children]
        match node:
            case Node(NodeKind.SEQUENCE):
                return trees.composites.Sequence(node.name, memory=True, children=children)
            case Node(NodeKind.FALLBACK):
                return trees.composites.Selector(node.name, memory=True, children=children)
            case Node(NodeKind.RETRY):
                return trees.decorators.Retry(node.name, children[0], node.attempts)
            case Node(NodeKind.SUCCEED):
                return trees.decorators.FailureIsSuccess(node.name, children[0])
            case Node(NodeKind.HOLDS, atom=Atom() as atom):
                return Leaf(node.name, lambda: holds(atom) is True)
            case Node(NodeKind.HOLDS_NOT, atom=Atom() as atom):
                return Leaf(node.name, lambda: holds(atom) is False)
            case Node(NodeKind.SKILL, step=Step() as step):
                return Leaf(node.name, lambda: skills[step.action](step))
        return Leaf(node.name, looked)

    return built(tree)
