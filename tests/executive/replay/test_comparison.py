"""A run's folder, replayed: from the command line, with what is missing or damaged in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive import cli
from executive.app.config import MonitorConfig
from executive.app.resume import PastRun
from executive.core.run_state import RunState
from executive.core.settings import Settings
from executive.errors import InputError
from executive.faults import FaultInjector, parse_fault
from executive.replay import compare_run
from executive.trace.record import monitor_file
from executive.trace.record.log import EVENTS_FILE, EventLog, read_events
from executive.types import Decision, Ended, Facts, OutcomeKind
from tests.fakes import Stage, at

ROOT = Path(__file__).parents[3]
GOAL = Facts({at("a", "q"): True, at("b", "r"): True})


def kept(folder: Path, events: int | None = None, **changes: object) -> Path:
    """A run's folder: two things were carried, and one look was not sure of one of them."""
    looks = {3: {at("a", "q"): 0.6}}
    stage = Stage(GOAL, {"a": "p", "b": "p"}, looks=looks, **changes)  # type: ignore[arg-type]
    stage.play()
    log = EventLog(folder)
    for event in stage.recorder.events[:events]:
        log.write(event)
    log.close()
    monitor_file.save(folder, stage.monitor)
    return folder


@pytest.mark.parametrize("wanted", [None, MonitorConfig(threshold=0.5)])
def test_the_run_that_comes_along_is_decided_again_as_it_was(wanted: MonitorConfig | None) -> None:
    comparison = compare_run(ROOT / "runs" / "example", wanted)
    assert comparison.names[0] == "consistency and memory"
    assert [row.same for row in comparison.rows] == [True] * 8


def test_as_recorded_all_is_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["replay", str(kept(tmp_path / "run"))]) == cli.REACHED
    assert capsys.readouterr().out.startswith("6 of 6 decisions are the same; 0.")


def test_at_another_threshold_both_sides_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = kept(tmp_path / "run")
    assert cli.exit_code(["replay", str(run), "--threshold", "0.7"]) == cli.NOT_REACHED
    head, row, *_, parted, counts = capsys.readouterr().out.splitlines()
    assert "recorded (threshold 0.5)  " in head
    assert head.rstrip().endswith("replayed (threshold 0.7)")
    assert "continue: as expected" in row
    assert "look again: at(a,q) not seen as expected" in row
    assert parted == "here the two part: it looks again (after place(a,q)), where action 3 of the run was pick(b,p)"
    assert counts.startswith("2 of 6 decisions are the same, 1 different, 3 not come to; ")


def test_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = kept(tmp_path / "run")
    assert cli.exit_code(["replay", str(run), "--monitor", "plain", "--json"]) == cli.REACHED
    said = json.loads(capsys.readouterr().out)
    assert (said["agree"], said["recorded"], said["replayed"]) == (True, "threshold 0.5", "threshold 0.5")
    assert all(each["recorded"] == each["replayed"] for each in said["decisions"])
    assert cli.exit_code(["replay", str(run), "--threshold", "0.7", "--json"]) == cli.NOT_REACHED
    assert json.loads(capsys.readouterr().out)["ends"][0].startswith("here the two part: it looks again")


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.booleans(), st.sampled_from([None, 0.3]))
def test_a_run_that_was_gone_on_with_is_replayed_process_by_process(
    tmp_path_factory: pytest.TempPathFactory, seed: int, killed_in: int, blind: bool, threshold: float | None
) -> None:
    run = tmp_path_factory.mktemp("run")
    script = {killed_in: "interrupt"}
    stage = Stage(GOAL, {"a": "p", "b": "p"}, script=script, blind=blind, settings=Settings(seed))
    stage.faults = FaultInjector([parse_fault("drop:p=0.3"), parse_fault("shove:p=0.2")], stage.world, seed)
    log = EventLog(run)
    stage.recorder.write = log.write  # type: ignore[method-assign]
    ended = stage.play()
    if ended.outcome is OutcomeKind.INTERRUPTED:
        past, task = PastRun.of(run), stage.task
        run_state = (
            RunState(task, task.goal, past.assumed())
            if blind
            else RunState(task, task.goal, Facts(), past.memory(stage.monitor))
        )
        again = stage.executive()
        again.run_state = run_state.resumed(past.resumed(past.cycle))
        again.run()
    log.close()
    monitor_file.save(run, stage.monitor)
    comparison = compare_run(run)
    assert len(comparison.records) == 1 + (ended.outcome is OutcomeKind.INTERRUPTED)
    assert (comparison.agree, comparison.left, comparison.ends) == (True, 0, ())
    assert all(row.recorded == row.replayed for row in comparison.rows)
    assert sum(row.recorded is not None for row in comparison.rows) == comparison.decisions
    if threshold is not None and not blind:
        compare_run(run, MonitorConfig(threshold=threshold))


