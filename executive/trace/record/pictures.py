"""Camera pictures as JPEG: what the record keeps and what the viewer shows."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from executive.errors import InputError
from executive.types import Image
from executive.util.files import read_bytes

LARGEST, LARGEST_FILE = 50_000_000, 200_000_000
"""Pixels, and bytes. A small file can hold a picture that fills the memory; it is refused before it is unpacked."""


def to_jpeg(image: Image, quality: int = 90) -> bytes:
    """An (H, W, 3) uint8 RGB picture as JPEG."""
    from PIL import Image as Picture

    buffer = io.BytesIO()
    Picture.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def from_jpeg(data: bytes) -> Image:
    """The picture in a JPEG, (H, W, 3) uint8 RGB.

    Raises:
        ValueError: it is none, or a broken or a very large one.
    """
    from PIL import Image as Picture
    from PIL import UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of size, which is checked here
            # No other format: Pillow knows some that run programs.
            with Picture.open(io.BytesIO(data), formats=("JPEG",)) as picture:
                width, height = picture.size
                if width * height > LARGEST:
                    raise ValueError(f"{width} x {height} pixels; at most {LARGEST:,} are read")
                return np.asarray(picture.convert("RGB"))
    except Picture.DecompressionBombError:
        raise ValueError(f"far more pixels than the {LARGEST:,} that are read") from None
    except UnidentifiedImageError:
        raise ValueError("not a JPEG") from None
    except (OSError, SyntaxError, EOFError, LookupError, TypeError, OverflowError, MemoryError) as error:
        raise ValueError(str(error) or type(error).__name__) from None


def read_picture(path: Path) -> Image:
    """The picture in a file, (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no picture.
    """
    data = read_bytes(path, largest=LARGEST_FILE)
    try:
        return from_jpeg(data)
    except ValueError as error:
        raise InputError(f"not a readable picture ({error})", file=path) from None
