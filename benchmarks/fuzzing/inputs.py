"""Inputs for a parser: what it reads, changed at random in ways that files are wrong in, and in ways that none is.

`changed` asks its dice for every choice. In the tests, hypothesis decides; in the long run, a generator of random
numbers, which takes a tenth of the time.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, TypeVar

from hypothesis import strategies as st

T = TypeVar("T")

_TOKEN = re.compile(rb"[A-Za-z0-9_\-.]+|[ \t]+|\r?\n|.", re.DOTALL)
_NUMBER = re.compile(rb"[+\-]?[0-9][0-9._eE+\-]*")
_NAME = re.compile(rb"[A-Za-z_][A-Za-z0-9_\-.]*")

NUMBERS: tuple[bytes, ...] = (
    *(b"0", b"-0", b"-1", b"1", b"2", b"7", b"0.1", b"-0.5", b"1e309", b"-1e309", b"1e-400", b"nan", b"inf", b"-inf"),
    *(b"NaN", b"Infinity", b"-Infinity", b"0x10", b"1_0", b"9223372036854775807", b"9223372036854775808", b"1e18"),
    *(b"-9223372036854775809", b"9" * 400, b"-" + b"9" * 400, b"9" * 5000, b"0x" + b"f" * 5000, b"1979-05-27"),
    *(b"true", b"false", b"null", b"[]", b"{}", b'""', b"[1]", b"[[1]]", b'"1"'),
)
"""What may stand where a number stood."""

NAMES: tuple[bytes, ...] = (
    *(b"", b"x", b".", b"..", b"../x", b"/", b"~", b"~nobody/x", b"con", b"a" * 300, b"a" * 5000, b"\\u0000", b"\\n"),
    *(b"\\ud800", b"\\u001b[2J", b"\\u202e", b"%s%n", b"{0}", b"{__class__}", b"{", b"}", b"(", b"null", b"None"),
    *("\N{KELVIN SIGN}\N{LATIN SMALL LETTER LONG S}".encode(), b"lemon", b"0", b"-", b"a,b", b"a b", b"a.b"),
)
"""What may stand where a word stood, in quotes or not."""

NASTY: tuple[bytes, ...] = (
    *(b"", b"\x00", b"\xff", b"\xfe\xff", b"\x7f", b"\r", b"\n", b"\t", b"\\", b"'", b'"', b'"""', b"#", b";"),
    *(b"0", b"-0", b"-1", b"1e309", b"-1e309", b"nan", b"inf", b"NaN", b"-Infinity", b"0x10", b"1_0", b"9" * 400),
    *(b"9" * 5000, b"1e-400", b"0.1", b"true", b"false", b"null", b"None", b"[]", b"{}", b"()", b"[[", b"}}"),
    *(
        "\N{KELVIN SIGN}\N{LATIN SMALL LETTER LONG S}\N{LATIN CAPITAL LETTER I WITH DOT ABOVE}".encode(),
        b"\xed\xa0\x80",
    ),
    *("\N{LINE SEPARATOR}\N{RIGHT-TO-LEFT OVERRIDE}\N{ZERO WIDTH JOINER}".encode(), b"\x1b[2J", b"\xc2\x85"),
    *(b"%s%n", b"{0}", b"{__class__}", b"$(id)", b"../../x", b"/etc/passwd", b"//", b"C:\\x", b"~root", b"con"),
    *(b"a" * 3000, b"[" * 2000, b"(" * 2000, b'{"a":' * 1500, b"a.b." * 800),
    *(b"\nx = " + b"[" * 2000 + b"\n", b"\nx = " + b"{a = " * 1000 + b"\n"),
)
"""Pieces of text that parsers choke on."""

OPERATIONS = (
    *("replace", "delete", "repeat", "insert", "nasty", "byte", "cut", "splice", "line", "swap"),
    *("number", "number", "name", "name"),
)


class Dice(Protocol):
    """Whoever decides."""

    def number(self, low: int, high: int) -> int:
        """A whole number, both ends included."""
        ...

    def of(self, values: Sequence[T]) -> T:
        """One of them."""
        ...


