"""What the machine has and lacks: whatever is wrong with it is a finding that names the way out, never an exception."""

from __future__ import annotations

import ctypes
import errno
import io
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from packaging.requirements import Requirement

from executive import cli
from executive.app import doctor, doctor_report, estimators
from executive.app.doctor import Finding, State
from executive.errors import MissingError
from executive.planning.fast_downward import FastDownwardPlanner
from executive.s3e.backends import loading, packages
from executive.types import NoPlan, NoPlanReason
from executive.util import requirements

PARTS = [
    "system",
    "threads",
    "Python",
    "packages",
    "domains",
    "planner",
    "OpenGL",
    "Vulkan",
    "display",
    "model",
    "GPU",
    "extras",
    "disk",
]


@pytest.fixture(scope="module")
def findings() -> list[Finding]:
    """Of the machine that runs the tests, tried for real."""
    return list(doctor.examine())


def test_this_machine_can_start_a_run(findings: list[Finding]) -> None:
    assert [finding.part for finding in findings] == [*PARTS, "look"]
    assert [finding for finding in findings if finding.state is State.MISSING] == []
    assert doctor.ready(findings)
    by_part = {finding.part: finding.found for finding in findings}
    assert sys.version.split()[0] in by_part["Python"]
    assert "plan of 2 steps" in by_part["planner"]
    assert "grocery" in by_part["domains"]
    assert "pick" in by_part["domains"].partition("skills: ")[2]
    assert "gripping" in by_part["domains"].partition("relations: ")[2]
    assert by_part["look"].startswith("grocery-eye answers ")


def test_every_finding_is_one_line(findings: list[Finding]) -> None:
    for finding in findings:
        assert finding.found.isprintable()
        assert finding.command is None or finding.command.isprintable()


def test_json_and_text_tell_the_same(findings: list[Finding]) -> None:
    document = json.loads(json.dumps(doctor_report.as_json(findings)))
    assert document["ready"] is True
    stream = io.StringIO()
    assert doctor_report.tell(iter(findings), stream) == findings
    for finding, entry in zip(findings, document["findings"], strict=True):
        assert entry == {
            "part": finding.part,
            "state": str(finding.state),
            "found": finding.found,
            "command": finding.command,
        }
        assert finding.found in stream.getvalue()
        assert (finding.command or "") in stream.getvalue()
    assert stream.getvalue().splitlines()[-1].startswith("a run can start")


def test_markdown_is_a_table_without_the_name_of_a_person(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: Path("/home/ada"))
    block = doctor_report.as_markdown([Finding("Python", State.OK, "3.12.1 at /home/ada/.venv/bin/python | odd")])
    assert block.splitlines()[-1] == "| Python | ok | 3.12.1 at ~/.venv/bin/python \\| odd |"
    assert all(line.startswith("|") for line in block.splitlines()[2:])


@pytest.mark.parametrize(("state", "command"), [(State.OK, "mend"), (State.LIMITED, None), (State.MISSING, None)])
def test_what_is_wrong_and_nothing_else_comes_with_a_command(state: State, command: str | None) -> None:
    with pytest.raises(ValueError, match="command"):
        Finding("disk", state, "something", command)


def only(monkeypatch: pytest.MonkeyPatch, part: str, trial: Callable[[], Finding]) -> Finding:
    """What `examine` makes of one trial; the others find nothing."""
    for name in [*PARTS, "look"]:
        monkeypatch.setattr(doctor, name.lower(), lambda name=name: Finding(name, State.OK, "fine"))
    monkeypatch.setattr(doctor, part.lower(), trial)
    by_part = {finding.part: finding for finding in doctor.examine()}
    assert by_part.keys() == {*PARTS, "look"}
    return by_part[part]


