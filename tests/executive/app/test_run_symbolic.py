"""Whole runs in the symbolic world: the same loop, faults, trace and summary, without a simulator."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from executive import cli
from executive.app.run import Run, RunConfig, resume
from executive.errors import InputError
from executive.replay import compare_run
from executive.symbolic.truth import SymbolicTruth
from executive.trace.record.log import read_events
from executive.types import Compared, Decision, Dispatched, Facts, FaultInjected, OutcomeKind
from tests.executive.symbolic import crates
from tests.executive.symbolic.couriers import PROBLEM, write
from tests.fakes import Recorder


@pytest.fixture
def config(tmp_path: Path) -> RunConfig:
    domain, problem = write(tmp_path)
    return RunConfig(str(domain), str(problem), seed=2, runs=tmp_path / "runs", viewer=False)


def troubled(config: RunConfig, **options: object) -> RunConfig:
    return replace(config, **{"no_effect": 0.2, "exogenous": 0.1, "flip": 0.05, **options})  # type: ignore[arg-type]


def test_a_pair_of_files_is_played_in_the_symbolic_world_and_the_seed_repeats_it(config: RunConfig) -> None:
    told = []
    for name in ("first", "second"):
        seen = Recorder()
        with Run(troubled(config, name=name), [seen]) as run:
            summary = run.execute()
        assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
        assert summary["estimator"] == "oracle, 0.05 flipped"
        assert {fault["kind"] for fault in summary["faults"]} <= {"no-effect", "exogenous"}
        assert summary["faults"], "this seed has some"
        assert json.loads((run.folder / "summary.json").read_text()) == summary
        told.append([(e.cycle, e.time, e.payload) for e in seen.events if isinstance(e.payload, Compared | Decision)])
    assert told[0] == told[1]


def test_the_loop_never_asks_for_the_truth(config: RunConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> Facts:
        raise AssertionError("the truth is not for the robot")

    with Run(troubled(config)) as run:
        monkeypatch.setattr(SymbolicTruth, "of", forbidden)
        assert run.executive.run().goal_seen


def test_without_trouble_it_is_done_as_planned_and_blind_as_well(config: RunConfig) -> None:
    for estimator, outcome in (("oracle", OutcomeKind.GOAL_REACHED), ("none", OutcomeKind.PLAN_COMPLETED)):
        with Run(replace(config, estimator=estimator)) as run:
            summary = run.execute()
        assert (summary["outcome"], summary["goal_true"], summary["actions"]) == (outcome, True, 8)


def test_at_least_three_items_in_the_crate(tmp_path: Path) -> None:
    """Numbers in the closed loop: estimated, believed as a distribution, expected, planned with and claimed."""
    domain, problem = map(str, crates.write(tmp_path))
    for seed in range(6):
        config = RunConfig(domain, problem, seed=seed, flip=0.05, no_effect=0.2, exogenous=0.1, viewer=False)
        with Run(replace(config, runs=tmp_path / "runs", name=f"seed-{seed}")) as run:
            summary = run.execute()
            fluent, judgement = run.domain.task.fluents[0], run.executive.run_state.judgement
            value = next(value for value, atom in fluent.values if run.world.state[atom])
        assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
        assert judgement is not None
        assert value >= 3
        assert fluent.most_probable(judgement.probability) == value
        assert fluent.mean(judgement.probability) == pytest.approx(value, abs=0.3)


def test_a_domain_folder_is_played_too_and_what_its_init_leaves_open_is_drawn(tmp_path: Path) -> None:
    starts = set()
    for seed in range(4):
        config = RunConfig("grocery", world="symbolic", seed=seed, runs=tmp_path, viewer=False)
        with Run(config) as run:
            true = run.truth.of(run.domain.task.atoms).true
            assert run.domain.task.declared <= true
            items = [name for name, kind in run.domain.task.objects.items() if kind == "item"]
            assert all(sum(item in atom.args for atom in true) == 1 for item in items)
            starts.add(true)
            if seed == 0:
                assert run.execute()["goal_true"]
    assert len(starts) > 1


def test_an_interrupted_run_goes_on_in_its_world(config: RunConfig) -> None:
    config = troubled(config, name="r")
    seen = Recorder()
    with Run(config, [seen]) as run:
        run.world.schedule(2.5, run.cancel)
        assert run.execute()["outcome"] == OutcomeKind.INTERRUPTED
        cut, state = run.world.time, run.world.state
    with resume(config.runs / "r") as run:
        assert (run.world.time, run.world.state) == (cut, state)
        summary = run.execute()
    assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
    orders = [event.payload for event in read_events(config.runs / "r") if isinstance(event.payload, Dispatched)]
    assert [order.action for order in orders] == list(range(1, len(orders) + 1))


def test_its_record_replays_to_the_same_decisions_also_with_the_monitor_made_anew(config: RunConfig) -> None:
    from executive.app.config import MonitorConfig

    with Run(troubled(config, name="r")) as run:
        run.execute()
    for wanted in (None, MonitorConfig()):
        assert compare_run(run.folder, wanted).agree


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"world": "moon"}, "world: no world 'moon'"),
        ({"world": "mujoco"}, "has no scene"),
        ({"flip": 0.5}, "flip: "),
        ({"no_effect": 1.5}, "no_effect: "),
        ({"exogenous": -0.1}, "exogenous: "),
        ({"estimator": "vlm"}, "estimator: "),
        ({"faults": ("drop@1",)}, "only with `world` mujoco"),
        ({"faults": ("exogenous:item=z@1",)}, "no item 'z'"),
        ({"domain": "grocery", "problem": None, "world": "mujoco", "flip": 0.1}, "goes with `world` symbolic"),
        ({"domain": "grocery", "problem": None, "world": "mujoco", "faults": ("no-effect@1",)}, "`world` symbolic"),
    ],
)
def test_what_does_not_go_together_is_said(config: RunConfig, options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as error:
        Run(replace(config, **options))  # type: ignore[arg-type]
    assert words in str(error.value)


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    domain, problem = map(str, write(tmp_path))
    common = ["run", domain, problem, "--world", "symbolic", "--runs", str(tmp_path / "runs"), "--no-trace-viewer"]
    assert cli.exit_code([*common, "--flip", "0.05", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["goal_true"] is True
    assert cli.exit_code([*common, "--problem", problem]) == cli.BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1
    write(tmp_path, PROBLEM.replace("(road b c)", ""))
    assert cli.exit_code([*common, "--quiet"]) == 1, "there is no way to c"


def test_no_simulator_and_no_model_is_loaded(tmp_path: Path) -> None:
    domain, problem = write(tmp_path)
    script = (
        "import sys; from pathlib import Path; from executive.app.run import RunConfig, run\n"
        f"run(RunConfig({str(domain)!r}, {str(problem)!r}, runs=Path({str(tmp_path)!r}), flip=0.05, viewer=False))\n"
        "heavy = {'mujoco', 'torch', 'robosuite', 'ompl', 'rerun', 'unified_planning'}\n"
        "print(sorted(heavy.intersection(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"


def test_faults_of_this_world_can_be_named_like_all_others(config: RunConfig) -> None:
    seen = Recorder()
    with Run(replace(config, faults=("no-effect@1", "exogenous:item=y@2")), [seen]) as run:
        assert run.execute()["goal_true"]
    assert [(fault.kind, fault.action) for fault in seen.of(FaultInjected)] == [("no-effect", 1), ("exogenous", 2)]
