"""What a run's folder has for exporting it: its events in order of the world's time, its pictures and its movements."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote

from executive.errors import InputError
from executive.trace.record.frames import Movements, read_movements
from executive.trace.record.log import DEPTH_FOLDER, IMAGES_FOLDER, read_events
from executive.types import Ended, Event, Questions, Resumed, Started

_LOOK = re.compile(r"(\d{4,9})-(.+)\.(?:jpg|png)")


@dataclass(frozen=True)
class Recording:
    """A run that has begun, and may have ended. `folder` is its folder.

    Raises:
        InputError: it has no record, or none of a run that began.
    """

    folder: Path

    def __post_init__(self) -> None:
        if not self.events or not isinstance(self.events[0].payload, Started):
            raise InputError("the record has no beginning: nothing was done in this run", file=self.folder)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Return the events in order of the world's time. What an earlier process did after the moment that the run was
        resumed from happened in a world that was set back, and is left out."""
        kept: list[Event] = []
        for event in read_events(self.folder, images=False):
            if isinstance(event.payload, Resumed):
                first = [each for each in kept if isinstance(each.payload, Started | Questions)]
                kept = [each for each in kept if each.time <= event.time or each in first]
            kept.append(event)
        return tuple(kept)

    @cached_property
    def movements(self) -> Movements:
        """Return how things moved; nothing, where that was not recorded."""
        return read_movements(self.folder)

    @property
    def started(self) -> Started:
        """Return the first event."""
        first = self.events[0].payload
        assert isinstance(first, Started)
        return first

    @property
    def ended(self) -> Ended | None:
        """Return the last event, of a run that has ended."""
        last = self.events[-1].payload
        return last if isinstance(last, Ended) else None

    def pictures(self, look: int) -> Iterator[tuple[str, Path]]:
        """Yield the cameras of a look, with their JPEG files."""
        yield from self._pictures.get(look, {}).items()

    def depth_pictures(self, look: int) -> Iterator[tuple[str, Path]]:
        """Yield the cameras of a look that measured depth, with their PNG files."""
        yield from self._depth.get(look, {}).items()

    @cached_property
    def _pictures(self) -> dict[int, dict[str, Path]]:
        return _by_look(self.folder / IMAGES_FOLDER)

    @cached_property
    def _depth(self) -> dict[int, dict[str, Path]]:
        return _by_look(self.folder / DEPTH_FOLDER)


def _by_look(folder: Path) -> dict[int, dict[str, Path]]:
    found: dict[int, dict[str, Path]] = {}
    for path in sorted(folder.glob("*")):
        if (match := _LOOK.fullmatch(path.name)) and path.is_file() and not path.is_symlink():
            found.setdefault(int(match[1]), {})[unquote(match[2])] = path
    return found
