"""Checks what this machine has and lacks, each part with the command that mends it, for `executive doctor`.

Every part is tried out and not only looked for: a picture is rendered, a plan is searched, a file is written. What may
crash (graphics drivers) or hang is tried in a process of its own. Any error in a trial is a finding.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageMetadata, PackageNotFoundError, metadata, version
from pathlib import Path

from packaging.requirements import Requirement

from executive.errors import InputError, MissingError
from executive.relations import kinds
from executive.util import requirements
from executive.util.files import check_writable, reason
from executive.util.threads import cores, settings

_CHECKOUT = Path(__file__).resolve().parents[2]
"""The repository's root, if this is not an installed wheel."""
_PATIENCE = 90.0
"""The time limit of a trial, in wall seconds; software drivers on a busy machine are slow."""
_LONG = 300.0
"""The time limit of the trial of a look, which loads everything that a run does, in wall seconds."""
_ROOM, _LEAST_ROOM = 1e9, 1e8
"""The free bytes that there should be where runs are written, and those without which no run starts."""
_FOR_DEVELOPERS = frozenset({"dev", "docs", "fuzz", "judge", "test-llm"})
"""Extras that only developers need."""


class State(StrEnum):
    OK = "ok"
    LIMITED = "limited"
    """Runs work, but something else does not; the finding says what."""
    MISSING = "missing"
    """No run works."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The state of one part of the machine, in one line, and the command that mends it if it is not ok."""

    part: str
    state: State
    found: str
    command: str | None = None

    def __post_init__(self) -> None:
        if (self.state is State.OK) != (self.command is None):
            raise ValueError(f"{self.part}: a finding has a command if and only if it is not ok")


def examine() -> Iterator[Finding]:
    """Yield the finding of every part, in a fixed order."""
    trials: dict[str, Callable[[], Finding]] = {
        "system": system,
        "threads": threads,
        "Python": python,
        "packages": packages,
        "domains": domains,
        "planner": planner,
        "OpenGL": opengl,
        "Vulkan": vulkan,
        "display": display,
        "model": model,
        "GPU": gpu,
        "extras": extras,
        "disk": disk,
        "look": look,
    }
    # Trials in processes of their own run beside the others, which import packages and so have to run one by one.
    with ThreadPoolExecutor() as pool:
        futures = {part: pool.submit(_tried, part, trials[part]) for part in ("look", "OpenGL", "Vulkan")}
        for part, trial in trials.items():
            yield futures[part].result() if part in futures else _tried(part, trial)


def _tried(part: str, trial: Callable[[], Finding]) -> Finding:
    try:
        return trial()
    except MissingError as error:
        return Finding(part, State.MISSING, _line(str(error).partition("; install it with: ")[0]), error.command)
    except Exception as error:  # a broken installation may raise anything
        return Finding(part, State.MISSING, _line(f"{type(error).__name__}: {error}"), _reinstall())


def _line(text: str) -> str:
    return " ".join(text.split())[:300]


def _reinstall() -> str:
    if (_CHECKOUT / "scripts" / "setup").is_file():
        return f"cd {shlex.quote(str(_CHECKOUT))} && make setup"
    return f"{sys.executable} -m pip install --force-reinstall EXECUTIVE.whl"


def ready(findings: Iterable[Finding]) -> bool:
    """Whether a run can start."""
    return all(finding.state is not State.MISSING for finding in findings)


# --- the parts --------------------------------------------------------------------------------------------------------


def system() -> Finding:
    """Check the operating system, the processor's cores and the memory."""
    wrong = requirements.wrong_system(sys.platform, requirements.PYTHONS[0])
    if wrong is not None:
        return Finding("system", State.MISSING, wrong.what, wrong.command)
    try:
        name = platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        name = platform.platform(aliased=True, terse=True)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    found = f"{name}, {platform.machine()}, {cores()} cores, {memory / 1e9:.0f} GB of memory"
    return Finding("system", State.OK, found)


