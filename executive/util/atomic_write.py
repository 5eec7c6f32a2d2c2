"""Files that are there whole or not at all, whenever the process that writes them is killed."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(file: Path, data: bytes, lasting: bool = True) -> Path:
    """Put `data` into a file. Until all of it is written, the file is what it was before.

    Args:
        lasting: it also survives a power cut.

    Raises:
        OSError: it cannot be written.
    """
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with draft.open("wb") as opened:
            opened.write(data)
            if lasting:
                opened.flush()
                os.fsync(opened.fileno())
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return file
