"""Estimates of films are scored as they deserve, and memory is worth something where mistakes do not last."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.evaluation.metrics import BoolArray
from executive.lab.evaluation.posterior import open_single_look
from executive.lab.evaluation.published import read
from executive.lab.film.frames import Frames
from executive.lab.film.memory import FilmMemory
from executive.lab.film.scoring import memory_table, scored, tabled
from executive.lab.film.watch import Watched, watch
from executive.types import Atom, Belief, Image, Observation

DOMAIN = load_domain("tabletop", "one-item")
ATOMS = DOMAIN.task.atoms
FPS = 10
PICTURE = np.zeros((4, 4, 3), dtype=np.uint8)


class Scripted:
    """Says the truth, surely, but for the answers that are wrong."""

    name = "scripted"

    def __init__(self, frames: Frames, wrong: BoolArray, sure: float = 0.9) -> None:
        self._frames, self._wrong, self._sure = frames, wrong, sure

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        row = self._frames.at(observation.time)
        so = self._frames.truth[row] != self._wrong[row]
        said = {atom: self._sure if value else 1.0 - self._sure for atom, value in zip(atoms, so, strict=True)}
        return Belief(observation.id, said, source=self.name)


def a_run() -> Frames:
    """The truth of a run that carries the spray bottle from one section to the other, 15 s long."""
    rows = []
    for second in np.arange(0, 15, 1 / FPS):
        true = {"in-table-section(green-mug,white)", "in-table-section(water-bottle,white)"}
        true |= {"in-table-section(soda-can,white)"}
        if second < 5:
            true |= {"in-table-section(spray-bottle,blue)", "robot-gripper-empty()"}
        elif second < 10:
            true |= {"robot-gripping(spray-bottle)"}
        else:
            true |= {"in-table-section(spray-bottle,white)", "robot-gripper-empty()"}
        rows.append([str(atom) in true for atom in ATOMS])
    times = np.arange(len(rows)) / FPS
    mid = np.array([time % 5 < 1 for time in times])
    nothing = ("",) * len(rows)
    return Frames(ATOMS, times, np.array(rows), mid, nothing, nothing, times)


FRAMES = a_run()


def pictures() -> list[tuple[float, Image]]:
    return [(float(time), PICTURE) for time in FRAMES.times]


def watched(wrong: BoolArray, memory: bool = True, sure: float = 0.9) -> Watched:
    kept = FilmMemory(open_single_look(DOMAIN, None)) if memory else None
    seen = watch(Scripted(FRAMES, wrong, sure), FRAMES, "front", pictures(), kept)
    return Watched.of("film", FRAMES, [(s.time, s.row, s.probability, s.remembered, s.seconds) for s in seen])


def test_who_says_the_truth_is_right_everywhere() -> None:
    document = scored([watched(np.zeros_like(FRAMES.truth))])
    for parts in (document, document["with_memory"]):
        assert {name: parts[name]["looks"] for name in ("frames", "mid_poses", "during_actions")} == {
            "frames": 150, "mid_poses": 30, "during_actions": 120,
        }  # fmt: skip
    for name in ("frames", "mid_poses", "during_actions"):
        assert document[name]["ap_micro"] == document[name]["ap_macro"] == document[name]["exact_state"] == 1.0
    # With memory, the frame after a change may still be doubted.
    assert document["with_memory"]["mid_poses"]["exact_state"] > 0.95


def test_mid_poses_and_the_rest_are_counted_apart() -> None:
    wrong = np.zeros_like(FRAMES.truth)
    wrong[~FRAMES.mid_pose, 0] = True
    document = scored([watched(wrong, memory=False)])
    assert document["with_memory"] is None
    assert document["mid_poses"]["exact_state"] == 1.0
    assert document["during_actions"]["exact_state"] == 0.0
    assert document["frames"]["exact_state"] == pytest.approx(0.2)
    assert document["frames"]["accuracy_0.5"] == pytest.approx(1 - 0.8 / len(ATOMS))


@pytest.mark.parametrize("seed", range(3))
def test_mistakes_of_single_frames_are_remembered_away(seed: int) -> None:
    wrong = np.random.default_rng(seed).random(FRAMES.truth.shape) < 0.08
    document = scored([watched(wrong)])
    for name in ("mid_poses", "during_actions"):
        alone, memory = document[name]["exact_state"], document["with_memory"][name]["exact_state"]
        assert alone < 0.5 < 0.75 < memory


def test_what_does_not_change_is_soon_known_and_a_change_is_noticed() -> None:
    wrong = np.zeros_like(FRAMES.truth)
    found = watched(wrong, sure=0.7)
    column = ATOMS.index(Atom.parse("robot-gripping(spray-bottle)"))
    remembered = found.remembered[:, column]
    assert remembered[45] < 0.1
    assert remembered[70] > 0.9
    assert remembered[-1] < 0.1
    assert (found.remembered[:, ATOMS.index(Atom.parse("in-table-section(soda-can,white)"))][10:] > 0.9).all()


def test_no_frame_is_scored_of_which_the_truth_says_nothing() -> None:
    late = [(100.0, PICTURE)]
    frames = Frames(
        ATOMS, FRAMES.times, FRAMES.truth, FRAMES.mid_pose, FRAMES.action, FRAMES.phase, FRAMES.times, end=15.0
    )
    with pytest.raises(InputError, match=r"says nothing of 100\.00 s"):
        list(watch(Scripted(FRAMES, np.zeros_like(FRAMES.truth)), frames, "front", late))


def test_films_of_other_atoms_are_not_scored_together() -> None:
    one = watched(np.zeros_like(FRAMES.truth), memory=False)
    other = Watched(
        "other", one.atoms[::-1], one.times, one.probability, one.remembered, one.truth, one.mid_pose, one.seconds
    )
    with pytest.raises(InputError, match="other has other atoms than film"):
        scored([one, other])


def test_the_papers_tables_have_our_rows_in_their_places() -> None:
    document = scored([watched(np.zeros_like(FRAMES.truth))])
    text = tabled(read(DOMAIN.files[0].parent), {"eye": document, "eye (no trans)": document})
    two, four = text[text.index("Table 2") : text.index("Table 4")], text[text.index("Table 4") :]
    names = [line.split("|")[1].strip() for line in two.splitlines() if line.startswith("| ")][2:]
    assert names == [
        "0.5B", "7B", "72B", "> eye", "0.5B Mid-poses", "7B Mid-poses", "72B Mid-poses", "> eye Mid-poses",
    ]  # fmt: skip
    row = next(line for line in two.splitlines() if line.startswith("| > eye Mid-poses"))
    assert [float(cell.strip(" *")) for cell in row.split("|")[2:-1]] == [1.0] * 5
    assert "0.5B (no trans) Mid-poses" in four
    assert four.count("> eye (no trans)") == 2
    assert memory_table({"eye": document}).count("with memory") == 3
