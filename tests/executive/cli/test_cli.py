"""The command line: options in, exit codes out, and one line for whatever goes wrong."""

from __future__ import annotations

import builtins
import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any

import pytest
import typer.core
import typer.main

import executive.__main__ as module
from executive import __version__, cli
from executive.app import run as assemble
from executive.core.settings import Settings
from executive.domain.loader import list_domains
from executive.errors import DomainError, InputError, MissingError
from executive.protocols import Sink
from executive.trace.report.summary import Looks, Summary
from executive.trace.story.costs import STAGES
from executive.trace.viewer import process, screenshot
from executive.types import OutcomeKind
from executive.util import requirements


class FakeRun:
    """In place of `assemble.Run`: keeps what it was given, and does in `execute` what the test wants."""

    last: FakeRun

    def __init__(self, config: assemble.RunConfig, sinks: Sequence[Sink] = (), view: str | None = None) -> None:
        FakeRun.last = self
        self.config, self.sinks, self.view, self.closed, self.cancelled = config, sinks, view, False, 0
        self.folder = Path("runs/r")

    meanwhile: Callable[[FakeRun], OutcomeKind] = staticmethod(lambda run: OutcomeKind.GOAL_REACHED)

    def __enter__(self) -> FakeRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True

    def cancel(self) -> None:
        self.cancelled += 1

    def execute(self) -> Summary:
        return summary(type(self).meanwhile(self))


def summary(outcome: OutcomeKind) -> Summary:
    return Summary(
        run="r",
        domain="grocery",
        problem="one-item",
        seed=0,
        estimator="oracle",
        outcome=str(outcome),
        goal_seen=outcome is OutcomeKind.GOAL_REACHED,
        goal_true=True,
        unreached=[],
        given_up=[],
        cycles=2,
        actions=2,
        replans=0,
        looks=3,
        looking=Looks(total=3, again=0, questions=15, moves=0, moving_seconds=0.0, glances=0),
        faults=[],
        sim_seconds=8.4,
        wall_seconds={"total": 2.0, **dict.fromkeys(STAGES, 0.3)},
    )


@pytest.fixture
def during(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[FakeRun], OutcomeKind]], None]:
    """Have `executive run` run a `FakeRun`, and say what happens during it."""

    def fake(meanwhile: Callable[[FakeRun], OutcomeKind]) -> None:
        monkeypatch.setattr(assemble, "Run", FakeRun)
        monkeypatch.setattr(FakeRun, "meanwhile", staticmethod(meanwhile))

    return fake


def ends(outcome: OutcomeKind) -> Callable[[FakeRun], OutcomeKind]:
    return lambda run: outcome


def fails(error: BaseException) -> Callable[[FakeRun], OutcomeKind]:
    def fail(run: FakeRun) -> OutcomeKind:
        raise error

    return fail


