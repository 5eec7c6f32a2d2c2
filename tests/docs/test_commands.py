"""Every command in README and docs is carried out, block by block, in a folder that has what the block needs.

What takes hours is done with less: `INSTEAD` says what is typed in place of what is written. A command that comes into
the pages and is too much for a test needs a line there. The pages in `FOLLOWED` are not here: test_tutorials.py follows
each of them as a whole.
"""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import typer.core
import typer.main
from PIL import Image as Picture

from executive import cli
from tests.docs.following import DOCS, DOCUMENTS, FOLLOWED, ROOT, Block, Follower, blocks
from tests.executive.s3e.chat_server import serving
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.on_server import honest
from tests.executive.s3e.videos import greys, write_video

pytestmark = pytest.mark.pages

INSTEAD = {
    "runs/<id>": "runs/example",
    "--points 2000": "--points 2",
    "--points 200": "--points 2",
    "benchmarks/campaigns/learned-pick.toml": "small.toml",
    "--alpha 0.05": "--alpha 0.5",  # all that two looks can promise
    "--seed 3 --fault drop@4 --estimator none": "--problem one-item --fault drop@2 --estimator none",
    "--problem breakfast --fault drop@4": "--problem one-item --fault drop@2",
    "--minutes 45 ": "",
    "train grocery": "train grocery --recipe smallest --jobs 1",
    "train workshop --from grocery": "train grocery --recipe smallest --jobs 1",
    "train workshop --from workshop-eye/model": "train grocery --recipe smallest --jobs 1 --from workshop-eye/model",
    "benchmarks/campaigns/grasp-drop.toml": "small.toml",
    "benchmarks/campaigns/blocksworld.toml": "small.toml",
    "campaigns/grasp-drop": "campaigns/small",
    "--seeds 20": "--seeds 1 --jobs 1",
    "http://127.0.0.1:8000/v1": "SERVER",
}
CODES = (
    (r"inspect \S+$", {3}),  # there is no screen here, and it says so
    (r"--renderer mitsuba", {0, 3}),  # where the extra is missing, it says so
    (r"--estimator none", {1}),  # nobody looks
    (r"--engine ray", {0, 2, 3}),  # there is no cluster here, and it says so; or nothing is left to play
    (r"resume", {2}),  # the run in the example has come to its end, and it says so
    (r"FOLDER|SERVER", {0, 1}),  # as a model that knows nothing sees it
    (r"", {0}),
)
"""How a command ends: the first that is found in it."""

IN_A_SHELL = re.compile(r"--web|--install-completion|^make |^\. ")
"""What waits, changes the shell, or sets up this very folder; these have tests of their own."""


_OUT = re.compile(r" --out \S+")


def lines(block: Block) -> list[str]:
    """The commands of a block, without comments."""
    return [line.split(" #")[0].strip() for line in block.text.splitlines() if line.strip() and line[0] != "#"]


PAGES = [page for page in DOCUMENTS if page not in [DOCS / followed for followed in FOLLOWED]]
SHELL = [
    block for page in PAGES for block in blocks(page) if block.language == "sh" and not block.note.startswith("not run")
]
COMMANDS = [block for block in SHELL if not all(IN_A_SHELL.search(line) for line in lines(block))]


@pytest.fixture
def server() -> Iterator[str]:
    with serving(honest) as there:
        yield there.url


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder like a clone's, with pictures and a model that knows nothing in it, and no screen."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "domains").symlink_to(ROOT / "domains")
    shutil.copytree(ROOT / "runs" / "example", tmp_path / "runs" / "example")
    for seed, name in enumerate(("a.png", "b.png")):
        pixels = np.random.default_rng(seed).integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Picture.fromarray(pixels).save(tmp_path / name)
    return tmp_path


SMALL_CAMPAIGN = """
title = "A small one"
seeds = 1
[[domains]]
domain = "grocery"
problems = ["one-item"]
[faults]
nothing = []
[estimators]
none = {}
oracle = {}
"""


