"""The grammar of faults, when they strike, and that their chance depends on nothing but seed, place and action."""

from __future__ import annotations

import re
import threading
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from executive.app.assembly import make_executive
from executive.core.loop import Executive
from executive.errors import InputError
from executive.faults import (
    EVER,
    KINDS,
    Fault,
    FaultInjector,
    faulty_estimator,
    faulty_planner,
    faulty_sensing,
    faulty_skills,
    faulty_world,
    parse_fault,
    read_faults,
)
from executive.faults.image_noise import SPOILED
from executive.protocols import Asking, Estimator
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Camera,
    DepthImage,
    Dispatched,
    Ended,
    Facts,
    FaultInjected,
    FloatArray,
    Image,
    NoPlan,
    Observation,
    OutcomeKind,
    Phase,
    Questions,
    Scenery,
    SkillResult,
    SkillStatus,
)
from tests.fakes import FakeWorld, Stage, at, held, pick, put

names = st.from_regex(r"[A-Za-z][A-Za-z0-9_\-]{0,8}", fullmatch=True)


@st.composite
def faults(draw: st.DrawFn) -> Fault:
    """Any fault, with any of what its kind takes."""
    name = draw(st.sampled_from(sorted(KINDS)))
    kind = KINDS[name]
    way = draw(st.sampled_from(sorted(kind.ways))) if kind.ways else ""
    action = draw(st.none() | st.integers(0 if kind.lasting else 1, 10**6))
    camera = draw(st.none() | names) if name == "camera" else None
    given: dict[str, Any] = {
        key: draw(st.none() | strategy)
        for key, strategy in {
            "item": names,
            "with": names,
            "table": names,
            "share": st.floats(0.0, 1.0),
            "seconds": st.integers(0, 3_600_000).map(lambda thousandths: thousandths / 1000),
            "times": st.integers(1, 10**5),
            "amount": st.integers(0, 1000).map(lambda thousandths: thousandths / 1000),
        }.items()
        if key in kind.keys
    }
    assume(camera not in (*kind.keys, "p"))
    assume(given.get("with") is None or given["with"] != given["item"])
    return Fault(
        name,
        action,
        draw(st.floats(0.0, 1.0)) if action is None else None,
        given.get("item"),
        None if action is None else draw(st.none() | st.integers(action + 1, EVER)),
        way,
        given.get("with"),
        given.get("table"),
        camera,
        given.get("share") if way == "wrong" else None,
        given.get("seconds") if way == "slow" or name in ("shove", "swap") else None,
        given.get("times"),
        given.get("amount") if way in SPOILED else None,
    )


@given(faults())
def test_a_fault_is_read_back_as_it_was_printed(fault: Fault) -> None:
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize(
    ("spec", "fault"),
    [
        ("drop@4", Fault("drop", 4)),
        (" drop:p=0.3 ", Fault("drop", chance=0.3)),
        ("drop: p = .3 , item = lemon", Fault("drop", chance=0.3, item="lemon")),
        ("miss@2", Fault("miss", 2)),
        ("shove@3:item=lemon", Fault("shove", 3, item="lemon")),
        ("miss:p=1", Fault("miss", chance=1.0)),
        ("miss:p=5e-2", Fault("miss", chance=0.05)),
        ("drop@4:item=lemon", Fault("drop", 4, item="lemon")),
        ("drop:item=lemon@4", Fault("drop", 4, item="lemon")),
        ("drop:release@2-5", Fault("drop", 2, until=5, way="release")),
        ("drop@5-5", Fault("drop", 5)),
        ("miss@3-", Fault("miss", 3, until=EVER)),
        (
            "shove:before,item=lemon,table=white-table@1",
            Fault("shove", 1, item="lemon", way="before", table="white-table"),
        ),
        ("swap:item=a,with=b@2", Fault("swap", 2, item="a", other="b")),
        ("camera:front=black@5-8", Fault("camera", 5, until=8, way="black", camera="front")),
        ("camera:frozen,p=0.1", Fault("camera", chance=0.1, way="frozen")),
        ("estimator:wrong,share=0.2@0", Fault("estimator", 0, way="wrong", share=0.2)),
        ("swap:item=lemon,with=soda-can,seconds=2@1", Fault("swap", 1, item="lemon", other="soda-can", seconds=2.0)),
        ("estimator:slow,seconds=0.5@1", Fault("estimator", 1, way="slow", seconds=0.5)),
        ("planner:crash,times=1@0-", Fault("planner", 0, until=EVER, way="crash", times=1)),
        ("motion@3", Fault("motion", 3)),
        ("skill:hang@3", Fault("skill", 3, way="hang")),
    ],
)
def test_what_the_command_line_takes(spec: str, fault: Fault) -> None:
    assert parse_fault(spec) == fault