@pytest.mark.parametrize("part", [*PARTS, "look"])
def test_whatever_a_trial_raises_is_a_finding(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> Finding:
        raise ZeroDivisionError("a\nb")

    def lacking() -> Finding:
        raise MissingError("no such thing", command="get it")

    finding = only(monkeypatch, part, broken)
    assert (finding.state, finding.found) == (State.MISSING, "ZeroDivisionError: a b")
    assert finding.command is not None
    assert finding.command.endswith("make setup")
    assert only(monkeypatch, part, lacking) == Finding(part, State.MISSING, "no such thing", "get it")


@pytest.mark.parametrize(
    ("lookup", "trial"),
    [("missing_packages", "packages"), ("missing_parts", "packages"), ("missing_libraries", "opengl")],
)
def test_what_keeps_a_run_from_starting_is_missing_here_too(
    lookup: str, trial: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(requirements, lookup, lambda: [requirements.Missing("a thing", "get it")])
    assert requirements.check()
    finding = getattr(doctor, trial)()
    assert (finding.state, finding.found, finding.command) == (State.MISSING, "a thing", "get it")


def test_windows_and_other_pythons_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "win32")
    assert doctor.system().state is State.MISSING
    monkeypatch.setattr(sys, "version_info", (3, 10, 0))
    assert doctor.python().state is State.MISSING


def test_versions_that_were_not_tested_are_named_with_what_was(monkeypatch: pytest.MonkeyPatch) -> None:
    real = doctor._version
    monkeypatch.setattr(doctor, "_version", lambda name: "2.0.0" if name == "mujoco" else real(name))
    finding = doctor.packages()
    assert finding.state is State.LIMITED
    assert finding.found == "not as tested: mujoco 2.0.0 (wanted ==3.8.1)"
    assert finding.command == f"{sys.executable} -m pip install 'mujoco==3.8.1'"


def test_an_extra_that_is_not_here_comes_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    real = doctor._version
    monkeypatch.setattr(doctor, "_version", lambda name: None if name == "av" else real(name))
    finding = doctor.extras()
    assert finding.state is State.LIMITED
    assert "video" in finding.found.partition("not here: ")[2]
    assert finding.command is not None
    assert "'av>=14'" in finding.command
    monkeypatch.setattr(doctor, "_fits", lambda requirement: True)
    assert doctor.extras().state is State.OK


def test_the_numeric_planner_needs_java(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_fits", lambda requirement: True)
    real = doctor._metadata().get_all("Provides-Extra") or []
    monkeypatch.setattr(doctor, "_metadata", lambda: Metadata([*real, "numeric"]))
    monkeypatch.setattr("shutil.which", lambda name: None)
    finding = doctor.extras()
    assert (finding.state, finding.command) == (State.LIMITED, requirements.JAVA)
    assert "Java" in finding.found
    monkeypatch.setattr("shutil.which", lambda name: "/usr/bin/java")
    assert doctor.extras().state is State.OK


class Metadata:
    """What a distribution says of itself, with these extras."""

    def __init__(self, extras: list[str]) -> None:
        self._extras = extras

    def get_all(self, name: str) -> list[str]:
        return self._extras if name == "Provides-Extra" else []


def test_a_planner_that_finds_nothing_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = NoPlan(NoPlanReason.CRASHED, "exec format error")
    monkeypatch.setattr(FastDownwardPlanner, "plan", lambda self, state, goal: answer)
    finding = doctor.planner()
    assert finding.state is State.MISSING
    assert finding.found == "Fast Downward: crashed: exec format error"


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """Writes a module that a trial can run, and gives its name."""

    def write(source: str) -> str:
        (tmp_path / "program_on_trial.py").write_text(source)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        return "program_on_trial"

    return write


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "the process crashes (SIGSEGV in {file}:1)"),
        ("raise OSError('no driver')", "no driver"),
        ("raise SystemExit(7)", "exit code 7"),
        ("import time; time.sleep(60)", "it takes longer than 1 s"),
    ],
)
def test_a_trial_that_fails_says_how(
    source: str, says: str, program: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(doctor, "_PATIENCE", 1.0 if "sleep" in source else 30.0)
    with pytest.raises(doctor._TrialError) as raised:
        doctor._trial(program(source))
    assert str(raised.value) == says.format(file=tmp_path / "program_on_trial.py")


def test_a_trial_that_succeeds_is_what_it_prints(program: Callable[[str], str]) -> None:
    assert doctor._trial(program("print('all', 'is well')")) == "all is well"


def test_a_look_that_ends_the_process_is_told_with_what_a_report_needs(
    program: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real, name = doctor._trial, program("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setattr(doctor, "_trial", lambda module, patience: real(name, patience))
    finding = doctor.look()
    assert finding.state is State.MISSING
    assert "SIGSEGV" in finding.found
    assert str(finding.command).endswith("-X faulthandler -m executive.app.first_look")


def test_a_look_that_lacks_something_comes_with_the_command_that_installs_it(
    program: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = program("from executive.errors import MissingError\nraise MissingError('no such', command='get it')")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([os.environ["PYTHONPATH"], *sys.path]))
    real = doctor._trial
    monkeypatch.setattr(doctor, "_trial", lambda module, patience: real(name, patience))
    finding = doctor.look()
    assert finding == Finding("look", State.MISSING, "a run would fail at its first look: no such", "get it")


def test_a_torchvision_that_does_not_load_is_told_with_the_one_that_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "broken_torchvision", lambda: "RuntimeError: operator does not exist")
    monkeypatch.setattr(packages, "fitting_torchvision", lambda: ("torchvision==0.28.0+cpu --index-url INDEX", ""))
    finding = doctor.extras()
    assert finding.state is State.LIMITED
    assert "RuntimeError: operator does not exist" in finding.found
    assert str(finding.command).endswith("--no-deps torchvision==0.28.0+cpu --index-url INDEX")


def fails(*_: object) -> str:
    raise doctor._TrialError("no driver")


@pytest.mark.parametrize(
    ("renderer", "command"), [("", "libgl1-mesa-dri"), ("glfw", "unset MUJOCO_GL"), ("elg", "unset MUJOCO_GL")]
)
def test_without_opengl_no_run_starts(renderer: str, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "missing_libraries", list)
    monkeypatch.setattr(doctor, "_trial", fails)
    monkeypatch.setenv("MUJOCO_GL", renderer)
    monkeypatch.delenv("DISPLAY", raising=False)
    finding = doctor._tried("OpenGL", doctor.opengl)
    assert finding.state is State.MISSING
    assert finding.command is not None
    assert finding.command.endswith(command)


@pytest.mark.parametrize("answer", [fails, lambda module: "[]"])
def test_without_vulkan_there_are_no_pictures_of_runs(answer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_trial", answer)
    finding = doctor.vulkan()
    assert finding.state is State.LIMITED
    assert "inspect --png" in finding.found
    assert "mesa-vulkan-drivers" in str(finding.command)


def test_a_display_is_found_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "has_display", lambda: False)
    assert doctor.display().command == "executive inspect RUN --web"
    monkeypatch.setattr(requirements, "has_display", lambda: True)
    assert doctor.display().state is State.OK


def test_a_model_that_is_not_there_or_not_whole_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "SHIPPED", tmp_path / "models")
    assert doctor.model().state is State.LIMITED
    folder = tmp_path / "models" / "grocery-eye"
    folder.mkdir(parents=True)
    (folder / "config.json").write_text('{"model_type": "fast_vlm"}')
    (folder / "model.safetensors").write_text("version https://git-lfs.github.com/spec/v1\n")
    finding = doctor.model()
    assert finding.state is State.LIMITED
    assert "model.safetensors" in finding.found


def test_a_gpu_that_torch_does_not_use_comes_with_the_build_that_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loading, "choose_device", lambda wanted: "cpu")
    monkeypatch.setattr(doctor, "_version", lambda name: "2.13.0+cpu")
    monkeypatch.setattr(requirements, "cuda_devices", list)
    assert doctor.gpu().state is State.OK
    monkeypatch.setattr(requirements, "cuda_devices", lambda: ["NVIDIA Abacus"])
    finding = doctor.gpu()
    assert (finding.state, finding.found) == (State.LIMITED, "NVIDIA Abacus, which torch 2.13.0+cpu does not use")
    assert str(finding.command).endswith(" torch==2.13.0")
    monkeypatch.setattr(loading, "choose_device", lambda wanted: "cuda")
    assert doctor.gpu().found == "NVIDIA Abacus, torch 2.13.0+cpu"


