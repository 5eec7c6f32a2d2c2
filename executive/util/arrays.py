"""Arrays in files: read without trust, and kept in the user's cache where they take long to compute."""

from __future__ import annotations

import io
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from executive.util.atomic_write import write_atomic
from executive.util.files import reason

LARGEST_ARRAYS = 1_000_000_000
"""Bytes of all arrays in a file, which may be a thousand times smaller."""

Arrays: TypeAlias = "Mapping[str, npt.NDArray[Any]]"
_T = TypeVar("_T")


def parse_arrays(data: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays in a file that `numpy.savez` wrote, by name. Nothing in it is run.

    Raises:
        ValueError: it is none.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            if sum(part.file_size for part in kept.zip.infolist()) > LARGEST_ARRAYS:
                raise ValueError(f"more than {LARGEST_ARRAYS:,} bytes in its arrays")
            arrays = {name: kept[name] for name in kept.files}
    except (
        *(OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, MemoryError, SyntaxError),
        *(NotImplementedError, RuntimeError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
    ) as error:  # NumPy and zipfile raise all of these for what they did not write
        raise ValueError(reason(error)) from None
    return {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}


def kept(
    subject: str,
    digest: str,
    make: Callable[[], Arrays],
    use: Callable[[Arrays], _T],
    folder: Path | None = None,
) -> _T:
    """Return what `use` makes of the arrays of a subject (`shapes`) that go by a digest of all that they follow from:
    from the cache, or made and kept there. What cannot be read, used or kept is made anew, and nothing else changes.

    Args:
        use: raises a ValueError or a KeyError for arrays that are not those.
        folder: in place of the subject's in the user's cache.
    """
    if folder is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("executive") / subject
    file = folder / f"{digest}.npz"
    with suppress(OSError, ValueError, KeyError):
        return use(parse_arrays(file.read_bytes()))
    arrays, buffer = make(), io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]  # of all names but allow_pickle
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(file, buffer.getvalue(), durable=False)
    return use(arrays)
