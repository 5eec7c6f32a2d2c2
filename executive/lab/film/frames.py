"""What is true in each frame of a film: `frames.parquet` beside it, or a table of intervals for a film of one's own.

The Parquet file has a row a frame: `frame` from 0, its `time` in the film and `world_time`, in s; the `action` that is
carried out and its `phase`, "" where nothing is; whether it is a mid-pose (`mid_pose`: between actions, where the robot
looks and decides); and a column for each atom, named as it is printed, with its truth.

The table of intervals is a CSV file with the columns `atom`, `from` and `to` (s; an empty `to` is the end): an atom is
true in its intervals and false elsewhere. The word `mid-pose` in place of an atom says when the robot stands still.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from executive.errors import InputError, nearest
from executive.lab.evaluation.metrics import BoolArray
from executive.types import Atom, FloatArray
from executive.util.atomic_write import write_atomic
from executive.util.files import read_bytes

MID_POSE = "mid-pose"
"""What stands in place of an atom in a table of intervals where the robot is between two actions."""

_COLUMNS = ("frame", "time", "world_time", "action", "phase", "mid_pose")
_LARGEST = 1_000_000_000
_SLACK = 1e-6
"""s by which a frame may be early: time stamps are fractions."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """The truth over a film. Each row holds from its `times` on until the next one's.

    Attributes:
        times: s in the film, (N,), ascending.
        truth: (N, atoms).
        mid_pose: (N,).
        action, phase: what is carried out, "" for nothing.
        world_times: s of the world's clock, (N,).
        end: s in the film at which the last row's time is over; infinity where that is not known.
    """

    atoms: tuple[Atom, ...]
    times: FloatArray
    truth: BoolArray
    mid_pose: BoolArray
    action: tuple[str, ...]
    phase: tuple[str, ...]
    world_times: FloatArray
    end: float = math.inf

    def __post_init__(self) -> None:
        count = len(self.times)
        if not count or self.truth.shape != (count, len(self.atoms)) or {
            len(self.mid_pose), len(self.action), len(self.phase), len(self.world_times)
        } != {count}:  # fmt: skip
            raise ValueError("the columns of a film's frames are not of the same frames, or of none")
        if not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise ValueError("the times of a film's frames do not ascend")

    def at(self, time: float) -> int:
        """Return the row that holds at a `time` of the film, in s.

        Raises:
            ValueError: the film goes on after the truth has ended, or begins before it.
        """
        row = int(np.searchsorted(self.times, time + _SLACK, side="right")) - 1
        if row < 0 or time > self.end + _SLACK:
            raise ValueError(f"says nothing of {time:.2f} s into the film")
        return row

    def only(self, atoms: Collection[Atom]) -> Frames:
        """Return the truth of these atoms alone, in their own order."""
        kept = [index for index, atom in enumerate(self.atoms) if atom in atoms]
        return Frames(
            tuple(self.atoms[index] for index in kept), self.times, self.truth[:, kept], self.mid_pose, self.action,
            self.phase, self.world_times, self.end,
        )  # fmt: skip


def write_frames(file: Path, frames: Frames) -> None:
    """Write frames as Parquet, whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {
        "frame": pa.array(range(len(frames.times)), pa.int64()),
        "time": pa.array(frames.times),
        "world_time": pa.array(frames.world_times),
        "action": pa.array(list(frames.action), pa.string()),
        "phase": pa.array(list(frames.phase), pa.string()),
        "mid_pose": pa.array(frames.mid_pose),
        **{str(atom): pa.array(frames.truth[:, index]) for index, atom in enumerate(frames.atoms)},
    }
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer)
    write_atomic(file, buffer.getvalue())


def read_truth(file: Path, atoms: Sequence[Atom]) -> Frames:
    """Read the truth of a film: Parquet, or a CSV of intervals by its ending.

    Args:
        atoms: those of the task. A table of intervals is about all of them, and a Parquet file has to be.

    Raises:
        InputError: the file is missing, damaged, or about other atoms; file and line or column are named.
    """
    return _read_intervals(file, atoms) if file.suffix.lower() == ".csv" else _read_parquet(file, atoms)