def threads() -> Finding:
    """Report the number of threads that a process computes with, and how they wait."""
    said = (f"{name}={value}{' (yours)' if own else ''}" for name, (value, own) in settings().items())
    return Finding("threads", State.OK, f"{', '.join(said)}; {cores()} cores may be used")


def python() -> Finding:
    """Check the Python version."""
    wrong = requirements.wrong_system("linux", sys.version_info[:2])
    if wrong is not None:
        return Finding("Python", State.MISSING, wrong.what, wrong.command)
    return Finding("Python", State.OK, f"{platform.python_version()} at {sys.executable}")


def packages() -> Finding:
    """Check the Python packages that Executive requires, and their versions."""
    lacks = [*requirements.missing_packages(), *requirements.missing_parts()]
    if lacks:
        commands = dict.fromkeys(each.command for each in lacks)
        return Finding("packages", State.MISSING, "; ".join(each.what for each in lacks), " && ".join(commands))
    wanted = _required()
    wrong = [each for each in wanted if not _fits(each)]
    if wrong:
        told = ", ".join(f"{each.name} {_version(each.name) or 'missing'} (wanted {each.specifier})" for each in wrong)
        return Finding("packages", State.LIMITED, f"not as tested: {told}", _pip(wrong))
    return Finding("packages", State.OK, f"all {len(wanted)} as wanted")


def domains() -> Finding:
    """Load the shipped domains, and list the registered skills and relations."""
    from executive.domain.loader import list_domains, load_domain
    from executive.domain.skills import skills

    for name in list_domains():
        load_domain(name)
    registered = f"skills: {', '.join(sorted(skills()))}; relations: {', '.join(sorted(kinds.names()))}"
    return Finding("domains", State.OK, f"{', '.join(list_domains())} ({registered})")


def planner() -> Finding:
    """Solve a shipped problem with Fast Downward."""
    from executive.domain.loader import load_domain
    from executive.planning.fast_downward import FastDownwardPlanner
    from executive.types import Facts, Plan

    domain = load_domain("grocery", "one-item")
    task = domain.task
    plan = FastDownwardPlanner(domain.parsed, timeout=_PATIENCE).plan(
        Facts.closed(task.declared, task.atoms), task.goal
    )
    if isinstance(plan, Plan):
        return Finding("planner", State.OK, f"Fast Downward finds a plan of {len(plan.steps)} steps")
    reinstall = f"{sys.executable} -m pip install --force-reinstall --no-deps up-fast-downward"
    return Finding("planner", State.MISSING, _line(f"Fast Downward: {plan.reason}: {plan.detail}"), reinstall)


def opengl() -> Finding:
    """Render a picture with OpenGL, as the cameras do."""
    try:
        renderer = requirements.choose_renderer() or "the system's"
        lacks = requirements.missing_libraries() if sys.platform == "linux" else []
        if lacks:
            return Finding("OpenGL", State.MISSING, lacks[0].what, lacks[0].command)
        try:
            name = _trial("executive.sim.gl_probe")
        except _TrialError as error:
            raise requirements.cannot_draw(f"by {renderer}: {error}") from None
    except InputError as error:
        return Finding("OpenGL", State.MISSING, str(error), f"unset {error.key}")
    return Finding("OpenGL", State.OK, f"{name}, by {renderer}")


def vulkan() -> Finding:
    """List the Vulkan devices, which the viewer renders with."""
    packages = f"{_sudo()}apt-get install -y mesa-vulkan-drivers libvulkan1"
    try:
        devices = json.loads(_trial("executive.trace.viewer.vulkan_probe"))
    except _TrialError as error:
        return Finding("Vulkan", State.LIMITED, f"{error}: the viewer's window and inspect --png do not work", packages)
    if not devices:
        return Finding(
            "Vulkan", State.LIMITED, "no device: the viewer's window and inspect --png do not work", packages
        )
    return Finding("Vulkan", State.OK, ", ".join(f"{name} ({kind})" for name, kind in devices))


