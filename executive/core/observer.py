"""Observers: what is asked about which pictures, again and more closely, and while something is carried.

Nothing here decides anything: the loop says what to look at, and its monitor weighs the answers.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

from executive.core.attention import Attention, same_view, uninformative
from executive.core.hold_guard import HoldGuard
from executive.core.run_state import RunState
from executive.core.session import Session
from executive.core.settings import Settings
from executive.protocols import Asking, Estimator, Skill, Witness, World
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Image,
    LookCause,
    Looked,
    LookKind,
    Observation,
    PictureFault,
    Questions,
    Step,
    Timing,
)


class Look(NamedTuple):
    """The estimator's answers, and which look they are from."""

    answers: Belief
    looked: Looked


class Observer(Protocol):
    """Takes one run's looks. `cause` says in the trace what a look is for."""

    @property
    def name(self) -> str:
        """The estimator's."""
        ...

    @property
    def questions(self) -> Questions | None:
        """What a model is asked in words, where one is."""
        ...

    def look(self, run_state: RunState, cause: str) -> Look:
        """Look at what matters now: everything, where that is no more than a look may ask about."""
        ...

    def look_at_all(self, run_state: RunState, cause: str) -> Look:
        """Look at everything."""
        ...

    def look_again(self, run_state: RunState, cause: str, atoms: Sequence[Atom], surprised: bool = False) -> Look:
        """Look once more at the same moment, at the atoms in doubt.

        Args:
            surprised: they were not as expected. That may have any cause, so that everything has to be asked about
                first.
        """
        ...

    def begin_moment(self) -> None:
        """The world may have changed: looks from here on are independent of those before."""
        ...

    def guard(self, step: Step) -> HoldGuard | None:
        """Who watches what the step's skill carries; None where that is not known."""
        ...