def one_error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What stderr says, which is one line that begins with `error: `; stdout says nothing."""
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("error: ")
    return err.removeprefix("error: ").rstrip("\n")


@pytest.mark.parametrize("outcome", OutcomeKind)
def test_the_outcome_is_the_exit_code(outcome: OutcomeKind, during: Any) -> None:
    during(ends(outcome))
    expected = {OutcomeKind.GOAL_REACHED: 0, OutcomeKind.INTERRUPTED: 130}.get(outcome, 1)
    assert cli.exit_code(["run", "grocery", "--quiet"]) == expected
    assert FakeRun.last.closed


def test_main_leaves_with_the_exit_code(during: Any) -> None:
    during(ends(OutcomeKind.PARTIAL))
    with pytest.raises(SystemExit) as left:
        cli.main(["run", "grocery", "--quiet"])
    assert left.value.code == 1


def test_every_option_reaches_the_configuration(during: Any, tmp_path: Path) -> None:
    during(ends(OutcomeKind.GOAL_REACHED))
    line = (
        "run grocery --problem breakfast --seed 3 --estimator none --fault drop@4 --fault miss@1 --no-home-pose "
        f"--grasp-noise 0.01 --max-replans 2 --max-actions 9 --runs {tmp_path} --name x --no-trace-viewer --quiet "
        "--max-looks-again 1 --max-questions 8 --no-guard"
    )
    assert cli.exit_code(shlex.split(line)) == 0
    assert FakeRun.last.config == assemble.RunConfig(
        domain="grocery",
        problem="breakfast",
        seed=3,
        estimator="none",
        faults=("drop@4", "miss@1"),
        home_pose=False,
        grasp_noise=0.01,
        max_replans=2,
        max_actions=9,
        max_looks_again=1,
        max_questions=8,
        guard=False,
        runs=tmp_path,
        name="x",
        viewer=False,
    )


def test_what_a_look_may_cost_is_among_the_settings() -> None:
    stingy = assemble.RunConfig("grocery", max_looks_again=0, max_questions=5, guard=False).settings()
    assert (stingy.max_looks_again, stingy.max_questions, stingy.guard_looks) == (0, 5, 0)
    assert assemble.RunConfig("grocery").settings() == Settings()
    with pytest.raises(InputError, match=r"^max_questions"):
        assemble.RunConfig("grocery", max_questions=0)


def test_defaults_are_those_of_the_library(during: Any) -> None:
    during(ends(OutcomeKind.GOAL_REACHED))
    assert cli.exit_code(["run", "grocery", "--quiet"]) == 0
    assert FakeRun.last.config == assemble.RunConfig(domain="grocery")


def test_json_is_all_of_stdout(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(ends(OutcomeKind.PARTIAL))
    assert cli.exit_code(["run", "grocery", "--json"]) == 1
    out, err = capsys.readouterr()
    assert json.loads(out) == summary(OutcomeKind.PARTIAL)
    assert "executive inspect runs/r" in err
    assert len(FakeRun.last.sinks) == 1


def test_a_run_can_be_watched_while_it_goes_on(during: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "open_window", lambda: "rerun+http://127.0.0.1:9/proxy")
    during(lambda run: OutcomeKind.GOAL_REACHED)
    assert cli.exit_code(["run", "grocery", "--view", "--tree"]) == 0
    assert FakeRun.last.view == "rerun+http://127.0.0.1:9/proxy"
    assert FakeRun.last.config.tree
    assert cli.exit_code(["run", "grocery"]) == 0
    assert FakeRun.last.view is None


def test_a_run_that_leaves_no_trace_cannot_be_watched(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(lambda run: OutcomeKind.GOAL_REACHED)
    assert cli.exit_code(["run", "grocery", "--view", "--no-trace-viewer"]) == 2
    assert "--view" in one_error_line(capsys)


def test_a_run_ends_with_the_command_that_inspects_it(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(ends(OutcomeKind.GOAL_REACHED))
    cli.exit_code(["run", "grocery"])
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].endswith("executive inspect runs/r")
    assert err == ""


def test_quiet_says_nothing(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(ends(OutcomeKind.GAVE_UP))
    cli.exit_code(["run", "grocery", "--quiet"])
    assert capsys.readouterr() == ("", "")
    assert FakeRun.last.sinks == []


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("no such estimator", key="--estimator"), 2),
        (DomainError("no body\n  for the lemon", file="scene.toml", key="items"), 2),
        (MissingError("no EGL", command="apt-get install -y libegl1"), 3),
    ],
)
def test_errors_are_one_line(error: Exception, code: int, during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(fails(error))
    assert cli.exit_code(["run", "grocery", "--quiet"]) == code
    assert one_error_line(capsys) == " ".join(str(error).split())


def test_a_bug_is_one_line_that_names_the_way_to_its_traceback(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(fails(ZeroDivisionError("a\nb")))
    assert cli.exit_code(["run", "my domain", "--quiet"]) == 70
    message = one_error_line(capsys)
    assert "ZeroDivisionError: a b" in message
    assert message.endswith("executive --debug run 'my domain' --quiet")


@pytest.mark.parametrize("error", [ZeroDivisionError(), InputError("x")])
def test_debug_lets_errors_through(error: Exception, during: Any) -> None:
    during(fails(error))
    with pytest.raises(type(error)):
        cli.exit_code(["--debug", "run", "grocery", "--quiet"])


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("nonsense", "'nonsense'"),
        ("--nonsense", "--nonsense"),
        ("run", "executive run --help"),
        ("run grocery --nonsense", "--nonsense"),
        ("run grocery --seed x", "--seed"),
        ("run grocery --seed -1", "--seed"),
        ("run grocery --grasp-noise -1", "--grasp-noise"),
        ("run grocery --max-actions 0", "--max-actions"),
        ("run grocery extra", "extra"),
    ],
)
def test_wrong_usage_is_bad_input(line: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(line.split()) == 2
    assert says in one_error_line(capsys)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("run no-such-domain", "no-such-domain"),
        ("run grocery --problem brekfast", "'breakfast'"),
        ("run grocery --estimator orcale", "'oracle'"),
        ("run grocery --fault drip@4", "drop"),
        ("run grocery --name ../x", "--name"),
    ],
)
def test_bad_input_is_told_by_the_real_parts(line: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code([*line.split(), "--quiet"]) == 2
    assert says in one_error_line(capsys)


def test_what_the_machine_lacks_is_told_before_anything_else(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        requirements, "check", lambda: [requirements.Missing("no graphics", "apt-get install -y graphics")]
    )
    assert cli.exit_code(["run", "no-such-domain"]) == 3
    assert one_error_line(capsys) == "no graphics; install it with: apt-get install -y graphics"


def test_ctrl_c_cancels_the_run(during: Any) -> None:
    def interrupted_once(run: FakeRun) -> OutcomeKind:
        os.kill(os.getpid(), signal.SIGINT)
        assert run.cancelled == 1
        return OutcomeKind.INTERRUPTED

    before = signal.getsignal(signal.SIGINT)
    during(interrupted_once)
    assert cli.exit_code(["run", "grocery", "--quiet"]) == 130
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_ctrl_c_leaves_at_once(during: Any) -> None:
    def interrupted_twice(run: FakeRun) -> OutcomeKind:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("still here")

    during(interrupted_twice)
    assert cli.exit_code(["run", "grocery", "--quiet"]) == 130
    assert (FakeRun.last.cancelled, FakeRun.last.closed) == (1, True)


def test_shipped_domains_are_listed_as_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["domains"]) == 0
    out = capsys.readouterr().out
    for name in list_domains():
        assert f"executive run {name} " in out
    assert "executive run grocery --problem breakfast\n" in out
    assert cli.exit_code(["domains", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [entry["name"] for entry in listed] == list(list_domains())
    commands = [problem["command"] for entry in listed for problem in entry["problems"]]
    assert [line.split("    # ")[0].strip() for line in out.splitlines() if "executive run" in line] == commands


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The arguments with which the viewer was opened, or a picture was drawn."""
    calls: list[tuple[Any, ...]] = []

    def draw(
        trace: Path, png: Path, at_cycle: int | None = None, at_time: float | None = None, panel: str | None = None
    ) -> list[str]:
        calls.append((trace, png, at_cycle, at_time, panel))
        return ["plan: error: too long"]

    def show(trace: Path, web: bool, tell: Callable[[str], None]) -> None:
        calls.append((trace, web))
        if web:
            tell("http://127.0.0.1:9")

    monkeypatch.setattr(process, "inspect", show)
    monkeypatch.setattr(screenshot, "screenshot", draw)
    return calls


