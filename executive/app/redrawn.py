"""Pictures of a run's moments, drawn anew by the simulator that it was in: a run has pictures of its looks alone."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from executive.app.config import CONFIG, MUJOCO, read_config
from executive.app.resume import PastRun
from executive.app.worlds import make_setting
from executive.domain.loader import load_domain
from executive.errors import InputError, nearest
from executive.trace.record.recording import Recording
from executive.types import Frame, Image

if TYPE_CHECKING:
    from executive.sim.world import MujocoWorld


class Redrawn:
    """The world of a run, as its cameras would see it without sensor noise. A context manager that frees it.

    Args:
        cameras: by name; without any, all that the scene has.

    Raises:
        InputError: the run was not in the simulator, its domain is gone or has changed, or there is no such camera.
        MissingError: the machine lacks what the simulator needs.
    """

    def __init__(self, recording: Recording, cameras: Sequence[str] = ()) -> None:
        config = read_config(recording.folder)
        if config.world != MUJOCO:
            raise InputError(
                "pictures are drawn by the simulator, and this run was not in it", file=recording.folder / CONFIG
            )
        self.domain = load_domain(config.domain, config.problem)
        PastRun.of(recording.folder).check(self.domain.task)
        self.world: MujocoWorld = make_setting(self.domain, config).open(0).world
        there = [camera.name for camera in self.world.spec.cameras]
        if unknown := [camera for camera in cameras if camera not in there]:
            self.world.close()
            raise InputError(f"the scene has no such camera; {nearest(unknown[0], there)}", key=unknown[0])
        self.cameras = tuple(cameras) or tuple(there)

    def __enter__(self) -> Redrawn:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.world.close()

    def show(self, frame: Frame) -> dict[str, Image]:
        """Return each camera's picture of a moment, (H, W, 3) uint8."""
        self.world.show(frame)
        return {camera: self.world.render(camera) for camera in self.cameras}
