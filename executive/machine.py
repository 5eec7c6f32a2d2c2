"""What a run needs of the machine it runs on, asked for before anything heavy is imported.

A missing library then ends as one line with the command that installs it, not as a traceback out of the middle of
somebody else's package. Everything here is cheap: nothing is imported, libraries are only opened.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path

from executive.errors import MissingError
from executive.native import keep_triton_apart

PYTHONS = ((3, 11), (3, 14))
"""The oldest Python that works, and the first that does not (ompl 2.0.1 has no wheel for it)."""

PACKAGES = {
    "daqp": "daqp",
    "mink": "mink",
    "mujoco": "mujoco",
    "ompl": "ompl",
    "pydantic": "pydantic",
    "rerun": "rerun-sdk",
    "robosuite": "robosuite",
    "unified_planning": "unified-planning",
    "up_fast_downward": "up-fast-downward",
}
"""Importable name -> the name to install it by."""

ENGINE = "downward/builds/release/bin/downward"
"""Fast Downward's search, inside the package up_fast_downward."""

ENGINE_SOURCE = "git+https://github.com/aiplan4eu/up-fast-downward"

ROBOT = "models/assets/robots/ur5e/robot.xml"
"""One of robosuite's assets: where this one is, the others are."""

LIBRARIES = {"libGL.so.1": "libgl1"}
"""What MuJoCo draws with: library -> its Debian package."""


@dataclass(frozen=True, slots=True)
class Missing:
    """One thing that the machine lacks, and the command that mends it."""

    what: str
    command: str


def require() -> None:
    """Raise when something is missing that every run needs.

    Raises:
        MissingError: names everything that is missing, with one command for all of it.
    """
    missing = check()
    if missing:
        commands = dict.fromkeys(entry.command for entry in missing)
        raise MissingError("; ".join(entry.what for entry in missing), command=" && ".join(commands))


def give_back_memory() -> None:
    """Have the C library hand what was freed back to the system (glibc; nothing elsewhere). It keeps what its threads
    have freed for them, and a recording for the viewer is made by many: a hundred megabytes stay with each run."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def check() -> list[Missing]:
    """Everything that is missing on this machine; empty when a run can start."""
    system = wrong_system(sys.platform, sys.version_info[:2])
    if system is not None:
        return [system]
    found = [*missing_packages(), *missing_parts()]
    if sys.platform == "linux":
        found += missing_libraries()
    return found


def wrong_system(name: str, python: Sequence[int]) -> Missing | None:
    """Whether the operating system (as in `sys.platform`) or the Python (major, minor) is one that cannot work."""
    if name == "win32":
        return Missing(
            "Executive does not run on Windows itself (ompl has no wheel there), but in WSL2", "wsl --install"
        )
    oldest, too_new = PYTHONS
    if not oldest <= tuple(python) < too_new:
        versions = ", ".join(f"3.{minor}" for minor in range(oldest[1], too_new[1]))
        return Missing(
            f"Executive needs Python {versions}, and this is {'.'.join(map(str, python))}",
            f"make setup PYTHON=python3.{too_new[1] - 1}",
        )
    return None


def missing_packages() -> list[Missing]:
    """The Python packages that are not installed."""
    missing = [name for module, name in PACKAGES.items() if find_spec(module) is None]
    if not missing:
        return []
    wanted, why = missing, ""
    if "up-fast-downward" in missing and sys.platform == "linux" and platform.machine() == "aarch64":
        wanted = [ENGINE_SOURCE if name == "up-fast-downward" else name for name in missing]
        why = " (up-fast-downward has no wheel for ARM Linux: this builds it)"
    several = len(missing) > 1
    what = f"the Python package{'s' * several} {', '.join(missing)} {'are' if several else 'is'} missing{why}"
    return [Missing(what, _pip(*wanted))]


def missing_parts() -> Iterator[Missing]:
    """Files of installed packages that a broken or partial installation may lack."""
    for module, part, what in (
        ("up_fast_downward", ENGINE, "Fast Downward's search engine"),
        ("robosuite", ROBOT, "robosuite's model of the UR5e"),
    ):
        spec = find_spec(module)
        if spec is None or spec.origin is None:  # said by `missing_packages` already
            continue
        file = Path(spec.origin).parent / part
        if not file.exists():
            yield Missing(f"{what} is missing ({file})", _pip("--force-reinstall --no-deps", PACKAGES[module]))


def missing_libraries() -> list[Missing]:
    """The system libraries that cannot be loaded (Linux)."""
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    renderer = os.environ.get("MUJOCO_GL", "").strip().lower() or "egl"
    if renderer == "egl":
        trouble = egl_trouble()
        if trouble is not None:
            missing[trouble] = "libegl1 libgl1-mesa-dri"
    elif renderer == "osmesa" and not _loads("libOSMesa.so.8"):
        missing["libOSMesa.so.8 (asked for by MUJOCO_GL=osmesa)"] = "libosmesa6"
    if not missing:
        return []
    sudo = "" if os.geteuid() == 0 else "sudo "
    packages = " ".join(missing.values())
    return [
        Missing(f"cannot use {', '.join(missing)}", f"{sudo}apt-get update && {sudo}apt-get install -y {packages}"),
    ]


def egl_trouble() -> str | None:
    """Why EGL cannot render off screen on any device, or None when it can.

    The same calls as MuJoCo's own EGL context makes (EGL_EXT_device_enumeration, EGL_EXT_platform_device).
    """
    os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # what Mesa would print is said here, in one line
    keep_triton_apart()
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    pointer, number = ctypes.c_void_p, ctypes.c_int
    query = _function(egl, b"eglQueryDevicesEXT", ctypes.c_uint, number, pointer, ctypes.POINTER(number))
    display_of = _function(egl, b"eglGetPlatformDisplayEXT", pointer, ctypes.c_uint, pointer, pointer)
    if query is None or display_of is None:
        return "EGL (it cannot render without a screen)"
    devices, count = (pointer * 32)(), number()
    query(len(devices), devices, ctypes.byref(count))
    for device in devices[: count.value]:
        display = display_of(0x313F, device, None)  # EGL_PLATFORM_DEVICE_EXT
        if display and egl.eglInitialize(display, None, None):
            return None
    return "EGL (no graphics driver, not even Mesa's software one)"


def cuda_devices() -> list[str]:
    """The names of the CUDA devices that the driver knows, whatever torch makes of them."""
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return []
    count = ctypes.c_int()
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return []
    names = []
    for index in range(count.value):
        device, name = ctypes.c_int(), ctypes.create_string_buffer(256)
        if driver.cuDeviceGet(ctypes.byref(device), index) == 0:
            driver.cuDeviceGetName(name, len(name), device)
            names.append(name.value.decode(errors="replace"))
    return names


def _function(egl: ctypes.CDLL, name: bytes, result: type, *arguments: type) -> Callable[..., int] | None:
    """An extension function of EGL, or None where the library does not have it."""
    address = egl.eglGetProcAddress(name)
    return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _pip(*what: str) -> str:
    """The pip command that installs `what` into this very Python, in the versions that Executive asks for."""
    try:
        declared = requires("executive") or []
    except PackageNotFoundError:
        declared = []
    pins = {re.split(r"[^\w-]", line, maxsplit=1)[0]: line.split(";")[0].strip() for line in declared}
    quoted = (f"'{pins[word]}'" if word in pins else word for word in what)
    return f"{sys.executable} -m pip install {' '.join(quoted)}"
