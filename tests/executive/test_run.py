"""Whole runs on the real stack: planner, simulator, motions and trace, with the oracle for an eye.

The numbers of the scenarios are those of the project's list; those marked there for the simulator are here.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from executive.assemble import Run, RunConfig
from executive.errors import DomainError, InputError
from executive.loop import Executive
from executive.protocols import Planner, Skill, SkillContext
from executive.sim.truth import Truth
from executive.trace.events import read_events
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Facts,
    FaultInjected,
    Judged,
    Looked,
    LookKind,
    NoPlan,
    Observation,
    Plan,
    Revised,
    SkillResult,
    SkillStatus,
    Step,
)
from tests.executive.sim.stage import ROOT
from tests.fakes import Recorder

GROCERY = ROOT / "domains" / "grocery"
TRAY = ROOT / "tests" / "domains" / "tray"
T = TypeVar("T")
Prepared = Callable[..., tuple[Run, Recorder]]


@pytest.fixture
def prepared(tmp_path: Path) -> Iterator[Prepared]:
    """Puts a run together in a folder of its own, without the viewer's file unless that is asked for."""
    made: list[Run] = []

    def prepare(domain: Path = GROCERY, seeing: Any = None, **options: Any) -> tuple[Run, Recorder]:
        recorder = Recorder()
        config = replace(RunConfig(str(domain), estimator="oracle", runs=tmp_path / "runs", viewer=False), **options)
        made.append(Run(config, [recorder], seeing))
        return made[-1], recorder

    yield prepare
    for run in made:
        run.world.close()


def of(recorder: Recorder, kind: type[T]) -> list[T]:
    return [event.payload for event in recorder.events if isinstance(event.payload, kind)]


def steps(recorder: Recorder) -> list[list[str]]:
    return [[str(step) for step in plan.steps] for plan in of(recorder, Plan)]


def statuses(recorder: Recorder) -> list[SkillStatus]:
    return [result.status for result in of(recorder, SkillResult)]


def on_the_floor(run: Run, item: str) -> None:
    start = run.world.model.joint(f"{item}/free").qposadr[0]
    run.world.data.qpos[start : start + 3] = [1.4, 0.9, 0.2]
    run.world.settle(0.5)


def test_example_1_of_the_paper(prepared: Prepared) -> None:
    """Scenario 4, and 3: the cereal is dropped, lands on another table, and the second plan fetches it from there."""
    run, seen = prepared(problem="breakfast", faults=("drop@4",))
    summary = run.execute()
    assert steps(seen) == [
        [
            "pick(milk-carton,black-table)",
            "place(milk-carton,white-table)",
            "pick(cereal-box,wood-table)",
            "place(cereal-box,white-table)",
        ],
        ["pick(cereal-box,black-table)", "place(cereal-box,white-table)"],
    ]
    dropped = of(seen, SkillResult)[3]
    assert dropped.status is SkillStatus.DROPPED
    assert dropped.planned_seconds - dropped.seconds > 0.5  # what ending early saved
    changed = of(seen, Revised)[0].changed
    assert changed == Facts.parse("on-table(cereal-box,black-table)", "not on-table(cereal-box,white-table)")
    assert (summary["outcome"], summary["goal_seen"], summary["goal_true"]) == ("goal-reached", True, True)
    assert summary["replans"] == 1
    assert [fault["action"] for fault in summary["faults"]] == [4]


def test_the_same_seed_repeats_decisions_and_poses_and_leaves_a_whole_trace(prepared: Prepared) -> None:
    ends, told = [], []
    for name in ("first", "second"):
        run, seen = prepared(seed=2, problem="breakfast", faults=("drop:p=0.4", "shove@2"), name=name)
        summary = run.execute()
        ends.append(run.world.data.qpos.copy())
        told.append([(e.cycle, e.time, e.payload) for e in seen.events if isinstance(e.payload, Compared | Decision)])
        assert json.loads((run.folder / "summary.json").read_text()) == summary
        assert [type(event.payload) for event in read_events(run.folder)][-1] is Ended
        assert (run.folder / "config.toml").read_text().count("drop:p=0.4") == 1
    assert told[0] == told[1]
    assert np.array_equal(*ends)


def test_blind_baseline_carries_on_and_is_wrong_about_it(prepared: Prepared) -> None:
    run, seen = prepared(problem="breakfast", faults=("drop@4",), estimator="none")
    summary = run.execute()
    assert len(of(seen, Observation)) == 0
    assert (summary["actions"], summary["replans"], summary["looks"]) == (4, 0, 0)
    assert (summary["goal_seen"], summary["goal_true"]) == (False, False)


def test_another_domain_of_cubes_and_a_tray(prepared: Prepared) -> None:
    run, seen = prepared(TRAY)
    summary = run.execute()
    assert (summary["outcome"], summary["goal_true"], summary["actions"]) == ("goal-reached", True, 4)
    assert steps(seen)[0][0] == "lift(green-cube,bench)"


