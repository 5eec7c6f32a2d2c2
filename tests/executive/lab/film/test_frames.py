"""The truth of a film's frames: written and read again, from intervals, or refused in one line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.lab.film.frames import Frames, read_truth, write_frames
from executive.types import Atom

IN_BLUE, EMPTY = Atom.parse("in-table-section(mug,blue)"), Atom.parse("robot-gripper-empty()")
ATOMS = (IN_BLUE, EMPTY)

CSV = """atom,from,to
in-table-section(mug,blue),0.0,3.2
In-Table-Section(mug,blue),7.5,
robot-gripper-empty(),0,3.2

"robot-gripper-empty()",7.0,9.0
mid-pose,0,1.0
mid-pose,8,
"""


def frames(count: int = 20) -> Frames:
    rng = np.random.default_rng(0)
    return Frames(
        ATOMS,
        np.arange(count) / 10,
        rng.random((count, 2)) > 0.5,
        rng.random(count) > 0.5,
        tuple("pick(mug,blue)" if number % 2 else "" for number in range(count)),
        tuple("grip" if number % 2 else "" for number in range(count)),
        np.arange(count) / 20,
    )


def test_what_is_written_is_read(tmp_path: Path) -> None:
    written = frames()
    write_frames(tmp_path / "frames.parquet", written)
    read = read_truth(tmp_path / "frames.parquet", ATOMS)
    assert read.atoms == ATOMS
    assert np.array_equal(read.truth, written.truth)
    assert np.array_equal(read.mid_pose, written.mid_pose)
    assert np.array_equal(read.times, written.times)
    assert (read.action, read.phase) == (written.action, written.phase)
    turned = read_truth(tmp_path / "frames.parquet", ATOMS[::-1])
    assert np.array_equal(turned.truth, written.truth[:, ::-1]), "in the order of the task's atoms"
    assert read.at(1.2345) == 12
    with pytest.raises(ValueError, match=r"3\.00 s"):
        read.at(3.0)


def test_intervals_say_what_is_true_when(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(CSV)
    truth = read_truth(file, ATOMS)

    def at(time: float) -> tuple[bool, bool, bool]:
        row = truth.at(time)
        return bool(truth.truth[row, 0]), bool(truth.truth[row, 1]), bool(truth.mid_pose[row])

    assert at(0.0) == (True, True, True)
    assert at(1.0) == (True, True, False)
    assert at(3.2) == (False, False, False)
    assert at(7.2) == (False, True, False)
    assert at(8.5) == (True, True, True)
    assert at(1000.0) == (True, False, True)
    assert math.isinf(truth.end)


@given(spans=st.lists(st.tuples(st.integers(0, 50), st.integers(1, 20)), max_size=8), at=st.integers(0, 80))
def test_an_atom_is_true_in_its_intervals_alone(
    spans: list[tuple[int, int]], at: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("csv") / "truth.csv"
    lines = [f"{IN_BLUE},{begin / 4},{(begin + length) / 4}" for begin, length in spans]
    file.write_text("\n".join(["atom,from,to", *lines]))
    truth = read_truth(file, ATOMS)
    row = truth.truth[truth.at(at / 4)]
    assert bool(row[0]) == any(begin <= at < begin + length for begin, length in spans)
    assert not row[1]


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("", "line 1", "atom,from,to"),
        ("time,atom\n", "line 1", "atom,from,to"),
        ("atom,from,to\nin-table-section(mug,bleu),0,1", "line 2", "in-table-section(mug,blue)"),
        ("atom,from,to\n\nrobot-gripper-empty(),0", "line 3", "with seconds"),
        ("atom,from,to\nrobot-gripper-empty(),zero,1", "line 2", "with seconds"),
        ("atom,from,to\nrobot-gripper-empty(),2,1", "line 2", "ends after that"),
        ("atom,from,to\nrobot-gripper-empty(),-1,1", "line 2", "begins at 0"),
        ("atom,from,to\nrobot-gripper-empty(),nan,1", "line 2", "begins at 0"),
        ("atom,from,to\nrobot gripper(,0,1", "line 2", "robot gripper"),
    ],
)
def test_a_mistake_in_a_table_is_named_with_its_line(tmp_path: Path, text: str, where: str, words: str) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(text)
    with pytest.raises(InputError) as told:
        read_truth(file, ATOMS)
    assert str(told.value).startswith(f"{file}: {where}: ")
    assert words in str(told.value)
    assert "\n" not in str(told.value)


def test_a_file_that_is_none_is_one_line(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = tmp_path / "frames.parquet"
    with pytest.raises(InputError, match=r"frames\.parquet"):
        read_truth(file, ATOMS)
    file.write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match="no Parquet file"):
        read_truth(file, ATOMS)
    write_frames(file, frames())
    with pytest.raises(InputError, match="has no column 'on-shelf"):
        read_truth(file, (Atom.parse("on-shelf(mug)"),))
    table = pq.read_table(file)
    index = table.column_names.index("mid_pose")
    pq.write_table(table.set_column(index, "mid_pose", pa.array(range(table.num_rows))), file)
    with pytest.raises(InputError, match="mid_pose is no column of true and false"):
        read_truth(file, ATOMS)
    pq.write_table(table.slice(0, 0), file)
    with pytest.raises(InputError, match="is damaged"):
        read_truth(file, ATOMS)
