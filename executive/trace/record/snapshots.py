"""The simulated world beside the events: one file a cycle in `snapshots/`, for a run that has to go on after its
process was killed.

A snapshot is taken before an event is recorded after which the world is not what it was: an action that begins or has
ended, the arm that was moved, a fault that struck. So no record ever tells of something that the last snapshot lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from executive.errors import InputError
from executive.protocols import Simulator
from executive.types import Dispatched, Event, FaultInjected, Moved, Resumed, SkillResult, Started
from executive.util.atomic_write import write_atomic

FOLDER = "snapshots"
SUFFIX = ".world"
_CHANGES = (Started, Resumed, Dispatched, FaultInjected, SkillResult, Moved)


class Snapshots:
    """A sink that keeps the world's latest state of each cycle in the run's folder. It comes before the sink that
    records.

    Args:
        failed: is told why a snapshot cannot be kept.

    Raises:
        InputError: the folder cannot be written to.
    """

    def __init__(self, run: Path | str, world: Simulator, failed: Callable[[str], None] | None = None) -> None:
        self._folder, self._world, self._failed = Path(run) / FOLDER, world, failed
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=self._folder) from None

    def write(self, event: Event) -> None:
        """Take a snapshot, if the world may have changed.

        Raises:
            OSError: the disk is full or gone.
        """
        if isinstance(event.payload, _CHANGES):
            file = self._folder / f"{event.cycle:04d}{SUFFIX}"
            try:
                # A kill takes nothing from what the system was given; a power cut may cost the latest one.
                write_atomic(file, self._world.snapshot(), durable=False)
            except OSError as error:
                if self._failed is not None:
                    self._failed(f"the world's state cannot be written: {error.strerror or error}")
                raise

    def close(self) -> None:
        """Nothing is open."""


def latest(run: Path | str) -> Iterator[tuple[int, bytes]]:
    """Yield the snapshots of a run, the latest first: the cycle, and what the world was then."""
    folder = Path(run) / FOLDER
    names = [path for path in folder.glob(f"[0-9]*{SUFFIX}") if path.stem.isdecimal() and path.is_file()]
    for path in sorted(names, key=lambda path: int(path.stem), reverse=True):
        try:
            yield int(path.stem), path.read_bytes()
        except OSError:
            continue
