"""What a run leaves, in the formats of others: MCAP for robot logs.

Each of them is read by its own side's tools; nothing of Executive is needed there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from executive.export.mcap_file import export_mcap

__all__ = ["export_mcap"]

_FROM = {"export_mcap": "executive.export.mcap_file"}


def __getattr__(name: str) -> object:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
