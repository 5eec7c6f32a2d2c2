"""The packages that writing another side's format takes, each from an extra of this package."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType

from executive.errors import MissingError


def needed(module: str, extra: str, what: str) -> ModuleType:
    """Return a module that an extra brings.

    Raises:
        MissingError: it is not installed; the message says for `what` it is needed, and names the extra.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingError(
            f"{what} needs the extra {extra!r}, which is missing",
            command=f"{sys.executable} -m pip install 'executive[{extra}]'",
        ) from None
