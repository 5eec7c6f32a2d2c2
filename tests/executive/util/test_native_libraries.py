"""What has to be loaded before what: each check in a fresh interpreter, because this one has loaded everything already.

A small library takes triton's place in the quick ones. The slow one has the real thing, and crashes as it does.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FIRST = """
import os, sys

def loaded():
    with open("/proc/self/maps") as maps:
        return "libtriton.so" in maps.read()

def watch(event, arguments):
    if event == "ctypes.dlopen" and arguments[0] == "libEGL.so.1" and egl:
        seen.append(loaded())
    if event == "import" and arguments[0] in ("torch", "transformers"):
        os._exit(0 if loaded() else 1)  # it would take seconds to import

egl, seen = False, []
sys.addaudithook(watch)
"""
"""Watches whether triton's library is there when torch is imported, or EGL opened (once `egl` is set)."""

RENDERER = """
import mujoco
real = mujoco.Renderer

def renderer(*arguments):
    seen.append(loaded())
    return real(*arguments)

mujoco.Renderer = renderer
"""
"""Writes down whether triton's library is there when an OpenGL context is made."""

MODEL = 'mujoco.MjModel.from_xml_string("<mujoco/>")'


def fresh(script: str, *folders: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([*map(str, folders), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": path},
    )


@pytest.fixture
def triton(tmp_path: Path) -> Path:
    """A folder with a package of that name, which must not be imported, and a library that can be loaded."""
    library = next(Path(os.path.realpath(sys.executable)).parent.parent.glob("lib/python*/lib-dynload/_json*.so"), None)
    if sys.platform != "linux" or library is None:
        pytest.skip("no library to stand in for triton's")
    folder = tmp_path / "there"
    (folder / "triton" / "_C").mkdir(parents=True)
    (folder / "triton" / "__init__.py").write_text("raise SystemExit('triton is imported')\n")
    shutil.copy(library, folder / "triton" / "_C" / "libtriton.so")
    return folder


@pytest.mark.parametrize(
    "statement",
    [
        "egl = True; from executive.util import requirements; requirements.egl_trouble()",
        "from executive.sim import gl_probe as probe" + RENDERER + "probe.draw()",
        f"from executive.sim import rendering as drawing{RENDERER}drawing.make_renderer({MODEL}, 8, 8)",
    ],
)
def test_tritons_library_is_there_before_a_picture_is_drawn(triton: Path, statement: str) -> None:
    run = fresh(f"{FIRST}\n{statement}\nassert seen and all(seen)", triton)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    "statement",
    [
        *(
            f"from executive.s3e.backends import loading; loading.{name}(None)"
            for name in ("load", "load_language_model")
        ),
        "from executive.s3e.backends import loading; loading.choose_device('auto')",
        "from executive.s3e.backends import loading; loading.native_bfloat16()",
        "from executive.lab.training import optimiser",
    ],
)
def test_it_is_there_before_torch(triton: Path, statement: str) -> None:
    run = fresh(f"{FIRST}\n{statement}\nassert False, 'torch was not imported'", triton)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("statement", ["import executive.cli", "import executive.s3e", "import executive.sim.world"])
def test_it_is_not_loaded_before_it_is_called_for(triton: Path, statement: str) -> None:
    run = fresh(f"{FIRST}\n{statement}\nassert not loaded()", triton)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(("defined", "prefers"), [(False, False), (True, True)])
def test_it_prefers_its_own_functions_where_others_are_visible(triton: Path, defined: bool, prefers: bool) -> None:
    """Beside a visible LLVM it does, and only then."""
    script = f"""
import ctypes, os
from pathlib import Path
real, modes = ctypes.CDLL, []

class Everything:
    if {defined}:
        LLVMContextCreate = None

def load(name, mode=None):
    if name is None:
        return Everything()
    modes.append(mode)
    return real(name, mode)

ctypes.CDLL = load
from executive.util.native_libraries import keep_triton_apart
keep_triton_apart()
keep_triton_apart()
[mode] = modes
assert bool(mode & os.RTLD_DEEPBIND) is {prefers}, mode
"""
    run = fresh(script, triton)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("content", [None, b"", b"no library"])
def test_a_triton_that_is_not_there_or_broken_is_left_alone(triton: Path, content: bytes | None) -> None:
    library = triton / "triton" / "_C" / "libtriton.so"
    library.unlink() if content is None else library.write_bytes(content)
    run = fresh("from executive.util.native_libraries import keep_triton_apart; keep_triton_apart()", triton)
    assert (run.returncode, run.stderr) == (0, "")


DRAW = f"""
import os
os.environ.setdefault("MUJOCO_GL", "egl")
import mujoco
renderer = mujoco.Renderer({MODEL}, 8, 8)
"""
OURS = """
from executive.sim import gl_probe
from executive.util import requirements
requirements.egl_trouble()
gl_probe.draw()
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_real_triton_beside_the_real_driver(tmp_path: Path) -> None:
    """Crashes the process where nobody sees to it (Mesa's software driver), and not after any of our ways in, nor when
    somebody else has drawn first."""
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(tmp_path), "triton==3.7.1"]
    if subprocess.run(pip, capture_output=True, check=False).returncode:
        pytest.skip("triton's wheel cannot be had")
    assert fresh(f"{OURS}\nimport triton", tmp_path).returncode == 0
    run = fresh(
        f"{DRAW}\nfrom executive.util.native_libraries import keep_triton_apart\nkeep_triton_apart()\nimport triton",
        tmp_path,
    )
    assert run.returncode == 0, run.stderr
    if fresh(f"{DRAW}\nimport triton", tmp_path).returncode == 0:
        pytest.skip("this machine's driver shows no LLVM, and so nothing was to be seen to")
