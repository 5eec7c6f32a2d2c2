"""Files of lines, each of which is written in one piece: a last one without its newline was cut off by a kill."""

from __future__ import annotations

import os


def whole_lines(file: int) -> int:
    """Return how many bytes of an open file are whole lines."""
    end = os.fstat(file).st_size
    while end:
        start = max(0, end - 65536)
        newline = os.pread(file, end - start, start).rfind(b"\n")
        if newline >= 0:
            return start + newline + 1
        end = start
    return 0