def display() -> Finding:
    """Check whether the viewer can open a window."""
    if requirements.has_display():
        return Finding("display", State.OK, "there is one")
    return Finding("display", State.LIMITED, "none: the viewer opens no window here", "executive inspect RUN --web")


def model() -> Finding:
    """Check the shipped vision-language models."""
    from executive.app import estimators
    from executive.s3e.backends.checkpoint import CONFIG, inspect

    configs = sorted(estimators.SHIPPED.rglob(CONFIG)) if estimators.SHIPPED.is_dir() else []
    if not configs:
        own = "executive run DOMAIN --estimator vlm --vlm FOLDER"
        return Finding("model", State.LIMITED, "none is shipped: --estimator vlm needs one of your own", own)
    try:
        whole = [inspect(config.parent, config.parent.name) for config in configs]
    except InputError as error:
        return Finding("model", State.LIMITED, _line(str(error)), _reinstall())
    sizes = [sum(file.stat().st_size for file in each.folder.iterdir() if file.is_file()) for each in whole]
    told = ", ".join(
        f"{each.name} ({each.model_type}, {size / 1e6:.0f} MB)" for each, size in zip(whole, sizes, strict=True)
    )
    return Finding("model", State.OK, told)


def gpu() -> Finding:
    """Check which device models run on."""
    from executive.s3e.backends.loading import choose_device, native_bfloat16

    names, device = requirements.cuda_devices(), choose_device("auto")
    torch = _version("torch") or ""
    if device == "cpu" and names:
        found = f"{', '.join(names)}, which torch {torch} does not use"
        command = f"{sys.executable} -m pip install --force-reinstall torch=={torch.partition('+')[0]}"
        return Finding("GPU", State.LIMITED, found, command)
    if device == "cpu":
        kind = "bfloat16" if native_bfloat16() else "float32"
        return Finding("GPU", State.OK, f"none; torch {torch} computes on the CPU, in {kind} at the fastest")
    return Finding("GPU", State.OK, f"{', '.join(names) or device}, torch {torch}")


def extras() -> Finding:
    """Check the optional packages (the distribution's extras)."""
    from executive.s3e.backends.packages import broken_torchvision, fitting_torchvision

    names = [name for name in _metadata().get_all("Provides-Extra") or () if name not in _FOR_DEVELOPERS]
    always = _required()
    lacking = {name: [each for each in _required(name) if each not in always and not _fits(each)] for name in names}
    there = ", ".join(name for name in names if not lacking[name])
    absent = ", ".join(name for name in names if lacking[name])
    trouble = broken_torchvision()
    if trouble is not None:
        found = f"torchvision does not load beside torch {_version('torch')} ({trouble}), and counts as not installed"
        requirement, note = fitting_torchvision()
        command = f"{sys.executable} -m pip install --force-reinstall --no-deps {requirement}"
        return Finding("extras", State.LIMITED, found + note, command)
    if "numeric" in names and not lacking["numeric"] and shutil.which("java") is None:
        return Finding("extras", State.LIMITED, f"{there}; numeric (ENHSP) lacks Java", requirements.JAVA)
    if not absent:
        return Finding("extras", State.OK, there or "none")
    # Any torchvision would be installed, and one of another build than torch does not load.
    wanted = [each for name in names if name != "torchvision" for each in lacking[name]]
    commands = [_pip(wanted)] if wanted else []
    if lacking.get("torchvision"):
        commands.append(f"{sys.executable} -m pip install --no-deps {fitting_torchvision()[0]}")
    return Finding("extras", State.LIMITED, f"{there or 'none'}; not here: {absent}", " && ".join(commands))


