"""Scenario 23 on the real stack: a run that was cut off goes on, from its configuration and its record."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import kills
from executive import cli
from executive.app.run import Run, RunConfig, read_config, resume
from executive.errors import InputError
from executive.protocols import SkillContext
from executive.trace.record.log import read_events
from executive.trace.report.summary import SUMMARY_FILE
from executive.types import Dispatched, Ended, FaultInjected, Observation, OutcomeKind, Resumed, SkillResult, Step
from tests.executive.sim.stage import ROOT
from tests.fakes import Recorder

CONFIG = RunConfig(
    str(ROOT / "domains" / "grocery"), problem="breakfast", seed=1, estimator="oracle", name="r", viewer=False
)


@pytest.mark.parametrize("estimator", ["oracle", "vlm"])
def test_23_interrupted_in_the_third_action_it_goes_on_from_there(estimator: str, tmp_path: Path) -> None:
    config = replace(CONFIG, runs=tmp_path, faults=("shove:item=lemon@1", "drop@6"), estimator=estimator)
    watching = Recorder()
    with Run(config, [watching]) as run:
        dispatch = run.executive.skills["pick"]

        def cut_off(step: Step, context: SkillContext) -> SkillResult:
            if step.args[0] == "cereal-box":
                run.world.schedule(1.0, run.cancel)
            return dispatch(step, context)

        run.executive.skills = {**run.executive.skills, "pick": cut_off}
        assert run.execute()["outcome"] == OutcomeKind.INTERRUPTED
        cut, lemon = run.world.time, run.world.pose("lemon")
    assert read_config(tmp_path / "r") == config
    seen = Recorder()
    with resume(tmp_path / "r", [seen]) as run:
        assert run.world.time == cut
        assert run.world.pose("lemon") == pytest.approx(lemon, abs=1e-9), "someone moved it before the end"
        summary = run.execute()
    assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
    events = list(read_events(tmp_path / "r"))
    assert [type(event.payload) for event in events].count(Resumed) == 1
    assert sum(isinstance(event.payload, Ended) for event in events) == 2
    assert kills.again(events) == []
    orders = [event.payload for event in events if isinstance(event.payload, Dispatched)]
    assert [order.action for order in orders] == list(range(1, len(orders) + 1))
    assert summary["actions"] == len(orders) == 5, "the one that was cut off is done once more"
    assert sum(isinstance(event.payload, FaultInjected) for event in events) == 1
    looks = [event.payload for event in events if isinstance(event.payload, Observation)]
    assert [look.id for look in looks] == list(range(len(looks)))
    pictures = list((tmp_path / "r" / "images").iterdir())
    assert sum(len(look.images) for look in looks) == len(pictures), "no look's pictures took another's place"
    with pytest.raises(InputError, match="goal-reached"):
        resume(tmp_path / "r")


def test_killed_between_its_end_and_its_summary_only_that_is_made_up_for(tmp_path: Path) -> None:
    config = replace(CONFIG, problem="one-item", runs=tmp_path)
    with Run(config) as run:
        whole = run.execute()
    (tmp_path / "r" / SUMMARY_FILE).unlink()
    before = (tmp_path / "r" / "events.jsonl").read_bytes()
    with resume(tmp_path / "r") as again:
        assert again.execute() == whole
    assert (tmp_path / "r" / "events.jsonl").read_bytes() == before


def test_killed_before_it_began_it_begins(tmp_path: Path) -> None:
    config = replace(CONFIG, problem="one-item", runs=tmp_path)
    with Run(config):
        """Made, with its configuration, and gone."""
    seen = Recorder()
    with resume(tmp_path / "r", [seen]) as run:
        assert run.execute()["goal_true"]
    assert seen.of(Resumed) == []
    assert len(seen.of(SkillResult)) == 2


def test_what_cannot_be_gone_on_with_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    assert cli.exit_code(["resume", str(tmp_path / "empty")]) == cli.BAD_INPUT
    assert "config.toml: is missing" in capsys.readouterr().err
    assert list((tmp_path / "empty").iterdir()) == []
    assert cli.exit_code(["resume", str(tmp_path / "none")]) == cli.BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1
    half = tmp_path / "half"
    half.mkdir()
    (half / "config.toml").write_text('domain = "grocery"\nseed = -')
    assert cli.exit_code(["resume", str(half)]) == cli.BAD_INPUT
    assert "config.toml: is not TOML" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_23_killed_as_a_process(tmp_path: Path, number: int) -> None:
    length = 80_000
    dice = random.Random(number)
    trial = kills.killed_and_resumed(
        tmp_path, "r", "breakfast", number, kills.DROPS if number % 2 else (), length, dice
    )
    assert trial.is_right, trial
