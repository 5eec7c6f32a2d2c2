"""A Panda in robosuite's own environment: short, and it recovers by the simulator's truth and by a model's answers."""

from __future__ import annotations

import functools
from pathlib import Path

from examples.robosuite_panda import panda as example
from examples.robosuite_panda.panda import CAMERAS, CUBES, FOLDER, RELATIONS, Panda, play
from executive import Atom, OutcomeKind, RelationEstimator, RerunSink, World, load_subject
from executive.s3e import Templates
from tests.contracts import WorldContract
from tests.executive.s3e.chat_server import Request, Response, completion, serving


@functools.cache
def shared() -> Panda:
    """One world for all tests that only look or wait: robosuite takes seconds to build one."""
    return Panda()


class TestPandasWorld(WorldContract):
    def make(self) -> World:
        return shared()

    def pass_time(self, world: World, seconds: float) -> None:
        assert isinstance(world, Panda)
        until = world.time + seconds
        while world.time < until - 1e-6:
            world.tick()


def test_it_is_at_most_a_hundred_lines() -> None:
    program = Path(example.__file__).read_text()
    assert sum(bool(line.strip()) for line in program.splitlines()) <= 100


def test_it_stacks_the_cubes_as_robosuite_sees_it(tmp_path: Path) -> None:
    world = Panda()
    ended = play(world, sinks=[RerunSink(tmp_path)])
    assert (ended.outcome, ended.actions, ended.replans) == (OutcomeKind.GOAL_REACHED, 2, 0)
    assert world.env._check_success()
    assert (tmp_path / "trace.rrd").stat().st_size > 100_000  # with the arm's shapes and how it moved


def test_it_recovers_from_a_drop() -> None:
    world = Panda()
    ended = play(world, ["drop@2"])
    assert (ended.outcome, ended.actions, ended.replans) == (OutcomeKind.GOAL_REACHED, 4, 1)
    assert world.env._check_success()


def test_a_vision_language_model_on_a_server_sees_for_it() -> None:
    """The server answers by what is there, and once in a while that it cannot tell; the questions are the domain's."""
    world, subject = Panda(), load_subject(FOLDER)
    assert subject.questions is not None
    text = Templates.read(subject.questions).translate(subject.task).text
    atoms = {question: atom for atom, question in text.items()}
    truth, asked = RelationEstimator(lambda: world, RELATIONS), set[str]()

    def answer(request: Request) -> Response:
        atom = next((each for question, each in atoms.items() if question in request.question), None)
        if atom is None:
            return completion({"yes": 0.98, "no": 0.02})  # whether two plus two is four
        assert len(request.images) == len(CAMERAS)
        assert "robot arm" in request.system
        asked.add(str(atom))
        yes = 0.97 if truth.of([atom])[atom] else 0.03
        return completion({"yes": yes, "no": 1.0 - yes})

    with serving(answer) as server:
        ended = play(world, server=server.url)
    assert (ended.outcome, ended.actions) == (OutcomeKind.GOAL_REACHED, 2)
    assert world.env._check_success()
    assert asked == {str(atom) for atom in subject.task.atoms}


def test_what_no_relation_is_about_is_unanswered() -> None:
    eye = RelationEstimator(lambda: shared(), RELATIONS, "oracle")
    lit = Atom("lit", ("red",))
    belief = eye.estimate(shared().observe(), [Atom("on-table", ("red",)), lit])
    assert belief.unanswered == {lit}
    assert belief.probability == {Atom("on-table", ("red",)): 1.0}
    assert {*CUBES} == {"red", "green"}
