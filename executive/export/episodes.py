"""A run as an episode to learn from: rows at a fixed rate, each with what was sensed, commanded, believed and done."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from executive.app.redrawn import Redrawn
from executive.errors import InputError
from executive.trace.record.frames import FRAMES_FILE
from executive.trace.record.recording import Recording
from executive.trace.report.summary import SUMMARY_FILE
from executive.types import Atom, Belief, Decision, Dispatched, FloatArray, Image, Judged, SkillResult
from executive.util.files import read_json


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One moment of an episode: `time` in s of the world's clock. `state` and `action` are (dof + 1,): positions of the
    joints in rad and the gripper's opening in m; what the servos are told in rad, and how far the fingers shall close,
    0 to 1. `moment` is what its picture is drawn from, and `more` what else is known of it, by feature."""

    time: float
    moment: Any
    state: FloatArray
    action: FloatArray
    more: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature that some episodes have: the type of its numbers, and their names where there are several."""

    kind: str
    names: tuple[str, ...] = ()


class Drawn(Protocol):
    """Draws pictures of an episode's moments."""

    def show(self, moment: Any) -> Mapping[str, Image]:
        """Return each camera's picture, (H, W, 3) uint8."""
        ...


class Source(Protocol):
    """What can be an episode of a data set: a run, or a demonstrated action."""

    @property
    def fps(self) -> int: ...
    @property
    def name(self) -> str:
        """Where it comes from, for messages."""
        ...

    @property
    def task(self) -> str:
        """What the robot was to do, in words."""
        ...

    @property
    def success(self) -> bool: ...
    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the numbers in `Row.state` and `Row.action`."""
        ...

    @property
    def features(self) -> Mapping[str, Feature]:
        """What `Row.more` has."""
        ...

    def __len__(self) -> int: ...
    def rows(self) -> Iterator[Row]: ...
    def about(self) -> Mapping[str, str]: ...
    def draw(self, cameras: Sequence[str]) -> AbstractContextManager[Drawn]:
        """Open what draws its moments.

        Raises:
            InputError: there is no such camera, or it cannot be drawn.
        """
        ...


@dataclass(slots=True)
class _Told:
    """What the events up to a moment say."""

    probability: Mapping[Atom, float]
    cycle: int = 0
    step: str = ""
    decision: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Episode:
    """A run, `fps` rows a second.

    Raises:
        InputError: the record does not say how the arm moved, or what it was told.
    """

    recording: Recording
    fps: int

    def __post_init__(self) -> None:
        moments = self.recording.movements.moments
        if not moments or moments[0].frame.command is None:
            why = (
                "does not say how the arm moved and what it was told; run it again with this version, in the simulator"
            )
            raise InputError(why, file=self.recording.folder / FRAMES_FILE)

    @property
    def name(self) -> str:
        return str(self.recording.folder)

    @property
    def task(self) -> str:
        return str(self.recording.started.task.goal)

    def draw(self, cameras: Sequence[str]) -> AbstractContextManager[Drawn]:
        return Redrawn(self.recording, cameras)

    @property
    def features(self) -> Mapping[str, Feature]:
        return {
            "loop.atoms": Feature("float32", tuple(map(str, self.atoms))),
            "loop.cycle": Feature("int64"),
            **{f"loop.{name}": Feature("string") for name in ("step", "decision", "reason")},
        }

    @property
    def atoms(self) -> tuple[Atom, ...]:
        """Return the atoms whose probability each row has."""
        return self.recording.started.task.atoms

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the numbers in `state` and `action`."""
        count = len(self.recording.movements.moments[0].frame.joints)
        names = self.recording.movements.joint_names
        return (*(names if len(names) == count else (f"joint_{n}" for n in range(1, count + 1))), "gripper")

    @cached_property
    def success(self) -> bool:
        """Return whether the goal was reached: by the truth, where the run was scored, else as it was seen."""
        file = self.recording.folder / SUMMARY_FILE
        scored = read_json(file) if file.is_file() else None
        true = scored.get("goal_true") if isinstance(scored, dict) else None
        ended = self.recording.ended
        return true if isinstance(true, bool) else ended is not None and ended.goal_seen

    def __len__(self) -> int:
        return max(1, int(self.recording.events[-1].time * self.fps) + 1)

    def rows(self) -> Iterator[Row]:
        """Yield the rows in order of time."""
        moments = self.recording.movements.moments
        times = [moment.time for moment in moments]
        events, at, told = self.recording.events, 0, _Told({})
        for number in range(len(self)):
            time = number / self.fps
            while at < len(events) and events[at].time <= time + 1e-9:
                self._tell(told, events[at].payload)
                told.cycle = max(told.cycle, events[at].cycle)
                at += 1
            frame = moments[max(0, bisect_right(times, time) - 1)].frame
            assert frame.command is not None
            yield Row(
                time,
                frame,
                np.append(frame.joints, frame.gripper),
                frame.command,
                {
                    "loop.atoms": np.array([told.probability.get(atom, 0.5) for atom in self.atoms], np.float32),
                    "loop.cycle": told.cycle,
                    "loop.step": told.step,
                    "loop.decision": told.decision,
                    "loop.reason": told.reason,
                },
            )

    @staticmethod
    def _tell(told: _Told, payload: object) -> None:
        match payload:
            case Judged() | Belief(source="assumed"):
                told.probability = payload.probability
            case Dispatched():
                told.step = str(payload.step)
            case SkillResult():
                told.step = ""
            case Decision():
                told.decision, told.reason = payload.kind.value, payload.code.value

    def about(self) -> dict[str, str]:
        """What there is to say of the whole episode, in short texts."""
        started, ended = self.recording.started, self.recording.ended
        return {
            "run": started.run,
            "domain": started.domain,
            "problem": started.task.problem,
            "seed": str(started.seed),
            "estimator": started.estimator,
            "outcome": "" if ended is None else ended.outcome.value,
            "success": json.dumps(self.success),
        }
