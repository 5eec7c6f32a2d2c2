"""A film of a run: as many frames as rows, whose truth is what the run did, from the world as from the record."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from executive import cli
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.film.config import FilmConfig
from executive.lab.film.filming import Filming
from executive.lab.film.frames import Frames, read_truth
from executive.lab.film.record import ABOUT, RUN, TRUTH, VIDEO, film_recording, films_in, read_about
from executive.s3e.video import read_frames
from executive.types import Atom
from tests.executive.cli.test_cli import one_error_line

ATOMS = load_domain("tabletop", "one-item").task.atoms
BLUE, WHITE, HELD, EMPTY = map(
    Atom.parse,
    (
        "in-table-section(spray-bottle,blue)", "in-table-section(spray-bottle,white)",
        "robot-gripping(spray-bottle)", "robot-gripper-empty()",
    ),
)  # fmt: skip


def column(frames: Frames, atom: Atom) -> list[bool]:
    return [bool(value) for value in frames.truth[:, frames.atoms.index(atom)]]


def test_every_frame_has_its_truth(film: Path) -> None:
    about, frames = read_about(film), read_truth(film / TRUTH, ATOMS)
    pictures = list(read_frames(film / VIDEO, 0.001))
    assert len(pictures) == len(frames.times) == about["frames"]
    assert [time for time, _ in pictures] == pytest.approx(frames.times)
    assert pictures[0][1].shape == (288, 384, 3)
    assert (about["domain"], about["problem"], about["seed"], about["mid_poses"]) == ("tabletop", "one-item", 1, 3)
    assert about["goal_true"] is True


def test_the_truth_is_what_the_run_did(film: Path) -> None:
    frames = read_truth(film / TRUTH, ATOMS)
    for atom, values in ((BLUE, [True, False]), (HELD, [False, True, False]), (WHITE, [False, True])):
        found = column(frames, atom)
        assert [value for value, last in zip(found, [None, *found], strict=False) if value is not last] == values
    empty, held = column(frames, EMPTY), column(frames, HELD)
    assert all(a is not b for a, b in zip(empty, held, strict=True))
    mid = [(column(frames, BLUE)[row], held[row]) for row in np.flatnonzero(frames.mid_pose)]
    assert list(dict.fromkeys(mid)) == [(True, False), (False, True), (False, False)]
    assert {action for action, mid in zip(frames.action, frames.mid_pose, strict=True) if not mid} == {
        "pick(spray-bottle,blue)", "place(spray-bottle,white)",
    }  # fmt: skip


def test_what_is_seen_moves_while_something_is_done_and_rests_between(film: Path) -> None:
    frames = read_truth(film / TRUTH, ATOMS)
    pictures = [image.astype(int) for _, image in read_frames(film / VIDEO, 0.001)]
    for row in range(1, len(pictures)):
        changed = float((np.abs(pictures[row] - pictures[row - 1]) > 40).mean())
        if frames.mid_pose[row] and frames.mid_pose[row - 1]:
            assert changed < 0.001
        elif frames.phase[row] == frames.phase[row - 1] == "transfer":
            assert changed > 0.001


def test_a_recorded_run_gives_the_same_film(film: Path, tmp_path: Path) -> None:
    config = FilmConfig("tabletop", tmp_path / "again", run=film / RUN, fps=5, pause=0.4)
    about = film_recording(film / RUN, config)
    assert about["frames"] == read_about(film)["frames"]
    one, other = (read_truth(folder / TRUTH, ATOMS) for folder in (film, tmp_path / "again"))
    assert (one.action, one.phase) == (other.action, other.phase)
    assert (one.truth != other.truth).mean() < 0.002, "poses of a record are rounded"
    for (_, live), (_, drawn) in zip(
        read_frames(film / VIDEO, 1.0), read_frames(tmp_path / "again" / VIDEO, 1.0), strict=True
    ):
        assert np.abs(live.astype(int) - drawn).mean() < 2.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--pause", "0.01"], "--pause: at 10 frames a second, that is none"),
        (["--films", "0"], "--films"),
        (["--problem", "none-such"], "none-such"),
        (["--fault", "drop@"], "drop@"),
    ],
)
def test_what_is_wrong_is_one_line(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.exit_code(["film", "tabletop", "--out", str(tmp_path / "film"), *arguments]) == 2
    assert words in one_error_line(capsys)
    assert not (tmp_path / "film").exists()


def test_a_recorded_run_is_filmed_as_it_was(film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, out = str(film / RUN), str(tmp_path / "film")
    assert cli.exit_code(["film", "tabletop", "--run", run, "--seed", "3", "--fault", "drop@1", "--out", out]) == 2
    assert "excludes --run" in one_error_line(capsys)
    assert cli.exit_code(["film", "grocery", "--run", run, "--out", out]) == 2
    assert "is of the domain 'tabletop', and not of 'grocery'" in one_error_line(capsys)
    assert cli.exit_code(["film", "tabletop", "--run", run, "--camera", "frnt", "--out", out]) == 2
    assert "front" in one_error_line(capsys)
    assert not (tmp_path / "film").exists()
    assert cli.exit_code(["film", "tabletop", "--run", run, "--out", str(film)]) == 2
    assert "is there already" in one_error_line(capsys)


def test_films_that_are_there_are_not_made_again_and_others_are_not_written_over(film: Path, tmp_path: Path) -> None:
    def filming(**options: object) -> Filming:
        return Filming(FilmConfig("tabletop", tmp_path, ("one-item",), fps=5, pause=0.4, films=1, **options))  # type: ignore[arg-type]

    shutil.copytree(film, tmp_path / "film-000")
    assert films_in(tmp_path) == [tmp_path / "film-000"]
    again = filming(seed=1)
    assert [take.folder for take in again.takes] == [tmp_path / "film-000"]
    with pytest.raises(InputError, match="seed is 1 and not 2"):
        filming(seed=2)
    with pytest.raises(InputError, match="faults"):
        filming(seed=1, faults=("drop@1",))
    about = json.loads((tmp_path / "film-000" / ABOUT).read_text())
    (tmp_path / "film-000" / ABOUT).write_text(json.dumps({**about, "fps": "five"}))
    with pytest.raises(InputError, match="does not say what was filmed"):
        filming(seed=1)
