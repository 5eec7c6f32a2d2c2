"""Checks what a run needs on this machine, before anything heavy is imported.

A missing library is then reported in one line with the command that installs it, instead of a traceback from inside
another package. The checks are cheap: nothing is imported, libraries are only opened.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path

from executive.errors import ExecutiveError, InputError, MissingError
from executive.util.native_libraries import keep_triton_apart

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

EVERYWHERE = ("pydantic", "rerun", "up_fast_downward")
"""Those that a run needs in a world without a simulator, too."""

JAVA = "apt-get install -y default-jre-headless"
"""Installs Java, which the planner ENHSP runs on (the extra `numeric`)."""

ENGINE = "downward/builds/release/bin/downward"
"""Fast Downward's search, inside the package up_fast_downward."""

ENGINE_SOURCE = "git+https://github.com/aiplan4eu/up-fast-downward"

ROBOT = "models/assets/robots/ur5e/robot.xml"
"""One of robosuite's assets: where this one is, the others are."""

LIBRARIES = {"libGL.so.1": "libgl1"}
"""What MuJoCo draws with: library -> its Debian package."""

RENDERER, BINDING, DEVICE = "MUJOCO_GL", "PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID"
OFF_SCREEN = ("egl", "osmesa")
"""What `RENDERER` may say wherever there is no screen."""

_ON_SCREEN = {"linux": ("glfw", "glx", "on", "enable", "enabled", "true", "1"), "darwin": ("cgl", "glfw", "")}
"""What else MuJoCo takes, where there is a screen."""

_DRIVER_VARIABLES = (
    *("GALLIUM_DRIVER", "MESA_LOADER_DRIVER_OVERRIDE", "LIBGL_DRIVERS_PATH", "LIBGL_ALWAYS_SOFTWARE"),
    *("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS", "EGL_PLATFORM", "__GLX_VENDOR_LIBRARY_NAME"),
)
"""Other variables that select an OpenGL driver; one that names what is not there is the user's mistake."""


@dataclass(frozen=True, slots=True)
class Missing:
    """Something that the machine lacks, and the command that installs it."""

    what: str
    command: str


def require(simulator: bool = True) -> None:
    """Raise an error if anything is missing that every run needs; without a `simulator`, nothing that only that needs.

    Raises:
        InputError: an environment variable selects a renderer that cannot work.
        MissingError: names everything that is missing, with one command for all of it.
    """
    if simulator:
        choose_renderer()
    missing = check() if simulator else missing_packages(EVERYWHERE)
    if missing:
        commands = dict.fromkeys(entry.command for entry in missing)
        raise MissingError("; ".join(entry.what for entry in missing), command=" && ".join(commands))


