"""Rerun's viewer as a process: its window, its page in a browser, or no screen at all. It listens on loopback alone."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING
from urllib.parse import quote

from executive.errors import ExecutiveError, InputError, MissingError
from executive.util.files import legible
from executive.util.requirements import has_display

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

TRACE_FILE = "trace.rrd"
_SOFTWARE_VULKAN = Path("/usr/share/vulkan/icd.d")
_VULKAN_PACKAGES = "apt-get install -y mesa-vulkan-drivers libvulkan1"
_PATIENCE = 60.0
"""Wall seconds that a viewer may take to start; software Vulkan on a busy machine is slow."""


class ViewerError(ExecutiveError):
    """The viewer did not start, did not answer, or could not draw."""

    exit_code = 3


def trace_file(trace: Path | str) -> Path:
    """Return the viewer's file of a run, given the run's folder or that file itself.

    Raises:
        InputError: there is none.
    """
    path = Path(trace)
    path = path / TRACE_FILE if path.is_dir() else path
    if not path.is_file():
        raise InputError("there is no trace for the viewer here", file=path)
    return path


def inspect(trace: Path | str, web: bool = False, tell: Callable[[str], None] = print) -> None:
    """Open the viewer on a trace, and return when it is closed (or, in the browser, at Ctrl-C).

    Args:
        trace: a run's folder, or its `trace.rrd`.
        web: serve it to a browser on this machine instead of opening a window; `tell` is given the address.

    Raises:
        InputError: there is no trace.
        ViewerError: there is no display for a window, or the viewer failed.
    """
    path = trace_file(trace)
    if web:
        data, page = free_port(), free_port()
        command = viewer_command("--web-viewer", "--port", str(data), "--web-viewer-port", str(page))
        source = quote(f"rerun+http://127.0.0.1:{data}/proxy", safe="")
        tell(f"http://127.0.0.1:{page}?url={source}")
    else:
        if not has_display():
            run = shlex.quote(str(trace))
            raise ViewerError(
                f"there is no display here; use: executive inspect {run} --web, or executive inspect {run} --png FILE"
            )
        command = viewer_command("--port", "auto")
    with (
        contextlib.suppress(KeyboardInterrupt),
        named_in_text(path) as named,
        started([*command, named], os.environ) as (process, output),
    ):
        if process.wait() != 0:
            raise ViewerError(f"the viewer failed: {_last_words(output)}")


@contextlib.contextmanager
def named_in_text(path: Path) -> Iterator[str]:
    """A file's name as the viewer takes it, who knows none but in UTF-8: where it has no such one, a link's."""
    if legible(str(path)) == str(path):
        yield str(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / path.name
        link.symlink_to(path.absolute())
        yield str(link)


def open_window() -> str:
    """Open a viewer that waits for a run to be shown in it, outlives this process, and return its address.

    Raises:
        ViewerError: there is no display, or it did not start.
    """
    if not has_display():
        raise ViewerError("there is no display here to watch the run on; look at its trace afterwards")
    port = free_port()
    process = subprocess.Popen(
        viewer_command("--port", str(port), "--expect-data-soon"),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return _connected(process, port).url
    except ConnectionError as error:
        raise ViewerError(f"the viewer did not start ({error})") from None


@contextlib.contextmanager
def headless_viewer(size: tuple[int, int]) -> Iterator[ViewerClient]:
    """A viewer that draws (width, height) pixels and no window. None of its processes outlives the block.

    Raises:
        MissingError: no Vulkan driver to draw with.
        ViewerError: it did not start, or failed while it was in use.
    """
    port, window = free_port(), f"{size[0]}x{size[1]}"
    command = viewer_command("--headless", "--port", str(port), "--window-size", window, "--hide-welcome-screen")
    # What is logged is shown as a notification, in the picture.
    # CI keeps the viewer from reporting its use to its makers.
    with contextlib.ExitStack() as stack:
        # A killed viewer leaves its temporary folders behind; here they go with the folder that they are in.
        own = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        defaults = {"CI": "true", "XDG_RUNTIME_DIR": own}
        environment = {**defaults, **os.environ, "RUST_LOG": "error", "TMPDIR": own, **vulkan()}
        process, output = stack.enter_context(started(command, environment))
        try:
            yield _connected(process, port)
        except (ConnectionError, TimeoutError, RuntimeError) as error:
            raise ViewerError(f"the viewer failed ({error}): {_last_words(output)}") from None


def viewer_command(*arguments: str) -> list[str]:
    """Return the command line of this environment's own viewer."""
    return [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *arguments]


@contextlib.contextmanager
def started(command: list[str], environment: Mapping[str, str]) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes]]]:
    """A process and what it prints; at the end it is killed, with all that it started.

    `rerun` is a wrapper around the real viewer, so both are put into a process group of their own.
    """
    with _signals_raise(), tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=environment, start_new_session=True
        )
        try:
            yield process, output
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextlib.contextmanager
def _signals_raise() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise SystemExit where nobody handles them: of themselves they end a process at once, and
    leave what it has started running."""

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signals = [signal.SIGTERM, signal.SIGHUP] if threading.current_thread() is threading.main_thread() else []
    handled = [each for each in signals if signal.getsignal(each) is signal.SIG_DFL]
    for each in handled:
        signal.signal(each, leave)
    try:
        yield
    finally:
        for each in handled:
            signal.signal(each, signal.SIG_DFL)


def free_port() -> int:
    """Return a TCP port of the loopback interface that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _connected(process: subprocess.Popen[bytes], port: int) -> ViewerClient:
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except ConnectionError:
            if process.poll() is not None or time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def vulkan() -> Mapping[str, str]:
    """The software driver, unless the environment names another or the machine has a graphics card of its own."""
    if any(key in os.environ for key in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES")):
        return {}
    software = sorted(_SOFTWARE_VULKAN.glob("lvp_icd*.json"))
    if software:
        return {"VK_ICD_FILENAMES": str(software[0])}
    if any(_SOFTWARE_VULKAN.glob("*.json")) or sys.platform == "darwin":
        return {}
    raise MissingError("there is no Vulkan driver to draw with", command=_VULKAN_PACKAGES)


def _last_words(output: IO[bytes]) -> str:
    output.seek(0)
    lines = [line for line in output.read().decode(errors="replace").splitlines() if line.strip()]
    said = next((line for line in lines if "panicked" in line), lines[-1] if lines else "it said nothing")
    return said.strip()[:300]
