"""Writes videos (H.264 in MP4) with PyAV, from the extra `video`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

from executive.types import Image
from executive.util.extras import needed

EXTRA = "video"

PIXELS = "yuv420p"
"""How colours are stored: what every player shows."""


@contextmanager
def video_writer(file: Path, shape: tuple[int, ...], fps: int, keyframes: int) -> Iterator[Callable[[Image], None]]:
    """Open a video file to be written; what is yielded adds a picture, (H, W, 3) uint8 RGB, as its next frame.

    Args:
        shape: of the pictures. Of an odd height or width the last row or column is left out, as H.264 asks for.
        fps: frames a second.
        keyframes: one in so many frames is whole: with few of them the file is small, with many a frame is found soon.

    Raises:
        MissingError: PyAV is not installed.
    """
    av = needed("av", EXTRA, "to write videos")
    height, width = shape[0] // 2 * 2, shape[1] // 2 * 2
    file.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(file), "w") as container:
        options = {"g": str(keyframes), "crf": "20", "threads": "1"}
        stream = container.add_stream("libx264", rate=fps, options=options)
        stream.height, stream.width = height, width
        stream.pix_fmt, stream.time_base = PIXELS, Fraction(1, fps)

        def add(picture: Image) -> None:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture[:height, :width], format="rgb24")))

        yield add
        container.mux(stream.encode(None))
