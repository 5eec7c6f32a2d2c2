"""What a skill did, as another could learn it: ten times a second what the robot sensed and what it was told.

Where an item is, is what the skill was answered when it asked, with the error of that answer, and not the truth. `qpos`
alone is the simulator's: pictures are drawn from it, and nothing is to be learned from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from executive.types import Atom, FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

COLUMN, LOCATED = "demonstration", "located"


class Sample(NamedTuple):
    """One moment of a demonstration.

    `time` in s; `joints` (6,) in rad and `gripper`, its opening in m, as measured; `hand` (7,) the pose of the grip
    point in the world's frame that follows from the joints: m, then quaternion w, x, y, z; `command` (7,) what the
    servos are told: rad, and last how far the fingers shall close, 0 to 1; `phase` of the skill; `qpos` (nq,).
    """

    time: float
    joints: FloatArray
    gripper: float
    hand: FloatArray
    command: FloatArray
    phase: str
    qpos: FloatArray


class Located(NamedTuple):
    """An answer to the question where an item is: the moment in s, its `pose` (7,), and the `centre` and the `half`
    size, (3,) in m each, of its bounding box in its own frame."""

    time: float
    item: str
    pose: FloatArray
    centre: FloatArray
    half: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """A completed action: `episode` and `step` say which, `action` is the step as text, and `surprises` the atoms whose
    truth is in the end not what its effects alone would have made it."""

    episode: int
    step: int
    action: str
    surprises: tuple[str, ...]
    samples: tuple[Sample, ...]
    located: tuple[Located, ...]

    @property
    def name(self) -> str:
        """The action's, without its arguments."""
        return Atom.parse(self.action).predicate

    @property
    def args(self) -> tuple[str, ...]:
        """The action's arguments."""
        return Atom.parse(self.action).args


def column(samples: Sequence[Sample], located: Sequence[Located]) -> Mapping[str, Any]:
    """The columns of a demonstration, for one row."""
    return {
        COLUMN: [
            {
                "time": each.time,
                "joints": each.joints.tolist(),
                "gripper": each.gripper,
                "hand": each.hand.tolist(),
                "command": each.command.tolist(),
                "phase": each.phase,
                "qpos": each.qpos.tolist(),
            }
            for each in samples
        ],
        LOCATED: [
            {
                "time": each.time,
                "item": each.item,
                "pose": each.pose.tolist(),
                "centre": each.centre.tolist(),
                "half": each.half.tolist(),
            }
            for each in located
        ],
    }


def schema() -> list[tuple[str, pa.DataType]]:
    """The columns' types."""
    import pyarrow as pa

    numbers = pa.list_(pa.float32())
    sample = {"time": pa.float64(), "joints": numbers, "gripper": pa.float32(), "hand": numbers, "command": numbers}
    sample |= {"phase": pa.string(), "qpos": pa.list_(pa.float64())}
    answer = {"time": pa.float64(), "item": pa.string(), "pose": numbers, "centre": numbers, "half": numbers}
    return [(name, pa.list_(pa.struct(list(each.items())))) for name, each in ((COLUMN, sample), (LOCATED, answer))]


def features() -> dict[str, Any]:
    """What the columns are to the package `datasets`."""

    def value(dtype: str) -> dict[str, str]:
        return {"dtype": dtype, "_type": "Value"}

    numbers, doubles = ({"feature": value(kind), "_type": "Sequence"} for kind in ("float32", "float64"))
    sample = {"time": value("float64"), "joints": numbers, "gripper": value("float32"), "hand": numbers}
    sample |= {"command": numbers, "phase": value("string"), "qpos": doubles}
    answer = {"time": value("float64"), "item": value("string"), "pose": numbers, "centre": numbers, "half": numbers}
    return {COLUMN: [sample], LOCATED: [answer]}


def parsed(episode: int, row: Mapping[str, Any]) -> Demonstration:
    """The demonstration of a row that has one."""
    samples = tuple(
        Sample(
            each["time"],
            np.array(each["joints"]),
            each["gripper"],
            np.array(each["hand"]),
            np.array(each["command"]),
            each["phase"],
            np.array(each["qpos"]),
        )
        for each in row[COLUMN]
    )
    located = tuple(
        Located(each["time"], each["item"], *(np.array(each[name]) for name in ("pose", "centre", "half")))
        for each in row[LOCATED]
    )
    return Demonstration(episode, row["step"], row["action"], tuple(row["surprises"]), samples, located)
