"""Reads frames of a video at regular intervals (the paper's Experiment 2 estimates a recorded robot frame by frame)."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from executive.errors import InputError, MissingError, OptionError
from executive.s3e.pictures import LARGEST
from executive.types import Image

if TYPE_CHECKING:
    import av

EXTRA = "video"
"""The extra of this package that brings what reads videos (PyAV)."""

FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,h264,hevc,ogg,flv,asf,gif,ivf,yuv4mpegpipe"
"""What is read. FFmpeg knows more, and some of those (playlists) name other files and machines to read from."""

_SLACK = 1e-6
"""Seconds by which a frame may be early: time stamps are fractions."""


def read_frames(path: Path | str, every: float) -> Iterator[tuple[float, Image]]:
    """The frames of a video that are shown at 0, `every`, 2 `every` ... seconds, or next after: seconds since the first
    frame, and the picture, (H, W, 3) uint8 RGB, upright.

    The file is opened at once, its first frame read, and the others as they are asked for.

    Raises:
        InputError: there is no such file, it is no video, it has no frames, or it breaks off (once the frames before
            have been given).
        MissingError: PyAV is not installed.
    """
    file = Path(path)
    if not every > 0:
        raise OptionError(f"expected seconds, more than none, got {every:g}", option="every")
    try:
        import av
    except ImportError:
        raise MissingError(
            f"to read a video, the extra {EXTRA!r} is missing",
            command=f"{sys.executable} -m pip install 'executive[{EXTRA}]'",
        ) from None
    if not os.path.isfile(file):
        raise InputError("is a folder; wanted a video" if os.path.isdir(file) else "there is no such file", file=file)
    try:
        container = av.open(str(file), options={"format_whitelist": FORMATS}, metadata_errors="ignore")
    except (av.FFmpegError, ValueError, OSError) as error:
        raise InputError(f"is no video ({_reason(error)})", file=file) from None
    frames = _sampled(container, file, every)
    return itertools.chain([next(frames)], frames)


def _sampled(container: av.container.InputContainer, file: Path, every: float) -> Iterator[tuple[float, Image]]:
    import av

    begin: float | None = None
    time, due = 0.0, 0.0
    with container:
        if not container.streams.video:
            raise InputError("has no pictures in it; wanted a video", file=file)
        stream = container.streams.video[0]
        if stream.codec_context.width * stream.codec_context.height > LARGEST:
            raise InputError(f"has more than {LARGEST:,} pixels a frame", file=file)
        try:
            for frame in container.decode(stream):
                if frame.time is not None:
                    begin = frame.time if begin is None else begin
                    time = frame.time - begin
                if time < due - _SLACK:
                    continue
                yield time, _picture(frame)
                due = every * (1 + np.floor((time + _SLACK) / every))
        except (av.FFmpegError, ValueError, OSError) as error:
            raise InputError(f"breaks off after {time:.1f} s ({_reason(error)})", file=file) from None
    if due == 0.0:
        raise InputError("has no frames", file=file)


def _picture(frame: av.VideoFrame) -> Image:
    """A frame as it is meant to be seen: a phone that is held upright writes its videos lying down."""
    quarters = round(frame.rotation / 90)
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), quarters))


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__)
