"""Probabilities over time: a recording that Rerun plays, and a picture."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture
from rerun.chunk import RrdReader

from executive.errors import InputError
from executive.trace.report.chart import ROWS, Chart
from executive.trace.viewer.video import TIME, Film
from executive.types import Image

GREY: Image = np.full((48, 64, 3), 128, np.uint8)
CURVES: list[dict[str, dict[str, float | None]]] = [
    {"on": {"on(a,b)": 0.9, "on(b,a)": 0.1}, "free": {"free()": 1.0}},
    {"on": {"on(a,b)": 0.2, "on(b,a)": None}, "free": {"free()": 0.0}},
]


def played(file: Path) -> tuple[Counter[str], list[float]]:
    """How many rows each entity has over time, and the probabilities that the file holds."""
    rows: Counter[str] = Counter()
    values: list[float] = []
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        if not chunk.is_static and TIME in batch.schema.names:
            rows[str(chunk.entity_path)] += batch.num_rows
        for name in batch.schema.names:
            if name.endswith(":scalars"):
                values += [float(cell) for row in batch.column(name).to_pylist() for cell in row or ()]
    return rows, values


def test_a_film_holds_every_picture_and_every_probability(tmp_path: Path) -> None:
    with Film(tmp_path / "film.rrd") as film:
        for number, curves in enumerate(CURVES):
            film.add(0.5 * number, {"clip.mp4": GREY}, curves)
    rows, values = played(film.file)
    assert {entity: count for entity, count in rows.items() if "picture" in entity} == {"/pictures/clip.mp4": 2}
    assert len([entity for entity in rows if entity.startswith("/probability/")]) == 3
    assert all(count == 2 for count in rows.values())
    assert sorted(value for value in values if not np.isnan(value)) == [0.0, 0.1, 0.2, 0.9, 1.0]
    assert sum(np.isnan(values)) == 1  # a gap where there was no answer


def test_rerun_itself_finds_nothing_wrong(tmp_path: Path) -> None:
    with Film(tmp_path / "film.rrd") as film:
        film.add(0.0, {"naïve 漢字 \x1b[2J": GREY}, {"own \N{ROBOT FACE}": {"Is it $x$?": 0.5}})
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(film.file)]
    check = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert check.returncode == 0, check.stderr


def test_what_was_added_before_an_error_is_in_the_file(tmp_path: Path) -> None:
    def interrupted() -> None:
        with Film(tmp_path / "film.rrd") as film:
            film.add(0.0, {"clip": GREY}, CURVES[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert played(tmp_path / "film.rrd")[0]["/pictures/clip"] == 1


def test_a_film_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        Film(tmp_path / "nowhere" / "film.rrd")


def drawn(chart: Chart, file: Path) -> Picture.Image:
    with Picture.open(chart.draw(file)) as picture:
        assert picture.format == "PNG"
        return picture.convert("RGB")


def test_a_chart_shows_what_changed(tmp_path: Path) -> None:
    still, moving = Chart(), Chart()
    for number in range(4):
        still.add(number, GREY, {"on": {"on(a,b)": 0.5}})
        moving.add(number, GREY, {"on": {"on(a,b)": number % 2}})
    one, other = drawn(still, tmp_path / "still.png"), drawn(moving, tmp_path / "moving.png")
    assert one.size == other.size
    assert not np.array_equal(np.asarray(one), np.asarray(other))


@pytest.mark.parametrize("count", [1, 2, 30])
def test_any_number_of_moments_can_be_drawn(tmp_path: Path, count: int) -> None:
    chart = Chart()
    for number in range(count):
        chart.add(0.5 * number, GREY, CURVES[number % 2])
    picture = drawn(chart, tmp_path / "chart.png")
    assert picture.width > 800
    colours = {colour for _, colour in picture.getcolors(1 << 24) or ()}
    assert (128, 128, 128) in colours  # what was seen


def test_names_and_gaps_of_any_kind_can_be_drawn(tmp_path: Path) -> None:
    chart = Chart()
    chart.add(0.0, GREY, {"own": {"Is it $\\frac$ or % or _^ and so on and on and on and on and on?": None}})
    chart.add(0.1, GREY[:, :2], {})
    drawn(chart, tmp_path / "chart.png")


def test_of_very_many_rows_those_that_change_are_drawn(tmp_path: Path) -> None:
    chart = Chart()
    for number in range(2):
        rows: dict[str, float | None] = {f"still({index})": 0.5 for index in range(500)}
        chart.add(number, GREY, {"g": {**rows, "moving()": float(number)}})
    assert ("g", "moving()") in chart._shown()
    assert len(chart._shown()) == ROWS
    assert drawn(chart, tmp_path / "chart.png").height < 3000


def test_a_chart_of_nothing_or_to_nowhere_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to draw"):
        Chart().draw(tmp_path / "chart.png")
    chart = Chart()
    chart.add(0.0, GREY, CURVES[0])
    with pytest.raises(InputError, match="cannot be written"):
        chart.draw(tmp_path / "nowhere" / "chart.png")