def test_what_a_record_says_does_not_move_the_cursor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = kept(tmp_path / "run") / EVENTS_FILE
    lines = [json.loads(line) for line in events.read_text().splitlines()]
    for line in lines:
        if line["data"].pop("causes", None):  # a record from before there were codes
            line["data"]["reason"] += " \x1b[2J\r"
    *others, last = lines
    last["data"]["outcome"] = "crashed"
    events.write_text("".join(json.dumps(line) + "\n" for line in [*others, last]))
    cli.exit_code(["replay", str(events.parent), "--all"])
    cli.exit_code(["replay", str(events.parent), "--threshold", "0.7"])
    told = "".join(capsys.readouterr())
    assert "[2J" in told
    assert not {"\x1b", "\r"} & {*told}


@pytest.mark.parametrize("events", range(1, 60, 7))
def test_an_unfinished_run_is_replayed_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], events: int
) -> None:
    run = kept(tmp_path / "run", events)
    with (run / EVENTS_FILE).open("ab") as file:
        file.write(b'{"v": 1, "type": "Dec')  # what a kill leaves
    assert cli.exit_code(["replay", str(run)]) == cli.REACHED
    out = capsys.readouterr().out
    assert out.startswith("the record ends: the run was killed here, or is still going on\n")
    assert "different" not in out


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda run: (run / EVENTS_FILE).unlink(), "no record of a run"),
        (lambda run: (run / EVENTS_FILE).write_text(""), "these events are no run: none of them starts it"),
        (lambda run: (run / EVENTS_FILE).write_text("\x00\x01\n"), "line 1: not a JSON object"),
        (lambda run: (run / monitor_file.FILE).unlink(), "monitor.json: is missing"),
        (lambda run: (run / monitor_file.FILE).write_text("[[["), "monitor.json: is not JSON"),
        (lambda run: (run / monitor_file.FILE).write_text("[]"), "monitor.json: is damaged"),
        (lambda run: (run / monitor_file.FILE).write_text('{"format": 1, "kind": "fussed"}'), "did you mean 'fused'?"),
    ],
)
def test_what_is_missing_or_damaged_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: object, told: str
) -> None:
    assert callable(spoil)
    spoil(run := kept(tmp_path / "run"))
    assert cli.exit_code(["replay", str(run)]) == cli.BAD_INPUT
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert told in err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--monitor", "plane"], "--monitor: no monitor 'plane'; did you mean 'plain'?"),
        (["--monitor", "plain", "--threshold", "0.4"], "--monitor: "),
        (["--threshold", "1.4"], "--threshold"),
        (
            ["--threshold", "0.4", "--alpha", "0.1"],
            "--alpha: sets the thresholds by an error rate, and excludes --threshold",
        ),
        (["--monitor", "full"], "config.toml: is missing"),
    ],
)
def test_monitors_that_cannot_be_made_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], told: str
) -> None:
    assert cli.exit_code(["replay", str(kept(tmp_path / "run")), *options]) == cli.BAD_INPUT
    assert told in capsys.readouterr().err


def test_a_blind_run_from_before_its_outcome_had_a_name_of_its_own_is_read(tmp_path: Path) -> None:
    file = kept(tmp_path / "run", blind=True) / EVENTS_FILE
    text = file.read_text()
    assert text.count('"plan-completed"') == 2, "the decision and the end"
    file.write_text(text.replace('"plan-completed"', '"goal-reached"'))
    ends = [event.payload.outcome for event in read_events(file) if isinstance(event.payload, Decision | Ended)]
    assert [each for each in ends if each] == [OutcomeKind.PLAN_COMPLETED] * 2
    assert compare_run(file.parent).agree


def test_a_blind_run_is_the_same_with_no_monitor_at_all(tmp_path: Path) -> None:
    run = kept(tmp_path / "run", blind=True)
    (run / monitor_file.FILE).unlink()
    assert compare_run(run).agree
    with pytest.raises(InputError, match="nobody looked in this run"):
        compare_run(run, MonitorConfig(threshold=0.4))
