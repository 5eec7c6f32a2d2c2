"""Folders that long work goes on in: one process at a time, and what a killed one left half written is taken away."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path

from executive.errors import InputError
from executive.util.files import parse_json

LOCK = ".lock"

_PASSING = re.compile(r"\..+\.[0-9]+")
"""How what is being written is called until it is whole: `.name.pid`."""


class Lock:
    """Holds a folder until `release`, or until this process ends, however it does."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    def release(self) -> None:
        """Let another process work in the folder."""
        if self._descriptor is not None:
            with suppress(OSError):
                os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
        self._descriptor = None


def lock(folder: Path, doing: str, command: str) -> Lock:
    """Make a folder where there is none, and keep other processes from working in it. The system lets go of it when
    this process ends, so that a lock whose holder is dead holds nobody up.

    Args:
        doing: what is done in it, such as "collecting".
        command: the command that does it; with this process and the time, what others are told.

    Raises:
        InputError: another process works in it, or it cannot be written to.
    """
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise InputError(f"cannot be written to ({error.strerror})", file=folder) from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        holder = {"pid": os.getpid(), "host": socket.gethostname(), "since": since, "doing": doing, "command": command}
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, (json.dumps(holder) + "\n").encode(), 0)
    except OSError as error:
        told = _holder(descriptor)
        os.close(descriptor)
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise InputError(f"another process is working in this folder{told}", file=folder) from None
        raise InputError(f"cannot be held for this process alone ({error.strerror})", file=folder) from None
    return Lock(descriptor)


def sweep(*folders: Path) -> None:
    """Take away what a process that was killed had half written. For whoever holds the lock."""
    for folder in folders:
        for each in folder.iterdir() if folder.is_dir() else ():
            if _PASSING.fullmatch(each.name):
                shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink(missing_ok=True)


def _holder(descriptor: int) -> str:
    """Who holds a folder, as far as that is told."""
    try:
        said = parse_json(os.pread(descriptor, 10_000, 0))
        return (
            f", {said['doing']} since {said['since']}: process {int(said['pid'])} on {said['host']}, {said['command']}"
        )
    except (OSError, ValueError, KeyError, TypeError):
        return ""
