"""Camera pictures as JPEG: what the record keeps and what the viewer shows."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from executive.errors import InputError
from executive.types import Image


def to_jpeg(image: Image, quality: int = 90) -> bytes:
    """An (H, W, 3) uint8 RGB picture as JPEG."""
    from PIL import Image as Picture

    buffer = io.BytesIO()
    Picture.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def from_jpeg(data: bytes) -> Image:
    """The picture in a JPEG, (H, W, 3) uint8 RGB."""
    from PIL import Image as Picture

    with Picture.open(io.BytesIO(data)) as picture:
        return np.asarray(picture.convert("RGB"))


def read_picture(path: Path) -> Image:
    """The picture in a file, (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no picture.
    """
    from PIL import Image as Picture

    try:
        with Picture.open(path) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"not a readable picture ({error})", file=path) from None
