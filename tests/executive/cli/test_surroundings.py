"""Whatever the caller has left of standard output and error, and whatever the environment says: a command ends with its
own exit code, or with one line."""

from __future__ import annotations

import dataclasses
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from executive import cli
from executive.app.config import RunConfig, make_folder, read_config
from executive.domain.loader import load_domain
from executive.trace.viewer.process import named_in_text
from executive.util.files import legible

EXECUTIVE = shlex.join([sys.executable, "-m", "executive"])
NOBODY_READS = [">&-", "2>&-", "<&- >&- 2>&-", "| true", "2>&1 | true"]
RUN = "run grocery --problem one-item --estimator oracle --no-trace-viewer --name r"


def shell(line: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """The exit code of the first program in a pipe, and what was printed."""
    command = ["bash", "-c", f"{line}; exit ${{PIPESTATUS[0]}}"]
    changed = {**os.environ, **environment}
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=240, cwd=folder, env=changed, errors="replace"
    )


@pytest.mark.parametrize("streams", NOBODY_READS)
@pytest.mark.parametrize(("command", "code"), [("domains", 0), ("run nowhere", 2)])
def test_a_command_ends_with_its_own_exit_code_where_nobody_reads(
    command: str, code: int, streams: str, tmp_path: Path
) -> None:
    ended = shell(f"{EXECUTIVE} {command} {streams}", tmp_path)
    assert ended.returncode == code
    assert ended.stderr.count("\n") == (code == 2 and streams in (">&-", "| true"))
    assert "bug" not in ended.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full is Linux's")
def test_output_that_is_full_is_bad_input_even_where_that_cannot_be_told(tmp_path: Path) -> None:
    ended = shell(f"{EXECUTIVE} domains >/dev/full 2>/dev/full", tmp_path)
    assert ended.returncode == 2


def test_what_is_closed_is_not_given_to_the_next_file(tmp_path: Path) -> None:
    """Else what libraries print would be in that file."""
    program = (
        "import os; from executive.cli import streams; streams.repair(); "
        "file = open('kept', 'w'); os.write(1, b'other'); os.write(2, b'other'); print('other'); file.write('kept')"
    )
    assert shell(f"{sys.executable} -c {shlex.quote(program)} <&- >&- 2>&-", tmp_path).returncode == 0
    assert (tmp_path / "kept").read_text() == "kept"


@pytest.mark.slow
@pytest.mark.parametrize("streams", [">&-", ">&- 2>&-", "--json >/dev/full", "| true", ">/dev/full 2>/dev/full"])
def test_a_run_that_reached_its_goal_ends_with_0_whoever_reads(streams: str, tmp_path: Path) -> None:
    ended = shell(f"{EXECUTIVE} {RUN} {streams}", tmp_path)
    assert ended.returncode == 0
    assert json.loads((tmp_path / "runs" / "r" / "summary.json").read_text())["outcome"] == "goal-reached"
    assert ("could not be printed" in ended.stderr) == (streams == "--json >/dev/full")


@pytest.mark.parametrize(
    "environment",
    [
        {"COLUMNS": "0", "LINES": "x", "TERM": "nonsense", "NO_COLOR": "1"},
        {"COLUMNS": "99999999999", "TERM": "", "FORCE_COLOR": "1"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"},
        {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"},
    ],
)
def test_nonsense_in_the_environment_changes_no_exit_code(environment: dict[str, str], tmp_path: Path) -> None:
    ended = shell(f"{EXECUTIVE} explain {Path('runs/example').resolve()}", tmp_path, **environment)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize("runs", ["/proc/nowhere", "/sys"])
def test_a_run_that_could_write_nothing_says_so_before_it_loads_anything(runs: str, tmp_path: Path) -> None:
    program = (
        "import sys; from executive import cli; "
        f"code = cli.exit_code(['run', 'grocery', '--runs', {runs!r}]); "
        "print(sorted({'torch', 'mujoco', 'unified_planning'} & set(sys.modules))); sys.exit(code)"
    )
    ended = shell(shlex.join([sys.executable, "-c", program]), tmp_path)
    assert (ended.returncode, ended.stdout.strip()) == (2, "[]")
    assert ended.stderr.startswith(f"error: {runs}: --runs: nothing can be written there")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["inspect run --png /sys/x.png", "estimate grocery --video clip.gif --out /sys/x"])
def test_what_could_not_be_written_is_said_before_it_is_made(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_late(*_: object, **__: object) -> None:
        raise AssertionError("it is done, for nothing")

    monkeypatch.setattr("executive.app.estimate.Session", too_late)
    monkeypatch.setattr("executive.trace.viewer.screenshot.screenshot", too_late)
    monkeypatch.setattr("executive.s3e.video.read_frames", lambda video, every: iter(()))
    shutil.copytree("runs/example", tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    assert cli.exit_code(command.split()) == cli.BAD_INPUT
    assert f"{command.split()[-2]}: nothing can be written there" in capsys.readouterr().err


@pytest.fixture
def nameless(tmp_path: Path) -> Path:
    """A folder whose name is no UTF-8."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/lat\351"))
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes names in UTF-8 alone")
    return folder


@pytest.mark.parametrize("command", ["explain", "replay"])
def test_a_run_is_told_of_in_a_folder_whose_name_is_no_text(command: str, nameless: Path) -> None:
    shutil.copytree("runs/example", nameless / "run")
    ended = shell(f"{EXECUTIVE} {command} run --json", nameless)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert cli.exit_code([command, str(nameless / "run")]) == 0


def test_a_configuration_can_be_read_again_whatever_the_folders_are_called(nameless: Path) -> None:
    config = RunConfig("grocery", "one-item", estimator="oracle", runs=nameless, name="r")
    folder = make_folder(config, load_domain("grocery", "one-item"))
    assert read_config(folder) == dataclasses.replace(config, runs=Path(legible(str(nameless))))


def test_the_viewer_is_given_a_name_that_is_text(nameless: Path) -> None:
    file = nameless / "trace.rrd"
    file.write_bytes(b"trace")
    with named_in_text(file) as named:
        assert Path(named.encode().decode()).read_bytes() == b"trace"
    assert not os.path.lexists(named)
    with named_in_text(nameless.parent / "trace.rrd") as named:
        assert named == str(nameless.parent / "trace.rrd")


@pytest.mark.slow
def test_a_run_is_drawn_in_a_folder_whose_name_is_no_text(nameless: Path) -> None:
    shutil.copytree("runs/example", nameless / "run")
    assert cli.exit_code(["inspect", str(nameless / "run"), "--png", str(nameless / "run.png"), "--at", "4"]) == 0
    assert (nameless / "run.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_collection_and_a_campaign_are_made_in_a_folder_whose_name_is_no_text(nameless: Path) -> None:
    collect = ["collect", "grocery", "--problem", "one-item", "--jobs", "1", "--out", str(nameless / "data")]
    assert cli.exit_code([*collect, "--points", "1"]) == 0
    assert cli.exit_code([*collect, "--points", "2"]) == 0
    campaign = nameless / "one.toml"
    campaign.write_text(
        'title = "One"\nseeds = 1\n[[domains]]\ndomain = "grocery"\nproblems = ["one-item"]\n[estimators]\nnone = {}\n'
    )
    assert cli.exit_code(["bench", str(campaign), "--jobs", "1", "--out", str(nameless / "campaign")]) == 0
    assert cli.exit_code(["bench", "--report", str(nameless / "campaign")]) == 0
