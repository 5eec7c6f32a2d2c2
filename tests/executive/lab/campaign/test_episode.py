"""An episode in the simulator, and the command that carries it out again."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import Any

import pytest

from executive import cli
from executive.app import run
from executive.app.config import EstimatorConfig, MonitorConfig
from executive.app.run import RunConfig
from executive.errors import InputError, MissingError
from executive.lab.campaign.design import Configuration, Episode, Place
from executive.lab.campaign.episode import FAILED, Simulated, command, out_of_reach, row_of
from executive.lab.common.process_pool import JobResult
from executive.types import Facts
from tests.executive.lab.campaign.players import campaign

TRAY = Path(__file__).parents[3] / "domains" / "tray"

CONFIGS: list[dict[str, Any]] = [
    {},
    {"problem": "one", "seed": 7, "estimator": "none", "faults": ("drop:p=0.3", "camera:front=black@5-8")},
    {"home_pose": False, "grasp_noise": 0.004, "max_replans": 0, "max_actions": 9},
    {"max_looks_again": 0, "max_questions": 8, "guard": False},
    {"max_cycles": 5, "max_looks": 6, "max_seconds": 7.5, "patience": 8.0},
    {"monitor": MonitorConfig(alpha=0.1, memory=False), "eye": EstimatorConfig(calibration=Path("a file"))},
    {"monitor": MonitorConfig(threshold=0.7)},
    {"policies": ("pick=a folder/pick.safetensors",)},
    {"estimator": "vlm", "eye": EstimatorConfig("a folder", None, "none", None, False, True, Path("c.json"))},
    {
        "estimator": "vlm",
        "eye": EstimatorConfig("a folder", cameras=("front", "left"), abstention=False, instructions="paper"),
    },
    {"estimator": "vlm", "eye": EstimatorConfig(server="http://127.0.0.1:8000/v1", translator="llm", llm="small")},
    {"planner": "fast-downward-opt", "poses": "depth", "film": 2.0, "renderer": "mitsuba"},
    {"world": "symbolic", "no_effect": 0.2, "exogenous": 0.1, "flip": 0.05},
    {"search": "likeliest", "places": Path("places.toml")},
    {"estimator": "vlm", "poses": "depth", "marks": True, "eye": EstimatorConfig("a folder")},
]


@pytest.mark.parametrize("chosen", CONFIGS)
def test_the_command_carries_out_the_same_run(chosen: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Every option that decides anything is in it, and the defaults are those of the command line."""
    made: list[RunConfig] = []

    def remember(config: RunConfig, *_: object, **__: object) -> None:
        made.append(config)
        raise InputError("enough")

    monkeypatch.setattr(run, "Run", remember)
    monkeypatch.setattr("executive.util.requirements.require", lambda *_: None)
    wanted = RunConfig("grocery", **chosen)
    assert cli.exit_code(shlex.split(command(wanted))[1:]) == cli.BAD_INPUT
    assert made == [wanted]


def test_every_option_of_a_run_is_in_some_command_that_is_tested() -> None:
    """An option that comes to be is to be put into the command, and here."""
    decides = {field.name for field in dataclasses.fields(RunConfig)} - {"domain", "runs", "name", "viewer", "tree"}
    assert {name for chosen in CONFIGS for name in chosen} == decides


def test_failures_are_told_in_a_line() -> None:
    episode = next(campaign().episodes())
    assert row_of(JobResult(episode, ValueError("two\nlines"), 1.5)).error == "ValueError: two lines"
    assert row_of(JobResult(episode, InputError("wrong", key="--x"), 0.0)).error == "--x: wrong"
    missing = row_of(JobResult(episode, MissingError("no GL", command="apt-get install gl"), 0.0))
    assert (missing.outcome, missing.error) == (FAILED, "no GL; install it with: apt-get install gl")
    assert missing.key == episode.key


def test_what_no_atom_is_true_of_is_out_of_reach() -> None:
    facts = Facts.parse("on-table(a,t)", "not on-table(b,t)", "held(c)", "not held(b)", "free()")
    assert out_of_reach(facts, ["a", "b", "c"]) == ("b",)


def test_an_episode_in_the_simulator_is_scored_by_its_truth(tmp_path: Path) -> None:
    place, who = Place("tray", "fill-tray", str(TRAY)), Configuration("oracle", kind="oracle")
    config = RunConfig(str(TRAY), seed=1, estimator="oracle", faults=("miss@1",), viewer=False, max_actions=2)
    made = Simulated(tmp_path)(Episode(place, "missed", who, 1, config))
    assert (made.outcome, made.goal_true, made.actions, made.lost, made.error) == ("gave-up", False, 2, (), "")
    (strike,) = made.strikes
    assert (strike.kind, strike.action) == ("miss", 1)
    assert strike.noticed is not None
    assert 0.0 < strike.noticed < 20.0
    assert (made.quiet + made.failed, made.alarms, made.missed) == (2, 0, 0)
    assert made.failed >= 1
    assert made.sim_seconds > 0.0
    assert list(tmp_path.iterdir()) == [], "its folder is gone"
