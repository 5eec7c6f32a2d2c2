"""The symbolic world: which atoms are true, and a clock.

An action does what the domain says of it, where its precondition holds in truth; elsewhere it fails and changes
nothing. There are no pictures: the world's sensor answers questions about atoms with probabilities, and is wrong as
often as these say.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from executive.errors import InputError, nearest
from executive.protocols import SkillContext
from executive.types import (
    Atom,
    Belief,
    DerivedRules,
    FloatArray,
    Fluent,
    Frame,
    Observation,
    Phase,
    Scenery,
    SkillResult,
    SkillStatus,
    Step,
    Visibility,
)

ACTION_SECONDS = 1.0
"""How long every action takes, in seconds of the world's clock."""

_SENSOR = 2
"""The stream of random numbers that the sensor's errors are drawn from, beside those of the faults and the skills."""

NextAction: TypeAlias = "Callable[[Mapping[Atom, bool], np.random.Generator, Collection[str]], Step | None]"
"""Draws an action that can be carried out in a state and is about all of some objects; None where there is none."""


class SymbolicWorld:
    """A world of atoms (see `executive.protocols.Simulator`).

    Args:
        atoms: the task's fluents.
        true: those that hold at first.
        next_action: draws what another agent does.
        flip: how often the sensor says the opposite of what is so.
        seed: fixes the sensor's errors.
        first_observation: the number of the first observation.
        rules: how derived atoms follow from the others.
        fluents: the numeric fluents, each of which is asked about once a look, as a number.
        visibility: when atoms can be seen; the sensor says nothing of those that cannot be.

    Raises:
        ValueError: the flip rate is not from 0 to less than 0.5.
    """

    items: tuple[str, ...] = ()
    """Objects that can get lost. Here none can."""

    def __init__(
        self,
        atoms: Sequence[Atom],
        true: Iterable[Atom],
        next_action: NextAction,
        flip: float = 0.0,
        seed: int = 0,
        first_observation: int = 0,
        rules: DerivedRules | None = None,
        fluents: Sequence[Fluent] = (),
        visibility: Visibility | None = None,
    ) -> None:
        if not 0.0 <= flip < 0.5:
            raise ValueError(f"flip: a share from 0 to less than 0.5 is expected, got {flip}")
        holding = frozenset(true)
        self._index = {atom: number for number, atom in enumerate(sorted(atoms))}
        self._state = {atom: atom in holding for atom in self._index}
        self._rules = rules or DerivedRules()
        self._fluents = {atom: fluent for fluent in fluents for _, atom in fluent.values}
        self._visibility = visibility or Visibility()
        self._seen: tuple[int, Mapping[Atom, bool]] = (-1, {})
        self._next_action, self._flip, self._seed = next_action, flip, seed
        self._time, self._observations, self._ineffective = 0.0, first_observation, False
        self._scheduled: list[tuple[float, Callable[[], None]]] = []

    @property
    def time(self) -> float:
        return self._time

    @property
    def handle(self) -> Any:
        return self.carry_out

    @property
    def state(self) -> Mapping[Atom, bool]:
        """The truth of every fluent, which is for `executive.symbolic.truth` alone."""
        return self._state

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        number = self._observations
        self._observations += 1
        self._seen = number, dict(self._state)
        return Observation(number, self._time, {}, np.zeros(0), cause)

    def sense(self, observation: Observation, atoms: Iterable[Atom]) -> dict[Atom, float]:
        """The sensor's answers at the moment of the last observation: the probability of each atom that can be seen. An
        atom gets the same answer as often as it is asked about at one moment, whatever else is asked.

        Raises:
            ValueError: it is another observation.
        """
        number, state = self._seen
        if observation.id != number:
            raise ValueError(f"the moment of observation {observation.id} is past")
        chance = np.random.default_rng([self._seed, _SENSOR, number]).random((2, len(self._index)))
        yes, no = 1.0 - self._flip, self._flip
        answers: dict[Atom, float] = {}
        for atom in atoms:
            if not self._visibility.truth(atom, state):
                continue
            if atom in self._fluents:
                said = self._said(self._fluents[atom], state, chance)
                answers[atom] = yes if atom == said else no / max(1, len(self._fluents[atom].values) - 1)
            else:
                answers[atom] = yes if state[atom] == (chance[0, self._index[atom]] >= self._flip) else no
        return answers

    def _said(self, fluent: Fluent, state: Mapping[Atom, bool], chance: FloatArray) -> Atom | None:
        """The atom of the value that the sensor reads: the true one, or as often as it errs any other one."""
        values = [atom for _, atom in fluent.values]
        true = next((atom for atom in values if state[atom]), None)
        draw, which = chance[:, self._index[values[0]]]
        others = [atom for atom in values if atom != true]
        return others[int(which * len(others))] if draw < self._flip and others else true

    def stop(self) -> None:
        """Nothing moves between actions."""

    def close(self) -> None:
        """Nothing is open."""

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        self._scheduled.append((self._time + delay, action))
        self._scheduled.sort(key=lambda entry: entry[0])

    def scenery(self) -> Scenery:
        return Scenery()

    def watch(self, listener: Callable[[Frame], None] | None) -> None:
        """Nothing has a pose."""

    def snapshot(self) -> bytes:
        true = [str(atom) for atom, value in self._state.items() if value]
        return json.dumps({"time": self._time, "ineffective": self._ineffective, "true": true}).encode()

    def restore(self, snapshot: bytes) -> None:
        try:
            said = json.loads(snapshot)
            true = frozenset(map(Atom.parse, said["true"]))
            time, ineffective = float(said["time"]), bool(said["ineffective"])
        except (ValueError, TypeError, KeyError) as error:
            raise InputError("is no snapshot of a symbolic world") from error
        if unknown := true - self._state.keys():
            raise InputError(f"is a snapshot of another task, with {min(unknown)}")
        self._state = {atom: atom in true for atom in self._state}
        self._time, self._ineffective = time, ineffective
        self._scheduled.clear()

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        if kind == "no-effect":
            self._ineffective = True
            return "the next action has no effect"
        if kind == "exogenous":
            step = self._next_action(self._state, rng, tuple(arguments.values()))
            if step is None:
                return "another agent finds nothing to do"
            self._change(step)
            return f"another agent does {step}"
        if kind == "relocate":
            moved = self._relocated(rng, tuple(arguments.values()))
            return "nothing out of view can be moved" if moved is None else f"{moved[0]} becomes {moved[1]} out of view"
        raise InputError(f"the symbolic world has no {kind!r}; {nearest(kind, ('no-effect', 'exogenous', 'relocate'))}")

    def _relocated(self, rng: np.random.Generator, about: Sequence[str]) -> tuple[Atom, Atom] | None:
        """Move something that is out of view: an atom ceases to be true, and one that differs in its last object and
        cannot be seen either becomes so."""
        hidden = sorted(atom for atom in self._index if self._visibility.truth(atom, self._state) is False)
        true = [atom for atom in hidden if self._state[atom] and set(about) <= set(atom.args)]
        pairs = [(atom, other) for atom in true for other in hidden if not self._state[other] and _moved(atom, other)]
        if not pairs:
            return None
        before, after = pairs[int(rng.integers(len(pairs)))]
        self._state.update({before: False, after: True})
        return before, after

    def advance(self, seconds: float) -> None:
        """Let time pass, with all that is scheduled for it."""
        until = self._time + seconds
        while self._scheduled and self._scheduled[0][0] <= until:
            self._time, action = self._scheduled.pop(0)
            action()
        self._time = until

    def carry_out(self, step: Step, context: SkillContext) -> SkillResult:
        """Do a step, which takes `ACTION_SECONDS`. One that has no effect reports that it is done: its skill does not
        notice."""
        context.announce(Phase("act", seconds=ACTION_SECONDS))
        ineffective, self._ineffective = self._ineffective, False
        if context.cancelled():
            return SkillResult(step, SkillStatus.CANCELLED, "cancelled", 0.0, ACTION_SECONDS)
        self.advance(ACTION_SECONDS)
        if not self._possible(step):
            reason = "its precondition does not hold"
            return SkillResult(step, SkillStatus.NOT_APPLICABLE, reason, ACTION_SECONDS, ACTION_SECONDS)
        if not ineffective:
            self._change(step)
        return SkillResult(step, SkillStatus.DONE, "", ACTION_SECONDS, ACTION_SECONDS)

    def _possible(self, step: Step) -> bool:
        return step.precondition.truth(self._rules.complete(self._state, step.precondition.atoms)) is True

    def _change(self, step: Step) -> None:
        changes = step.changes(self._rules.complete(self._state))  # all told, as the state is complete
        self._state.update({atom: bool(value) for atom, value in changes.items()})


def _moved(atom: Atom, other: Atom) -> bool:
    """Whether two atoms differ in their last object alone: where a thing is."""
    return (atom.predicate, atom.args[:-1]) == (other.predicate, other.args[:-1]) and len(atom.args) > 1


class SymbolicSkill:
    """The one skill of the symbolic world: it carries out any action."""

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        result: SkillResult = context.handle(step, context)
        return result


class SymbolicEstimator:
    """The estimator that asks the world's sensor. Of the run it gets observations, and of the truth nothing."""

    def __init__(self, world: SymbolicWorld, flip: float = 0.0) -> None:
        self._world = world
        self.name = f"oracle, {flip:.3g} flipped" if flip else "oracle"

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        answers = self._world.sense(observation, atoms)
        return Belief(observation.id, answers, frozenset(atoms) - answers.keys(), self.name)
