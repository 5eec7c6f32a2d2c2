"""Of identical things, tracks answer; and where a label is in doubt, nothing is said that depends on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from executive.app.identity import TRACKED, answered_by_tracks, names_identical, trusting_tracks
from executive.belief import EXACT, BayesMonitor, MutexNetwork, ThresholdMonitor
from executive.protocols import Asking, Estimator
from executive.types import Atom, Belief, Observation, PosesEstimated, Questions

CANS = ("can-a", "can-b", "can-c")
LEFT, MIDDLE, RIGHT = ({can: Atom("on", (can, table)) for can in CANS} for table in ("left", "middle", "right"))
EMPTY = Atom("hand-empty")
PLACES = {"can-a": LEFT, "can-b": MIDDLE, "can-c": RIGHT}
LOOK = Observation(1, 0.0, {}, np.zeros(6))
ATOMS = [*LEFT.values(), *MIDDLE.values(), *RIGHT.values(), EMPTY]


class Model:
    """A model that takes everything to be true, and remembers what it was asked."""

    name = "model"

    def __init__(self) -> None:
        self.asked: list[Atom] = []

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        self.asked += atoms
        return Belief(observation.id, dict.fromkeys(atoms, 1.0), source=self.name)


class AskingModel(Model):
    questions = Questions({EMPTY: "Is the hand empty?"}, "", "test")


def told(_: Observation, atoms: Sequence[Atom]) -> dict[Atom, float]:
    """Each is on its own table, if it is what it goes by."""
    return {atom: float(PLACES[atom.args[0]][atom.args[0]] == atom) for atom in atoms}


def sure(share: float) -> Mapping[str, Mapping[str, float]]:
    """Identities in which a and c may have been exchanged."""
    return {
        "can-a": {"can-a": share, "can-b": 0.0, "can-c": 1.0 - share},
        "can-b": {"can-a": 0.0, "can-b": 1.0, "can-c": 0.0},
        "can-c": {"can-a": 1.0 - share, "can-b": 0.0, "can-c": share},
    }


def answers(identity: Mapping[str, Mapping[str, float]], model: Estimator | None = None) -> Belief:
    estimate = PosesEstimated({}, identity=identity)
    return answered_by_tracks(model or Model(), lambda: estimate, told, [CANS]).estimate(LOOK, ATOMS)


def test_a_model_is_asked_about_nothing_that_it_cannot_tell() -> None:
    model = Model()
    belief = answers(sure(1.0), model)
    assert model.asked == [EMPTY]
    assert belief.probability[EMPTY] == 1.0
    assert {atom for atom, value in belief.probability.items() if value > 0.9} == {
        EMPTY, LEFT["can-a"], MIDDLE["can-b"], RIGHT["can-c"],
    }  # fmt: skip
    assert not belief.unanswered


@pytest.mark.parametrize("share", [0.5, 0.6, 0.85])
def test_of_a_label_in_doubt_only_what_holds_either_way_is_told(share: float) -> None:
    belief = answers(sure(share))
    assert belief.unanswered == {LEFT["can-a"], RIGHT["can-a"], LEFT["can-c"], RIGHT["can-c"]}
    assert belief.probability[MIDDLE["can-a"]] < 0.05
    assert belief.probability[MIDDLE["can-b"]] > 0.95


def test_labels_that_were_exchanged_are_where_they_went() -> None:
    belief = answers(sure(0.02))
    assert belief.probability[RIGHT["can-a"]] > 0.9
    assert belief.probability[LEFT["can-a"]] < 0.1


def test_what_is_hidden_is_not_told_unless_it_decides_nothing() -> None:
    def some(look: Observation, atoms: Sequence[Atom]) -> dict[Atom, float]:
        return {atom: value for atom, value in told(look, atoms).items() if atom.args[0] != "can-c"}

    estimate = PosesEstimated({}, identity=sure(0.97))
    belief = answered_by_tracks(Model(), lambda: estimate, some, [CANS]).estimate(LOOK, ATOMS)
    assert belief.unanswered == set(ATOMS) - belief.probability.keys()
    assert {LEFT["can-c"], MIDDLE["can-c"], RIGHT["can-c"]} <= belief.unanswered
    assert belief.probability[LEFT["can-a"]] > 0.9


def by_tags(identity: Mapping[str, Mapping[str, float]], doubt: float) -> Belief:
    """The answers of a model that sees tags, and doubts what is on the left table."""

    def said(_: Observation, atoms: Sequence[Atom]) -> dict[Atom, float]:
        return {atom: doubt if atom in LEFT.values() else value for atom, value in told(LOOK, atoms).items()}

    estimate = PosesEstimated({}, identity=identity)
    return answered_by_tracks(Model(), lambda: estimate, said, [CANS], undecided=True).estimate(LOOK, ATOMS)


def test_a_doubt_of_the_model_is_told_and_one_about_labels_is_none() -> None:
    assert by_tags(sure(1.0), 0.4).probability[LEFT["can-a"]] == pytest.approx(0.4)
    assert not by_tags(sure(1.0), 0.4).unanswered
    assert LEFT["can-a"] in by_tags(sure(0.6), 0.4).unanswered
    assert MIDDLE["can-b"] not in by_tags(sure(0.6), 0.4).unanswered


def test_no_two_labels_of_one_atom_are_the_same_thing() -> None:
    beside = Atom("beside", ("can-a", "can-c"))
    asked: list[Atom] = []

    def say(_: Observation, atoms: Sequence[Atom]) -> dict[Atom, float]:
        asked.extend(atoms)
        return dict.fromkeys(atoms, 1.0)

    estimate = PosesEstimated({}, identity=sure(0.5))
    belief = answered_by_tracks(Model(), lambda: estimate, say, [CANS]).estimate(LOOK, [beside])
    assert belief.probability[beside] > 0.9
    assert all(len(set(atom.args)) == 2 for atom in asked)


def test_who_asks_in_words_still_does() -> None:
    asking: object = answered_by_tracks(AskingModel(), lambda: PosesEstimated({}), told, [CANS])
    assert isinstance(asking, Asking)
    assert asking.questions is AskingModel.questions
    assert not isinstance(answered_by_tracks(Model(), lambda: PosesEstimated({}), told, [CANS]), Asking)


def test_tracks_have_error_rates_of_their_own() -> None:
    monitor = trusting_tracks(BayesMonitor(MutexNetwork(tuple(ATOMS), ()), EXACT), [CANS])
    assert isinstance(monitor, BayesMonitor)
    assert monitor.sensor_model.evidence(LEFT["can-a"], 1.0) == pytest.approx(TRACKED.evidence(1.0))
    assert monitor.sensor_model.evidence(EMPTY, 1.0) == pytest.approx(EXACT.evidence(EMPTY, 1.0))
    plain = ThresholdMonitor(tuple(ATOMS))
    assert trusting_tracks(plain, [CANS]) is plain


def test_atoms_about_identical_things_are_known_by_any_argument() -> None:
    assert names_identical(Atom("holds", ("table", "can-b")), [CANS])
    assert not names_identical(EMPTY, [CANS])
