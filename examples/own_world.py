"""A world of one's own: marbles in cups, a hand on a rail above them, one camera, and an estimator that reads pixels.

    python -m examples.own_world

The smallest `Simulator` with its `Skill`s and its `Estimator`; docs/how-to/own-world.md goes through it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from executive import (
    Atom,
    Belief,
    Ended,
    FastDownwardPlanner,
    FaultInjector,
    Frame,
    Image,
    InputError,
    Observation,
    Phase,
    Scenery,
    SkillContext,
    SkillResult,
    SkillStatus,
    Step,
    TerminalSink,
    make_executive,
    parse_fault,
    read_task,
)

FOLDER = Path(__file__).parent / "marbles"
COLOURS = {"red": (200, 40, 40), "blue": (40, 70, 200)}
TICK, PATCH, HAND = 0.1, 16, "hand"


class Board:
    """A row of cups. `where` says for each marble which cup it is in, or that the hand has it."""

    def __init__(self, where: Mapping[str, str], cups: Sequence[str]) -> None:
        self.where, self.cups = dict(where), tuple(cups)
        self.time = 0.0
        self.clumsy = False
        """Whether the next grasp closes beside its marble."""
        self._looks = 0
        self._scheduled: list[tuple[float, Callable[[], None]]] = []
        self._listener: Callable[[Frame], None] | None = None

    @property
    def handle(self) -> Board:
        return self

    @property
    def held(self) -> str | None:
        return next((marble for marble, place in self.where.items() if place == HAND), None)

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        images = {"front": self.picture()} if cameras is None or "front" in cameras else {}
        self._looks += 1
        return Observation(self._looks - 1, self.time, images, np.zeros(1), cause)

    def picture(self) -> Image:
        """A column for each cup, a row for each marble, and above them a row with what the hand holds."""
        image = np.full(((len(self.where) + 1) * PATCH, len(self.cups) * PATCH, 3), 230, np.uint8)
        for row, (marble, place) in enumerate(self.where.items(), start=1):
            if place == HAND:
                image[:PATCH] = COLOURS[marble]
            else:
                column = self.cups.index(place) * PATCH
                image[row * PATCH : (row + 1) * PATCH, column : column + PATCH] = COLOURS[marble]
        return image

    def advance(self, seconds: float) -> None:
        """Let time pass, with all that is scheduled for it."""
        until = self.time + seconds
        while due := [entry for entry in self._scheduled if entry[0] <= until]:
            first = min(due, key=lambda entry: entry[0])
            self._scheduled.remove(first)
            self.time = first[0]
            first[1]()
        self.time = until
        if self._listener is not None:
            self._listener(Frame({}, np.zeros(1), 0.0))

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        self._scheduled.append((self.time + delay, action))

    def stop(self) -> None:
        """The hand moves only while a skill has time pass."""

    def scenery(self) -> Scenery:
        return Scenery()

    def watch(self, listener: Callable[[Frame], None] | None) -> None:
        self._listener = listener

    # Up to here it is a `World`. What follows makes it a `Simulator`.

    def snapshot(self) -> bytes:
        return json.dumps([self.where, self.time, self.clumsy]).encode()

    def restore(self, snapshot: bytes) -> None:
        self.where, self.time, self.clumsy = json.loads(snapshot)
        self._scheduled.clear()

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        if kind == "miss":
            self.clumsy = True
            return "the next grasp goes beside"
        if kind not in ("drop", "shove"):
            raise InputError(f"nothing here does {kind!r}; there are drop, miss and shove")
        marble = self.held if kind == "drop" else arguments.get("item", str(rng.choice(sorted(self.where))))
        if marble is None:
            return "nothing is held"
        if marble not in self.where:
            raise InputError(f"no marble {marble!r}; there are {', '.join(self.where)}")
        self.where[marble] = str(rng.choice(self.cups))
        return f"{marble} ends up in the {self.where[marble]} cup"


def take(step: Step, context: SkillContext) -> SkillResult:
    """take(marble, cup): into the hand."""
    board: Board = context.handle
    start, (marble, cup) = board.time, step.args
    if board.where[marble] != cup:
        return report(step, board, start, SkillStatus.NOT_THERE, f"{marble} is not in the {cup} cup")
    if not (spend(context, "approach", 1.0) and spend(context, "grip", 0.5)):
        return report(step, board, start, SkillStatus.CANCELLED)
    missed, board.clumsy = board.clumsy, False
    if missed:
        return report(step, board, start, SkillStatus.GRASP_MISSED, "the fingers closed on nothing")
    board.where[marble] = HAND
    return carry(step, context, start)


def put(step: Step, context: SkillContext) -> SkillResult:
    """put(marble, cup): out of the hand, into the cup."""
    board: Board = context.handle
    start, (marble, cup) = board.time, step.args
    if board.held != marble:
        return report(step, board, start, SkillStatus.NOT_THERE, f"the hand does not hold {marble}")
    result = carry(step, context, start)
    if result.done:
        board.where[marble] = cup
    return result


def carry(step: Step, context: SkillContext, start: float) -> SkillResult:
    """Move with the marble in the hand, and feel whether it stays there."""
    board: Board = context.handle
    if not spend(context, "transfer", 2.0, until=lambda: board.held != step.args[0]):
        return report(step, board, start, SkillStatus.CANCELLED)
    if board.held != step.args[0]:
        return report(step, board, start, SkillStatus.DROPPED, "the fingers feel nothing any more")
    return report(step, board, start, SkillStatus.DONE)


def spend(context: SkillContext, phase: str, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
    """Announce a phase and let its time pass, or less if `until` comes about; False once the skill is cancelled."""
    context.announce(Phase(phase, seconds=seconds))
    for _ in range(round(seconds / TICK)):
        if context.cancelled():
            return False
        if until():
            break
        context.handle.advance(TICK)
    return not context.cancelled()


def report(step: Step, board: Board, start: float, status: SkillStatus, reason: str = "") -> SkillResult:
    seconds = board.time - start
    return SkillResult(step, status, reason, seconds, seconds)


class ColourEstimator:
    """Judges by the picture alone: how much of the place where a marble would be has the marble's colour."""

    name = "colours"

    def __init__(self, marbles: Sequence[str], cups: Sequence[str]) -> None:
        self.marbles, self.cups = tuple(marbles), tuple(cups)

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        image = observation.images.get("front")
        if image is None:
            return Belief(observation.id, {}, frozenset(atoms), self.name)
        return Belief(observation.id, {atom: self.share(image, atom) for atom in atoms}, source=self.name)

    def share(self, image: Image, atom: Atom) -> float:
        if atom.predicate == "free":
            return 1.0 - max(self.share(image, Atom("held", (marble,))) for marble in self.marbles)
        marble, row, column = atom.args[0], 0, 0
        if atom.predicate == "in":
            row, column = self.marbles.index(marble) + 1, self.cups.index(atom.args[1])
        patch = image[row * PATCH : (row + 1) * PATCH, column * PATCH : (column + 1) * PATCH]
        return float((np.abs(patch.astype(int) - COLOURS[marble]).max(axis=2) < 40).mean())


def main(faults: Sequence[str] = ("drop@2",), seed: int = 1) -> Ended:
    schema = read_task(FOLDER / "domain.pddl", FOLDER / "problem.pddl")
    task = schema.task
    marbles = [name for name, kind in task.objects.items() if kind == "marble"]
    cups = [name for name, kind in task.objects.items() if kind == "cup"]
    board = Board({atom.args[0]: atom.args[1] for atom in sorted(task.declared) if atom.predicate == "in"}, cups)
    executive = make_executive(
        task,
        FastDownwardPlanner(schema),
        board,
        skills={"take": take, "put": put},
        estimator=ColourEstimator(list(board.where), cups),
        sinks=[TerminalSink(sys.stdout)],
        faults=FaultInjector([parse_fault(fault, marbles) for fault in faults], board, seed),
        domain="marbles",
    )
    return executive.run()


if __name__ == "__main__":
    sys.exit(not main().goal_seen)