class _Driver:
    """Stands in for libcuda: so many devices, unless it cannot even start."""

    def __init__(self, names: list[bytes], broken: bool = False) -> None:
        self.names, self.broken = names, broken

    def cuInit(self, flags: int) -> int:  # noqa: N802
        return 100 if self.broken else 0

    def cuDeviceGetCount(self, count: Any) -> int:  # noqa: N802
        count._obj.value = len(self.names)
        return 0

    def cuDeviceGet(self, device: Any, index: int) -> int:  # noqa: N802
        device._obj.value = index
        return 0

    def cuDeviceGetName(self, buffer: Any, length: int, device: Any) -> int:  # noqa: N802
        buffer.value = self.names[device.value]
        return 0


def test_gpus_are_named_by_their_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(driver: Any) -> Callable[[str], Any]:
        def cdll(name: str) -> Any:
            if driver is None:
                raise OSError(name)
            return driver

        return cdll

    for driver, names in (
        (None, []),
        (_Driver([b"A", b"B"], broken=True), []),
        (_Driver([]), []),
        (_Driver([b"A", b"B"]), ["A", "B"]),
    ):
        monkeypatch.setattr(ctypes, "CDLL", load(driver))
        assert requirements.cuda_devices() == names


@pytest.mark.parametrize(("free", "state"), [(5e9, State.OK), (5e8, State.LIMITED), (5e6, State.MISSING)])
def test_a_disk_that_fills_up_is_told_in_time(free: float, state: State, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=free))
    assert doctor.disk().state is state


def test_a_folder_that_cannot_be_written_to_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def read_only(**_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("tempfile.TemporaryFile", read_only)
    finding = doctor.disk()
    assert finding.state is State.LIMITED
    assert "Read-only file system" in finding.found
    assert finding.command == "executive run DOMAIN --runs FOLDER"


def test_requirements_are_read_with_their_extras() -> None:
    always, video = doctor._required(), doctor._required("video")
    assert Requirement("mujoco==3.8.1") in always
    assert [each.name for each in video if each not in always] == ["av"]


@pytest.mark.parametrize(("state", "code"), [(State.OK, 0), (State.LIMITED, 0), (State.MISSING, 3)])
@pytest.mark.parametrize("option", ["", "--json", "--markdown"])
def test_the_exit_code_says_whether_a_run_can_start(
    state: State, code: int, option: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = Finding("disk", state, "as it is", None if state is State.OK else "mend it")
    monkeypatch.setattr(doctor, "examine", lambda: iter([finding]))
    assert cli.exit_code(["doctor", *option.split()]) == code
    out, err = capsys.readouterr()
    assert "as it is" in out
    assert err == ""


def test_one_form_at_a_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["doctor", "--json", "--markdown"]) == 2
    assert "--markdown" in capsys.readouterr().err
