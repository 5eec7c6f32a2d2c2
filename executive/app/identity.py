"""What is asked about identical things is answered by their tracks: no model can tell them apart, and no oracle may.

An answer is the probability that the atom is true, over everything that the label's thing may be: where each of its
kind is, weighed by how probable it is that this is the one. Where that decides nothing there is no answer, so that
nothing is claimed of a label whose identity is in doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from executive.belief import BayesMonitor, ErrorModel, Monitor
from executive.protocols import Asking, Estimator
from executive.types import Atom, Belief, Observation, PosesEstimated, Questions

TRACKED = ErrorModel(0.01, 0.01)
"""The error rates of an answer by tracks; `python -m benchmarks.identity` measures them."""

DECIDED = 0.1
"""An answer whose probability is within this of 0 or 1 decides; any other is none."""

_SURE = 0.99
"""The most that is ever said for an atom."""

Told = Callable[[Observation, Sequence[Atom]], Mapping[Atom, float]]
"""How probable atoms are at a moment, if each thing is what it goes by: where things are estimated to be, or by a model
that sees their tags. Atoms of which nothing can be said are left out."""


def names_identical(atom: Atom, identical: Collection[Sequence[str]]) -> bool:
    """Whether an atom is about one of several identical things."""
    return any(name in names for names in identical for name in atom.args)


def answered_by_tracks(
    estimator: Estimator,
    localize: Callable[[], PosesEstimated],
    told: Told,
    identical: Sequence[Sequence[str]],
    undecided: bool = False,
) -> Estimator:
    """Return an estimator that answers what is about identical things by their tracks, and has `estimator` answer the
    rest.

    Args:
        undecided: see `over_identities`.
    """
    asking: object = estimator  # whether it asks in words is for the running program to find out
    kind = _AskingTracks if isinstance(asking, Asking) else _Tracks
    return kind(estimator, localize, told, identical, undecided)


def trusting_tracks(monitor: Monitor, identical: Sequence[Sequence[str]]) -> Monitor:
    """Return the monitor with the error rates of tracks for what they answer."""
    if not isinstance(monitor, BayesMonitor):
        return monitor
    mine = {atom: TRACKED for atom in monitor.network.atoms if names_identical(atom, identical)}
    sensor = monitor.sensor_model
    return replace(monitor, sensor_model=replace(sensor, atoms={**sensor.atoms, **mine}))


def asked_by_tags(estimator: Estimator) -> Told:
    """Return what has an estimator, which is shown the tags, answer about the things that go by them."""
    return lambda observation, atoms: estimator.estimate(observation, atoms).probability


def over_identities(
    atoms: Sequence[Atom],
    told: Callable[[Sequence[Atom]], Mapping[Atom, float]],
    estimate: PosesEstimated,
    identical: Sequence[Sequence[str]],
    undecided: bool = False,
) -> dict[Atom, float]:
    """Return how probable atoms about identical things are, over everything that each of these may be.

    Args:
        told: how probable atoms are if each thing is what it goes by; what cannot be told is left out.
        estimate: has the probability that a thing is the one that it goes by.
        undecided: return what decides nothing, too, where that is not for doubt about which thing is which: a model's
            doubt is a part of its answer.
    """
    ways = {atom: _ways(atom, estimate, identical) for atom in atoms}
    probability = told(sorted({meant for each in ways.values() for meant in each}))
    found = {}
    for atom, each in ways.items():
        least = sum(chance * probability.get(meant, 0.0) for meant, chance in each.items())
        most = least + sum(chance for meant, chance in each.items() if meant not in probability)
        is_decided = most <= DECIDED or least >= 1.0 - DECIDED
        if is_decided or (undecided and most - least <= DECIDED and max(each.values()) >= 1.0 - DECIDED):
            found[atom] = min(_SURE, max(1.0 - _SURE, 0.5 * (least + most)))
    return found


class _Tracks:
    def __init__(
        self,
        estimator: Estimator,
        localize: Callable[[], PosesEstimated],
        told: Told,
        identical: Sequence[Sequence[str]],
        undecided: bool,
    ) -> None:
        self._estimator, self._localize, self._tell, self._undecided = estimator, localize, told, undecided
        self._identical = [tuple(names) for names in identical]

    @property
    def name(self) -> str:
        return self._estimator.name

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        mine = [atom for atom in atoms if names_identical(atom, self._identical)]
        if not mine:
            return self._estimator.estimate(observation, atoms)
        others = [atom for atom in atoms if atom not in mine]
        rest = self._estimator.estimate(observation, others) if others else Belief(observation.id, {}, source=self.name)
        answers = over_identities(
            mine, lambda asked: self._tell(observation, asked), self._localize(), self._identical, self._undecided
        )
        return replace(
            rest,
            probability={**rest.probability, **answers},
            unanswered=rest.unanswered | frozenset(mine).difference(answers),
        )


class _AskingTracks(_Tracks):
    @property
    def questions(self) -> Questions:
        asking: Any = self._estimator
        questions: Questions = asking.questions
        return questions


def _ways(atom: Atom, estimate: PosesEstimated, identical: Sequence[Sequence[str]]) -> dict[Atom, float]:
    """What an atom may mean, by names that things go by: each with its probability. Several identical things in one
    atom are taken to be mistaken for one another independently, but for the same one only once."""
    ways: dict[tuple[str, ...], float] = {(): 1.0}
    for name in atom.args:
        row = estimate.identity.get(name, {name: 1.0}) if any(name in names for names in identical) else {name: 1.0}
        ways = {
            (*args, other): chance * share
            for args, chance in ways.items()
            for other, share in row.items()
            if other not in args
        }
    total = sum(ways.values()) or 1.0
    return {Atom(atom.predicate, args): chance / total for args, chance in ways.items()}