@pytest.mark.parametrize("name", KINDS)
def test_the_catalogues_examples_are_faults(name: str) -> None:
    assert parse_fault(KINDS[name].example).kind == name


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "it names no kind"),
        ("drp@4", "no kind 'drp', did you mean 'drop'?"),
        ("drop", "say when: drop@4"),
        ("drop@", "the number of an action"),
        ("drop@0", "counted from 1, or a span such as 5-8, not '0'"),
        ("drop@-1", "not '-1'"),
        ("drop@4.5", "not '4.5'"),
        ("drop@٣", "the number of an action"),
        ("drop@4@5", "not '4@5'"),
        ("drop@9999999999", "the number of an action"),
        ("drop:", "nothing after it"),
        ("drop:p=0.3,", "nothing after it"),
        ("drop:p", "p has no value"),
        ("drop:p=", "p has no value"),
        ("drop:p=0.3,p=0.4", "p is given twice"),
        ("drop:p=1.01", "from 0 to 1, not '1.01'"),
        ("drop:p=-0.1", "from 0 to 1"),
        ("drop:p=nan", "from 0 to 1"),
        ("drop:p=1e9", "from 0 to 1"),
        ("drop:p=e-3", "from 0 to 1"),
        ("drop:p=.", "from 0 to 1"),
        ("drop:p=1_0e-2", "from 0 to 1"),
        ("drop:q=0.3", "no argument 'q', valid: grasp, item, p, release, transfer"),
        ("drop:itm=lemon,p=0.1", "did you mean 'item'?"),
        ("drop@4:item=a b", "'a b' is no name of an item"),
        ("drop@4:p=0.3", "and not both"),
        ("drop@4:item=lemon@5", "it says twice when"),
        ("drop@5-4", "actions 5 to 4 are none"),
        ("drop@4-x", "not '4-x'"),
        ("camera:black@0-3-4", "counted from 1 (0: before the first one)"),
        ("drop:grasp,release@4", "both 'grasp' and 'release'"),
        ("drop:grasp=1@4", "no argument 'grasp'"),
        ("camera@4", "say how: black, frozen, blurred, shifted, noisy, dark, no-depth, moved"),
        ("camera:dark,amount=1.5@4", "a number up to 1 (share of the light"),
        ("camera:black,amount=1@4", "amount goes with blurred, noisy, dark"),
        ("camera:front=blak@4", "a camera is no 'blak', did you mean 'black'?"),
        ("camera:frnt=black@4", "no camera 'frnt', did you mean 'front'?"),
        ("camera:front=black,wood=black@4", "both 'black' and 'black'"),
        ("estimator:silent,seconds=3@4", "seconds goes with the way 'slow'"),
        ("estimator:silent,share=0.3@4", "share goes with the way 'wrong'"),
        ("estimator:slow,seconds=4000@4", "a number up to 3600, not '4000'"),
        ("planner:crash,times=0@4", "a whole number from 1, not '0'"),
        ("swap:item=lemon,with=lemon@4", "'with' is another item"),
        ("shove:table=wod@4", "no table 'wod', did you mean 'wood'?"),
        ("shove@3:item=lemmon", "no item 'lemmon', did you mean 'lemon'?"),
    ],
)
def test_a_mistake_is_answered_in_one_line_with_what_would_be_right(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        parse_fault(spec, ["lemon", "milk"], ["wood"], ["front", "wood"])
    line = str(caught.value)
    assert repr(spec) in line
    assert "drop@4" in line
    assert "\n" not in line


@given(
    st.text(max_size=40) | st.from_regex(r"(drop|camera|estimator)[@:,=.\-0-9pitemblackwronseu]{0,16}", fullmatch=True)
)
def test_any_text_is_a_fault_or_bad_input(text: str) -> None:
    try:
        fault = parse_fault(text)
    except InputError:
        return
    assert parse_fault(str(fault)) == fault


STEPS = (pick("lemon", "p"), put("lemon", "q"), pick("milk", "p"), put("milk", "q"))


class Play:
    """Actions as the loop would announce them, on a world whose clock is moved by hand."""

    def __init__(self, *specs: str, seed: int = 0) -> None:
        self.world = FakeWorld({"lemon": "hand", "milk": "p"}, ["p", "q", "r"])
        self.injector = FaultInjector([parse_fault(spec) for spec in specs], self.world, seed)
        self.reports: list[tuple[float, FaultInjected]] = []
        self.injector.begin(self.report)

    def report(self, fault: FaultInjected) -> None:
        self.reports.append((self.world.time, fault))

    def act(self, action: int, transfer: float = 10.0, passes: float = 10.0) -> list[tuple[float, FaultInjected]]:
        """One action, of which `passes` seconds of its transfer happen; the faults with the time into the transfer."""
        step, before = STEPS[(action - 1) % 4], len(self.reports)
        self.injector.before_action(action, step)
        self.world.advance(5.0)
        start = self.world.time
        for name, seconds in (("approach", 5.0), ("transfer", transfer), ("transfer", transfer)):
            self.injector.on_phase(action, step, Phase(name, seconds=seconds))
        self.world.advance(passes)
        self.injector.after_action(action, step)
        return [(time - start, fault) for time, fault in self.reports[before:]]


def test_a_drop_happens_once_in_mid_transfer_of_its_action() -> None:
    play = Play("drop@2")
    assert play.act(1) == []
    ((time, fault),) = play.act(2)
    assert 2.5 <= time <= 7.5
    assert (fault.kind, fault.spec, fault.action) == ("drop", "drop@2", 2)
    assert fault.detail.startswith("lemon went to ")
    assert play.act(3) == []


def test_a_drop_never_outlives_its_action() -> None:
    play = Play("drop@1")
    assert play.act(1, passes=1.0) == []
    assert play.act(2, passes=100.0) == []
    assert play.world.held == "lemon"


def test_a_miss_is_prepared_before_the_action_and_a_shove_follows_it() -> None:
    play = Play("miss@1", "shove@2:item=milk")
    ((time, miss),) = play.act(1)
    assert (time, miss.kind, play.world.missing) == (-5.0, "miss", True)
    ((time, shove),) = play.act(2)
    assert (time, shove.kind, shove.detail) == (10.0, "shove", f"milk went to {play.world.where['milk']}")
    assert play.world.where["milk"] != "p"


def test_an_item_picks_the_actions_that_have_to_do_with_it() -> None:
    play = Play("miss:p=1,item=milk")
    assert [len(play.act(action)) for action in range(1, 9)] == [0, 0, 1, 1, 0, 0, 1, 1]
    assert len(Play("miss@1:item=milk").act(1)) == 0


@given(st.integers(0, 2**63), st.lists(st.sampled_from(["drop:p=0.4", "miss:p=0.4", "shove:p=0.4"]), max_size=3))
def test_the_same_seed_breaks_the_same_actions_whatever_happened_before(seed: int, specs: list[str]) -> None:
    def struck(play: Play, actions: list[int]) -> set[tuple[int, str]]:
        return {(action, fault.spec) for action in actions for _, fault in play.act(action)}

    whole, part = Play(*specs, seed=seed), Play(*specs, seed=seed)
    part.world.advance(3.0)
    assert struck(part, [5, 6, 8]) == {hit for hit in struck(whole, list(range(1, 9))) if hit[0] in (5, 6, 8)}


def test_chance_comes_as_often_as_it_should_and_differs_from_fault_to_fault() -> None:
    play = Play("miss:p=0.3", "miss:p=0.3", seed=5)
    hits: Counter[int] = Counter()
    both = 0
    for action in range(1, 1001):
        count = len(play.act(action))
        hits[count] += 1
        both += count == 2
    struck = hits[1] + 2 * hits[2]
    assert 520 <= struck <= 680, "600 expected, standard deviation 20"
    assert 60 <= both <= 120, "independent faults coincide in 9 % of actions"
    assert sum(len(Play("miss:p=0", seed=1).act(action)) for action in range(1, 100)) == 0


def test_an_argument_that_the_world_does_not_know_is_bad_input() -> None:
    with pytest.raises(InputError, match="no thing 'pear'"):
        Play("shove@1:item=pear").act(1)


def test_where_in_an_action_a_drop_strikes() -> None:
    """As the item leaves its place, in the middle of the transfer, or while it is lowered."""
    for way, window in (("grasp", (5.5, 6.4)), ("transfer", (6.25, 7.75)), ("release", (8.75, 9.25))):
        for seed in range(20):
            play, step = Play(f"drop:{way}@1", seed=seed), pick("lemon", "p")
            play.injector.before_action(1, step)
            for name, seconds in (
                ("approach", 5.0),
                ("grip", 0.5),
                ("transfer", 3.0),
                ("lower", 1.0),
                ("release", 0.5),
            ):
                play.injector.on_phase(1, step, Phase(name, seconds=seconds))
                play.world.advance(seconds)
            play.injector.after_action(1, step)
            ((time, fault),) = play.reports
            assert window[0] <= time <= window[1]
            assert fault.detail.startswith("lemon went to ")


def test_who_goes_about_in_the_robots_world_comes_before_or_after_the_action() -> None:
    asked: list[tuple[str, dict[str, str]]] = []

    class Patient(FakeWorld):
        def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
            asked.append((kind, arguments))
            return "done"

    specs = ["swap:item=lemon,with=milk@1", "take:before@1", "push:item=milk@2", "block:table=q,p=1", "tip@1-2"]
    injector = FaultInjector([parse_fault(spec) for spec in specs], Patient({"lemon": "p", "milk": "p"}, ["p", "q"]))
    told: list[FaultInjected] = []
    injector.begin(told.append)
    injector.before_action(1, pick("lemon", "p"))
    assert asked == [("take", {})]
    injector.after_action(1, pick("lemon", "p"))
    assert asked[1:] == [("swap", {"item": "lemon", "with": "milk"}), ("block", {"table": "q"}), ("tip", {})]
    injector.before_action(2, put("lemon", "q"))
    injector.after_action(2, put("lemon", "q"))
    assert [kind for kind, _ in asked[4:]] == ["push", "block", "tip"]
    assert [fault.action for fault in told] == [1, 1, 1, 1, 2, 2, 2]


# Between the executive and its parts.

GREY = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)


