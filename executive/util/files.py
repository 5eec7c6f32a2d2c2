"""Reads untrusted files as bytes, text, TOML or JSON. Every error is one line with the file's name.

The results are safe to handle: they are limited in size, nested no deeper than `DEEPEST`, and whole numbers in TOML
have at most 64 bits, as its specification says. (JSON has no such limit, and files of other programs make use of that.)
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from executive.errors import InputError, OptionError

LARGEST, LARGEST_TOML = 10_000_000, 1_000_000
"""The default size limits in bytes. Parsing TOML takes seconds for each million of them."""

_PAGE = 4096
"""Bytes that are written to a folder to see whether that works; a few may go where there is no room for a file."""

DEEPEST = 100
"""How many lists and tables may be nested in each other."""

_LONG_KEY = re.compile(rf"""(?<![\w.\-])(?:(?:[\w\-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
"""A key of so many parts takes `tomllib` time that grows with the square of their number."""


def read_bytes(file: Path, *, largest: int = LARGEST, mistake: type[InputError] = InputError) -> bytes:
    """Return a file's content.

    Args:
        largest: the size limit in bytes.
        mistake: the exception type that is raised.

    Raises:
        InputError: there is no such file, it cannot be read, or it is larger.
    """
    try:
        with file.open("rb") as stream:
            data = stream.read(largest + 1)
    except FileNotFoundError:
        raise mistake("there is no such file", file=file) from None
    except (OSError, ValueError) as error:  # a zero byte in a path is a ValueError
        raise mistake(f"cannot be read ({reason(error)})", file=file) from None
    if len(data) > largest:
        raise mistake(f"has more than {largest:,} bytes, which no such file has", file=file)
    return data


def read_text(file: Path, *, largest: int = LARGEST, mistake: type[InputError] = InputError) -> str:
    r"""Return a text file's content, in UTF-8 with or without a mark at its beginning; lines end with `\n`.

    Raises:
        InputError: as `read_bytes`, or it is not UTF-8.
    """
    try:
        text = read_bytes(file, largest=largest, mistake=mistake).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise mistake(f"is not UTF-8 text ({error.reason} at byte {error.start})", file=file) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_toml(file: Path, *, largest: int = LARGEST_TOML, mistake: type[InputError] = InputError) -> dict[str, Any]:
    """Return a TOML file's table.

    Raises:
        InputError: as `read_text`, or it is not TOML.
    """
    return parse_toml(read_text(file, largest=largest, mistake=mistake), file, mistake=mistake)


def parse_toml(text: str, file: Path, *, mistake: type[InputError] = InputError) -> dict[str, Any]:
    """The table in a text that was read from `file`.

    Raises:
        InputError: it is not TOML.
    """
    deep = "is not TOML that anyone would write: nested too deep"
    if (key := _LONG_KEY.search(text)) is not None:
        raise mistake(deep, file=file, key=f"line {_line(text, key.start())}")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise mistake(f"is not TOML: {error}", file=file) from None
    except RecursionError:
        raise mistake(deep, file=file) from None
    except ValueError as error:
        raise mistake(f"is not TOML: {_long_number(text) or error}", file=file) from None
    if _is_deep(table):
        raise mistake(deep, file=file)
    for key_of, number in _whole_numbers(table):
        if not -(2**63) <= number < 2**63:
            raise mistake("is not TOML: a number of more than 64 bits", file=file, key=key_of)
    return table


def read_json(file: Path, *, largest: int = LARGEST, mistake: type[InputError] = InputError) -> Any:
    """Return a JSON file's value.

    Raises:
        InputError: as `read_bytes`, or it is not JSON.
    """
    data = read_bytes(file, largest=largest, mistake=mistake)
    try:
        return parse_json(data)
    except ValueError as error:
        raise mistake(f"is not JSON ({error})", file=file) from None


def parse_json(data: bytes | str) -> Any:
    """Return the value in a JSON text.

    Raises:
        ValueError: it is not JSON.
    """
    try:
        value = json.loads(data)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise
    except RecursionError:
        raise ValueError("nested too deep") from None
    except ValueError as error:
        text = data if isinstance(data, str) else data.decode(errors="replace")
        raise ValueError(_long_number(text) or str(error)) from None
    if _is_deep(value):
        raise ValueError("nested too deep")
    return value


def check_writable(folder: Path, option: str) -> None:
    """Check now, and not only when there is something to write, that files can be written to a folder, or to where it
    would have to be made.

    Args:
        option: the option that names another folder.

    Raises:
        InputError: a file cannot be made there, or there is no room for one.
    """
    try:
        with tempfile.TemporaryFile(dir=_nearest(folder.absolute())) as file:
            file.write(bytes(_PAGE))
            file.flush()
    except (OSError, ValueError) as error:
        raise OptionError(
            f"nothing can be written there ({reason(error)}); name another folder", file=folder, option=option
        ) from None


def _nearest(folder: Path) -> Path:
    """Return the folder, or its nearest parent that exists."""
    for path in (folder, *folder.parents):
        with contextlib.suppress(FileNotFoundError):
            path.stat()
            return path
    return folder


def home(path: str | Path) -> Path:
    """Return the path with `~` expanded as a shell does; unchanged if there is no such home."""
    try:
        return Path(os.path.expanduser(path))
    except ValueError:  # a zero byte in the user's name
        return Path(path)


def legible(text: str) -> str:
    """Return the text with question marks for lone surrogates: file names may be any bytes, records are UTF-8."""
    return text if text.isascii() else text.encode(errors="replace").decode()


def reason(error: Exception) -> str:
    """Return the operating system's message of an error, or else Python's."""
    return str(getattr(error, "strerror", None) or error or type(error).__name__)


def caseless(
    table: Mapping[str, Any], file: Path, key: str, *, mistake: type[InputError] = InputError
) -> dict[str, Any]:
    """Return a table with its keys, which are case-insensitive PDDL names, in lower case, as our reader has them.

    Args:
        key: the table's own; none for the whole file.

    Raises:
        InputError: two of them are the same name.
    """
    names: dict[str, Any] = {}
    for name, value in table.items():
        if name.lower() in names:
            raise mistake("is there twice: PDDL names are case-insensitive", file=file, key=f"{key}.{name}".lstrip("."))
        names[name.lower()] = value
    return names


def _is_deep(value: Any) -> bool:
    level = [value] if isinstance(value, dict | list) else []
    for _ in range(DEEPEST):
        inner = [outer.values() if isinstance(outer, dict) else outer for outer in level]
        level = [each for values in inner for each in values if isinstance(each, dict | list)]
        if not level:
            return False
    return True


def _whole_numbers(value: Any, key: str = "") -> Iterator[tuple[str, int]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _whole_numbers(inner, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _whole_numbers(inner, f"{key}[{number}]")
    elif isinstance(value, int):
        yield key, value


def _long_number(text: str) -> str:
    """Return a description of a number with more digits than Python parses, or ""."""
    most = sys.get_int_max_str_digits()
    found = re.search(rf"\d[\d_]{{{most},}}+", text)
    return "" if found is None else f"a number of more than {most:,} digits (at line {_line(text, found.start())})"


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1
