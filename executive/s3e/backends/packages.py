"""Packages that models need: what is done about one that is missing, or that does not load beside the others."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from executive.errors import ExecutiveError, MissingError
from executive.util.native_libraries import keep_triton_apart

EXTRAS = {"torchvision": "torchvision", "num2words": "smolvlm"}
"""What some family's processor asks for and the default installation lacks -> our extra that brings it."""


@contextmanager
def importing() -> Iterator[None]:
    """For a block that imports torch and transformers: what has to be seen to before, and one line where they do not
    load.

    Raises:
        MissingError: they do not; says why.
    """
    keep_triton_apart()
    broken_torchvision()
    try:
        yield
    except ExecutiveError:
        raise
    except Exception as error:  # a package that is broken raises whatever it raises
        raise unloadable("torch and transformers", error) from error


def unloadable(what: str, error: BaseException) -> MissingError:
    """What to say of something that does not load because of a package that is missing or broken."""
    while error.__cause__ is not None:  # transformers says "Could not import module", and what is wrong below that
        error = error.__cause__
    asked = _ASKED.search(str(error))
    lacking = asked[1].lower() if asked else error.name if isinstance(error, ModuleNotFoundError) else None
    if lacking:
        command = f"install {lacking.partition('.')[0]}"
    else:
        culprit = "transformers" if "torch" in sys.modules else "torch"
        command = f"install --force-reinstall --no-deps {culprit}=={_version(culprit)}"
    return MissingError(f"{what} cannot be loaded ({line(error)})", command=f"{sys.executable} -m pip {command}")


_ASKED = re.compile(r"requires the ([\w-]+) library")
"""How transformers says which package is missing."""


@cache
def broken_torchvision() -> str | None:
    """Why the torchvision that is installed cannot be used, or None where it can or is not there: as a rule, it is of
    another build (CUDA, CPU) or release than torch.

    Transformers then fails for every family, whether it needs torchvision or not, and so one that is broken counts as
    not installed for the rest of this process.
    """
    if find_spec("torchvision") is None:
        return None
    try:
        import_module("torchvision")
    except Exception as error:  # one that does not fit torch raises whatever its extension raises
        for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
            del sys.modules[name]
        sys.modules["torchvision"] = None  # type: ignore[assignment]  # `find_spec` finds nothing, import fails
        _forget_torchvision()
        return line(error)
    return None


def _forget_torchvision() -> None:
    """Have transformers, if it is loaded, ask again whether there is a torchvision."""
    loaded = sys.modules.get("transformers.utils.import_utils")
    for name in ("is_torchvision_available", "is_torchvision_v2_available", "is_torchvision_greater_or_equal"):
        forget = getattr(getattr(loaded, name, None), "cache_clear", None)
        if forget is not None:
            forget()


def needed(package: str, what: str) -> MissingError:
    """What to say of a model (`what`) that does not load without `package`."""
    message, force = f"{what} prepares its prompts with {package}", ""
    if package != "torchvision":
        return MissingError(message, command=f"pip install 'executive[{EXTRAS[package]}]'")
    trouble = broken_torchvision()
    if trouble is not None:
        message += f", and the one that is installed does not load beside torch {_version('torch')} ({trouble})"
        force = " --force-reinstall"  # to pip, 0.28.0 and 0.28.0+cpu may be the same
    requirement, note = fitting_torchvision()
    return MissingError(message + note, command=f"{sys.executable} -m pip install{force} --no-deps {requirement}")


def fitting_torchvision() -> tuple[str, str]:
    """The torchvision that goes with the torch that is installed, as pip takes it, and a note where to get it if it is
    not where pip looks by itself.

    Both are built together: torch 2.13.0 goes with torchvision 0.28.0, and what follows a + (cpu, cu130), which builds
    from PyTorch's own indexes have, has to be the same.
    """
    release, _, build = (_version("torch") or "").partition("+")
    major, minor, patch = ([*release.split("."), "", ""])[:3]
    if major != "2" or not (minor + patch).isdecimal():
        return "'executive[torchvision]'", ""
    wanted = f"torchvision==0.{int(minor) + 15}.{patch}"
    if not build:
        return wanted, ""
    note = f"; it has to be built as torch is (+{build}): INDEX is the address that torch came from, which PyTorch's"
    return f"{wanted}+{build} --index-url INDEX", f"{note} installation page names"


def line(error: BaseException) -> str:
    """An exception in one line."""
    text = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
    return f"{type(error).__name__}: {text[:300]}"


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
