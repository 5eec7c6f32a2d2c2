"""What is compiled, and where it is kept."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from executive.protocols import Preparing
from executive.skills.clear_view import aside, home
from executive.skills.pick import pick
from executive.skills.place import place

NOWHERE = """
from numba.core.caching import CacheImpl, UserProvidedCacheLocator
CacheImpl._locator_classes = [UserProvidedCacheLocator]  # as where nothing can be written beside the file or at home
"""
IMPORT = "from executive.skills import collision_kernels as kernels"
FOLDER = f"executive-compiled-{os.getuid()}"


def fresh(script: str, **environment: str) -> object:
    """What a script prints as JSON in a fresh interpreter."""
    clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    run = subprocess.run(
        [sys.executable, "-c", script], env={**clean, **environment}, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


@pytest.mark.parametrize("skill", [pick, place, home, aside])
def test_every_skill_of_the_arm_can_be_made_ready(skill: object) -> None:
    assert isinstance(skill, Preparing)


def test_what_is_kept_is_not_told_of() -> None:
    script = f"import json\n{IMPORT}\ntold = []\nkernels.ready()\nkernels.ready(told.append)\n"
    assert fresh(f"{script}print(json.dumps(told))") == []


@pytest.mark.slow
def test_what_is_compiled_is_told_of_once_and_is_there_in_the_next_process(tmp_path: Path) -> None:
    script = f"import json\n{IMPORT}\ntold = []\nkernels.ready(told.append)\nprint(json.dumps(told))"
    first, second = (fresh(script, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert isinstance(first, list)
    assert len(first) == 1
    assert second == []


def test_where_numba_can_keep_nothing_there_is_a_folder_of_the_users_own(tmp_path: Path) -> None:
    script = f"import json, numba\n{IMPORT}\nprint(json.dumps([kernels.KEPT, numba.config.CACHE_DIR]))"
    assert fresh(NOWHERE + script, TMPDIR=str(tmp_path)) == [True, str(tmp_path / FOLDER)]
    assert stat.S_IMODE((tmp_path / FOLDER).stat().st_mode) == 0o700


@pytest.mark.parametrize("kind", ["open to others", "a link", "a file"])
def test_what_others_could_have_written_is_not_run(kind: str, tmp_path: Path) -> None:
    folder = tmp_path / FOLDER
    match kind:
        case "open to others":
            folder.mkdir()
            folder.chmod(0o777)
        case "a link":
            (tmp_path / "elsewhere").mkdir(mode=0o700)
            folder.symlink_to(tmp_path / "elsewhere")
        case _:
            folder.touch(mode=0o600)
    script = f"import json, numba\n{IMPORT}\nprint(json.dumps([kernels.KEPT, numba.config.CACHE_DIR]))"
    assert fresh(NOWHERE + script, TMPDIR=str(tmp_path)) == [False, ""]