def give_back_memory() -> None:
    """Return freed memory to the system (glibc; no effect elsewhere). Its allocator keeps what threads have freed, and
    many threads write the viewer's recording: a hundred megabytes would stay with each run."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def check() -> list[Missing]:
    """Return everything that is missing on this machine; empty when a run can start."""
    system = wrong_system(sys.platform, sys.version_info[:2])
    if system is not None:
        return [system]
    found = [*missing_packages(), *missing_parts()]
    if sys.platform == "linux":
        found += missing_libraries()
    return found


def wrong_system(name: str, python: Sequence[int]) -> Missing | None:
    """Return what is wrong with the operating system (as in `sys.platform`) or the Python version (major, minor)."""
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


def missing_packages(needed: Collection[str] | None = None) -> list[Missing]:
    """Return those of `PACKAGES` that are not installed, or only those of them that are `needed`."""
    packages = {module: name for module, name in PACKAGES.items() if needed is None or module in needed}
    missing = [name for module, name in packages.items() if find_spec(module) is None]
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


def choose_renderer() -> str:
    """Choose MuJoCo's renderer, set `MUJOCO_GL` to it and return it: off screen unless the variable says otherwise. It
    must be called before MuJoCo is imported, which reads the variable once.

    Raises:
        InputError: this variable, or another that goes with it, says what cannot be; its name is the error's key.
    """
    said = os.environ.get(RENDERER, "").strip().lower()
    if sys.platform != "linux":
        if said not in _ON_SCREEN.get(sys.platform, (said,)):
            raise InputError(f"is {said!r}, with which MuJoCo draws nothing here; it has to be unset", key=RENDERER)
        return said
    renderer = said or OFF_SCREEN[0]
    ways = " or ".join(OFF_SCREEN)
    if renderer in _ON_SCREEN["linux"]:
        if not has_display():
            why = f"is {said!r}, which draws on a screen, and there is none; it has to be {ways}, or unset"
            raise InputError(why, key=RENDERER)
    elif renderer not in OFF_SCREEN:
        raise InputError(f"is {said!r}, with which MuJoCo draws nothing; it has to be {ways}, or unset", key=RENDERER)
    os.environ[RENDERER] = renderer
    if renderer in OFF_SCREEN:
        binding = os.environ.get(BINDING, "").strip().lower()
        if binding not in ("", renderer):
            why = f"is {binding!r}, and what draws is {renderer!r} (see {RENDERER}); it has to be the same, or unset"
            raise InputError(why, key=BINDING)
        if binding:
            os.environ[BINDING] = binding  # OpenGL's own has no other case
    return renderer


def has_display(environment: Mapping[str, str] = os.environ, system: str = sys.platform) -> bool:
    """Return whether a window can be opened."""
    return not system.startswith("linux") or any(environment.get(key) for key in ("DISPLAY", "WAYLAND_DISPLAY"))


def cannot_draw(why: str) -> ExecutiveError:
    """Return the error for a machine that cannot render: what to install, or the environment variables that may have
    selected a wrong driver."""
    blamed = [name for name in (DEVICE, *_DRIVER_VARIABLES) if os.environ.get(name)]
    renderer = os.environ.get(RENDERER, "")
    if renderer not in ("", *OFF_SCREEN):
        blamed.append(RENDERER)
    if blamed:
        told = ", ".join(f"{name}={os.environ[name]}" for name in blamed)
        return InputError(f"nothing can be drawn ({why}), with {told} set; try without", key=" ".join(blamed))
    return MissingError(
        f"nothing can be drawn off screen ({why})", command=_apt("libegl1", "libgl1", "libgl1-mesa-dri")
    )


def missing_libraries() -> list[Missing]:
    """Return the system libraries that cannot be loaded (Linux).

    Raises:
        InputError: an environment variable selects a renderer that cannot work.
    """
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    renderer = choose_renderer()
    if renderer == "egl":
        trouble = egl_trouble()
        if trouble is not None:
            missing[trouble] = "libegl1 libgl1-mesa-dri"
    elif renderer == "osmesa" and not _loads("libOSMesa.so.8"):
        missing["libOSMesa.so.8 (asked for by MUJOCO_GL=osmesa)"] = "libosmesa6"
    if not missing:
        return []
    return [Missing(f"cannot use {', '.join(missing)}", _apt(*missing.values()))]


def egl_trouble() -> str | None:
    """Return why EGL cannot render off screen on any device, or None when it can.

    The same calls as MuJoCo's own EGL context makes (EGL_EXT_device_enumeration, EGL_EXT_platform_device).

    Raises:
        InputError: an environment variable names a device or a driver that does not exist.
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
    for device in _chosen(devices[: count.value]):
        display = display_of(0x313F, device, None)  # EGL_PLATFORM_DEVICE_EXT
        if display and egl.eglInitialize(display, None, None):
            return None
    trouble = "no graphics driver, not even Mesa's software one"
    if isinstance(misled := cannot_draw(f"by EGL: {trouble}"), InputError):
        raise misled
    return f"EGL ({trouble})"


def _chosen(devices: Sequence[int | None]) -> Sequence[int | None]:
    """The one of EGL's devices that the environment names, or all of them."""
    said = os.environ.get(DEVICE, "").strip()
    if not said:
        os.environ.pop(DEVICE, None)  # for MuJoCo, nothing is no number
        return devices
    if not devices:
        return devices
    if not (said.isdecimal() and int(said) < len(devices)):
        raise InputError(f"is {said!r}; it has to be a number from 0 to {len(devices) - 1}, or unset", key=DEVICE)
    return devices[int(said) : int(said) + 1]


def cuda_devices() -> list[str]:
    """Return the names of the driver's CUDA devices, whether or not torch can use them."""
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


def _apt(*packages: str) -> str:
    sudo = "" if os.geteuid() == 0 else "sudo "
    return f"{sudo}apt-get update && {sudo}apt-get install -y {' '.join(packages)}"


def _pip(*what: str) -> str:
    """The pip command that installs `what` into this very Python, in the versions that Executive asks for."""
    try:
        declared = requires("executive") or []
    except PackageNotFoundError:
        declared = []
    pins = {re.split(r"[^\w-]", line, maxsplit=1)[0]: line.split(";")[0].strip() for line in declared}
    quoted = (f"'{pins[word]}'" if word in pins else word for word in what)
    return f"{sys.executable} -m pip install {' '.join(quoted)}"
