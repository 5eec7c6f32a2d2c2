"""A short fuzz of every parser, and that the fuzzer would notice. The long one is `python -m benchmarks.fuzz`."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzzing import watch
from benchmarks.fuzzing.inputs import NASTY, inputs
from benchmarks.fuzzing.targets import TARGETS
from benchmarks.fuzzing.watch import Hang, MisdeedError, judged
from executive.errors import InputError

EXAMPLES = 60


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("name", TARGETS)
def test_a_parser_takes_what_it_is_for(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    first, *others = target.seeds()
    assert judged(target.read, first, tmp_path)
    for seed in others:  # a server's refusals are among them
        judged(target.read, seed, tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_whatever_a_parser_is_given_it_takes_or_refuses_in_a_line(name: str, scratch: Path) -> None:
    target, seen = TARGETS[name], {True: 0, False: 0}

    @settings(
        max_examples=EXAMPLES, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
    )
    @given(inputs(target.seeds(), target.words))
    def harmless(data: bytes) -> None:
        seen[judged(target.read, data, scratch / name.replace(" ", "-"))] += 1

    (scratch / name.replace(" ", "-")).mkdir()
    harmless()
    assert sum(seen.values()) >= EXAMPLES // 2


@pytest.mark.parametrize("name", TARGETS)
def test_pieces_that_parsers_choke_on_in_the_middle_of_what_they_read(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    seed = min(target.seeds(), key=len)
    for piece in NASTY:
        for at in (0, len(seed) // 3, len(seed)):
            judged(target.read, seed[:at] + piece + seed[at:], tmp_path)


def forever(data: bytes, scratch: Path) -> None:
    while True:
        try:
            sum(range(1000))
        except Exception:
            continue


def refused(message: str) -> Callable[[bytes, Path], None]:
    class OddError(InputError):
        def __str__(self) -> str:
            return message

    def read(data: bytes, scratch: Path) -> None:
        raise OddError(message)

    return read


def test_a_hang_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "PATIENCE", 0.05)
    with pytest.raises(Hang, match=r"more than 0\.05 s"):
        judged(forever, b"", tmp_path)
    time.sleep(0)  # nothing is left that could go off later


@pytest.mark.parametrize(
    ("name", "deed"),
    [
        ("open", lambda data, scratch: (scratch.parent / "elsewhere").write_bytes(data)),
        ("open", lambda data, scratch: (scratch / ".." / "elsewhere").open("ab").close()),
        ("os.mkdir", lambda data, scratch: (scratch.parent / "elsewhere").mkdir()),
        ("os.rename", lambda data, scratch: scratch.rename(scratch.parent / "elsewhere")),
        ("os.symlink", lambda data, scratch: (scratch.parent / "elsewhere").symlink_to("/")),
        ("subprocess.Popen", lambda data, scratch: subprocess.run(["true"], check=True)),
        ("os.system", lambda data, scratch: os.system("true")),
        ("socket.getaddrinfo", lambda data, scratch: socket.getaddrinfo("localhost", 80)),
    ],
)
def test_what_no_parser_may_do_is_noticed(name: str, deed: Callable[[bytes, Path], object], tmp_path: Path) -> None:
    inner = tmp_path / "scratch"
    inner.mkdir()
    with pytest.raises(MisdeedError, match=f"^{name}: "):
        judged(deed, b"x", inner)
    assert [path.name for path in tmp_path.iterdir()] == ["scratch"]


def test_what_it_may_do_is_not(tmp_path: Path) -> None:
    def read(data: bytes, scratch: Path) -> None:
        (scratch / "deep").mkdir()
        (scratch / "deep" / "file").write_bytes(data)
        (scratch / "deep" / "file").rename(scratch / "file")
        Path(os.devnull).write_bytes(data)
        Path(__file__).read_bytes()

    assert judged(read, b"x", tmp_path)


@pytest.mark.parametrize("message", ["two\nlines", "", "  ", "a\x1b[2Jb", "x" * 200_000])
def test_a_bad_line_is_noticed(message: str, tmp_path: Path) -> None:
    with pytest.raises(MisdeedError, match="no line that anybody wants to read"):
        judged(refused(message), b"", tmp_path)


def test_a_good_line_is_a_refusal(tmp_path: Path) -> None:
    assert judged(refused("faults.toml: is not TOML"), b"", tmp_path) is False
    with pytest.raises(ZeroDivisionError):
        judged(lambda data, scratch: 1 // 0, b"", tmp_path)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.data())
def test_inputs_stay_of_a_size_that_can_be_read(data: st.DataObject) -> None:
    assert len(data.draw(inputs([b"a = 1\nb = [2]\n"], ["x"]))) < 60_000
