"""From pictures and questions to a belief: an answer is a number, and whatever is none never looks like one."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError, MissingError
from executive.protocols import Estimator
from executive.s3e import LEAST_MASS, S3E, YES_NO, Answer, AnswerWords, Backend, Look, Questions, Untranslated, observe
from executive.trace.record.codec import decode, encode
from executive.types import Atom, Belief, Evidence, Image, Observation
from tests.executive.s3e.fakes import FakeBackend, FakeLook, Said, picture
from tests.executive.s3e.questions.test_templates import TRAY

ATOMS = tuple(Atom("on", (item, table)) for item in "abc" for table in "xy")
QUESTIONS = Questions({atom: f"Is {atom}?" for atom in ATOMS}, "Answer yes or no.", "templates")
SCENE = observe({"front": picture(1), "left": picture(2), "right": picture(3)})
shares = st.floats(0.0, 1.0)
masses = st.tuples(shares, shares).map(lambda pair: (pair[0], (1 - pair[0]) * pair[1]))
said = st.dictionaries(st.sampled_from(ATOMS), masses)


def estimator(say: Any, **options: Any) -> tuple[S3E, FakeBackend]:
    backend = FakeBackend(say if callable(say) else lambda question, images: say)
    return S3E(backend, QUESTIONS, **options), backend


def by_atom(table: dict[Atom, tuple[float, float]]) -> Any:
    """Answers as a table has them, else yes for sure."""
    return lambda question, images: table.get(Atom.parse(question[3:-1]), (1.0, 0.0))


def test_parts_are_what_they_claim_to_be() -> None:
    eye, backend = estimator((1.0, 0.0))
    assert isinstance(eye, Estimator)
    assert isinstance(backend, Backend)
    assert isinstance(backend.look([], ""), Look)
    assert eye.name == "s3e:fake"


def test_pictures_are_shown_together_and_in_order_under_the_prompt() -> None:
    eye, backend = estimator((0.9, 0.0))
    eye.estimate(SCENE, ATOMS)
    (look,) = backend.looks
    assert [image[0, 0, 0] for image in look.images] == [1, 2, 3]
    assert (look.system, look.words) == ("Answer yes or no.", AnswerWords("yes", "no"))
    assert look.asked == [[f"Is {atom}?" for atom in ATOMS]]


def test_cameras_are_chosen_and_ordered() -> None:
    eye, backend = estimator((0.9, 0.0), cameras=["right", "front"])
    belief = eye.estimate(SCENE, ATOMS)
    assert [image[0, 0, 0] for image in backend.looks[0].images] == [3, 1]
    assert {e.cameras for evidence in belief.evidence.values() for e in evidence} == {("right", "front")}


def test_without_translation_the_answers_are_true_and_false() -> None:
    from executive.domain.loader import load_subject

    subject = load_subject(TRAY)
    backend = FakeBackend(lambda question, images: (0.2, 0.8))
    questions = Untranslated(subject.pddl.read_text()).translate(subject.task)
    belief = S3E(backend, questions).estimate(SCENE, subject.task.atoms)
    (look,) = backend.looks
    assert look.words == AnswerWords("true", "false")
    assert look.asked == [[str(atom) for atom in subject.task.atoms]]
    assert set(belief.probability.values()) == {0.2}


@given(said)
def test_a_probability_is_yes_against_no_and_too_little_of_both_is_none(table: dict[Atom, tuple[float, float]]) -> None:
    eye, _ = estimator(by_atom(table))
    belief = eye.estimate(SCENE, ATOMS)
    assert belief.probability.keys() | belief.unanswered == set(ATOMS)
    for atom in ATOMS:
        yes, no = table.get(atom, (1.0, 0.0))
        (evidence,) = belief.evidence[atom]
        assert (evidence.yes_mass, evidence.no_mass) == (yes, no)
        assert evidence.elsewhere == pytest.approx(1 - yes - no)
        if yes + no < LEAST_MASS:
            assert belief.truth(atom) is None
        else:
            assert belief.probability[atom] == pytest.approx(yes / (yes + no))


def test_an_answer_that_is_neither_is_not_one_half() -> None:
    """ "unknown" instead of yes or no: the authors' own package makes P = 0.5 of that, and then true."""
    eye, _ = estimator((0.001, 0.001))
    belief = eye.estimate(SCENE, ATOMS)
    assert belief.unanswered == set(ATOMS)
    assert all(belief.truth(atom) is None for atom in ATOMS)
    assert belief.evidence[ATOMS[0]][0].elsewhere == pytest.approx(0.998)