def test_01_and_05_a_missed_grasp_is_a_failure_and_is_tried_again(prepared: Prepared) -> None:
    run, seen = prepared(problem="one-item", faults=("miss@1",), seed=1)
    summary = run.execute()
    first, second = of(seen, Dispatched)[:2]
    assert statuses(seen)[0] is SkillStatus.GRASP_MISSED
    assert first.step == second.step
    assert summary["goal_true"]


def test_02_a_skill_that_claims_what_it_did_not_do(prepared: Prepared) -> None:
    run, seen = prepared(problem="one-item", faults=("miss@1",), seed=1)
    honest = run.executive.skills["pick"]

    def boastful(step: Step, context: SkillContext) -> SkillResult:
        return replace(honest(step, context), status=SkillStatus.DONE, reason="")

    run.executive.skills = {**run.executive.skills, "pick": boastful}
    summary = run.execute()
    assert statuses(seen)[0] is SkillStatus.DONE
    effects = next(compared for compared in of(seen, Compared) if compared.what == "effects")
    assert Atom.parse("robot-gripping(lemon)") in effects.verdict.violated
    assert summary["goal_true"]


def test_07_the_world_changes_between_planning_and_the_first_dispatch(prepared: Prepared) -> None:
    run, seen = prepared(problem="one-item")
    planner, world = run.executive.planner, run.world

    class Distracted(Planner):
        """Somebody moves the lemon to the white table while it plans for the first time."""

        planned = 0

        def plan(self, state: Facts, goal: Facts) -> Plan | NoPlan:
            found = planner.plan(state, goal)
            self.planned += 1
            for index in range(50 if self.planned == 1 else 0):
                if world.disturb("shove", np.random.default_rng(index), item="lemon").endswith("white-table"):
                    break
            return found

    run.executive.planner = Distracted()
    summary = run.execute()
    assert statuses(seen)[0] is SkillStatus.NOT_THERE
    assert steps(seen)[-1][0] == "pick(lemon,white-table)"
    assert summary["goal_true"]


def test_09_and_19_what_never_works_ends_with_a_name(prepared: Prepared) -> None:
    def hopeless(step: Step, context: SkillContext) -> SkillResult:
        return SkillResult(step, SkillStatus.NO_PATH, "no collision-free motion")

    run, seen = prepared(problem="one-item")
    run.executive.skills = {**run.executive.skills, "pick": hopeless}
    summary = run.execute()
    assert summary["outcome"] == "gave-up"
    assert summary["unreached"] == ["on-table(lemon,wood-table)"]
    assert summary["actions"] < 15
    assert "no collision-free motion" in of(seen, Ended)[0].reason


def test_13_what_cannot_be_seen_for_a_while_keeps_its_last_value_and_grows_old(prepared: Prepared) -> None:
    """Neither the oracle's answer nor what an action was to do stands in for a look."""
    run, seen = prepared(problem="breakfast", faults=("estimator:silent,item=cereal-box@1-2",))
    summary = run.execute()
    assert (summary["outcome"], summary["goal_true"], summary["replans"]) == ("goal-reached", True, 0)
    # That it is not in the hand follows from what is.
    hidden = {atom for atom in run.domain.task.atoms if "cereal-box" in atom.args and atom.predicate == "on-table"}
    judged = {judgement.observation_id: judgement for judgement in of(seen, Judged)}
    blind = [judged[belief.observation_id] for belief in of(seen, Belief) if belief.unanswered >= hidden]
    assert not any(judgement.seen.keys() & hidden for judgement in blind)
    assert {judgement.remembered[atom].age for judgement in blind for atom in hidden} == {1, 2}


def test_26_a_camera_that_goes_black_is_left_out_and_nothing_else_changes(prepared: Prepared) -> None:
    run, seen = prepared(problem="one-item", faults=("camera:front=black@1-2",))
    summary = run.execute()
    assert (summary["outcome"], summary["actions"], summary["replans"]) == ("goal-reached", 2, 0)
    (blinded,) = of(seen, Blinded)
    assert blinded.camera == "front"
    looks = [look for look in of(seen, Looked) if look.kind is LookKind.FULL]
    assert ["front" in look.cameras for look in looks] == [True, False, False]


def test_17_a_goal_that_holds_already_needs_no_action(prepared: Prepared) -> None:
    run, _ = prepared(problem="one-item")
    assert run.execute()["goal_true"]
    parts, again = run.executive, Recorder()
    ended = Executive(run.domain.task, parts.planner, run.world, parts.skills, parts.estimator, [again]).run()
    assert (ended.goal_seen, ended.actions) == (True, 0)
    assert steps(again) == [[]]


def test_18_and_27_what_has_nothing_to_do_with_the_plan_changes_nothing(prepared: Prepared) -> None:
    run, seen = prepared(problem="breakfast", faults=("shove@1:item=bread-loaf", "shove@3:item=lemon"), seed=4)
    summary = run.execute()
    assert len(of(seen, FaultInjected)) == 2
    assert (summary["replans"], summary["goal_true"], summary["actions"]) == (0, True, 4)


