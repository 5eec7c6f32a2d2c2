"""Files from anywhere: whatever is in one, it is read, or one line says what is wrong with it."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import DomainError, InputError
from executive.util import arrays
from executive.util.arrays import parse_arrays
from executive.util.files import (
    DEEPEST,
    check_writable,
    home,
    legible,
    parse_json,
    parse_toml,
    read_bytes,
    read_json,
    read_text,
    read_toml,
)

HUGE = "9" * 5_000
"""More digits than Python turns into a number."""


def refused(read: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        read()
    return str(caught.value)


# What is read.

scalars = st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text()
documents = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4), max_leaves=20
)


@given(documents)
def test_json_is_what_was_written(document: Any) -> None:
    text = json.dumps(document)
    assert json.dumps(parse_json(text)) == json.dumps(parse_json(text.encode())) == text


@given(st.binary(max_size=40))
def test_bytes_are_json_or_a_value_error(data: bytes) -> None:
    with contextlib.suppress(ValueError):
        parse_json(data)


@given(st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_bytes_are_toml_or_an_input_error(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    file = tmp_path_factory.getbasetemp() / "any.toml"
    file.write_bytes(data)
    with contextlib.suppress(InputError):
        assert isinstance(read_toml(file), dict)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_is_the_same_wherever_it_was_written(tmp_path: Path, mark: bytes, end: str) -> None:
    (tmp_path / "a.toml").write_bytes(mark + end.join(["# a", "b = 'ü'", ""]).encode())
    assert read_text(tmp_path / "a.toml") == "# a\nb = 'ü'\n"
    assert read_toml(tmp_path / "a.toml") == {"b": "ü"}


# What is not.


@pytest.mark.parametrize("name", ["a" * 5_000, "a\0b", "\ud800", ".", "file/inside", "nothing"])
def test_a_file_that_cannot_be_is_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    told = refused(lambda: read_bytes(tmp_path / name))
    assert "there is no such file" in told or "cannot be read (" in told
    assert told.isprintable()


def test_a_file_may_have_so_many_bytes_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1234")
    assert read_bytes(tmp_path / "a", largest=4) == b"1234"
    assert refused(lambda: read_bytes(tmp_path / "a", largest=3)).endswith(
        "a: has more than 3 bytes, which no such file has"
    )


def test_the_mistake_is_of_the_kind_that_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xff")
    for read in (read_text, read_toml, read_json):
        with pytest.raises(DomainError, match="a: is not "):
            read(tmp_path / "a", mistake=DomainError)
        with pytest.raises(DomainError, match="there is no such file"):
            read(tmp_path / "b", mistake=DomainError)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = ", "x.toml: is not TOML: Invalid value"),
        (f"a = 1\nb = -{HUGE}", "x.toml: is not TOML: a number of more than 4,300 digits (at line 2)"),
        (f"a = '''\n\n'''\nb = [1_{HUGE}]", "x.toml: is not TOML: a number of more than 4,300 digits (at line 4)"),
        (f"[a]\nb = [1, {{c = 0x{HUGE}}}]", "x.toml: a.b[1].c: is not TOML: a number of more than 64 bits"),
        (f"a = {2**63}", "x.toml: a: is not TOML: a number of more than 64 bits"),
        (f"a = {-(2**63) - 1}", "x.toml: a: is not TOML: a number of more than 64 bits"),
        ("a = " + "[" * 100_000, "x.toml: is not TOML that anyone would write: nested too deep"),
        ("a = " + "[" * DEEPEST + "]" * DEEPEST, "x.toml: is not TOML that anyone would write: nested too deep"),
        ("\n" + "a." * 400_000 + "a = 1", "x.toml: line 2: is not TOML that anyone would write: nested too deep"),
        ("a = {" + "'a' . " * 100_000 + "a = 1}", "x.toml: line 1: is not TOML that anyone would write: nested too"),
        ("[" + "a." * 100_000 + "a]", "x.toml: line 1: is not TOML that anyone would write: nested too deep"),
    ],
)
def test_toml_that_nobody_writes_is_one_line_before_the_test_times_out(text: str, told: str) -> None:
    assert refused(lambda: parse_toml(text, Path("x.toml"))).startswith(told)


@pytest.mark.parametrize(
    "text",
    [
        f"a = [{2**63 - 1}, {-(2**63)}, 0x7fffffffffffffff]",
        f"a = '{HUGE}'  # {HUGE}",
        "a = '" + "a." * 90 + "'",
        "a = " + "[" * (DEEPEST - 1) + "]" * (DEEPEST - 1),
        "a." * (DEEPEST - 2) + "a = 1",
        f"a = 1.{HUGE}",
    ],
)
def test_toml_that_looks_like_it_is_read(text: str) -> None:
    assert parse_toml(text, Path("x.toml")).keys() == {"a"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[", "Expecting value"),
        (f"[1,\n{HUGE}]", "a number of more than 4,300 digits (at line 2)"),
        ("[" * 100_000, "nested too deep"),
        ("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), "nested too deep"),
        ('{"a": ' * (DEEPEST + 1) + "1" + "}" * (DEEPEST + 1), "nested too deep"),
    ],
)
def test_json_that_nobody_writes_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    for data in (text, text.encode()):
        with pytest.raises(ValueError) as caught:
            parse_json(data)
        assert told in str(caught.value)
    (tmp_path / "x.json").write_text(text)
    assert f"x.json: is not JSON ({told}" in refused(lambda: read_json(tmp_path / "x.json"))


def test_json_may_have_large_numbers_and_be_deep() -> None:
    assert parse_json(str(10**400)) == 10**400  # tokenizers write 10**30 for "any length"
    assert json.dumps(parse_json("[" * DEEPEST + "]" * DEEPEST)) == "[" * DEEPEST + "]" * DEEPEST


# Arrays.


def saved(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def test_arrays_are_what_was_written() -> None:
    read = parse_arrays(saved(a=np.arange(3), b=1.5))
    assert read.keys() == {"a", "b"}
    assert (read["a"].tolist(), read["b"].item()) == ([0, 1, 2], 1.5)


def test_a_small_file_of_large_arrays_is_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    small = saved(a=np.zeros(100_000), b=np.zeros(10))
    assert len(small) < 2_000
    monkeypatch.setattr(arrays, "LARGEST_ARRAYS", 800_000)
    with pytest.raises(ValueError, match="more than 800,000 bytes in its arrays"):
        parse_arrays(small)
    monkeypatch.setattr(arrays, "LARGEST_ARRAYS", 810_000)
    assert parse_arrays(small).keys() == {"a", "b"}


@given(st.data())
def test_damaged_arrays_are_a_value_error(data: st.DataObject) -> None:
    whole = bytearray(saved(a=np.arange(9.0), b=np.array(["x", "yz"])))
    for _ in range(data.draw(st.integers(1, 3))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(ValueError):
        parse_arrays(bytes(whole[: data.draw(st.integers(0, len(whole)))]))


def test_objects_are_not_unpickled() -> None:
    class Harm:
        def __reduce__(self) -> tuple[Any, ...]:
            return (pytest.fail, ("unpickled",))

    with pytest.raises(ValueError, match="allow_pickle=False"):
        parse_arrays(saved(a=np.array([Harm()], dtype=object)))


@pytest.mark.parametrize("path", ["~nobody-of-this-name/x", "~a\0b/x", "/a/b", "a~"])
def test_what_is_no_home_stays_as_it_is(path: str) -> None:
    assert home(path) == Path(path)


def test_home_is_home() -> None:
    assert home("~/x") == Path.home() / "x"


def test_what_is_no_text_is_marked_and_text_is_left_as_it_is() -> None:
    assert legible("lat\udce9/run") == "lat?/run"
    assert legible("laté/run") == "laté/run"


def test_where_files_can_be_made_nothing_is_left_behind(tmp_path: Path) -> None:
    check_writable(tmp_path / "not" / "there" / "yet", "--out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", ["/proc/nowhere", "/sys", "/dev/null/x", "a\0b", "a" * 5_000])
def test_where_no_file_can_be_made_is_said_with_the_option(folder: str) -> None:
    with pytest.raises(InputError) as raised:
        check_writable(Path(folder), "--out")
    assert raised.value.key == "--out"
