"""Atomic writes: a file has its old content or its new content, whenever the writing process is killed."""

from __future__ import annotations

import os
from pathlib import Path


def write_atomic(file: Path, data: bytes, durable: bool = True) -> Path:
    """Write `data` to a temporary file beside `file` and rename it to `file`.

    Args:
        durable: whether the data is synced to disk first, so that it also survives a power cut.

    Raises:
        OSError: the file cannot be written.
    """
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with draft.open("wb") as opened:
            opened.write(data)
            if durable:
                opened.flush()
                os.fsync(opened.fileno())
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return file
