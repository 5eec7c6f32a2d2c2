"""The demonstrations of a collection as episodes to learn from: an action each."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from executive.domain.loader import Domain, load_domain
from executive.errors import InputError, nearest
from executive.export.episodes import Drawn, Feature, Row
from executive.lab.collection import dataset
from executive.lab.collection.demonstrations import Demonstration
from executive.types import FloatArray, Image


@dataclass(frozen=True)
class DemonstratedEpisode:
    """One demonstrated action, `fps` rows a second. `domain` is the collection's, and `folder` where it is."""

    folder: Path
    domain: Domain
    demonstration: Demonstration
    fps: int

    @property
    def name(self) -> str:
        return str(self.folder)

    @property
    def task(self) -> str:
        return self.demonstration.action

    @property
    def success(self) -> bool:
        """Whether, by the truth, the action's effects came about, and nothing else."""
        return not self.demonstration.surprises

    @property
    def joint_names(self) -> tuple[str, ...]:
        from executive.sim.scene import JOINTS

        return (*JOINTS, "gripper")

    @property
    def features(self) -> Mapping[str, Feature]:
        return {f"skill.{name}": Feature("string") for name in ("action", "phase", "surprises")}

    def __len__(self) -> int:
        samples = self.demonstration.samples
        return max(1, int((samples[-1].time - samples[0].time) * self.fps) + 1)

    def rows(self) -> Iterator[Row]:
        """Yield the rows in order of time, which begins at 0."""
        samples, at = self.demonstration.samples, 0
        for number in range(len(self)):
            time = number / self.fps
            while at + 1 < len(samples) and samples[at + 1].time - samples[0].time <= time + 1e-9:
                at += 1
            now = samples[at]
            more = {
                "skill.action": self.demonstration.action,
                "skill.phase": now.phase,
                "skill.surprises": " ".join(self.demonstration.surprises),
            }
            yield Row(time, now.qpos, np.append(now.joints, now.gripper), now.command, more)

    def about(self) -> Mapping[str, str]:
        """What there is to say of the whole episode, in short texts."""
        shown = self.demonstration
        told = {"run": f"{shown.episode}-{shown.step}", "domain": self.domain.name, "problem": self.domain.task.problem}
        return {**told, "seed": str(dataset.read_manifest(self.folder)["collection"]["seed"])}

    def draw(self, cameras: Sequence[str]) -> AbstractContextManager[Drawn]:
        return _Scene(self.domain, cameras)


class _Scene:
    """The scene of a collection, as its cameras would see it without sensor noise."""

    def __init__(self, domain: Domain, cameras: Sequence[str]) -> None:
        from executive.sim.world import MujocoWorld

        self._world = MujocoWorld(domain.scene, domain.task.objects)
        there = [camera.name for camera in self._world.spec.cameras]
        if unknown := [camera for camera in cameras if camera not in there]:
            self._world.close()
            raise InputError(f"the scene has no such camera; {nearest(unknown[0], there)}", key=unknown[0])
        self._cameras = tuple(cameras) or tuple(there)

    def __enter__(self) -> _Scene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._world.close()

    def show(self, qpos: FloatArray) -> dict[str, Image]:
        self._world.data.qpos[:] = qpos
        return {camera: self._world.render(camera) for camera in self._cameras}


def demonstrated_episodes(folder: Path, fps: int) -> list[DemonstratedEpisode]:
    """Return the demonstrations of a finished collection, in order.

    Raises:
        InputError: it has none, its episodes have objects of their own, or its domain is gone or has changed.
    """
    manifest = dataset.read_manifest(folder)
    if manifest["collection"].get("objects"):
        raise InputError("has other objects in each episode, and a data set has one scene", file=folder)
    words: list[Any] = shlex.split(manifest["command"])
    problem = words[words.index("--problem") + 1] if "--problem" in words else None
    domain = load_domain(words[2], problem)
    if domain.fingerprint() != manifest["collection"]["files"]:
        raise InputError(f"was collected in {words[2]} as it was before its files changed", file=folder)
    return [DemonstratedEpisode(folder, domain, each, fps) for each in dataset.read_demonstrations(folder)]