@given(said, st.permutations(ATOMS), st.sets(st.sampled_from(ATOMS)))
def test_the_order_and_the_number_of_atoms_change_nothing(
    table: dict[Atom, tuple[float, float]], order: list[Atom], some: set[Atom]
) -> None:
    eye, _ = estimator(by_atom(table))
    every = eye.estimate(SCENE, ATOMS)
    assert eye.estimate(SCENE, order) == every
    part = eye.estimate(SCENE, [*some, *some])
    assert part.probability == {atom: p for atom, p in every.probability.items() if atom in some}
    assert part.unanswered == every.unanswered & some


def test_more_atoms_of_the_same_observation_cost_their_questions_alone() -> None:
    eye, backend = estimator((0.9, 0.0))
    eye.estimate(SCENE, ATOMS[:2])
    eye.estimate(SCENE, ATOMS[1:])
    assert [len(batch) for batch in backend.looks[0].asked] == [2, 5]
    assert len(backend.looks) == 1
    eye.estimate(observe({"front": picture(9)}), ATOMS)  # the same number, another observation
    assert len(backend.looks) == 2
    eye.estimate(SCENE, ATOMS)
    assert len(backend.looks) == 3


def test_no_question_is_asked_twice_and_none_for_nothing() -> None:
    eye, backend = estimator((0.9, 0.0))
    assert eye.estimate(SCENE, []) == Belief(0, {}, source="s3e:fake")
    assert backend.looks == []
    eye.estimate(SCENE, ATOMS + ATOMS)
    assert len(backend.asked) == len(ATOMS)


@given(st.lists(masses, min_size=3, max_size=3))
def test_averaged_is_the_mean_over_the_cameras_that_can_tell(table: list[tuple[float, float]]) -> None:
    eye, backend = estimator(lambda question, images: table[images[0][0, 0, 0] - 1], views="averaged")
    belief = eye.estimate(SCENE, ATOMS)
    told = [yes / (yes + no) for yes, no in table if yes + no >= LEAST_MASS and yes + no > 0]
    assert [len(look.images) for look in backend.looks] == [1, 1, 1]
    for atom in ATOMS:
        assert [evidence.cameras for evidence in belief.evidence[atom]] == [("front",), ("left",), ("right",)]
        assert belief.truth(atom) is None if not told else belief.probability[atom] == pytest.approx(np.mean(told))


def test_a_camera_that_fails_leaves_the_others() -> None:
    def say(question: str, images: Sequence[Image]) -> Said:
        return ValueError("black") if images[0][0, 0, 0] == 2 else (0.8, 0.2)

    eye, _ = estimator(say, views="averaged")
    belief = eye.estimate(SCENE, ATOMS)
    assert set(belief.probability.values()) == {0.8}
    assert [evidence.error for evidence in belief.evidence[ATOMS[0]]] == ["", "black", ""]


def test_a_camera_without_a_picture_is_left_out() -> None:
    for views in ("together", "averaged"):
        eye, backend = estimator((0.9, 0.0), cameras=("front", "gone"), views=views)
        assert eye.estimate(SCENE, ATOMS).unanswered == frozenset()
        assert [len(look.images) for look in backend.looks] == [1]


@pytest.mark.parametrize(
    ("cameras", "observation", "error"),
    [
        (None, observe({}), "there is no picture"),
        (["fornt"], SCENE, "no picture from fornt; did you mean 'front'? valid: front, left, right"),
        ([], SCENE, "there is no picture"),
    ],
)
def test_without_any_picture_nothing_is_answered(cameras: Any, observation: Observation, error: str) -> None:
    eye, backend = estimator((0.9, 0.0), cameras=cameras)
    belief = eye.estimate(observation, ATOMS)
    assert belief.unanswered == set(ATOMS)
    assert {evidence.error for parts in belief.evidence.values() for evidence in parts} == {error}
    assert backend.looks == []


def test_an_error_of_one_answer_costs_that_answer() -> None:
    def say(question: str, images: Sequence[Image]) -> Said:
        return Answer(question, 0.0, 0.0, error="no logprobs") if question == f"Is {ATOMS[0]}?" else (0.3, 0.7)

    eye, _ = estimator(say)
    belief = eye.estimate(SCENE, ATOMS)
    assert belief.unanswered == {ATOMS[0]}
    assert belief.evidence[ATOMS[0]][0].error == "no logprobs"


