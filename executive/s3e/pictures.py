"""Reads untrusted picture files as they are meant to be displayed, or refuses them in one line."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from executive.errors import InputError
from executive.types import Image
from executive.util.files import reason

LARGEST_FILE = 200_000_000
"""Bytes; no file of a picture within `LARGEST` is larger."""

LARGEST = 50_000_000
"""Pixels. A small file can hold a picture that fills the memory; it is refused before it is unpacked."""

_BITS = (8, 10, 12, 14, 16)
"""How many bits a pixel cameras and scanners have; files have room for 16, however many are meant."""

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "PPM")
"""What is read. Pillow knows more, and some of those run other programs."""


def read_picture(path: Path | str) -> Image:
    """Return the picture in a file, (H, W, 3) uint8 RGB, upright by its EXIF data, on white where it is
    transparent, reduced to eight bits a channel; of an animation, the first picture.

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
                if shown.mode.startswith(("I", "F")):
                    shown = Picture.fromarray(_in_eight_bits(np.asarray(shown), file))
                elif shown.has_transparency_data:
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


def _in_eight_bits(values: npt.NDArray[Any], file: Path) -> npt.NDArray[np.uint8]:
    """Shades of grey as they are meant: of whole numbers, the range is that of the camera with the fewest bits that has
    the brightest of them; floating-point ones go from 0 to 1. (Pillow's own conversion cuts off all above 255.)

    Raises:
        InputError: there are others, and so it is not known what is black and what is white.
    """
    lowest, highest = values.min(), values.max()
    if values.dtype.kind == "f":
        if not (lowest >= 0.0 and highest <= 1.0):  # nor if there is one that is no number
            told = f"has floating-point values from {lowest:g} to {highest:g}; those of a picture go from 0 to 1"
            raise InputError(told, file=file)
        white = 1
    else:
        white = next((2**bits - 1 for bits in _BITS if highest < 2**bits), 0)
        if lowest < 0 or not white:
            told = f"has values from {lowest:,} to {highest:,}; those of a picture go from 0 to {2 ** _BITS[-1] - 1:,}"
            raise InputError(told, file=file)
    shades: npt.NDArray[np.uint8] = np.rint(values * (255.0 / white)).astype(np.uint8)
    return shades


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
