"""The viewer's file of a run, begun once the arm has moved: a person waits for that, and importing Rerun takes half a
second."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from executive.belief import Thresholds
from executive.errors import InputError
from executive.trace.viewer.process import TRACE_FILE
from executive.types import Dispatched, Event, Frame, SkillResult

if TYPE_CHECKING:
    from executive.trace.viewer.sink import RerunSink


def preload() -> Thread:
    """Begin to import what the viewer's sink needs, in a thread. What fails is raised where it is imported for use; the
    interpreter's end waits for it."""

    def load() -> None:
        with suppress(Exception):
            import executive.trace.viewer.sink  # noqa: F401 (loaded for those who import it later)

    thread = Thread(target=load, name="preload")
    thread.start()
    return thread


class LateSink:
    """Writes what happens into `trace.rrd`, as `RerunSink` does, from the arm's first motion on; what came before is
    kept until then.

    Args:
        run: the run's folder.
        thresholds: as those of `RerunSink`.

    Raises:
        InputError: there is such a file already, and it cannot be written.
    """

    def __init__(self, run: Path, thresholds: Mapping[str, Thresholds]) -> None:
        file = run / TRACE_FILE
        if file.is_dir() or (file.exists() and not os.access(file, os.W_OK)):
            raise InputError("cannot be written", file=file)
        self._run, self._thresholds = run, thresholds
        self._kept: list[Event] = []
        self._has_step = False
        self._loading: Thread | None = None
        self._sink: RerunSink | None = None

    def write(self, event: Event) -> None:
        if self._sink is not None:
            self._sink.write(event)
            return
        self._kept.append(event)
        if self._loading is None:
            self._has_step = self._has_step or isinstance(event.payload, Dispatched)
            if self._has_step and isinstance(event.payload, Frame | SkillResult):
                self._loading = preload()
        elif not self._loading.is_alive() and not isinstance(event.payload, Frame):  # no motion is held up
            self._open()

    def recall(self, event: Event) -> None:
        """Take in what an earlier process of this run recorded."""
        self.write(event)

    def close(self) -> None:
        if self._sink is None and self._kept:
            self._open()
        if self._sink is not None:
            self._sink.close()

    def _open(self) -> None:
        from executive.trace.viewer.sink import RerunSink

        self._sink = RerunSink(self._run, thresholds=self._thresholds)
        for event in self._kept:
            self._sink.write(event)
        self._kept.clear()
