"""Pictures of a record, which may be a stranger's: JPEG that is read, or one line."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from PIL import Image as Picture

from executive.errors import InputError
from executive.trace.record import pictures
from executive.trace.record.pictures import (
    depth_from_png,
    depth_to_png,
    from_jpeg,
    jpegs,
    read_depth,
    read_picture,
    to_jpeg,
)
from executive.types import Observation

SHADES = np.linspace(0, 255, 24 * 32 * 3).astype(np.uint8).reshape(24, 32, 3)
EPS = b"""%!PS-Adobe-3.0 EPSF-3.0
%%BoundingBox: 0 0 8 8
%%EndComments
(x) (w) file
"""


def test_what_is_written_is_nearly_read_back(tmp_path: Path) -> None:
    data = to_jpeg(SHADES, 95)
    assert np.abs(from_jpeg(data).astype(int) - SHADES).max() < 20
    (tmp_path / "a.jpg").write_bytes(data)
    assert np.array_equal(read_picture(tmp_path / "a.jpg"), from_jpeg(data))


def test_the_pictures_of_an_observation_are_encoded_once_and_are_its_own() -> None:
    one, other = (Observation(0, 0.0, {"front": image}, np.zeros(6)) for image in (SHADES, SHADES[::-1].copy()))
    first = jpegs(one)
    assert jpegs(one) is first, "the record's and the viewer's"
    assert dict(first) == {"front": to_jpeg(SHADES)}
    assert dict(jpegs(other)) == {"front": to_jpeg(SHADES[::-1])}, "of the same look's number, and other pictures"
    assert dict(jpegs(one)) == dict(first)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200, deadline=None)
@given(st.integers(0, 700), st.binary(max_size=4), st.integers(0, 900))
@example(0, EPS, 0)
def test_whatever_else_is_there_is_read_or_one_line(tmp_path: Path, at: int, wrong: bytes, length: int) -> None:
    whole = to_jpeg(SHADES)
    file = tmp_path / "a.jpg"
    file.write_bytes((whole[:at] + wrong + whole[at + len(wrong) :])[:length])
    try:
        picture = read_picture(file)
    except InputError as error:
        line = str(error)
    else:
        assert picture.ndim == 3
        assert picture.dtype == np.uint8
        line = f"{file}: not a readable picture ()"
    assert line.startswith(f"{file}: not a readable picture (")


@pytest.mark.parametrize("kind", ["PNG", "GIF", "BMP", "TIFF", "EPS"])
def test_other_formats_are_not_opened(tmp_path: Path, kind: str) -> None:
    """Pillow has another program draw some of them."""
    buffer = io.BytesIO()
    Picture.fromarray(SHADES).save(buffer, kind)
    (tmp_path / "a.jpg").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match=r"a\.jpg: not a readable picture \(not a JPEG\)"):
        read_picture(tmp_path / "a.jpg")


@pytest.mark.parametrize(("largest", "told"), [(700, "32 x 24 pixels; at most 700 are read"), (800, "")])
def test_a_picture_that_fills_the_memory_is_not_unpacked(
    monkeypatch: pytest.MonkeyPatch, largest: int, told: str
) -> None:
    monkeypatch.setattr(pictures, "LARGEST", largest)
    if told:
        with pytest.raises(ValueError, match=told):
            from_jpeg(to_jpeg(SHADES))
    else:
        assert from_jpeg(to_jpeg(SHADES)).shape == SHADES.shape


def test_neither_is_one_that_pillow_itself_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Picture, "MAX_IMAGE_PIXELS", 100)
    with pytest.raises(ValueError, match="far more pixels than"):
        from_jpeg(to_jpeg(SHADES))


def test_a_picture_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"b\.jpg: there is no such file"):
        read_picture(tmp_path / "b.jpg")


DEPTHS = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) * np.uint16(85)


def test_depth_is_read_back_exactly(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(depth_to_png(DEPTHS))
    back = read_depth(tmp_path / "a.png")
    assert back.dtype == np.uint16
    assert np.array_equal(back, DEPTHS)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 700), st.binary(max_size=4), st.integers(0, 900))
def test_whatever_else_is_given_as_depth_is_read_or_one_line(at: int, wrong: bytes, length: int) -> None:
    whole = depth_to_png(DEPTHS)
    try:
        depth = depth_from_png((whole[:at] + wrong + whole[at + len(wrong) :])[:length])
    except ValueError as error:
        line = str(error)
    else:
        line = ""
        assert depth.ndim == 2
        assert depth.dtype == np.uint16
    assert "\n" not in line


def test_a_picture_of_8_bits_is_no_depth() -> None:
    buffer = io.BytesIO()
    Picture.fromarray(SHADES).save(buffer, "PNG")
    with pytest.raises(ValueError, match="16 bits"):
        depth_from_png(buffer.getvalue())