@dataclass(frozen=True, slots=True)
class Rolled:
    """Dice that are fixed by a seed."""

    rng: random.Random

    def number(self, low: int, high: int) -> int:
        return low + int(self.rng.random() * (high - low + 1))

    def of(self, values: Sequence[T]) -> T:
        return values[int(self.rng.random() * len(values))]


@dataclass(frozen=True, slots=True)
class Drawn:
    """Dice of hypothesis, which finds the simplest throws that do harm."""

    draw: st.DrawFn

    def number(self, low: int, high: int) -> int:
        return self.draw(st.integers(low, high))

    def of(self, values: Sequence[T]) -> T:
        return self.draw(st.sampled_from(values))


@st.composite
def inputs(draw: st.DrawFn, seeds: Sequence[bytes], words: Sequence[str]) -> bytes:
    """One of `seeds` with one change or a few, or else anything."""
    return changed(Drawn(draw), seeds, words)


def changed(dice: Dice, seeds: Sequence[bytes], words: Sequence[str]) -> bytes:
    """The same, with the changes that the dice decide on."""
    if dice.number(0, 49) == 0:
        return bytes(dice.number(0, 255) for _ in range(dice.number(0, 60)))
    parts = list(tokens(dice.of(seeds)))
    own = [word.encode() for word in words] or [b"x"]
    for _ in range(dice.number(1, 4)):
        parts = _changed(dice, parts, seeds, own)
    return b"".join(parts)


def smallest(data: bytes, harmful: Callable[[bytes], bool], tries: int = 400) -> bytes:
    """Of an input that does harm, as little as still does."""
    parts, size = list(tokens(data)), len(tokens(data)) // 2
    while size:
        at = 0
        while at < len(parts) and tries:
            tries -= 1
            less = [*parts[:at], *parts[at + size :]]
            if harmful(b"".join(less)):
                parts = less
            else:
                at += size
        size //= 2
    return b"".join(parts)


@lru_cache(maxsize=64)
def tokens(data: bytes) -> tuple[bytes, ...]:
    """Words, numbers, space, ends of lines, and single characters of anything else."""
    return tuple(_TOKEN.findall(data))


def _changed(dice: Dice, parts: list[bytes], seeds: Sequence[bytes], words: Sequence[bytes]) -> list[bytes]:
    operation = dice.of(OPERATIONS)
    at = dice.number(0, max(0, len(parts) - 1))
    match operation:
        case "replace":
            return [*parts[:at], dice.of(words), *parts[at + 1 :]]
        case "insert":
            return [*parts[:at], dice.of(words), *parts[at:]]
        case "nasty":
            return [*parts[:at], dice.of(NASTY), *parts[at + dice.number(0, 1) :]]
        case "number":
            return _instead(dice, parts, at, _NUMBER, NUMBERS)
        case "name":
            return _instead(dice, parts, at, _NAME, NAMES)
        case "delete":
            return [*parts[:at], *parts[at + dice.number(1, 8) :]]
        case "repeat":
            span = parts[at : at + dice.number(1, 12)]
            return [*parts[:at], *span * dice.number(2, 4), *parts[at + len(span) :]]
        case "byte":
            whole = bytearray(b"".join(parts) or b"\0")
            place = dice.number(0, len(whole) - 1)
            whole[place] = dice.number(0, 255)
            return list(_TOKEN.findall(bytes(whole)))
        case "cut":
            return parts[:at] if dice.number(0, 1) else parts[at:]
        case "splice":
            other = tokens(dice.of(seeds))
            start = dice.number(0, max(0, len(other) - 1))
            return [*parts[:at], *other[start : start + dice.number(1, 30)], *parts[at:]]
        case _:
            lines = b"".join(parts).splitlines(keepends=True) or [b""]
            first, second = (dice.number(0, len(lines) - 1) for _ in range(2))
            if operation == "line":
                lines.insert(first, lines[second])
            else:
                lines[first], lines[second] = lines[second], lines[first]
            return list(_TOKEN.findall(b"".join(lines)))


def _instead(dice: Dice, parts: list[bytes], at: int, kind: re.Pattern[bytes], values: Sequence[bytes]) -> list[bytes]:
    """The next part of that kind, replaced; of a file that has none of it, the part at hand."""
    place = next((number for number in range(at, len(parts)) if kind.fullmatch(parts[number])), at)
    return [*parts[:place], dice.of(values), *parts[place + 1 :]]
