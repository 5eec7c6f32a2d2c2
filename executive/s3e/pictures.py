"""Pictures from files of strangers: read as they are meant to be seen, or refused in one line."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from executive.errors import InputError
from executive.files import reason
from executive.types import Image

LARGEST_FILE = 200_000_000
"""Bytes; no file of a picture within `LARGEST` is larger."""

LARGEST = 50_000_000
"""Pixels. A small file can hold a picture that fills the memory; it is refused before it is unpacked."""

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "PPM")
"""What is read. Pillow knows more, and some of those run other programs."""


def read_picture(path: Path | str) -> Image:
    """The picture in a file, (H, W, 3) uint8 RGB, turned upright where its EXIF data says so. What is transparent is
    shown on white; of an animation, the first picture.

    Raises:
        InputError: there is no such file, or it is no picture, a broken one, or one that is too large.
    """
    from PIL import Image as Picture
    from PIL import ImageOps, UnidentifiedImageError

    file = Path(path)
    _check_file(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of size, which is checked here, and of metadata
            with Picture.open(file, formats=FORMATS) as picture:
                width, height = picture.size
                if width * height > LARGEST:
                    raise InputError(f"has {width} x {height} pixels; at most {LARGEST:,} are read", file=file)
                shown = ImageOps.exif_transpose(picture)
                if shown.has_transparency_data:
                    shown = shown.convert("RGBA")
                    white = Picture.new("RGBA", shown.size, "white")
                    shown = Picture.alpha_composite(white, shown)
                return np.array(shown.convert("RGB"))
    except UnidentifiedImageError:
        raise InputError(f"is no picture ({', '.join(FORMATS)})", file=file) from None
    except Picture.DecompressionBombError:
        raise InputError(f"has far more pixels than the {LARGEST:,} that are read", file=file) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", file=file) from None
    except (ValueError, SyntaxError, EOFError, OverflowError, MemoryError, IndexError, TypeError) as error:
        # What Pillow's decoders raise for files that begin well and go on badly.
        raise InputError(f"is a broken picture ({error or type(error).__name__})", file=file) from None


def _check_file(file: Path) -> None:
    try:
        size = file.stat().st_size
    except FileNotFoundError:
        raise InputError("there is no such file", file=file) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({reason(error)})", file=file) from None
    if file.is_dir():
        raise InputError("is a folder; wanted a picture", file=file)
    if not file.is_file():
        raise InputError("is not a file; wanted a picture", file=file)
    if size == 0:
        raise InputError("is empty; wanted a picture", file=file)
    if size > LARGEST_FILE:
        raise InputError(f"has {size:,} bytes; a picture has at most {LARGEST_FILE:,}", file=file)
