"""Looks: again and closer, with the arm out of the way, without eyes that tell nothing, and never twice the same."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive import types
from executive.belief import ErrorModel, SensorModel, Thresholds, WitnessModel
from executive.core.attention import Attention
from executive.core.settings import Settings
from executive.protocols import Skill, SkillContext
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Decision,
    DecisionKind,
    Dispatched,
    Facts,
    Image,
    Judged,
    Looked,
    LookKind,
    Moved,
    Observation,
    OutcomeKind,
    PictureFault,
    Questions,
    Reason,
    SkillResult,
    SkillStatus,
    Step,
)
from tests.fakes import FREE, FakeWorld, ScriptedEstimator, Stage, at

GOAL = Facts({at("a", "q"): True, at("b", "r"): True})
CLOSER = Attention(closer={"q": ("left",), "p": ("right",), "held": ("hand",)})


def seen_by(*places: str) -> Callable[[FakeWorld], Image]:
    """A camera's picture, with noise: another one whenever something else is in one of the places (in any, if none is
    named)."""

    def draw(world: FakeWorld) -> Image:
        shown = sorted((thing, place) for thing, place in world.where.items() if not places or place in places)
        digest = hashlib.sha256(repr(shown).encode()).digest()
        picture = np.frombuffer(digest[:27] + b"\x00\xff" + digest[:7], dtype=np.uint8).reshape(3, 4, 3)
        return picture ^ np.random.default_rng(len(world.past)).integers(0, 2, picture.shape, dtype=np.uint8)

    return draw


class Watching(ScriptedEstimator):
    """Keeps what it was asked, through which cameras."""

    def __init__(self, world: FakeWorld, **script: object) -> None:
        super().__init__(world, **script)  # type: ignore[arg-type]
        self.asked: list[tuple[tuple[str, ...], tuple[Atom, ...]]] = []
        self.numbers: list[int] = []

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        self.asked.append((tuple(observation.images), tuple(atoms)))
        self.numbers.append(observation.id)
        return super().estimate(observation, atoms)


class Wordy(Watching):
    """Asks a model in words."""

    questions = Questions({at("a", "q"): "Is a on q?"}, "", "me")


def stage(eye: type[Watching] = Watching, **changes: object) -> Stage:
    made = Stage(GOAL, {"a": "p", "b": "p"}, attention=CLOSER, **changes)  # type: ignore[arg-type]
    made.world.noisy = True
    made.world.cameras = {
        "front": seen_by(), "left": seen_by("q"), "right": seen_by("p"), "hand": seen_by("hand")
    }  # fmt: skip
    made.estimator = eye(made.world, looks=changes.get("looks"), always=changes.get("always"))
    return made


def asked(made: Stage) -> list[tuple[tuple[str, ...], tuple[Atom, ...]]]:
    assert isinstance(made.estimator, Watching)
    return made.estimator.asked


def looks(made: Stage) -> list[Looked]:
    return made.recorder.of(Looked)


ALL = ("front", "left", "right", "hand")


def test_a_doubt_is_looked_at_through_the_cameras_that_show_it_best_and_at_nothing_else() -> None:
    made = stage(looks={3: {at("a", "q"): None, at("b", "p"): None}})
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    assert asked(made)[2] == (ALL, made.task.atoms)
    assert asked(made)[3:5] == [(("left",), (at("a", "q"),)), (("right",), (at("b", "p"),))]
    closer = looks(made)[3]
    assert (closer.kind, closer.questions, closer.atoms) == (LookKind.CLOSER, 2, len(made.task.atoms))
    assert set(closer.cameras) == {"left", "right"}, "no other picture is taken"
    judged = made.recorder.of(Judged)[3]
    assert judged.seen.keys() == set(made.task.atoms), "what the first look told still counts"


def out_of_the_way(seconds: float) -> Skill:
    def move(step: Step, context: SkillContext) -> SkillResult:
        context.handle.advance(seconds)
        return SkillResult(step, SkillStatus.DONE, seconds=seconds)

    return move


@pytest.mark.parametrize(
    ("seconds", "moved", "kinds"),
    [
        ((2.0, 1.0), ["home", "aside"], [LookKind.CLOSER, LookKind.MOVED, LookKind.MOVED]),
        ((0.0, 1.0), ["home", "aside", "aside"], [LookKind.CLOSER, LookKind.MOVED, LookKind.MOVED]),
        ((0.0, 0.0), ["home", "aside", "aside"], [LookKind.CLOSER] * 3),
    ],
)
def test_what_stays_in_doubt_is_looked_at_with_the_arm_further_and_further_out_of_the_way(
    seconds: tuple[float, float], moved: list[str], kinds: list[LookKind]
) -> None:
    """A move that gets the arm nowhere costs nothing, and the next one is tried in its place."""
    doubt = at("a", "q")
    made = stage(looks={number: {doubt: None} for number in range(3, 99)})
    made.moves = {name: out_of_the_way(time) for name, time in zip(("home", "aside"), seconds, strict=True)}
    made.play()
    second = [index for index, look in enumerate(looks(made)) if look.kind is LookKind.FULL][2]
    again = looks(made)[second + 1 : second + 4]
    assert [look.kind for look in again] == kinds
    assert {look.questions for look in again} == {1}
    events = [event.payload for event in made.recorder.events]
    start, end = (events.index(look) for look in (looks(made)[second], again[-1]))
    assert [event.move for event in events[start:end] if isinstance(event, Moved)] == moved
    assert made.recorder.of(Dispatched)[-1].action == made.skill.count, "a move is no action"


def test_a_move_that_drops_what_is_carried_is_seen() -> None:
    made = stage(looks={2: {at("b", "p"): None}, 3: {at("b", "p"): None}})

    def clumsy(step: Step, context: SkillContext) -> SkillResult:
        context.handle.where["a"] = "r"
        context.handle.advance(1.0)
        return SkillResult(step, SkillStatus.DROPPED, "it slipped", 1.0)

    made.moves = {"home": clumsy}
    ended = made.play()
    assert (ended.outcome, made.goal_true) == (OutcomeKind.GOAL_REACHED, True)


def test_looking_again_is_bounded_and_its_costs_are_told() -> None:
    made = stage(always={at("a", "q"): None}, settings=Settings(max_looks_again=2))
    made.moves = {"home": out_of_the_way(1.5)}
    ended = made.play()
    assert not ended.goal_seen
    run = 0
    for event in made.recorder.events:
        if isinstance(event.payload, Decision):
            run = run + 1 if event.payload.kind is DecisionKind.LOOK_AGAIN else 0
            assert run <= 2
    assert ended.looks == len(looks(made))
    assert {moved.seconds for moved in made.recorder.of(Moved)} == {1.5}


def test_a_model_is_not_asked_twice_about_the_same_picture() -> None:
    """An answer that settles nothing is an answer, and the same picture would bring the same one."""
    wrong = stage(Wordy, always={at("a", "q"): 0.5}, thresholds=Thresholds(0.3, 0.7), settings=Settings(max_actions=9))
    wrong.play()
    assert isinstance(wrong.estimator, Wordy)
    questions = iter(zip(wrong.estimator.numbers, asked(wrong), strict=True))
    number, (cameras, atoms) = next(questions)
    told: set[tuple[tuple[str, ...], Atom]] = set()
    for event in wrong.recorder.events:
        match event.payload:
            case Dispatched():
                told = set()
            case Observation(id=taken, cause=cause):
                told = set() if cause.startswith("before") else told  # time went by
                while number == taken:
                    new = {(cameras, atom) for atom in atoms}
                    assert not new & told
                    told |= new
                    number, (cameras, atoms) = next(questions, (-1, ((), ())))
    assert number == -1
    assert any(look.questions == 0 for look in looks(wrong)), "there was a look that had nothing left to ask"


def test_one_that_errs_anew_each_time_is_asked_as_often_as_it_takes() -> None:
    made = stage(looks={3: {at("a", "q"): 0.0}})
    made.world.cameras = {}
    ended = made.play()
    assert (ended.outcome, ended.looks, ended.replans) == (OutcomeKind.GOAL_REACHED, 6, 0)


def black(world: FakeWorld) -> Image:
    return np.zeros((3, 4, 3), dtype=np.uint8)


@pytest.mark.parametrize("camera", ALL)
def test_a_camera_that_goes_black_is_left_out_and_reported_once(camera: str) -> None:
    made = stage()
    made.skill.script = {2: lambda world: world.cameras.update({camera: black})}
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    (blinded,) = made.recorder.of(Blinded)
    assert (blinded.camera, blinded.reason) == (camera, PictureFault.PLAIN)
    assert all(camera in cameras for cameras, _ in asked(made)[:2])
    assert all(camera not in cameras for cameras, _ in asked(made)[2:])


def test_a_camera_that_comes_back_is_looked_through_again() -> None:
    made = stage()
    whole = made.world.cameras["left"]
    made.skill.script = {
        1: lambda world: world.cameras.update(left=black),
        3: lambda world: world.cameras.update(left=whole),
    }
    made.play()
    assert ["left" in cameras for cameras, _ in asked(made)] == [True, False, False, True, True]


def test_a_closer_look_does_not_go_by_a_camera_that_tells_nothing() -> None:
    made = stage(looks={3: {at("a", "q"): None}})
    made.skill.script = {1: lambda world: world.cameras.update(left=black)}
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    assert asked(made)[3] == (("front", "right", "hand"), (at("a", "q"),))


def test_a_camera_that_shows_the_same_picture_twice_has_frozen() -> None:
    made = stage()

    def freeze(world: FakeWorld) -> None:
        picture = world.cameras["front"](world)
        world.cameras["front"] = lambda world: picture

    made.skill.script = {2: freeze}
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    (blinded,) = made.recorder.of(Blinded)
    assert (blinded.camera, blinded.reason) == ("front", PictureFault.FROZEN)
    assert ["front" in cameras for cameras, _ in asked(made)] == [True, True, False, False, False]


@pytest.mark.parametrize("noisy", [True, False])
def test_an_action_that_did_nothing_freezes_no_camera(noisy: bool) -> None:
    """Pictures that are drawn may be the same, bit for bit, as often as there is nothing new to see."""
    made = stage(script={2: "lie"})
    made.world.noisy = noisy
    if not noisy:
        made.world.cameras = dict.fromkeys(ALL, lambda world: np.arange(36, dtype=np.uint8).reshape(3, 4, 3))
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    assert made.recorder.of(Blinded) == []


def test_where_no_camera_shows_it_better_the_arm_moves_at_once() -> None:
    made = stage(looks={3: {FREE: None}, 4: {FREE: None}})
    made.moves = {name: out_of_the_way(1.0) for name in ("home", "aside")}
    assert made.play().outcome is OutcomeKind.GOAL_REACHED
    again = looks(made)[3:5]
    assert [(look.kind, look.questions) for look in again] == [(LookKind.MOVED, 1)] * 2
    assert [moved.move for moved in made.recorder.of(Moved)][:2] == ["home", "aside"]


def test_with_no_camera_left_everything_is_unknown_and_the_run_ends_by_name() -> None:
    made = stage()
    made.skill.script = {2: lambda world: world.cameras.update(dict.fromkeys(ALL, black))}
    ended = made.play()
    assert (ended.outcome, ended.goal_seen) == (OutcomeKind.GAVE_UP, False)
    (cause,) = ended.causes
    assert (cause.code, len(cause.steps)) == (Reason.NOTHING_SEEN, 1)
    assert {blinded.camera for blinded in made.recorder.of(Blinded)} == set(ALL)
    last = made.recorder.of(Belief)[-1]
    assert (last.probability, last.unanswered <= set(made.task.atoms)) == ({}, True)
    assert len(asked(made)) == 2, "nobody is asked about pictures that show nothing"


things = st.integers(2, 5)


@settings(max_examples=25, deadline=None)
@given(things, st.integers(5, 12))
def test_no_look_asks_more_than_it_may_but_the_first_and_the_last(count: int, most: int) -> None:
    names = [f"t{number}" for number in range(count)]
    goal = Facts({at(name, "q"): True for name in names[:2]})
    made = Stage(goal, dict.fromkeys(names, "p"), settings=Settings(max_questions=most))
    ended = made.play()
    assert (ended.outcome, made.goal_true) == (OutcomeKind.GOAL_REACHED, True)
    told = looks(made)
    assert all(look.questions <= most for look in told if look.kind is not LookKind.FULL)
    assert told[0].kind is told[-1].kind is LookKind.FULL
    if most < len(made.task.atoms):
        assert sum(look.kind is LookKind.FULL for look in told) == 2


def test_a_surprise_in_a_look_at_some_atoms_has_the_rest_looked_at_before_it_is_believed() -> None:
    """What fell may have fallen anywhere."""
    made = Stage(GOAL, {"a": "p", "b": "p"}, script={2: "land quietly r"}, settings=Settings(max_questions=5))
    ended = made.play()
    assert (ended.outcome, ended.replans, made.goal_true) == (OutcomeKind.GOAL_REACHED, 1, True)
    kinds = [look.kind for look in looks(made)]
    assert kinds[:4] == [LookKind.FULL, LookKind.FOCUSED, LookKind.FOCUSED, LookKind.FULL]


def test_what_is_never_sure_enough_is_not_claimed() -> None:
    """Every answer is for the goal, and none by enough to bet on it."""
    always = {at("a", "q"): 0.8, at("a", "r"): 0.3}
    leaning = stage(always=always).weighing(
        sensor_model=SensorModel(other=ErrorModel(1e-3, 1e-3), correlation_within=0.8, correlation_across=0.8)
    )
    ended = leaning.play()
    assert (ended.outcome, ended.goal_seen) == (OutcomeKind.PARTIAL, False)
    assert any(at("a", "q") in cause.atoms for cause in ended.causes)
    at_its_word = stage(always=always).play()
    assert (at_its_word.outcome, at_its_word.goal_seen) == (OutcomeKind.GOAL_REACHED, True)


class Feeling:
    """A witness that tells where a thing is, which no picture can."""

    name = "touch"

    def __init__(self, world: FakeWorld, thing: str) -> None:
        self._world, self._thing = world, thing

    def testify(self, observation: Observation, atoms: Sequence[Atom]) -> types.Testimony:
        about = [atom for atom in atoms if atom.predicate == "at" and atom.args[0] == self._thing]
        truth = self._world.truth(about)
        return types.Testimony({atom: 0.999 if truth[atom] else 0.001 for atom in about}, frozenset(about))


@pytest.mark.parametrize("tells", [True, False])
def test_what_a_witness_alone_can_tell_is_not_taken_from_pictures(tells: bool) -> None:
    """A model that is sure, and wrong, about an item across two tables is not heard about it."""
    wrong = {at("a", "q"): 0.01, at("a", "r"): 0.99}
    made = stage(always=wrong).weighing(witnesses={"touch": WitnessModel(SensorModel())})
    if tells:
        made.witness = Feeling(made.world, "a")
    ended = made.play()
    reached = ended.outcome is OutcomeKind.GOAL_REACHED
    assert (reached, made.goal_true and reached) == (tells, tells)