def seen(world: FakeWorld) -> Image:
    """A picture that changes as time goes by."""
    return np.roll(GREY, int(world.time), axis=0)


def played(stage: Stage, *specs: str, seed: int = 0) -> Ended:
    """The stage's run, with faults between the executive and all of its parts."""
    return broken(stage, *specs, seed=seed).run()


def broken(stage: Stage, *specs: str, seed: int = 0) -> Executive:
    faults = FaultInjector([parse_fault(spec) for spec in specs], stage.world, seed)
    return make_executive(
        stage.task,
        faulty_planner(stage.planner, faults),
        faulty_world(stage.world, faults),
        faulty_skills({"pick": stage.skill, "place": stage.skill}, faults),
        faulty_estimator(stage.estimator, faults),
        [stage.recorder],
        stage.settings,
        faults,
        monitor=stage.monitor,
    )


def one_thing() -> Stage:
    return Stage(Facts({at("a", "q"): True}), {"a": "p"})


def injected(stage: Stage) -> list[tuple[str, int]]:
    return [(fault.spec, fault.action) for fault in stage.recorder.of(FaultInjected)]


@pytest.mark.parametrize("way", [way for way in KINDS["camera"].ways if way not in ("no-depth", "moved")])
def test_a_camera_fails_in_its_span_and_no_longer(way: str) -> None:
    world = FakeWorld({"a": "p"}, ["p"])
    world.cameras = {"front": seen, "side": seen}
    faults = FaultInjector([parse_fault(f"camera:front={way}@1-2")], world)
    reports: list[FaultInjected] = []
    faults.begin(reports.append)
    through = faulty_world(world, faults)
    pictures = []
    for action in range(4):
        if action:
            world.advance(3.0)
            faults.before_action(action, pick("a", "p"))
        for _ in range(2):
            images = through.observe().images
            assert np.array_equal(images["side"], seen(world))
        pictures.append((images["front"], seen(world)))
    assert [np.array_equal(shown, real) for shown, real in pictures] == [True, False, False, True]
    assert [(report.action, report.detail) for report in reports] == [(1, f"front: {way}"), (2, f"front: {way}")]
    (before, _), (shown, real), (later, _), _ = pictures
    match way:
        case "black":
            assert not shown.any()
        case "frozen":
            assert np.array_equal(shown, before)
            assert np.array_equal(later, before)
        case "dark":
            assert float(shown.mean()) < 0.5 * float(real.mean())
        case "blurred":
            assert float(shown.std()) < 0.5 * float(real.std())
        case "shifted":
            margin = 10  # px; it shifts by at most 9
            offsets = [
                (down, right)
                for down in range(-margin, margin + 1)
                for right in range(-margin, margin + 1)
                if np.array_equal(
                    shown[margin:-margin, margin:-margin],
                    np.roll(real, (down, right), (0, 1))[margin:-margin, margin:-margin],
                )
            ]
            assert len(offsets) == 1
            assert 0.07 * 60 <= np.hypot(*offsets[0]) <= 0.16 * 60