class CameraObserver:
    """Looks through the world's cameras, and emits what each look showed and what it cost.

    A picture that shows nothing (its camera is black, or frozen) is left out and reported; where none is left, every
    atom is unanswered. A model that was asked about a picture is not asked the same again: its second answer would be
    the first one and no independent evidence.

    Args:
        attention: which cameras show what best.
        moves: skills that bring the arm out of the way, by name, the mildest first.
        witness: what tells of atoms at a look beside the estimator.
    """

    def __init__(
        self,
        estimator: Estimator,
        world: World,
        session: Session,
        settings: Settings,
        attention: Attention | None = None,
        moves: Mapping[str, Skill] | None = None,
        witness: Witness | None = None,
    ) -> None:
        self._witness = witness
        self.estimator, self._world, self._session, self._settings = estimator, world, session, settings
        self._attention, self._moves = attention or Attention(), dict(moves or {})
        self._latest: dict[str, Image] = {}
        self._uninformative: dict[str, PictureFault] = {}
        self._answered: list[tuple[Mapping[str, Image], frozenset[Atom]]] = []

    @property
    def name(self) -> str:
        return self.estimator.name

    @property
    def questions(self) -> Questions | None:
        estimator: object = self.estimator  # whether it asks in words is for the running program to find out
        return estimator.questions if isinstance(estimator, Asking) else None

    def look(self, run_state: RunState, cause: str) -> Look:
        return self._look(run_state, cause, {(): run_state.questions(self._settings.max_questions)}, LookKind.FOCUSED)

    def look_at_all(self, run_state: RunState, cause: str) -> Look:
        return self._look(run_state, cause, {(): run_state.askable}, LookKind.FULL)

    def look_again(self, run_state: RunState, cause: str, atoms: Sequence[Atom], surprised: bool = False) -> Look:
        """Look through the cameras that show the atoms best, then each time with the arm further out of the way, as far
        as it gets. Where no camera shows them better than the others, the arm moves at once."""
        if surprised and not run_state.asked_all:
            return self.look_at_all(run_state, cause)
        askable = run_state.askable
        if atoms := run_state.task.derived.support(atoms):
            atoms = tuple(atom for atom in atoms if atom in askable) if run_state.task.visible else atoms
        atoms = atoms or askable
        groups = self._attention.groups(atoms)
        moved = run_state.moment.looks - any(groups)
        if moved > 0 and self._clear(atoms, moved - 1):
            return self._look(run_state, cause, {(): atoms}, LookKind.MOVED)
        return self._look(run_state, cause, groups, LookKind.CLOSER if any(groups) else LookKind.FOCUSED)

    def begin_moment(self) -> None:
        self._answered = []

    def guard(self, step: Step) -> HoldGuard | None:
        atom = self._attention.held(step)
        if atom is None:
            return None
        return HoldGuard(atom, self._settings.guard_looks, self._world, self.glance, self._session.emit)

    def glance(self, atom: Atom) -> Belief:
        """Ask about one atom in the middle of a skill."""
        began = time.monotonic()
        observation = self._world.observe(
            LookCause.GLANCE.about(atom), self._attention.guard or self._attention.shown or None
        )
        self._session.emit(observation)
        images = self._usable(observation)
        belief = self._ask(observation, images, [atom])
        self._report(observation, belief, LookKind.GUARD, images, 1)
        self._session.emit(Timing("guard", time.monotonic() - began))
        return belief

    def _clear(self, atoms: Sequence[Atom], first: int) -> bool:
        """Bring the arm out of the way by the first move, from the `first` on, that gets it anywhere."""
        objects = tuple(dict.fromkeys(name for atom in sorted(atoms) for name in atom.args))
        for name in list(self._moves)[first:]:
            if self._session.move(Step(name, objects), self._moves[name]).seconds > 0.0:
                return True
        return False

    def _look(
        self, run_state: RunState, cause: str, groups: Mapping[tuple[str, ...], Sequence[Atom]], kind: LookKind
    ) -> Look:
        """One look; `groups` are the atoms to ask about, by the cameras to show (none: all of them)."""
        close: dict[tuple[str, ...], list[Atom]] = {}
        for cameras, atoms in groups.items():  # a camera that shows nothing does not show best what it looks at
            close.setdefault(tuple(camera for camera in cameras if camera not in self._uninformative), []).extend(atoms)
        with self._session.stage("observe"):
            every = self._attention.shown or None
            wanted = every if () in close else {camera for cameras in close for camera in cameras}
            observation = self._world.observe(cause, wanted)
        self._session.emit(observation)
        good = self._usable(observation)
        with self._session.stage("estimate"):
            parts = []
            for cameras, atoms in close.items():
                images = {camera: image for camera, image in good.items() if not cameras or camera in cameras}
                parts.append(self._ask(observation, images, self._unanswered(images, atoms)))
                self._answered.append((images, frozenset(parts[-1].probability)))
            answers = parts[0] if len(parts) == 1 else _joined(parts)
            if self._witness is not None:
                about = [atom for atoms in close.values() for atom in atoms]
                told = self._witness.testify(observation, about)
                answers = replace(answers.without(told.alone), witnesses={self._witness.name: told.probability})
        atoms_there_are = len(run_state.task.atoms)
        whole = kind is LookKind.FOCUSED and sum(map(len, close.values())) == atoms_there_are
        return self._report(observation, answers, LookKind.FULL if whole else kind, good, atoms_there_are)

    def _usable(self, observation: Observation) -> dict[str, Image]:
        """The pictures that show something; the others are reported."""
        images = observation.images
        bad = uninformative(images, self._latest if observation.noisy else {})
        for camera, reason in bad.items():
            if self._uninformative.get(camera) != reason:
                self._session.emit(Blinded(camera, reason, observation.id))
        self._uninformative = {
            camera: reason for camera, reason in self._uninformative.items() if camera not in images
        } | bad
        self._latest |= images
        return {camera: image for camera, image in images.items() if camera not in bad}

    def _unanswered(self, images: Mapping[str, Image], atoms: Sequence[Atom]) -> list[Atom]:
        """The atoms that no model has answered yet for just these pictures."""
        if self.questions is None:
            return list(atoms)
        answered = {atom for shown, told in self._answered if same_view(shown, images) for atom in told}
        return [atom for atom in atoms if atom not in answered]

    def _ask(self, observation: Observation, images: Mapping[str, Image], atoms: Sequence[Atom]) -> Belief:
        if observation.images and not images:
            return Belief(observation.id, {}, frozenset(atoms), self.estimator.name)
        shown = observation if images.keys() == observation.images.keys() else replace(observation, images=images)
        return self.estimator.estimate(shown, atoms)

    def _report(
        self, observation: Observation, answers: Belief, kind: LookKind, images: Mapping[str, Image], atoms: int
    ) -> Look:
        self._session.emit(answers)
        asked = len(answers.probability) + len(answers.unanswered)
        looked = Looked(observation.id, kind, asked, atoms, tuple(images))
        self._session.emit(looked)
        return Look(answers, looked)


def _joined(parts: Sequence[Belief]) -> Belief:
    """One belief of several about different atoms."""
    first = parts[0]
    return Belief(
        first.observation_id,
        {atom: value for part in parts for atom, value in part.probability.items()},
        frozenset(atom for part in parts for atom in part.unanswered),
        first.source,
        {atom: answers for part in parts for atom, answers in part.evidence.items()},
    )
