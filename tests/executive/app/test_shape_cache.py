"""Distance fields are computed once for a shape, and read where they are there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from executive.app.shape_cache import with_field
from tests.executive.perception.room import box


def test_the_second_time_it_is_read(tmp_path: Path) -> None:
    made = with_field(box("box", (0.04, 0.05, 0.06)), tmp_path)
    (file,) = tmp_path.glob("*.npz")
    told = np.load(file)["field"]
    told[0, 0, 0, 0] = 7.0
    np.savez(file, field=told)
    assert with_field(box("other name", (0.04, 0.05, 0.06)), tmp_path).field[0, 0, 0, 0] == 7.0
    assert made.field[0, 0, 0, 0] != 7.0
    with_field(box("box", (0.04, 0.05, 0.07)), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_what_is_damaged_is_computed_anew(tmp_path: Path) -> None:
    right = with_field(box("box", (0.04, 0.05, 0.06)), tmp_path).field
    (file,) = tmp_path.glob("*.npz")
    for damage in (b"", b"no array", file.read_bytes()[:-40]):
        file.write_bytes(damage)
        assert np.array_equal(with_field(box("box", (0.04, 0.05, 0.06)), tmp_path).field, right)
    np.savez(file, another=right)
    assert np.array_equal(with_field(box("box", (0.04, 0.05, 0.06)), tmp_path).field, right)
    np.savez(file, field=np.full_like(right, np.nan))
    assert np.array_equal(with_field(box("box", (0.04, 0.05, 0.06)), tmp_path).field, right)


def test_without_a_place_to_keep_it_it_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert with_field(box("box", (0.04, 0.05, 0.06)), tmp_path / "file").field.shape[-1] == 4
