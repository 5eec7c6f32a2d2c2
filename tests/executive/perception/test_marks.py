"""Tags in pictures: what is on them, and what they are drawn beside."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.perception import marks
from executive.types import Camera, FloatArray, Image

# Looks along +x from the origin, with z up.
CAMERA = Camera("front", (0.0, 0.0, 0.0, 0.5, 0.5, -0.5, -0.5), 0.5 * pi, 64, 48)
AHEAD: FloatArray = np.array([1.0, 0.0, 0.0])
GREY: Image = np.full((96, 128, 3), 100, np.uint8)


def changed(place: FloatArray, millimetres: int | None = None) -> np.ndarray:
    depth = None if millimetres is None else np.full((48, 64), millimetres, np.uint16)
    picture = marks.drawn(GREY, CAMERA, depth, {"A": place})
    assert picture.shape == GREY.shape
    assert picture.dtype == np.uint8
    return np.argwhere((picture != GREY).any(axis=2))


def test_a_tag_stands_above_its_thing_and_a_line_leads_there() -> None:
    rows, columns = changed(AHEAD).T
    assert rows.max() == pytest.approx(48, abs=1)  # the middle of the picture, where the thing is
    assert rows.min() < 30
    assert columns.mean() == pytest.approx(64, abs=2)


@pytest.mark.parametrize(
    ("place", "millimetres"), [((-1.0, 0.0, 0.0), None), ((1.0, 3.0, 0.0), None), ((1.0, 0.0, 0.0), 600)]
)
def test_what_is_behind_the_camera_beside_the_picture_or_hidden_has_no_tag(
    place: tuple[float, ...], millimetres: int | None
) -> None:
    assert not len(changed(np.array(place), millimetres))


@pytest.mark.parametrize("millimetres", [0, 960, 1000])
def test_what_is_measured_at_a_thing_or_not_at_all_hides_it_not(millimetres: int) -> None:
    assert len(changed(AHEAD, millimetres))


@pytest.mark.parametrize("place", [(1.0, 0.0, 0.74), (1.0, 0.99, 0.0), (1.0, -0.99, -0.74)])
def test_at_the_edge_the_whole_tag_is_in_the_picture(place: tuple[float, ...]) -> None:
    count = len(changed(AHEAD))
    assert len(changed(np.array(place))) == pytest.approx(count, rel=0.35)


@given(st.lists(st.lists(st.sampled_from("abc"), min_size=1, max_size=4), min_size=2, max_size=4, unique_by=tuple))
def test_tags_tell_things_apart_and_end_what_they_are_called(words: list[list[str]]) -> None:
    called = {str(index): " ".join(each) for index, each in enumerate(words)}
    tags = marks.tags(called)
    assert len(set(tags.values())) == len(called)
    for name, tag in tags.items():
        assert tag
        assert called[name].endswith(tag)


def test_words_that_all_share_are_on_no_tag() -> None:
    assert marks.tags({"x": "the red can A", "y": "the red can B"}) == {"x": "A", "y": "B"}
