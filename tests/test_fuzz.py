"""A short fuzz of every parser, and that the fuzzer would notice. The long one is `python -m benchmarks.fuzz`."""

from __future__ import annotations

import os
import random
import re
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz import by_chance, main
from benchmarks.fuzzing import watch
from benchmarks.fuzzing.inputs import NAMES, NASTY, NUMBERS, Rolled, changed, inputs, smallest, tokens
from benchmarks.fuzzing.targets import TARGETS, Target
from benchmarks.fuzzing.watch import Hang, MisdeedError, judged
from executive.errors import InputError

EXAMPLES, PLACES = 60, 5
"""Inputs that a target gets by chance; words and numbers in each seed that are replaced, each by each nasty one."""


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


@pytest.mark.parametrize("name", TARGETS)
def test_numbers_and_words_that_nobody_writes_in_the_place_of_each(name: str, tmp_path: Path) -> None:
    """Numbers without end, names that no file can have, and whatever else may stand where one stood."""
    target = TARGETS[name]
    for seed in sorted(target.seeds(), key=len)[:4]:  # a server's replies are of four kinds
        parts = list(tokens(re.sub(rb"(?m)^#.*\n", b"", seed)))
        for begin, values in ((rb"[0-9]", NUMBERS), (rb"[A-Za-z]", NAMES)):
            places = [number for number, part in enumerate(parts) if re.match(begin, part)]
            for place in places[:: -(-len(places) // PLACES) or 1]:
                for value in values:
                    judged(target.read, b"".join([*parts[:place], value, *parts[place + 1 :]]), tmp_path)


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


@pytest.mark.parametrize("message", ["two\nlines", "", "  ", "a\x1b[2Jb", "x" * 2_001])
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


def picky(data: bytes, scratch: Path) -> None:
    """Does not like a lemon that comes after a milk carton."""
    if b"lemon" in data.partition(b"milk")[2]:
        raise KeyError("lemon")


def test_what_does_harm_is_found_kept_and_made_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        TARGETS, "picky", Target(picky, lambda: [b"a = [milk, bread]\n" * 9, b"lemon = 1\n"], ("lemon",))
    )
    tally = by_chance("picky", 2_000, tmp_path)
    (file,) = tmp_path.iterdir()
    assert file.read_bytes() == b"milklemon"
    assert "KeyError: 'lemon'" in tally.finding
    assert file.name in tally.finding
    assert 0 < tally.inputs < 2_000
    assert by_chance("picky", tally.inputs - 1, tmp_path).finding == "", "the same inputs in the same order"
    assert by_chance("picky", 2_000, tmp_path, seed=1).inputs != tally.inputs


def test_the_command_says_what_came_of_each_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TARGETS, "picky", Target(picky, lambda: [b"milk lemon"]))
    for targets, code, told in ((["address"], 0, "nothing was found"), (["address", "picky"], 1, "1 findings")):
        options = ["--inputs", "100", "--engine", "chance", "--found", str(tmp_path)]
        monkeypatch.setattr("sys.argv", ["fuzz", *targets, *options])
        with pytest.raises(SystemExit) as left:
            main()
        assert left.value.code == code
        head, *lines, last = capsys.readouterr().out.splitlines()
        assert head.split() == ["target", "engine", "inputs", "taken", "refused", "s", "found"]
        assert [line.split()[0] for line in lines] == targets
        assert last == told
    monkeypatch.setattr("sys.argv", ["fuzz", "adress"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "no target 'adress'; valid: " in capsys.readouterr().err


def test_chance_is_fixed_by_its_seed() -> None:
    seeds = TARGETS["scene.toml"].seeds()
    once, again = ([changed(Rolled(random.Random(n)), seeds, ["x"]) for n in range(99)] for _ in range(2))
    assert once == again
    assert len(set(once)) > 90


@given(st.binary(max_size=200), st.sets(st.integers(0, 255), min_size=1, max_size=3))
def test_the_smallest_is_still_harmful_and_no_larger(data: bytes, needed: set[int]) -> None:
    whole = data + bytes(needed)
    small = smallest(whole, lambda less: needed <= set(less))
    assert needed <= set(small)
    assert len(small) <= len(whole)
    assert b"".join(tokens(whole)) == whole
