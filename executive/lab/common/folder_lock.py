"""Locks on the folders of long work: one process at a time; and the removal of partial files of a killed process."""

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

_PARTIAL = re.compile(r"\..+\.[0-9]+")
"""The name of a file or folder while it is being written: `.name.pid`."""


class Lock:
    """The lock of a folder, held until `release` or until this process ends, however it ends."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    def release(self) -> None:
        """Releases the lock."""
        if self._descriptor is not None:
            with suppress(OSError):
                os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
        self._descriptor = None


def lock(folder: Path, doing: str, command: str) -> Lock:
    """Creates a folder if needed, and locks it. The system releases the lock when this process ends, so that none
    outlives its holder.

    Args:
        doing: what is done in the folder, such as "collecting".
        command: the command that does it; others read it, with the process id and the time, in their error message.

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
        holder_text = _holder(descriptor)
        os.close(descriptor)
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise InputError(f"another process is working in this folder{holder_text}", file=folder) from None
        raise InputError(f"cannot be locked ({error.strerror})", file=folder) from None
    return Lock(descriptor)


def remove_partial(*folders: Path) -> None:
    """Removes the partial files and folders that a killed process left. The caller holds the lock."""
    for folder in folders:
        for each in folder.iterdir() if folder.is_dir() else ():
            if _PARTIAL.fullmatch(each.name):
                shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink(missing_ok=True)


def _holder(descriptor: int) -> str:
    """The text about the holder of a lock; empty where it cannot be read."""
    try:
        holder = parse_json(os.pread(descriptor, 10_000, 0))
        process = f"process {int(holder['pid'])} on {holder['host']}"
        return f", {holder['doing']} since {holder['since']}: {process}, {holder['command']}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""
