"""Someone who does what a document says, word for word, in a folder of their own.

What is in an `sh` block is typed into a terminal of 80 by 24, and has to succeed. A `text` block shows what the block
before it prints: its lines have to be there, in this order; `...` stands for any lines. Other blocks are there to be
read, unless a comment right above one, which readers of the rendered page do not see, says otherwise:

    <!-- file PATH -->      the block is a new file; the text above it has to say so
    <!-- append PATH -->    the block goes to the end of a file; likewise
    <!-- exit N -->         its last command ends with this exit code, or `N or M`
    <!-- not run: WHY -->   nobody types this here
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shlex
import signal
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), ROOT / "runs" / "README.md"])
"""Every page that people read."""

FOLLOWED = (
    "tutorials/domain.md",
    "how-to/own-model.md",
    "how-to/own-world.md",
    "how-to/real-robot.md",
    "how-to/symbolic-world.md",
)
"""The pages of docs/ that are followed from beginning to end, in one folder; elsewhere each block stands alone."""

LANGUAGES = frozenset({"", "markdown", "pddl", "python", "sh", "text", "toml", "xml"})
_BLOCK = re.compile(r"^(?:<!-- (?P<note>[^\n]*) -->\n)?```(?P<language>[^\n]*)\n(?P<text>.*?)^```$", re.M | re.S)
_SEQUENCE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")
_CURSOR_BACK = "\x1b[?25h"
"""What a live view ends with; what it showed before is gone from the screen."""


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: where it begins, the text since the block before it, and the note right above it."""

    document: Path
    line: int
    language: str
    text: str
    note: str
    before: str

    def __str__(self) -> str:
        return f"{self.document.name}, line {self.line}"


def blocks(document: Path) -> Iterator[Block]:
    text, end = document.read_text(encoding="utf-8"), 0
    for match in _BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("text"))
        yield Block(document, line, match["language"], match["text"], match["note"] or "", text[end : match.start()])
        end = match.end()


class Follower:
    """Follows documents in `folder`; what they change is kept from one block to the next."""

    def __init__(self, folder: Path, instead: Mapping[str, str] | None = None) -> None:
        """`instead` maps what is written in the document to what is typed in its place."""
        self.folder = self.here = folder
        self._instead = dict(instead or {})
        self.printed = ""
        scripts = str(Path(sys.executable).parent)
        self._environment = {
            **{
                key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY", "NO_COLOR")
            },
            "PATH": os.pathsep.join([scripts, os.environ["PATH"]]),
            "HOME": str(folder),
            "TERM": "xterm-256color",
            "OMP_NUM_THREADS": "1",  # a tiny model is quicker on one thread than on several that wait for each other
        }

    def follow(self, block: Block) -> None:
        what, _, rest = block.note.partition(" ")
        match what, block.language:
            case "file" | "append", _:
                self._write(block, rest, "x" if what == "file" else "a")
            case "exit", "sh":
                self.type(block.text, {int(code) for code in rest.split(" or ")})
            case "", "sh":
                self.type(block.text)
            case "", "text":
                assert_shows(self.printed, block)
            case "not", "sh":
                assert rest.startswith("run: "), f"{block}: {block.note!r} is no note"
            case _:
                assert not block.note, f"{block}: {block.note!r} is no note for {block.language!r}"

    def type(self, script: str, codes: Collection[int] = (0,), patience: float = 240.0) -> str:
        """Type some lines into a shell in a terminal, and return what is printed; they end with one of `codes`."""
        for written, typed in self._instead.items():
            script = script.replace(written, typed)
        here = self.folder / ".here"
        trap = f"trap 'pwd > {shlex.quote(str(here))}' EXIT"
        full = f"set -eu\ncd {shlex.quote(str(self.here))}\n{trap}\n{script}"
        returned, printed = in_terminal(["sh", "-c", full], self._environment, patience)
        self.printed = _SEQUENCE.sub("", printed.rpartition(_CURSOR_BACK)[2])
        assert returned in codes, f"{script}ends with {returned}:\n{self.printed}"
        self.here = Path(here.read_text().strip())
        return self.printed

    def _write(self, block: Block, name: str, mode: str) -> None:
        assert Path(name).name in block.before, f"{block}: the text does not say that this is {name}"
        path = self.here / name
        assert path.resolve().is_relative_to(self.folder.resolve())
        with path.open(mode, encoding="utf-8") as file:
            file.write(block.text)


def assert_shows(printed: str, block: Block) -> None:
    lines = iter(line.rstrip() for line in printed.splitlines())
    for wanted in block.text.splitlines():
        if wanted.strip() != "...":
            assert wanted.rstrip() in lines, f"{block}: {wanted!r} is not printed here:\n{printed}"


def in_terminal(command: list[str], environment: Mapping[str, str], patience: float) -> tuple[int, str]:
    """Run a command in a terminal of 80 by 24; its exit code, and all that it wrote."""
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs, env=dict(environment), start_new_session=True
    )
    os.close(theirs)
    signal_late = _kill_after(process, patience)
    written = bytearray()
    try:
        with contextlib.suppress(OSError):  # how a terminal says that nobody is left to write to it
            while data := os.read(ours, 65536):
                written += data
        return process.wait(), written.decode(errors="replace")
    finally:
        signal_late.cancel()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        os.close(ours)


def _kill_after(process: subprocess.Popen[bytes], seconds: float) -> threading.Timer:
    timer = threading.Timer(seconds, os.killpg, (process.pid, signal.SIGKILL))
    timer.daemon = True
    timer.start()
    return timer