def test_a_run_is_found_by_folder_and_by_name(
    looked_at: list[tuple[Any, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "monday").mkdir(parents=True)
    assert cli.exit_code(["inspect", "monday"]) == 0
    assert cli.exit_code(["inspect", "runs/monday", "--web"]) == 0
    assert looked_at == [(Path("runs/monday"), False), (Path("runs/monday"), True)]


def test_a_picture_is_drawn_and_what_the_viewer_complains_of_is_told(
    looked_at: list[tuple[Any, ...]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    png = tmp_path / "run.png"
    assert cli.exit_code(["inspect", str(tmp_path), "--png", str(png), "--at", "4"]) == 0
    assert cli.exit_code(["inspect", str(tmp_path), "--png", str(png), "--at", "13.4s", "--panel", "plan"]) == 0
    assert looked_at == [(tmp_path, png, 4, None, None), (tmp_path, png, None, 13.4, "plan")]
    assert capsys.readouterr() == ("", "warning: plan: error: too long\n" * 2)


def test_where_a_run_is_shown_is_json_where_that_is_wanted(
    looked_at: list[tuple[Any, ...]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.exit_code(["inspect", str(tmp_path), "--web"]) == 0
    assert capsys.readouterr().out == "http://127.0.0.1:9   (Ctrl-C ends it)\n"
    assert cli.exit_code(["inspect", str(tmp_path), "--web", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"run": str(tmp_path), "address": "http://127.0.0.1:9"}
    png = tmp_path / "run.png"
    assert cli.exit_code(["inspect", str(tmp_path), "--png", str(png), "--json"]) == 0
    told = {"run": str(tmp_path), "png": str(png), "warnings": ["plan: error: too long"]}
    assert json.loads(capsys.readouterr().out) == told


def test_every_command_has_json() -> None:
    group = typer.main.get_command(cli.app)
    assert isinstance(group, typer.core.TyperGroup)
    commands = dict(group.commands)
    for name, command in group.commands.items():
        if isinstance(command, typer.core.TyperGroup):
            del commands[name]
            commands |= {f"{name} {inner}": each for inner, each in command.commands.items()}
    options = {name: [text for each in command.params for text in each.opts] for name, command in commands.items()}
    assert "export mcap" in options
    assert [name for name, texts in options.items() if "--json" not in texts] == []


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("inspect tuesday", "tuesday: there is no such run; the latest in runs is monday"),
        ("inspect monday", "trace.rrd"),
        ("inspect monday --at 3", "--at: goes with --png"),
        ("inspect monday --at noon --png x.png", "--at: a cycle such as 4, or seconds of the world's clock"),
        ("inspect monday --panel plan", "--panel: goes with --png"),
        ("inspect monday --web --png x.png", "--web"),
        ("inspect monday --png no/such/folder/x.png", "no/such/folder"),
    ],
)
def test_what_cannot_be_inspected_is_bad_input(
    line: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "monday").mkdir(parents=True)
    assert cli.exit_code(line.split()) == 2
    assert says in one_error_line(capsys)


def test_a_fault_that_never_struck_is_told(during: Any, capsys: pytest.CaptureFixture[str]) -> None:
    during(ends(OutcomeKind.GOAL_REACHED))
    assert cli.exit_code(["run", "grocery", "--fault", "drop@99", "--fault", "shove:p=0.1"]) == 0
    assert capsys.readouterr().err == "warning: the fault drop@99 never struck in 2 actions\n"


def test_without_arguments_it_helps(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code([]) == 0
    assert "Usage: executive" in capsys.readouterr().out


def executive(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "executive", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, **options)


def test_the_module_is_the_command() -> None:
    (script,) = (point for point in entry_points(group="console_scripts", name="executive"))
    assert script.load() is module.main
    run = executive("--version")
    assert (run.returncode, run.stdout, run.stderr) == (0, f"executive {__version__}\n", "")
    assert version("executive") == __version__


def test_ctrl_c_while_it_loads_is_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def interrupted(name: str, *rest: Any, **more: Any) -> Any:
        if name == "executive.cli":
            raise KeyboardInterrupt
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", interrupted)
    with pytest.raises(SystemExit) as left:
        module.main()
    assert left.value.code == cli.INTERRUPTED


def test_it_works_from_any_folder(tmp_path: Path) -> None:
    run = executive("domains", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")


def test_a_reader_that_has_seen_enough_ends_no_run(tmp_path: Path) -> None:
    line = ("run", "grocery", "--problem", "one-item", "--estimator", "oracle", "--no-trace-viewer", "--name", "r")
    command = shlex.join([sys.executable, "-m", "executive", *line])
    script = f"{command} | head -n 1; echo ${{PIPESTATUS[0]}}"
    run = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, timeout=120, cwd=tmp_path)
    assert run.stderr == ""
    assert run.stdout.splitlines()[1:] == ["0"]
    assert json.loads((tmp_path / "runs" / "r" / "summary.json").read_text())["outcome"] == "goal-reached"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full is Linux's")
def test_where_there_is_no_room_is_said_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "executive", "domains"]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    assert run.returncode == 2
    assert run.stderr == "error: there is no room to write to: [Errno 28] No space left on device\n"


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    command = shlex.join([sys.executable, "-m", "executive", "domains"])
    run = subprocess.run(f"{command} | true", shell=True, capture_output=True, text=True, check=False, timeout=120)
    assert run.stderr == ""
