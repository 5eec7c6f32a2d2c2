"""How text reaches a person: in colour on a terminal, plain elsewhere."""

from __future__ import annotations

import codecs
import io
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.text import Text


def console_for(stream: TextIO, environment: Mapping[str, str] = os.environ) -> Console:
    """A console on `stream` that prints what it is given and nothing more (no markup, no guessed highlights).

    Colour only on a terminal, and not where NO_COLOR is set (https://no-color.org) or TERM is "dumb".
    """
    if isinstance(stream, io.TextIOWrapper):  # in UTF-8, too, there are names of files that are no text
        stream.reconfigure(errors=_IN_ASCII)
    plain = bool(environment.get("NO_COLOR")) or environment.get("TERM") == "dumb"
    return _Console(file=stream, markup=False, highlight=False, emoji=False, no_color=plain or None)


def printable(text: str) -> str:
    """Return the text in one line, without what moves the cursor: messages from outside may hold anything."""
    return "".join(each if each.isprintable() else " " for each in text)


@contextmanager
def waiting(stream: TextIO, text: str) -> Iterator[None]:
    """Say on a terminal what is waited for, for as long as the block takes; elsewhere, say nothing."""
    console = console_for(stream)
    if not is_live(console):
        yield
        return
    with console.status(Text(text, "dim")):
        yield


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Say so; rich would end the whole process, and a run does not end because nobody reads along."""
        raise BrokenPipeError


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_ASCII.get(each, "?") for each in error.object[error.start : error.end]), error.end


_ASCII = {"✓": "+", "✗": "x", "▶": ">", "·": ".", "…": "~"}
_IN_ASCII = "executive-in-ascii"
codecs.register_error(_IN_ASCII, _in_ascii)


def is_live(console: Console) -> bool:
    """Return whether lines on this console can be taken back: a terminal with a cursor, where colour is wanted."""
    return console.is_terminal and not console.is_dumb_terminal and not console.no_color