def disk() -> Finding:
    """Check the free disk space for runs and temporary files."""
    runs = Path("runs").absolute()
    try:
        temporary = Path(tempfile.gettempdir())
    except OSError as error:
        return Finding("disk", State.MISSING, _line(reason(error)), "export TMPDIR=FOLDER")
    for place, key, command in (
        (runs, "runs", "executive run DOMAIN --runs FOLDER"),
        (temporary, "TMPDIR", "export TMPDIR=FOLDER"),
    ):
        try:
            check_writable(place, key)
        except InputError as error:
            return Finding("disk", State.LIMITED, _line(str(error)), command)
    folder = next(path for path in (runs, *runs.parents) if path.is_dir())
    free = min(shutil.disk_usage(place).free for place in (folder, temporary))
    if free < _ROOM:
        state = State.MISSING if free < _LEAST_ROOM else State.LIMITED
        return Finding("disk", state, f"only {free / 1e6:.0f} MB free in {folder}", f"du -sh {folder}/* | sort -h")
    return Finding("disk", State.OK, f"{free / 1e9:.0f} GB free")


def look() -> Finding:
    """Do what a run begins with, in one process and in the same order: native libraries may each work alone and crash
    together."""
    try:
        return Finding("look", State.OK, _trial("executive.app.first_look", _LONG))
    except _TrialError as error:
        what, _, command = str(error).partition("; install it with: ")
        report = f"{sys.executable} -X faulthandler -m executive.app.first_look"  # prints all there is for a bug report
        return Finding("look", State.MISSING, f"a run would fail at its first look: {what}", command or report)


class _TrialError(Exception):
    """A trial in a process of its own failed; the message is one line."""


def _trial(module: str, patience: float | None = None) -> str:
    """Return what a module prints when it is run as a program."""
    command = [sys.executable, "-X", "faulthandler", "-m", module]
    patience = _PATIENCE if patience is None else patience
    try:
        run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=patience, errors="replace")
    except subprocess.TimeoutExpired:
        raise _TrialError(f"it takes longer than {patience:.0f} s") from None
    if run.returncode < 0:
        raise _TrialError(f"the process crashes ({_crash(-run.returncode, run.stderr)})")
    if run.returncode:
        lines = [line for line in run.stderr.splitlines() if line.strip()]
        raise _TrialError(_line(_RAISED.sub("", lines[-1])) if lines else f"exit code {run.returncode}")
    return _line(run.stdout)


_RAISED = re.compile(r"(OSError|executive\.errors\.\w+): ")
"""What Python prints before the message of an error that is already a full sentence."""


def _crash(number: int, stderr: str) -> str:
    """Return the signal's name and the Python file that was running: the first that is not the import machinery."""
    name = signal.Signals(number).name if number in {*signal.Signals} else f"signal {number}"
    files = re.findall(r'^  File "(?!<)([^"]+)", line (\d+)', stderr, re.MULTILINE)
    return f"{name} in {files[0][0]}:{files[0][1]}" if files else name


def _required(extra: str = "") -> list[Requirement]:
    """Return what this distribution requires on this machine, for an extra or for none."""
    required = [Requirement(line) for line in _metadata().get_all("Requires-Dist") or ()]
    return [each for each in required if each.marker is None or each.marker.evaluate({"extra": extra})]


def _metadata() -> PackageMetadata:
    try:
        return metadata("executive")
    except PackageNotFoundError:
        raise MissingError("Executive itself is not installed into this Python", command=_reinstall()) from None


def _fits(requirement: Requirement) -> bool:
    installed = _version(requirement.name)
    return installed is not None and requirement.specifier.contains(installed, prereleases=True)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _pip(packages: Sequence[Requirement]) -> str:
    wanted = dict.fromkeys(f"'{each.name}{each.specifier}'" for each in packages)
    return f"{sys.executable} -m pip install {' '.join(wanted)}"


def _sudo() -> str:
    return "" if not hasattr(os, "geteuid") or os.geteuid() == 0 else "sudo "
