"""What surrounds every command: options for all of them, errors as one line, exit codes, Ctrl-C."""

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
from executive.errors import ExecutiveError

REACHED, NOT_REACHED, BAD_INPUT, BUG, INTERRUPTED, TERMINATED = 0, 1, 2, 70, 130, 143

SECONDS_TO_LEAVE = 4.0
"""In which long work that is interrupted comes to rest, or is left."""

app = typer.Typer(
    help="Plan, do one thing, look, and ask whether the world is as expected.",
    epilog="Exit codes: 0 goal reached, 1 not reached, 2 bad input, 3 missing on this machine, 130 interrupted, "
    "143 asked to end.",
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
        code = exit_code(sys.argv[1:] if arguments is None else arguments)
    finally:
        streams.leave()
    if code > INTERRUPTED - signal.SIGINT:  # told to end: to take down all that was loaded can take seconds
        os._exit(code)
    sys.exit(code)


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
    except SystemExit as order:
        return int(order.code or 0)
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


class Interrupted:
    """Whether Ctrl-C came, or another order to end, and the exit code that says which."""

    def __init__(self) -> None:
        self.order = 0

    @property
    def code(self) -> int:
        """As a shell has it: 128 and the signal's number."""
        return 128 + (self.order or signal.SIGINT)


def _leave(number: int, frame: FrameType | None) -> None:
    """Leave at once, with the exit code of the order that came."""
    raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


@contextmanager
def ctrl_c(cancel: Callable[[], None], seconds: float | None = None) -> Iterator[Interrupted]:
    """Ctrl-C once cancels, which leaves the arm at rest and the trace whole; a second one leaves at once. So does being
    asked to end, and the end of the terminal, unless that is not to matter (nohup).

    Args:
        seconds: after which this process is left anyway, wherever it is. For work that is kept as it goes; that the
            order has been heard is then said at once, even while this thread is in the middle of something.
    """
    heard = Interrupted()

    def interrupt(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, _leave)
        heard.order = number
        cancel()

    orders = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    heeded = [each for each in orders if signal.getsignal(each) is not signal.SIG_IGN]
    before = {each: signal.signal(each, interrupt) for each in heeded}
    try:
        with nullcontext() if seconds is None else _left_within(seconds, heeded):
            yield heard
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def _left_within(seconds: float, orders: Sequence[int]) -> Iterator[None]:
    """Say at once that an order has been heard, and leave this process so many seconds after it."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    former = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    watch = threading.Thread(target=_watch, args=(reading, seconds, orders), name="orders", daemon=True)
    watch.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(former)
        os.close(writing)
        watch.join()
        os.close(reading)


def _watch(reading: int, seconds: float, orders: Sequence[int]) -> None:
    """What `_left_within` has a thread do: the system writes the number of each signal that comes."""
    while (number := os.read(reading, 1)) and number[0] not in orders:
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
            return  # it has come to its end
        if any(each in orders for each in more):
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