def rising(world: FakeWorld) -> DepthImage:
    """The distances of a wall that stands askew, and recedes as time passes."""
    return np.add.outer(np.arange(40), 500 + 10 * np.arange(60)).astype(np.uint16) + np.uint16(world.time)


@pytest.mark.parametrize("way", KINDS["camera"].ways)
def test_depth_fails_with_its_camera(way: str) -> None:
    world = FakeWorld({"a": "p"}, ["p"])
    world.cameras = {"front": seen, "side": seen}
    world.measured = {"front": rising}
    faults = FaultInjector([parse_fault(f"camera:{way}@1")], world)
    faults.begin(lambda _: None)
    through = faulty_world(world, faults)
    before = through.observe().depth["front"]
    world.advance(3.0)
    faults.before_action(1, pick("a", "p"))
    now = through.observe().depth
    if way in ("black", "no-depth"):
        assert not now
    elif way == "frozen":
        assert np.array_equal(now["front"], before)
    elif way == "shifted":
        lost = (now["front"] == 0).mean()
        assert 0.05 < lost < 0.4, "what is past the border is not measured"
    else:
        assert np.array_equal(now["front"], rising(world)), "only the picture is spoiled"
    world.advance(3.0)
    faults.before_action(2, pick("a", "p"))
    assert np.array_equal(through.observe().depth["front"], rising(world))


