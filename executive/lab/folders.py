"""Folders that long work goes on in: one process at a time."""

from __future__ import annotations

import os
from pathlib import Path

from executive.errors import InputError


def lock(folder: Path, doing: str) -> int:
    """Make a folder where there is none, and keep other processes from working in it while the returned file descriptor
    is open.

    Args:
        doing: what is done in it, such as "collecting".

    Raises:
        InputError: another process does that already, or the folder cannot be written to.
    """
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise InputError(f"cannot be written to ({error.strerror})", file=folder) from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise InputError(f"another process is {doing} in this folder", file=folder) from None
    return descriptor
