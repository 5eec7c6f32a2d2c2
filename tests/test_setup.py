"""The set-up on a machine that has something missing, and (slow) on one that has everything."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TOOLS = ("dirname", "cat", "cksum", "grep", "uname")
"""What scripts/setup uses before it installs anything."""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with all that the set-up reads."""
    folder = tmp_path / "checkout"
    (folder / "scripts").mkdir(parents=True)
    for name in ("scripts/setup", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder for PATH that has the plainest tools, no Python and no compiler."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in TOOLS:
        found = shutil.which(name)
        assert found is not None
        (folder / name).symlink_to(found)
    return folder


def add(folder: Path, name: str, script: str) -> None:
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def setup(checkout: Path, tools: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    run = subprocess.run(
        ["/bin/sh", "scripts/setup"],
        cwd=checkout,
        env={"PATH": str(tools), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert not (checkout / ".venv" / ".executive-setup").exists()
    return run


def test_without_a_python_it_says_which_ones_would_do(checkout: Path, tools: Path) -> None:
    add(tools, "python3", "exit 1")  # as a Python does that is too old
    run = setup(checkout, tools)
    assert run.returncode == 3
    assert run.stderr.startswith("error: no Python 3.11, 3.12 or 3.13 found;")
    assert run.stderr.count("\n") == 1


def test_a_python_that_was_asked_for_is_not_replaced_by_another(checkout: Path, tools: Path) -> None:
    (tools / "python3").symlink_to(sys.executable)
    add(tools, "wanted", "exit 1")
    run = setup(checkout, tools, PYTHON="wanted")
    assert (run.returncode, run.stderr) == (3, "error: PYTHON=wanted is not a Python 3.11, 3.12 or 3.13\n")


@pytest.mark.skipif(sys.platform != "linux", reason="system packages are looked after on Linux alone")
def test_who_is_not_root_is_told_the_command(checkout: Path, tools: Path) -> None:
    add(tools, "id", "echo 1000")
    add(tools, "apt-get", "echo must not be called >&2; exit 1")
    run = setup(checkout, tools, PYTHON=sys.executable)
    assert run.returncode == 3
    command = "sudo apt-get update && sudo apt-get install -y gcc libc6-dev"
    assert run.stderr.startswith(f"error: missing system packages; install them with: {command}")
    assert run.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="system packages are looked after on Linux alone")
def test_without_apt_the_packages_are_named(checkout: Path, tools: Path) -> None:
    add(tools, "id", "echo 0")
    run = setup(checkout, tools, PYTHON=sys.executable)
    assert run.returncode == 3
    assert "gcc libc6-dev" in run.stderr


def working_tree(target: Path) -> Path:
    """A copy of what git knows or would take, as a fresh clone would have it."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).exists():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target / name, follow_symlinks=False)
    return target


def printed(*command: str | Path, cwd: Path, **environment: str) -> str:
    """What a command prints, once it has succeeded."""
    run = subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_fresh_clone_sets_itself_up_once(tmp_path: Path) -> None:
    clone = working_tree(tmp_path / "clone")
    assert "Installing Python packages" in printed(
        "make", "--no-print-directory", "setup", cwd=clone, PYTHON=sys.executable
    )
    printed(".venv/bin/python", "-m", "pip", "check", cwd=clone)
    assert "executive run grocery" in printed(".venv/bin/executive", "domains", cwd=clone)
    assert printed("make", "--no-print-directory", "setup", cwd=clone) == ""


def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as opened:
        return set(opened.namelist())


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_an_installed_wheel_runs_a_shipped_domain_from_anywhere(tmp_path: Path) -> None:
    source, elsewhere, venv = working_tree(tmp_path / "source"), tmp_path / "elsewhere", tmp_path / "venv"
    elsewhere.mkdir()
    printed(sys.executable, "-m", "pip", "wheel", "-qq", "--no-deps", "-w", tmp_path, source, cwd=tmp_path)
    (wheel,) = tmp_path.glob("executive-*.whl")
    assert {name.split("/")[0].split("-")[0] for name in names(wheel)} == {"executive"}
    assert {"executive/skills/pick.py", "executive/domains/grocery/domain.toml"} <= names(wheel)
    printed(sys.executable, "-m", "venv", venv, cwd=tmp_path)
    printed(venv / "bin/python", "-m", "pip", "install", "-qq", "hatchling", cwd=tmp_path)
    printed(venv / "bin/python", "-m", "hatchling", "build", "-t", "sdist", "-d", tmp_path, cwd=source)
    (archive,) = tmp_path.glob("executive-*.tar.gz")
    printed(sys.executable, "-m", "pip", "wheel", "-qq", "--no-deps", "-w", tmp_path / "again", archive, cwd=tmp_path)
    (again,) = (tmp_path / "again").glob("executive-*.whl")
    assert names(again) == names(wheel)
    printed(venv / "bin/python", "-m", "pip", "install", "-qq", "--no-deps", wheel, cwd=tmp_path)
    # Everything that it depends on is borrowed from the environment of this test.
    (site,) = venv.glob("lib/python*/site-packages")
    (site / "borrowed.pth").write_text(f"{sysconfig.get_path('purelib')}\n{sysconfig.get_path('purelib')}/rerun_sdk\n")
    where = printed(venv / "bin/python", "-c", "import executive; print(executive.__file__)", cwd=elsewhere)
    assert Path(where.strip()).is_relative_to(venv)
    printed(venv / "bin/executive", "run", "grocery", "--problem", "one-item", "--quiet", cwd=elsewhere)
    assert "executive run shelf" in printed(venv / "bin/executive", "new", "shelf", cwd=elsewhere)
    assert (elsewhere / "shelf" / "scene.toml").is_file()
    assert len(list((elsewhere / "runs").glob("*/summary.json"))) == 1
