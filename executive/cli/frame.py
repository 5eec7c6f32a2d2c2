"""What surrounds every command: options for all of them, errors as one line, exit codes, Ctrl-C."""

from __future__ import annotations

import errno
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Annotated

import typer

from executive import __version__
from executive.cli import streams
from executive.errors import ExecutiveError

REACHED, NOT_REACHED, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130

app = typer.Typer(
    help="Plan, do one thing, look, and ask whether the world is as expected.",
    epilog="Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 missing on this machine, 130 interrupted.",
    rich_markup_mode=None,
)


@dataclass
class Settings:
    """What holds for every command."""

    debug: bool = False


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (`sys.argv` unless `arguments` are given) and leave the process with its exit code."""
    streams.settle()
    try:
        sys.exit(exit_code(sys.argv[1:] if arguments is None else arguments))
    finally:
        streams.leave()


def exit_code(arguments: Sequence[str]) -> int:
    """Run one command; every error becomes a line on stderr and an exit code."""
    settings = Settings()
    try:
        code = app(list(arguments) or ["--help"], prog_name="executive", standalone_mode=False, obj=settings)
        if sys.stdout is not None:
            sys.stdout.flush()
        return int(code or 0)
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if settings.debug:
            raise
        code, message = _told(error, arguments)
        print(f"error: {message}", file=sys.stderr)
        return code


def _told(error: Exception, arguments: Sequence[str]) -> tuple[int, str]:
    """The exit code for an error, and the one line that tells of it."""
    match error:
        case ExecutiveError():
            return error.exit_code, one_line(str(error))
        case typer.TyperException():
            context = getattr(error, "ctx", None)
            command = context.command_path if context is not None else "executive"
            return BAD_INPUT, f"{one_line(error.format_message()).rstrip('.')}; see: {command} --help"
        case OSError(errno=errno.ENOSPC | errno.EDQUOT):
            return BAD_INPUT, f"there is no room to write to: {one_line(str(error))}"
        case OSError() if error.errno is not None:
            return BAD_INPUT, f"the system refuses: {one_line(str(error))}"
        case MemoryError():
            return BAD_INPUT, "there is not enough memory"
    again = shlex.join(["executive", "--debug", *arguments])
    return BUG, f"this is a bug in Executive: {one_line(f'{type(error).__name__}: {error}')}; traceback: {again}"


def one_line(text: str) -> str:
    """The text as a line that can be printed, whoever it comes from."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in " ".join(text.split()))


@contextmanager
def ctrl_c(cancel: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C once cancels, which leaves the arm at rest and the trace whole; a second one leaves at once. So does being
    asked to end, and the end of the terminal, unless that is not to matter (nohup)."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, signal.default_int_handler)
        cancel()

    orders = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    heeded = [each for each in orders if signal.getsignal(each) is not signal.SIG_IGN]
    before = {each: signal.signal(each, interrupt) for each in heeded}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"executive {__version__}")
        raise typer.Exit


@app.callback()
def executive(
    context: typer.Context,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    context.obj.debug = debug
