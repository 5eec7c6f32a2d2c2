"""Inputs for a parser: what it reads, changed at random in ways that files are wrong in, and in ways that none is."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hypothesis import strategies as st

_TOKEN = re.compile(rb"[A-Za-z0-9_\-.]+|[ \t]+|\r?\n|.", re.DOTALL)

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

OPERATIONS = ("replace", "delete", "repeat", "insert", "nasty", "byte", "cut", "splice", "line", "swap")


@st.composite
def inputs(draw: st.DrawFn, seeds: Sequence[bytes], words: Sequence[str]) -> bytes:
    """One of `seeds` with one change or a few, or else anything."""
    if draw(st.integers(0, 49)) == 0:
        return draw(st.binary(max_size=60) | st.text(max_size=60).map(lambda text: text.encode(errors="replace")))
    parts = _TOKEN.findall(draw(st.sampled_from(seeds)))
    own = [word.encode() for word in words] or [b"x"]
    for _ in range(draw(st.integers(1, 4))):
        parts = _changed(draw, parts, seeds, own)
    return b"".join(parts)


def _changed(draw: st.DrawFn, parts: list[bytes], seeds: Sequence[bytes], words: Sequence[bytes]) -> list[bytes]:
    operation = draw(st.sampled_from(OPERATIONS))
    at = draw(st.integers(0, max(0, len(parts) - 1)))
    match operation:
        case "replace":
            return [*parts[:at], draw(st.sampled_from(words)), *parts[at + 1 :]]
        case "insert":
            return [*parts[:at], draw(st.sampled_from(words)), *parts[at:]]
        case "nasty":
            return [*parts[:at], draw(st.sampled_from(NASTY)), *parts[at + draw(st.integers(0, 1)) :]]
        case "delete":
            return [*parts[:at], *parts[at + draw(st.integers(1, 8)) :]]
        case "repeat":
            span = parts[at : at + draw(st.integers(1, 12))]
            return [*parts[:at], *span * draw(st.integers(2, 4)), *parts[at + len(span) :]]
        case "byte":
            whole = bytearray(b"".join(parts) or b"\0")
            place = draw(st.integers(0, len(whole) - 1))
            whole[place] = draw(st.integers(0, 255))
            return _TOKEN.findall(bytes(whole))
        case "cut":
            return parts[:at] if draw(st.booleans()) else parts[at:]
        case "splice":
            other = _TOKEN.findall(draw(st.sampled_from(seeds)))
            start = draw(st.integers(0, max(0, len(other) - 1)))
            return [*parts[:at], *other[start : start + draw(st.integers(1, 30))], *parts[at:]]
        case _:
            lines = b"".join(parts).splitlines(keepends=True) or [b""]
            first, second = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
            if operation == "line":
                lines.insert(first, lines[second])
            else:
                lines[first], lines[second] = lines[second], lines[first]
            return _TOKEN.findall(b"".join(lines))
