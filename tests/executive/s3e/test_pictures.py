"""Pictures from files: as they are meant to be seen, and one line for whatever is no picture."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image as Picture

from executive.errors import InputError
from executive.s3e import pictures
from executive.s3e.pictures import FORMATS, LARGEST, read_picture
from executive.types import Image

NOISE: Image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)


def encoded(image: Picture.Image, kind: str = "PNG", **options: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def bomb(width: int, height: int) -> bytes:
    """A small PNG file that claims to hold a picture of so many pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TIFF", "PPM"])
def test_a_picture_is_read_as_it_was_written(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "picture"  # what a file is called does not matter
    file.write_bytes(encoded(Picture.fromarray(NOISE), kind))
    assert np.array_equal(read_picture(file), NOISE)


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_rgb(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.new("RGB", (30, 20), (200, 100, 50)), kind))
    image = read_picture(file)
    assert image.shape == (20, 30, 3)
    assert image.dtype == np.uint8
    assert np.abs(image.astype(int) - (200, 100, 50)).max() < 12


@pytest.mark.parametrize("mode", ["L", "1", "P", "CMYK", "RGBA", "LA"])
def test_every_mode_gives_rgb(tmp_path: Path, mode: str) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.new("RGB", (4, 3), "white").convert(mode), "TIFF"))
    assert np.array_equal(read_picture(file), np.full((3, 4, 3), 255, np.uint8))


def test_what_is_transparent_is_shown_on_white(tmp_path: Path) -> None:
    file = tmp_path / "cut-out.png"
    file.write_bytes(encoded(Picture.new("RGBA", (4, 3), (0, 0, 0, 0))))
    assert np.array_equal(read_picture(file), np.full((3, 4, 3), 255, np.uint8))


def test_a_phone_held_upright_gives_an_upright_picture(tmp_path: Path) -> None:
    exif = Picture.Exif()
    exif[0x0112] = 6  # to be turned by 90 degrees clockwise
    file = tmp_path / "phone.png"
    file.write_bytes(encoded(Picture.fromarray(NOISE), exif=exif))
    assert np.array_equal(read_picture(file), np.rot90(NOISE, -1))


WHOLE = encoded(Picture.fromarray(NOISE))
BAD = {
    "text": (b"hello, I am no picture\n", "is no picture"),
    "empty": (b"", "is empty"),
    "cut off": (WHOLE[: len(WHOLE) // 2], "truncated"),
    "cut off in its header": (WHOLE[:20], ""),
    "large": (bomb(10_000, 6_000), "has 10000 x 6000 pixels; at most 50,000,000 are read"),
    "enormous": (bomb(100_000, 100_000), "has far more pixels than the 50,000,000 that are read"),
    "PostScript": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\n", "is no picture"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_picture_is_one_line(tmp_path: Path, bad: str) -> None:
    data, said = BAD[bad]
    file = tmp_path / "bad.png"
    file.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_picture(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert said in str(caught.value)


def test_no_file_a_folder_and_a_pipe_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_picture(tmp_path / "nothing.png")
    with pytest.raises(InputError, match="is a folder"):
        read_picture(tmp_path)
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(InputError, match="is not a file"):
        read_picture(tmp_path / "pipe.png")
    with pytest.raises(InputError, match="cannot be read"):
        read_picture("nul\0byte.png")


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "LARGEST_FILE", 100)
    (tmp_path / "large.png").write_bytes(WHOLE)
    with pytest.raises(InputError, match=r"bytes; a picture has at most 100"):
        read_picture(tmp_path / "large.png")


def test_the_largest_is_still_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert LARGEST >= 4000 * 3000 * 4
    monkeypatch.setattr(pictures, "LARGEST", 600)
    (tmp_path / "just.png").write_bytes(WHOLE)
    assert read_picture(tmp_path / "just.png").shape == (20, 30, 3)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from(FORMATS), data=st.data())
def test_a_damaged_file_is_a_picture_or_one_line(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    whole = bytearray(encoded(Picture.fromarray(NOISE), kind))
    for _ in range(data.draw(st.integers(1, 8))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path / "damaged"
    file.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    try:
        image = read_picture(file)
    except InputError:
        return
    assert image.ndim == 3
    assert image.shape[2] == 3


RAMP = np.tile(np.linspace(0.0, 1.0, 256), (4, 1))


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "PPM"])
@pytest.mark.parametrize("bits", [9, 10, 12, 14, 16])
def test_whole_numbers_of_more_than_eight_bits_are_brought_to_eight(tmp_path: Path, kind: str, bits: int) -> None:
    file = tmp_path / "picture"
    white = 2 ** (bits + bits % 2) - 1
    file.write_bytes(encoded(Picture.fromarray(np.rint(RAMP * white).astype(np.uint16)), kind))
    shades = read_picture(file)[..., 0].astype(float)
    assert np.abs(shades - 255.0 * RAMP).max() <= 1.0


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<i4"])
def test_how_whole_numbers_are_written_does_not_matter(tmp_path: Path, dtype: str) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.fromarray(np.rint(RAMP * 61_440).astype(dtype)), "TIFF"))
    assert abs(read_picture(file).mean() - 127.5 * 61_440 / 65_535) < 1.0


def test_eight_bits_in_the_room_of_sixteen_are_left_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.fromarray(NOISE[..., 0].astype(np.uint16))))
    assert np.array_equal(read_picture(file)[..., 0], NOISE[..., 0])


def test_floating_point_from_black_to_white_is_read(tmp_path: Path) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.fromarray(RAMP.astype(np.float32)), "TIFF"))
    assert np.abs(read_picture(file)[..., 0] - 255.0 * RAMP).max() <= 1.0


@pytest.mark.parametrize(
    "values", [np.float32(RAMP * 5.0), np.float32(RAMP - 0.5), np.float32(RAMP * np.nan), np.int32(RAMP * 1e9)]
)
def test_what_has_no_known_black_and_white_is_refused(tmp_path: Path, values: npt.NDArray[Any]) -> None:
    file = tmp_path / "picture"
    file.write_bytes(encoded(Picture.fromarray(values), "TIFF"))
    with pytest.raises(InputError, match=r"has (floating-point )?values from") as raised:
        read_picture(file)
    assert raised.value.file == file


def test_more_than_eight_bits_are_turned_upright_too(tmp_path: Path) -> None:
    file, turned = tmp_path / "picture", Picture.Exif()
    turned[0x0112] = 6
    file.write_bytes(encoded(Picture.fromarray(np.rint(RAMP * 65_535).astype(np.uint16)), exif=turned))
    assert read_picture(file).shape == (256, 4, 3)
