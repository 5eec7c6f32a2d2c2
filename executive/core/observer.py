"""Looks: what is asked of which pictures, again and more closely, and while something is carried.

Nothing here decides anything. The loop says what to look at and what to make of it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from executive.belief.interface import Judgement, Monitor
from executive.core.attention import Attention, alike, useless
from executive.core.hold_guard import HoldGuard
from executive.core.policy import Settings
from executive.core.run_state import RunState
from executive.core.session import Session
from executive.protocols import Asking, Estimator, Skill, World
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Facts,
    Image,
    Judged,
    Looked,
    LookKind,
    Observation,
    SkillResult,
    Step,
    Timing,
)


class Observer:
    """Takes one run's looks, and tells of each what it showed and what it cost.

    A picture that tells nothing (its camera is black, or frozen) is left out and said so; where none is left, every
    atom is unanswered. A model that was asked about a picture is not asked the same again: its second answer would be
    the first one and no second witness.

    Args:
        monitor: makes something of the answers.
        attention: which cameras show what best.
        moves: skills that bring the arm out of the way, by name, the mildest first.
    """

    def __init__(
        self,
        estimator: Estimator,
        world: World,
        monitor: Monitor,
        attention: Attention,
        moves: Mapping[str, Skill],
        session: Session,
        settings: Settings,
    ) -> None:
        self._estimator, self._world, self._monitor, self._attention = estimator, world, monitor, attention
        self._moves, self._session, self._settings = dict(moves), session, settings
        self._latest: dict[str, Image] = {}
        self._useless: dict[str, str] = {}
        self._answered: list[tuple[Mapping[str, Image], frozenset[Atom]]] = []

    # Each takes how the run stands and returns how it stands with one more look, or with what makes the next one new.

    def look(self, run_state: RunState, cause: str) -> RunState:
        """Look at what matters now: everything, where that is no more than a look may ask about."""
        return self._look(run_state, cause, {(): run_state.questions(self._settings.max_questions)}, LookKind.FOCUSED)

    def look_at_all(self, run_state: RunState, cause: str) -> RunState:
        """Look at everything."""
        return self._look(run_state, cause, {(): run_state.task.atoms}, LookKind.FULL)

    def again(self, run_state: RunState, cause: str, atoms: Sequence[Atom], surprised: bool = False) -> RunState:
        """Look once more at the same moment, at what is in doubt alone: through the cameras that show it best, then
        each time with the arm further out of the way, as far as it gets. Where no camera shows it better than the
        others, the arm moves at once. What took it by surprise may have come to anything: then all that there is has to
        have been asked about first."""
        if surprised and not run_state.asked_all:
            return self.look_at_all(run_state, cause)
        groups = self._attention.groups(atoms)
        moved = run_state.moment.looks - any(groups)
        if moved > 0 and self._clear(atoms, moved - 1):
            return self._look(run_state, cause, {(): atoms}, LookKind.MOVED)
        return self._look(run_state, cause, groups, LookKind.CLOSER if any(groups) else LookKind.FOCUSED)

    def acted(self, run_state: RunState, result: SkillResult) -> RunState:
        """A skill was at work since: what is seen from here on is another moment."""
        self._answered = []
        return run_state.acted(result, self._monitor.acted(run_state.memory, result.step, result))

    def otherwise(self, run_state: RunState, atom: Atom) -> Facts | None:
        """What is most probable if an atom is not what it is believed to be."""
        return self._monitor.state_without(run_state.memory, atom)

    def supposing(self, run_state: RunState, atom: Atom) -> Facts | None:
        """What is most probable if an atom is true."""
        return self._monitor.state_with(run_state.memory, atom)

    def waited(self, run_state: RunState) -> RunState:
        """Time went by in which the world may have changed."""
        self._answered = []
        return run_state.waiting(self._monitor.acted(run_state.memory, None))

    def guard(self, step: Step) -> HoldGuard | None:
        """Who watches what the step's skill carries; nobody where that is not known."""
        atom = self._attention.held(step)
        if atom is None:
            return None
        return HoldGuard(atom, self._settings.guard_looks, self._world, self.glance, self._session.emit)

    def glance(self, atom: Atom) -> Belief:
        """Ask about one atom in the middle of a skill."""
        began = time.monotonic()
        observation = self._world.observe(f"is {atom} so?", self._attention.guard or self._attention.shown or None)
        self._session.emit(observation)
        images = self._trusted(observation)
        belief = self._ask(observation, images, [atom])
        self._tell(observation, belief, LookKind.GUARD, images, 1)
        self._session.emit(Timing("guard", time.monotonic() - began))
        return belief

    def _clear(self, atoms: Sequence[Atom], first: int) -> bool:
        """Bring the arm out of the way by the first move, from the `first` on, that gets it anywhere."""
        objects = tuple(dict.fromkeys(name for atom in sorted(atoms) for name in atom.args))
        for name in list(self._moves)[first:]:
            if self._session.move(Step(name, objects, Facts(), Facts()), self._moves[name]).seconds > 0.0:
                return True
        return False

    def _look(
        self, run_state: RunState, cause: str, groups: Mapping[tuple[str, ...], Sequence[Atom]], kind: LookKind
    ) -> RunState:
        """One look; `groups` are the atoms to ask about, by the cameras to show (none: all of them)."""
        close: dict[tuple[str, ...], list[Atom]] = {}
        for cameras, atoms in groups.items():  # a camera that tells nothing does not show best what it looks at
            close.setdefault(tuple(camera for camera in cameras if camera not in self._useless), []).extend(atoms)
        with self._session.stage("observe"):
            every = self._attention.shown or None
            wanted = every if () in close else {camera for cameras in close for camera in cameras}
            observation = self._world.observe(cause, wanted)
        self._session.emit(observation)
        good = self._trusted(observation)
        with self._session.stage("estimate"):
            parts = []
            for cameras, atoms in close.items():
                images = {camera: image for camera, image in good.items() if not cameras or camera in cameras}
                parts.append(self._ask(observation, images, self._new(images, atoms)))
                self._answered.append((images, frozenset(parts[-1].probability)))
        raw = parts[0] if len(parts) == 1 else _joined(parts)
        atoms_there_are = len(run_state.task.atoms)
        whole = kind is LookKind.FOCUSED and sum(map(len, close.values())) == atoms_there_are
        looked = self._tell(observation, raw, LookKind.FULL if whole else kind, good, atoms_there_are)
        return self._weighed(run_state, raw, looked)

    def _weighed(self, run_state: RunState, raw: Belief, looked: Looked) -> RunState:
        """What the monitor makes of a look."""
        memory, judgement = self._monitor.looked(run_state.memory, raw, run_state.cycle)
        self._session.emit(_judged(judgement))
        return run_state.looked(memory, judgement, raw, looked)

    def _trusted(self, observation: Observation) -> dict[str, Image]:
        """The pictures that tell something; the others are reported."""
        images = observation.images
        bad = useless(images, self._latest if observation.noisy else {})
        for camera, reason in bad.items():
            if self._useless.get(camera) != reason:
                self._session.emit(Blinded(camera, reason, observation.id))
        self._useless = {camera: reason for camera, reason in self._useless.items() if camera not in images} | bad
        self._latest |= images
        return {camera: image for camera, image in images.items() if camera not in bad}

    def _new(self, images: Mapping[str, Image], atoms: Sequence[Atom]) -> list[Atom]:
        """The atoms that no model has answered yet for just these pictures."""
        estimator: object = self._estimator  # whether a model answers is for the running program to find out
        if not isinstance(estimator, Asking):
            return list(atoms)
        answered = {atom for shown, told in self._answered if alike(shown, images) for atom in told}
        return [atom for atom in atoms if atom not in answered]

    def _ask(self, observation: Observation, images: Mapping[str, Image], atoms: Sequence[Atom]) -> Belief:
        if observation.images and not images:
            return Belief(observation.id, {}, frozenset(atoms), self._estimator.name)
        shown = observation if images.keys() == observation.images.keys() else replace(observation, images=images)
        return self._estimator.estimate(shown, atoms)

    def _tell(
        self, observation: Observation, raw: Belief, kind: LookKind, images: Mapping[str, Image], atoms: int
    ) -> Looked:
        self._session.emit(raw)
        looked = Looked(observation.id, kind, len(raw.probability) + len(raw.unanswered), atoms, tuple(images))
        self._session.emit(looked)
        return looked


def _judged(judgement: Judgement) -> Judged:
    return Judged(
        judgement.belief.observation_id,
        judgement.probability,
        judgement.seen,
        judgement.contradictions,
        judgement.overruled,
        judgement.remembered,
        judgement.came_about,
    )


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