@pytest.mark.parametrize(
    "error", [RuntimeError("out of memory"), InputError("too small"), ValueError(), OSError("gone")]
)
def test_whatever_goes_wrong_is_no_answer_and_no_crash(error: Exception) -> None:
    eye, backend = estimator((0.9, 0.0))
    backend.refuse = error
    belief = eye.estimate(SCENE, ATOMS)
    assert belief.unanswered == set(ATOMS)
    assert belief.evidence[ATOMS[0]][0].error == (str(error) or "ValueError")
    backend.refuse = None
    assert eye.estimate(SCENE, ATOMS).unanswered == frozenset()  # the next attempt takes the pictures in after all


def test_too_few_answers_are_none() -> None:
    class Short(FakeLook):
        def ask(self, questions: Sequence[str]) -> list[Answer]:
            return super().ask(questions)[1:]

    class Backend(FakeBackend):
        def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> FakeLook:
            return Short(self, tuple(images), system, words)

    eye = S3E(Backend(lambda question, images: (1.0, 0.0)), QUESTIONS)
    assert eye.estimate(SCENE, ATOMS).unanswered == set(ATOMS)


def test_what_the_machine_lacks_is_said() -> None:
    eye, backend = estimator((0.9, 0.0))
    backend.refuse = MissingError("no torch", command="pip install torch")
    with pytest.raises(MissingError):
        eye.estimate(SCENE, ATOMS)


def test_an_atom_without_a_question_is_unanswered() -> None:
    eye, backend = estimator((0.9, 0.0))
    stranger = Atom("stranger")
    belief = eye.estimate(SCENE, [stranger, ATOMS[0]])
    assert belief.unanswered == {stranger}
    assert belief.evidence[stranger] == (Evidence((), 0.0, 0.0, "there is no question for this atom"),)
    assert backend.asked == [f"Is {ATOMS[0]}?"]


def test_a_calibrator_corrects_the_probability_and_leaves_the_evidence() -> None:
    eye, _ = estimator((0.4, 0.4), calibrate=lambda atom, p: p / 2 if atom == ATOMS[0] else 1.0)
    belief = eye.estimate(SCENE, ATOMS)
    assert belief.probability == {**dict.fromkeys(ATOMS, 1.0), ATOMS[0]: 0.25}
    assert belief.evidence[ATOMS[0]] == (Evidence(("front", "left", "right"), 0.4, 0.4),)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -0.1, 1.1])
def test_a_correction_that_is_no_probability_is_no_answer(wrong: float) -> None:
    eye, _ = estimator((0.4, 0.4), calibrate=lambda atom, p: wrong)
    assert eye.estimate(SCENE, ATOMS).unanswered == set(ATOMS)


def test_everything_behind_a_belief_can_be_asked_for() -> None:
    eye, _ = estimator((0.6, 0.2))
    finding = eye.ask(SCENE, ATOMS[:1])[ATOMS[0]]
    (view,) = finding.views
    assert finding.question == f"Is {ATOMS[0]}?"
    assert finding.probability == pytest.approx(0.75)
    assert (view.cameras, view.answer.prompt) == (("front", "left", "right"), f"Answer yes or no.\nIs {ATOMS[0]}?")


@given(said)
def test_beliefs_and_questions_are_recorded_with_their_evidence(table: dict[Atom, tuple[float, float]]) -> None:
    for views in ("together", "averaged"):
        belief = estimator(by_atom(table), views=views)[0].estimate(SCENE, ATOMS)
        assert decode(Belief, json.loads(json.dumps(encode(belief)))) == belief
    assert decode(Questions, json.loads(json.dumps(encode(QUESTIONS)))) == QUESTIONS


@pytest.mark.parametrize("options", [{"least_mass": -0.1}, {"least_mass": 1.1}, {"views": "sideways"}])
def test_nonsense_is_refused(options: Any) -> None:
    with pytest.raises(ValueError):
        estimator((1.0, 0.0), **options)


@pytest.mark.parametrize("text", ["", " ", "Is\nit?", "Is it?\x1b[2J"])
def test_a_question_is_one_line(text: str) -> None:
    with pytest.raises(ValueError, match="is not a line of text"):
        Questions({ATOMS[0]: text}, "", "")


@pytest.mark.parametrize("answers", [("yes",), ("yes", "Yes"), ("yes", "no", "maybe")])
def test_there_are_two_answers(answers: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="two different answers"):
        Questions({}, "", "", answers)