def _read_parquet(file: Path, atoms: Sequence[Atom]) -> Frames:
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = read_bytes(file, largest=_LARGEST)
    try:
        table = pq.read_table(pa.BufferReader(content))
    except pa.ArrowException as error:
        raise InputError(f"is no Parquet file ({str(error).splitlines()[0]})", file=file) from None
    names = [*_COLUMNS, *map(str, atoms)]
    if missing := [name for name in names if name not in table.column_names]:
        raise InputError(f"has no column {missing[0]!r}; {nearest(missing[0], table.column_names)}", file=file)
    try:
        columns = {name: table.column(name).to_numpy() for name in names}
        times = columns["time"].astype(float)
        step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        truth = np.stack([_flags(columns[str(atom)], str(atom)) for atom in atoms], axis=1)
        return Frames(
            tuple(atoms),
            times,
            truth,
            _flags(columns["mid_pose"], "mid_pose"),
            tuple(map(str, columns["action"])),
            tuple(map(str, columns["phase"])),
            columns["world_time"].astype(float),
            end=float(times[-1]) + 2.0 * step,
        )
    except (ValueError, TypeError, IndexError, pa.ArrowException) as error:
        raise InputError(f"is damaged ({error})", file=file) from None


def _flags(column: npt.NDArray[Any], name: str) -> BoolArray:
    if column.dtype != np.bool_:
        raise ValueError(f"{name} is no column of true and false")
    return column


def _read_intervals(file: Path, atoms: Sequence[Atom]) -> Frames:
    known = {str(atom): atom for atom in atoms}
    spans: list[tuple[str, float, float]] = []
    try:
        rows = list(csv.reader(io.StringIO(read_bytes(file, largest=_LARGEST).decode("utf-8-sig"))))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"is no CSV file ({error})", file=file) from None
    if not rows or [cell.strip().lower() for cell in rows[0]] != ["atom", "from", "to"]:
        raise InputError("its first line has to be: atom,from,to", file=file, key="line 1")
    for number, row in enumerate(rows[1:], start=2):
        if row and "".join(row).strip():
            spans.append(_interval(row, known, file, f"line {number}"))
    edges = np.unique([0.0, *(edge for _, begin, end in spans for edge in (begin, end) if math.isfinite(edge))])
    truth = np.zeros((len(edges), len(atoms)), dtype=bool)
    mid_pose = np.zeros(len(edges), dtype=bool)
    columns = {str(atom): index for index, atom in enumerate(atoms)}
    for name, begin, end in spans:
        here = (edges >= begin) & (edges < end)
        if name == MID_POSE:
            mid_pose |= here
        else:
            truth[:, columns[name]] |= here
    nothing = ("",) * len(edges)
    return Frames(tuple(atoms), edges, truth, mid_pose, nothing, nothing, edges)


def _interval(row: Sequence[str], known: Collection[str], file: Path, line: str) -> tuple[str, float, float]:
    """Read one line: an atom, or the word for mid-poses, and the seconds from and to which it is so."""
    wrong = f"expected atom,from,to with seconds, such as robot-gripper-empty(),0.0,3.5; got {','.join(row)}"
    if len(row) < 3:
        raise InputError(wrong, file=file, key=line)
    *parts, begin, end = row  # commas within an atom are not between cells
    text = ",".join(parts).strip().lower()
    try:
        name = MID_POSE if text == MID_POSE else str(Atom.parse(text))
    except ValueError as error:
        raise InputError(str(error), file=file, key=line) from None
    if name != MID_POSE and name not in known:
        raise InputError(f"there is no atom {name}; {nearest(name, known)}", file=file, key=line)
    try:
        since, until = float(begin), float(end) if end.strip() else math.inf
    except ValueError:
        raise InputError(wrong, file=file, key=line) from None
    if not 0 <= since < until:
        why = f"an interval begins at 0 or later and ends after that, got {begin} to {end}"
        raise InputError(why, file=file, key=line)
    return name, since, until
