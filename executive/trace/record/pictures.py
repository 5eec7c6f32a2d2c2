"""Camera pictures as JPEG and depth pictures as PNG: what the record keeps and what the viewer shows."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from executive.errors import InputError
from executive.types import DepthImage, Image, Observation
from executive.util.files import read_bytes

LARGEST, LARGEST_FILE = 50_000_000, 200_000_000
"""Pixels, and bytes. A small file can hold a picture that fills the memory; it is refused before it is unpacked."""


Picture = TypeVar("Picture", Image, DepthImage)


def to_jpeg(image: Image, quality: int = 90) -> bytes:
    """Return an (H, W, 3) uint8 RGB picture as JPEG."""
    from PIL import Image as Picture

    buffer = io.BytesIO()
    Picture.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


@lru_cache(maxsize=1)
def jpegs(look: Observation) -> Mapping[str, bytes]:
    """Return the pictures of an observation as JPEG, by camera. Record and viewer want the same ones, one after the
    other: those of the last observation are kept."""
    return MappingProxyType({camera: to_jpeg(image) for camera, image in look.images.items()})


def from_jpeg(data: bytes) -> Image:
    """Return the picture in a JPEG, (H, W, 3) uint8 RGB.

    Raises:
        ValueError: it is none, or a broken or a very large one.
    """
    return np.asarray(_decoded(data, "JPEG", "RGB"), dtype=np.uint8)


def depth_to_png(depth: DepthImage) -> bytes:
    """Return an (H, W) uint16 depth picture in mm as a PNG of one channel of 16 bits."""
    from PIL import Image as Picture

    buffer = io.BytesIO()
    # Noise repeats nothing that would be worth searching for: runs of equal bytes (3) take less time and less room.
    Picture.fromarray(depth).save(buffer, "PNG", compress_level=1, compress_type=3)
    return buffer.getvalue()


def depth_from_png(data: bytes) -> DepthImage:
    """Return the depth picture in a PNG of 16 bits, (H, W) uint16.

    Raises:
        ValueError: it is none, or a broken or a very large one.
    """
    return np.asarray(_decoded(data, "PNG", "I;16"), dtype=np.uint16)


def _decoded(data: bytes, kind: str, mode: str) -> Any:
    """The picture of one format, so that no other is opened: Pillow knows some that run programs."""
    from PIL import Image as Picture
    from PIL import UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of size, which is checked here
            with Picture.open(io.BytesIO(data), formats=(kind,)) as picture:
                width, height = picture.size
                if width * height > LARGEST:
                    raise ValueError(f"{width} x {height} pixels; at most {LARGEST:,} are read")
                if kind == "PNG":
                    if picture.mode not in (mode, "I"):
                        raise ValueError("not of 16 bits")
                    return np.asarray(picture)
                return np.asarray(picture.convert(mode))
    except Picture.DecompressionBombError:
        raise ValueError(f"far more pixels than the {LARGEST:,} that are read") from None
    except UnidentifiedImageError:
        raise ValueError(f"not a {kind}") from None
    except (OSError, SyntaxError, EOFError, LookupError, TypeError, OverflowError, MemoryError) as error:
        raise ValueError(str(error) or type(error).__name__) from None


def read_picture(path: Path) -> Image:
    """Return the picture in a file, (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no picture.
    """
    return _read(path, from_jpeg)


def read_depth(path: Path) -> DepthImage:
    """Return the depth picture in a file, (H, W) uint16 in mm.

    Raises:
        InputError: the file is missing or is no depth picture.
    """
    return _read(path, depth_from_png)


def _read(path: Path, decode: Callable[[bytes], Picture]) -> Picture:
    data = read_bytes(path, largest=LARGEST_FILE)
    try:
        return decode(data)
    except ValueError as error:
        raise InputError(f"not a readable picture ({error})", file=path) from None
