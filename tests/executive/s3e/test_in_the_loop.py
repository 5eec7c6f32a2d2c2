"""S3E as the loop's estimator: questions and evidence are recorded, and what it cannot tell stops a run by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.app.assembly import make_executive
from executive.protocols import Asking
from executive.s3e import S3E, LanguageModel, Questions, generic
from executive.trace.record.codec import decode, encode
from executive.trace.story.story import Story
from executive.trace.terminal.view import event_line
from executive.types import Atom, Belief, Facts, Image, Observation, OutcomeKind, Started
from tests.executive.s3e.fakes import FakeBackend, FakeWriter, Said
from tests.fakes import FakeWorld, ScriptedEstimator, Stage, at

GOAL = Facts({at("cup", "q"): True})


class PicturedWorld(FakeWorld):
    """A picture of this world is the number of the observation, beside something bright and something that changes."""

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        seen = super().observe(cause, cameras)
        image = np.full((2, 2, 3), 255, dtype=np.uint8)
        image[0, 0], image[1] = seen.id, 97 * seen.id % 256  # no two are alike
        return replace(seen, images={"front": image})


def played(say: Callable[[Atom, bool], Said], questions: Questions | None = None) -> tuple[Stage, Any]:
    stage = Stage(GOAL, {"cup": "p"})
    stage.world = PicturedWorld(stage.where, stage.places)
    asked = questions or generic(stage.task).translate(stage.task)
    atoms = {text: atom for atom, text in asked.text.items()}

    def answer(question: str, images: Sequence[Image]) -> Said:
        atom = atoms[question]
        return say(atom, stage.world.truth([atom], int(images[0][0, 0, 0]))[atom])

    eye = S3E(FakeBackend(answer), asked)
    parts = (stage.task, stage.planner, stage.world, {"pick": stage.skill, "place": stage.skill}, eye)
    return stage, make_executive(*parts, sinks=[stage.recorder], settings=stage.settings).run()


def test_a_run_that_asks_reaches_its_goal_and_records_what_it_asked() -> None:
    stage, ended = played(lambda atom, truth: (0.7, 0.1) if truth else (0.1, 0.7))
    assert (ended.outcome, stage.goal_true) == (OutcomeKind.GOAL_REACHED, True)
    first, second = stage.recorder.events[:2]
    assert isinstance(first.payload, Started)
    assert isinstance(second.payload, Questions)
    assert second.payload.text.keys() == set(stage.task.atoms)
    for belief in stage.recorder.of(Belief):
        assert belief.source == "s3e:fake"
        assert {answer.cameras for answers in belief.evidence.values() for answer in answers} == {("front",)}
        assert decode(Belief, encode(belief)) == belief


@pytest.mark.parametrize("said", [(0.01, 0.01), RuntimeError("the model is gone")])
def test_a_model_that_cannot_tell_stops_the_run_by_name_and_touches_nothing(said: Said) -> None:
    _, ended = played(lambda atom, truth: said)
    assert ended.outcome is OutcomeKind.GAVE_UP
    assert (ended.actions, ended.goal_seen) == (0, False)


def test_a_question_that_was_replaced_is_an_event_that_is_shown() -> None:
    task = Stage(GOAL, {"cup": "p"}).task
    refused = Atom.parse("held(cup)")
    model = FakeWriter(lambda prompt, attempt: "hm" if prompt == str(refused) else f"Is {prompt} so?")
    questions = LanguageModel(model, "(define (domain things))").translate(task)
    stage, _ = played(lambda atom, truth: (0.9, 0.0) if truth else (0.0, 0.9), questions)
    (event,) = [event for event in stage.recorder.events if isinstance(event.payload, Questions)]
    assert [warning.partition(": ")[0] for warning in questions.warnings] == [str(refused)]
    assert event.payload == questions
    line = event_line(event, Story())
    assert line is not None
    assert questions.warnings[0] in line.plain


def test_an_estimator_that_asks_nothing_in_words_is_left_alone() -> None:
    stage = Stage(GOAL, {"cup": "p"})
    assert not isinstance(ScriptedEstimator(stage.world), Asking)
    stage.play()
    assert stage.recorder.of(Questions) == []


def test_the_record_of_a_run_keeps_questions_and_evidence(tmp_path: Path) -> None:
    from executive.trace.record.log import EventLog, read_events

    stage, _ = played(lambda atom, truth: (0.7, 0.1) if truth else (0.1, 0.7))
    log = EventLog(tmp_path)
    for event in stage.recorder.events:
        log.write(event)
    log.close()
    again = [event.payload for event in read_events(tmp_path)]
    assert [payload for payload in again if isinstance(payload, Questions)] == stage.recorder.of(Questions)
    assert [payload for payload in again if isinstance(payload, Belief)] == stage.recorder.of(Belief)