class Shelf(FakeWorld):
    """A world whose cameras can be moved."""

    def __init__(self) -> None:
        super().__init__({"a": "p"}, ["p"])
        self.cameras = {"front": seen, "side": seen}
        self.moves: list[tuple[str, float]] = []
        self.now_moved: set[str] = set()

    def scenery(self) -> Scenery:
        return Scenery((), tuple(Camera(name, (0.0,) * 7, 1.0, 60, 40) for name in self.cameras))

    def move_camera(self, camera: str, by: FloatArray) -> None:
        away = float(np.linalg.norm(by))
        self.moves.append((camera, away))
        (self.now_moved.add if away else self.now_moved.discard)(camera)

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        assert self.now_moved == self.expected
        return super().observe(cause, cameras)

    expected: frozenset[str] = frozenset()


def test_a_camera_that_was_moved_stands_elsewhere_while_it_looks_and_no_longer() -> None:
    world = Shelf()
    reports: list[FaultInjected] = []
    faults = FaultInjector([parse_fault("camera:front=moved@1")], world)
    faults.begin(reports.append)
    through, sensed = faulty_world(world, faults), faulty_sensing(world, world.observe, faults)
    through.observe()
    faults.before_action(1, pick("a", "p"))
    world.expected = frozenset({"front"})
    through.observe()
    sensed()
    assert not world.now_moved
    away = [length for _, length in world.moves if length]
    assert {camera for camera, _ in world.moves} == {"front"}
    assert all(0.01 <= length <= 0.03 for length in away)
    assert len(set(away)) == 1, "it stays where it was moved to"
    assert [report.detail for report in reports] == ["front: moved"]
    faults.before_action(2, pick("a", "p"))
    world.expected = frozenset()
    through.observe()


