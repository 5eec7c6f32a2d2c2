"""The gallery: what its page shows is there, is small, and plays."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from PIL import Image as Picture

from benchmarks.gallery.make import GALLERY, PANDA, PIECES
from tests.docs.following import DOCS

FILMS = [*(piece.name for piece in PIECES if piece.camera), PANDA]
RECORDINGS = [piece.name for piece in PIECES if piece.is_kept]


def test_it_holds_what_is_made_for_it_and_no_more_than_10_mb() -> None:
    made = {*(f"{name}.webp" for name in FILMS), *(f"{name}.rrd" for name in RECORDINGS), "index.md"}
    assert {file.name for file in GALLERY.iterdir()} == made
    assert sum(file.stat().st_size for file in GALLERY.iterdir()) < 10_000_000


def test_the_page_shows_all_of_it() -> None:
    page = (DOCS / "gallery" / "index.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(([\w-]+\.(?:webp|rrd))\)", page)) == {
        *(f"{name}.webp" for name in FILMS),
        *(f"{name}.rrd" for name in RECORDINGS),
    }


@pytest.mark.parametrize("name", FILMS)
def test_a_film_moves_and_is_short(name: str) -> None:
    with Picture.open(GALLERY / f"{name}.webp") as film:
        assert 320 <= film.width <= 480
        durations = []
        for frame in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(frame)
            film.load()
            durations.append(film.info["duration"])
    assert len(durations) > 50
    assert 5_000 < sum(durations) <= 25_000


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_is_one_of_a_run_that_reached_its_goal(name: str) -> None:
    from rerun.chunk import RrdReader

    (recording,) = RrdReader(str(GALLERY / f"{name}.rrd")).recordings()
    assert recording.application_id == "executive"
    assert recording.recording_id == name
    told = {}
    for chunk in RrdReader(str(GALLERY / f"{name}.rrd")).stream():
        batch = chunk.to_record_batch()
        for column in batch.schema.names:
            if column.endswith("outcome"):
                told[column] = batch.column(column).to_pylist()
    assert list(told.values()) == [[["goal-reached"]]]


def test_what_is_not_in_the_gallery_is_refused_by_name() -> None:
    command = [sys.executable, "-m", "benchmarks.gallery.make", "pancakes"]
    told = subprocess.run(command, cwd=DOCS.parent, capture_output=True, text=True, check=False)
    assert told.returncode == 2
    assert "'pancakes'" in told.stderr