def test_20_cancelled_in_the_middle_of_a_skill(prepared: Prepared) -> None:
    run, seen = prepared(problem="one-item")
    run.world.schedule(1.5, run.cancel)
    summary = run.execute()
    assert summary["outcome"] == "interrupted"
    assert statuses(seen) == [SkillStatus.CANCELLED]
    assert np.abs(run.world.data.qvel[:6]).max() < 0.05
    assert isinstance(seen.events[-1].payload, Ended)


def test_25_what_lies_on_the_floor_costs_its_own_goal_alone(prepared: Prepared) -> None:
    run, seen = prepared(problem="breakfast")
    on_the_floor(run, "cereal-box")
    summary = run.execute()
    assert summary["outcome"] == "partial"
    assert summary["unreached"] == ["on-table(cereal-box,white-table)"]
    milk = Atom.parse("on-table(milk-carton,white-table)")
    assert run.truth.of([milk])[milk]
    assert any(decision.kind is DecisionKind.GIVE_UP_GOAL for decision in of(seen, Decision))


def test_the_loop_never_asks_for_the_truth(prepared: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the truth made to raise, an eye that reads a script from pictures alone carries the run to its end."""
    script = iter(
        [
            Facts.parse("on-table(lemon,black-table)", "robot-gripper-empty()"),
            Facts.parse("robot-gripping(lemon)"),
            Facts.parse("on-table(lemon,wood-table)", "robot-gripper-empty()"),
            Facts.parse("on-table(lemon,wood-table)", "robot-gripper-empty()"),
        ]
    )

    class Scripted:
        name = "scripted"

        def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
            assert observation.images
            if len(atoms) == 1:  # is what is carried still held?
                return Belief.certain({atoms[0]: True}, observation.id, self.name)
            return Belief.certain(Facts.closed(next(script).true, atoms), observation.id, self.name)

    def forbidden(*_: object) -> Facts:
        raise AssertionError("the truth is not for the robot")

    monkeypatch.setattr(Truth, "of", forbidden)
    run, seen = prepared(problem="one-item", seeing=Scripted())
    ended = run.executive.run()
    assert ended.goal_seen
    assert statuses(seen) == [SkillStatus.DONE, SkillStatus.DONE]


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("domain.toml", 'skill = "pick"', 'skill = "pik"', ": actions.pick.skill: no skill 'pik'"),
        ("domain.toml", 'relation = "on"', 'relation = "onto"', ": predicates.on-table.relation: no relation 'onto'"),
        (
            "domain.toml",
            'relation = "gripper-empty"',
            'relation = "gripping"',
            "domain.toml: predicates.robot-gripper-empty",
        ),
        ("domain.toml", "[world]", "[wrld]", "domain.toml"),
        ("domain.pddl", ":precondition (robot-gripping", ":precondition (robot-griping", "domain.pddl"),
        ("scene.toml", 'name = "lemon"', 'name = "lime"', "scene.toml: item: the problem's object 'lemon' has no body"),
        ("scene.toml", "reach = ", "raech = ", "scene.toml: robot.raech"),
        ("scene.toml", "", None, "scene.toml"),
        ("domain.pddl", "", None, "domain.pddl"),
    ],
)
def test_a_broken_domain_folder_is_one_line_with_file_and_key(
    tmp_path: Path, file: str, old: str, new: str | None, words: str
) -> None:
    folder = tmp_path / "grocery"
    shutil.copytree(GROCERY, folder)
    if new is None:
        (folder / file).unlink()
    else:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))
    with pytest.raises(DomainError) as caught:
        Run(RunConfig(str(folder), estimator="oracle", runs=tmp_path / "runs", viewer=False))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "runs").exists()


def test_wrong_configurations_say_what_is_valid(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'oracle'"):
        RunConfig("grocery", estimator="orakle")
    with pytest.raises(InputError, match="no folder name"):
        RunConfig("grocery", name="../elsewhere")
    with pytest.raises(InputError, match="drop"):
        Run(RunConfig("grocery", faults=("drp@3",), runs=tmp_path))
    with pytest.raises(InputError, match="no item 'wood-table'"):
        Run(RunConfig("grocery", faults=("shove@3:item=wood-table",), runs=tmp_path))
    for noise in (-0.1, float("inf"), float("nan")):
        with pytest.raises(InputError, match="--grasp-noise: "):
            RunConfig("grocery", grasp_noise=noise)
    skill: Skill = Run(
        RunConfig("grocery", estimator="oracle", name="once", runs=tmp_path, viewer=False)
    ).executive.skills["pick"]
    assert callable(skill)
    with pytest.raises(InputError, match="there is a run of this name already"):
        Run(RunConfig("grocery", estimator="oracle", name="once", runs=tmp_path, viewer=False))


def test_a_run_that_never_began_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("executive.assemble.load_skills", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Run(RunConfig(str(GROCERY), problem="one-item", estimator="oracle", runs=tmp_path / "runs", viewer=False))
    assert list((tmp_path / "runs").iterdir()) == []