def test_a_camera_that_measures_no_depth_shows_its_picture_and_is_reported_where_it_measured_any() -> None:
    world = FakeWorld({"a": "p"}, ["p"])
    world.cameras = {"front": seen, "side": seen}
    world.measured = {"front": rising}
    reports: list[FaultInjected] = []
    faults = FaultInjector([parse_fault("camera:no-depth@0")], world)
    faults.begin(reports.append)
    look = faulty_world(world, faults).observe()
    assert np.array_equal(look.images["front"], seen(world))
    assert not look.depth
    assert [report.detail for report in reports] == ["front: no-depth"]


def test_a_run_that_sees_through_another_camera_or_through_none() -> None:
    stage = one_thing()
    stage.world.cameras = {"front": seen, "side": seen}
    assert played(stage, "camera:front=black@0-").outcome is OutcomeKind.GOAL_REACHED
    assert [blinded.camera for blinded in stage.recorder.of(Blinded)] == ["front"]
    assert injected(stage) == [("camera:front=black@0-", action) for action in (0, 1, 2)]
    stage = one_thing()
    stage.world.cameras = {"front": seen}
    assert played(stage, "camera:black@1-").outcome is OutcomeKind.GAVE_UP
    assert {action for _, action in injected(stage)} == {1}


def test_an_estimator_is_silent_or_wrong_about_what_it_is_asked() -> None:
    stage = one_thing()
    assert played(stage, "estimator:wrong,times=1@1").outcome is OutcomeKind.GOAL_REACHED
    assert injected(stage) == [("estimator:wrong,times=1@1", 1)]
    asked = stage.recorder.of(Belief)
    assert asked[1].probability == {atom: 1.0 - value for atom, value in asked[2].probability.items()}
    stage = one_thing()
    assert played(stage, "estimator:silent@1").outcome is OutcomeKind.GAVE_UP
    assert all(not belief.probability for belief in stage.recorder.of(Belief)[1:])


def test_what_is_wrong_about_an_item_is_drawn_atom_by_atom_and_look_by_look() -> None:
    world = FakeWorld({"a": "p", "b": "q"}, ["p", "q"])
    atoms = [at("a", "p"), at("a", "q"), at("b", "p"), at("b", "q"), held("a"), held("b"), Atom("free")]

    class Sure:
        name = "sure"

        def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
            return Belief(observation.id, dict.fromkeys(atoms, 0.9), source=self.name)

    def wrong(spec: str, asked: Sequence[Atom], looks: int) -> list[set[Atom]]:
        faults = FaultInjector([parse_fault(spec)], world, 3)
        faults.begin(lambda _: None)
        eye = faulty_estimator(Sure(), faults)
        beliefs = [eye.estimate(world.observe(), asked) for _ in range(looks)]
        return [{atom for atom, value in belief.probability.items() if value < 0.5} for belief in beliefs]

    assert wrong("estimator:wrong,item=b@0", atoms, 2) == [{at("b", "p"), at("b", "q"), held("b")}] * 2
    drawn = wrong("estimator:wrong,share=0.5@0", atoms, 40)
    assert 100 <= sum(map(len, drawn)) <= 180, "140 expected, standard deviation 8"
    assert len(set(map(frozenset, drawn))) > 20
    assert wrong("estimator:wrong,share=0.5@0", atoms[:3], 1)[0] == drawn[0] & set(atoms[:3])


