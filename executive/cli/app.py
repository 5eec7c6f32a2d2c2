"""The application around the commands: common options, errors as one line, exit codes, Ctrl-C."""

from __future__ import annotations

import errno
import os
import select
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Annotated

import typer

from executive import __version__
from executive.cli import streams
from executive.cli.options import with_flags
from executive.errors import ExecutiveError, OptionError

REACHED, NOT_REACHED, BAD_INPUT, BUG, INTERRUPTED, TERMINATED = 0, 1, 2, 70, 130, 143

SECONDS_TO_LEAVE = 4.0
"""The time that interrupted work has to stop before the process exits anyway."""

app = typer.Typer(
    help="Closed-loop execution monitoring: plan, act, look, and compare the world with what was expected.",
    epilog="Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 missing on this machine, 130 interrupted, "
    "143 terminated.",
    rich_markup_mode=None,
)


@dataclass
class Settings:
    """The options of every command."""

    debug: bool = False


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (`sys.argv` unless `arguments` are given) and leave the process with its exit code."""
    streams.repair()
    try:
        code = exit_code(sys.argv[1:] if arguments is None else arguments)
    finally:
        streams.flush_quietly()
    if code > INTERRUPTED - signal.SIGINT:  # told to end: to take down all that was loaded can take seconds
        os._exit(code)
    sys.exit(code)


_COMPLETE = "_EXECUTIVE_COMPLETE"
"""The variable by which a shell asks for completions."""


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
    except SystemExit as left:
        return int(left.code or 0)
    except Exception as error:
        if settings.debug:
            raise
        code, message = _exit_line(error, arguments)
        print(f"error: {message}", file=sys.stderr)
        return code


def _exit_line(error: Exception, arguments: Sequence[str]) -> tuple[int, str]:
    """Return the exit code for an error, and its message in one line."""
    match error:
        case OptionError():
            return error.exit_code, one_line(str(with_flags(error)))
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
        case KeyError() | ValueError() if _COMPLETE in os.environ:  # typer reads what the shell sets without a check
            return BAD_INPUT, f"{_COMPLETE} is for shells, which say beside it what is typed ({one_line(str(error))})"
    again = shlex.join(["executive", "--debug", *arguments])
    return BUG, f"this is a bug in Executive: {one_line(f'{type(error).__name__}: {error}')}; traceback: {again}"


def one_line(text: str) -> str:
    """Return the text as one printable line."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in " ".join(text.split()))


class Interrupted:
    """The termination signal that was received, if any, and its exit code."""

    def __init__(self) -> None:
        self.signal = 0

    @property
    def code(self) -> int:
        """Return 128 plus the signal's number, as shells do."""
        return 128 + (self.signal or signal.SIGINT)


def _leave(number: int, frame: FrameType | None) -> None:
    """Exit at once, with the signal's exit code."""
    raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


@contextmanager
def ctrl_c(cancel: Callable[[], None], seconds: float | None = None) -> Iterator[Interrupted]:
    """Handle Ctrl-C, SIGTERM and SIGHUP: the first cancels, which stops the arm and completes the trace; a second one
    exits at once. Signals that are ignored (nohup) stay so.

    Args:
        cancel: called from the signal handler.
        seconds: after which the process exits anyway, for work that is kept as it goes. A message then says at once
            that the signal was received, even while the main thread is busy.
    """
    received = Interrupted()

    def interrupt(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, _leave)
        received.signal = number
        cancel()

    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handled = [each for each in signals if signal.getsignal(each) is not signal.SIG_IGN]
    before = {each: signal.signal(each, interrupt) for each in handled}
    try:
        with nullcontext() if seconds is None else _exit_within(seconds, handled):
            yield received
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def _exit_within(seconds: float, signals: Sequence[int]) -> Iterator[None]:
    """Print a message when a signal is received, and exit the process so many seconds later."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    former = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    watch = threading.Thread(target=_watch, args=(reading, seconds, signals), name="signals", daemon=True)
    watch.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(former)
        os.close(writing)
        watch.join()
        os.close(reading)


def _watch(reading: int, seconds: float, signals: Sequence[int]) -> None:
    """The thread of `_exit_within`: reads the number of each signal that the interpreter writes to a pipe."""
    while (number := os.read(reading, 1)) and number[0] not in signals:
        pass
    if not number:
        return
    with suppress(OSError, ValueError):
        print("stopping; what is finished is kept (once more to leave at once)", file=sys.stderr, flush=True)
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0.0:
        if not select.select([reading], [], [], left)[0]:
            continue
        more = os.read(reading, 64)
        if not more:
            return  # the work has ended
        if any(each in signals for each in more):
            until = min(until, time.monotonic() + 1.0)
    with suppress(OSError, ValueError):
        sys.stderr.write("\x1b[?25h" if sys.stderr.isatty() else "")  # the cursor, which a bar hides
        print("left in the middle of something; what was finished is kept", file=sys.stderr, flush=True)
    os._exit(128 + number[0])


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
