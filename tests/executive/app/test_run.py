"""Whole runs on the real stack: planner, simulator, motions and trace, with the oracle for an eye. What they are to get
right is in `test_scenarios_simulated`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from executive.app.run import Run, RunConfig
from executive.errors import DomainError, InputError
from executive.protocols import Skill
from executive.sim.truth import Truth
from executive.trace.record.log import read_events
from executive.types import Atom, Belief, Compared, Decision, Ended, Facts, Observation, Plan, SkillResult, SkillStatus
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

    def prepare(domain: Path = GROCERY, vlm: Any = None, **options: Any) -> tuple[Run, Recorder]:
        recorder = Recorder()
        config = replace(RunConfig(str(domain), estimator="oracle", runs=tmp_path / "runs", viewer=False), **options)
        made.append(Run(config, [recorder], vlm))
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
    assert summary["outcome"] == "plan-completed"
    assert (summary["goal_seen"], summary["goal_true"]) == (False, False)


def test_another_domain_of_cubes_and_a_tray(prepared: Prepared) -> None:
    run, seen = prepared(TRAY)
    summary = run.execute()
    assert (summary["outcome"], summary["goal_true"], summary["actions"]) == ("goal-reached", True, 4)
    assert steps(seen)[0][0] == "lift(green-cube,bench)"


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

    run, seen = prepared(problem="one-item", vlm=Scripted())
    monkeypatch.setattr(Truth, "of", forbidden)  # before, the stage was set and checked
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
        with pytest.raises(InputError, match=r"^grasp_noise: "):
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

    monkeypatch.setattr("executive.app.run.FaultInjector", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Run(RunConfig(str(GROCERY), problem="one-item", estimator="oracle", runs=tmp_path / "runs", viewer=False))
    assert list((tmp_path / "runs").iterdir()) == []