def test_an_estimator_that_asks_in_words_still_does() -> None:
    class Wordy:
        name = "wordy"
        questions = Questions({at("a", "p"): "Is a on p?"}, "", "templates")

        def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
            return Belief(observation.id, {}, frozenset(atoms), self.name)

    stage = one_thing()
    wordy: Estimator = Wordy()
    faults = FaultInjector([], stage.world)
    wrapped = faulty_estimator(wordy, faults)
    assert isinstance(wrapped, Asking)
    assert wrapped.questions is Wordy.questions
    assert wrapped.name == "wordy"
    assert not isinstance(faulty_estimator(stage.estimator, faults), Asking)


def test_answers_come_late(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("executive.faults.wrappers.time.sleep", slept.append)
    stage = one_thing()
    assert played(stage, "estimator:slow@1", "estimator:slow,seconds=7.5@2").outcome is OutcomeKind.GOAL_REACHED
    assert (slept[0], slept[-1]) == (2.0, 7.5)
    assert injected(stage) == [("estimator:slow@1", 1), ("estimator:slow,seconds=7.5@2", 2)]


def test_a_planner_that_has_no_answer_once_and_one_that_never_has() -> None:
    for way, reason in (("crash", "crashed"), ("timeout", "timed out")):
        stage = one_thing()
        assert played(stage, f"planner:{way},times=1@0").outcome is OutcomeKind.GOAL_REACHED
        assert [str(answer.reason) for answer in stage.recorder.of(NoPlan)] == [reason]
        stage = one_thing()
        assert played(stage, f"planner:{way}@0").outcome is OutcomeKind.NO_PLAN
        assert injected(stage) == [(f"planner:{way}@0", 0)]


def test_a_skill_that_finds_no_motion_and_one_that_raises() -> None:
    stage = one_thing()
    assert played(stage, "motion@1").outcome is OutcomeKind.GOAL_REACHED
    assert stage.recorder.of(SkillResult)[0].status is SkillStatus.NO_PATH
    stage = one_thing()
    ended = played(stage, "skill:raise,item=a@2")
    assert (ended.outcome, ended.actions) == (OutcomeKind.CRASHED, 2)
    assert injected(stage) == [("skill:raise,item=a@2", 2)]


def test_a_skill_that_hangs_stops_when_it_is_told_to() -> None:
    stage = one_thing()
    executive = broken(stage, "skill:hang@2")
    threading.Timer(0.05, executive.cancel).start()
    assert executive.run().outcome is OutcomeKind.INTERRUPTED
    assert [result.status for result in stage.recorder.of(SkillResult)] == [SkillStatus.DONE, SkillStatus.CANCELLED]


def test_nothing_to_break_changes_nothing() -> None:
    with_faults, without = one_thing(), one_thing()
    played(with_faults), without.play()
    assert [step.step for step in with_faults.recorder.of(Dispatched)] == [
        step.step for step in without.recorder.of(Dispatched)
    ]


# In a file.


def test_the_same_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text('faults = ["drop:p=0.3", "camera:front=black@5-8"] # both\n')
    assert read_faults(file) == ("drop:p=0.3", "camera:front=black@5-8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "faults: a list of faults"),
        ("faults = 3", "faults: a list of faults"),
        ("faults = [3]", "faults[0]: a fault in quotes"),
        ('faults = ["drop@1", "drp@4"]', "faults[1]: fault 'drp@4': no kind 'drp'"),
        ('faults = ["drop@1"', "is not TOML"),
        ('fault = ["drop@1"]', "fault: unknown key; did you mean 'faults'?"),
        ("faults = " + "[" * 100_000, "is not TOML"),
        ("faults = []" + " " * 1_000_000, "has more than 1,000,000 bytes"),
        ("\ud800", "is not UTF-8 text"),
    ],
)
def test_a_mistake_in_a_file_is_named_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "faults.toml"
    file.write_bytes(text.encode(errors="surrogatepass"))
    with pytest.raises(InputError, match=re.escape(f"faults.toml: {message}")):
        read_faults(file)
    with pytest.raises(InputError, match="cannot be read"):
        read_faults(tmp_path)
