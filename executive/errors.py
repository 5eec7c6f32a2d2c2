"""What is raised when the set-up is wrong or the machine lacks something.

Failures of the task itself (no plan, a dropped item, a timeout) are values, never exceptions.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

LONGEST = 2_000
"""Characters of a message. Of a longer one, which quotes what nobody wrote, the middle is left out."""


class ExecutiveError(Exception):
    """Base of every error that Executive raises on purpose. `exit_code` is what the command line ends with."""

    exit_code = 2


class InputError(ExecutiveError):
    """Bad input: one line that says what is wrong, where, and what would be right.

    As text it is one printable line whatever the input was: files of strangers get no control characters through.
    """

    def __init__(self, message: str, *, file: Path | str | None = None, key: str | None = None) -> None:
        self.message, self.file, self.key = message, file, key
        text = " ".join(": ".join(str(part) for part in (file, key, message) if part is not None).split())
        if len(text) > LONGEST:
            text = f"{text[: LONGEST - 500]} [...] {text[-490:]}"
        super().__init__("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text))


class OptionError(InputError):
    """A mistake in an option of a run or of another piece of work: `option` names the field of its configuration.

    The message has other options in backquotes, as in "goes with `server`"; the command line puts flags in their place.
    """

    def __init__(self, message: str, *, option: str, file: Path | str | None = None) -> None:
        super().__init__(message, file=file, key=option)
        self.option = option


class DomainError(InputError):
    """A mistake in a domain folder, named with file and key."""


class MissingError(ExecutiveError):
    """The machine lacks something; `command` installs it."""

    exit_code = 3

    def __init__(self, message: str, *, command: str) -> None:
        self.message, self.command = message, command
        super().__init__(f"{message}; install it with: {command}")

    def __reduce__(self) -> tuple[Callable[[str], MissingError], tuple[str]]:
        """On the way between processes it stays what it is."""
        return partial(MissingError, command=self.command), (self.message,)


def unregistered(what: str, word: str, known: Iterable[str]) -> str:
    """Say that no skill or relation is registered under a word, and which ones are. A word that resembles none of them
    may be that of an entry point which stands in a pyproject.toml, and not among what is installed yet."""
    hint = nearest(word, known)
    added = "" if hint.startswith("did you mean") else "; a new entry point counts once its package is installed again"
    return f"no {what} {word!r} is registered; {hint}{added}"


def nearest(name: str, valid: Iterable[str]) -> str:
    """The tail of an error message that lists the valid names and, when one is close, asks whether it was meant."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}valid: {', '.join(names) if names else 'none'}"