def prepare(folder: Path, text: str) -> None:
    """What only some blocks need."""
    if "FOLDER" in text:
        build("fastvlm", folder / "FOLDER", answering=8.0)
    if "bench" in text:
        (folder / "small.toml").write_text(SMALL_CAMPAIGN)
    if "clip.mp4" in text:
        write_video(folder / "clip.mp4", greys(6))
    if (" data " in text and "collect" not in text) or "evaluations/" in text:
        assert cli.exit_code(shlex.split("collect grocery --points 2 --seed 7 --out data --jobs 1")) == 0
    if "evaluations/" in text and " data " not in text:
        assert cli.exit_code(shlex.split("eval grocery data --vlm FOLDER")) == 0


@pytest.mark.timeout(900)
@pytest.mark.parametrize("block", COMMANDS, ids=str)
def test_a_block_of_commands(
    block: Block, workplace: Path, server: str, one_thread: None, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare(workplace, block.text)
    trained = set[str]()
    for line in lines(block):
        if IN_A_SHELL.search(line):
            continue
        for written, typed in INSTEAD.items():
            line = line.replace(written, typed)
        if line.startswith("executive train ") and _OUT.sub("", line) in trained:
            continue  # done with less, several of a block become the same training
        trained.add(_OUT.sub("", line))
        codes = next(codes for pattern, codes in CODES if re.search(pattern, line))
        made = sorted((workplace / "evaluations").glob("*/"))
        arguments = shlex.split(line.replace("evaluations/<id>", str(made[-1]) if made else ""))
        assert arguments.pop(0) == "executive", f"{block}: {line}"
        if arguments[0] == "run" and re.search(r"FOLDER|SERVER", line):
            arguments += ["--max-looks", "8"]  # as a model that knows nothing sees it, a run goes on for long
        code = cli.exit_code([argument.replace("SERVER", server) for argument in arguments])
        out, err = capsys.readouterr()
        assert code in codes, f"{line}\n{out}\n{err}"


def test_every_command_is_shown_on_some_page() -> None:
    group = typer.main.get_command(cli.app)
    assert isinstance(group, typer.core.TyperGroup)
    everywhere = [block for page in DOCUMENTS for block in blocks(page) if block.language == "sh"]
    shown = {line.split()[1] for block in everywhere for line in lines(block) if line.startswith("executive ")}
    assert group.commands.keys() - shown == set()


def test_make_run_is_the_first_command() -> None:
    tutorial = [block for block in COMMANDS if block.document == DOCS / "tutorials" / "first-run.md"]
    first = next(line for block in tutorial for line in lines(block) if line.startswith("executive run "))
    assert f"run: setup\n\t.venv/bin/{first}\n" in (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_the_browser_gets_its_page_until_a_signal_comes(number: signal.Signals, code: int, workplace: Path) -> None:
    assert any("inspect runs/<id> --web" in block.text for block in SHELL)
    command = [sys.executable, "-m", "executive", "inspect", "runs/example", "--web"]
    # Whoever runs the tests in the background has them ignore SIGINT; this one is to hear it.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heard) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().split()[0]
            page = _fetched(address.partition("?")[0])
        finally:
            process.send_signal(number)
    assert process.returncode == code
    assert b"<html" in page.lower()
    with pytest.raises(OSError):  # the viewer, which is another process, has ended with it
        urllib.request.urlopen(address.partition("?")[0], timeout=10)


def _fetched(address: str) -> bytes:
    """The page, once the server is there."""
    assert address.startswith("http://127.0.0.1:")
    for _ in range(200):
        try:
            with urllib.request.urlopen(address, timeout=10) as answer:
                return bytes(answer.read())
        except OSError:
            subprocess.run(["sleep", "0.3"], check=True)
    raise AssertionError(f"nobody answers at {address}")


def test_completion_is_installed_for_the_shell(tmp_path: Path) -> None:
    assert any("executive --install-completion" in block.text for block in SHELL)
    reader = Follower(tmp_path)
    assert "completion installed" in reader.type("bash -c 'executive --install-completion; true'\n")
    assert "executive" in (tmp_path / ".bash_completions" / "executive.sh").read_text()
    assert ".bash_completions/executive.sh" in (tmp_path / ".bashrc").read_text()
