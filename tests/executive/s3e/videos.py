"""Small videos, encoded for a test."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from executive.types import Image


def write_video(file: Path, frames: Sequence[Image], rate: int = 10) -> Path:
    """A video of (H, W, 3) uint8 frames, all of one size (even numbers), `rate` a second."""
    import av

    height, width = frames[0].shape[:2]
    with av.open(str(file), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(rate))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())
    return file


def greys(count: int, size: tuple[int, int] = (48, 64)) -> list[Image]:
    """Frames that tell by their shade which ones they are: the n-th is 10 n bright."""
    return [np.full((*size, 3), 10 * number, np.uint8) for number in range(count)]
