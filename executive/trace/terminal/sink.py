"""The run as it happens, in a terminal: a calm live view that fits 80x24 and leaves the story behind when it closes;
elsewhere (a pipe, a log, NO_COLOR) plain lines, one for each thing worth telling."""

from __future__ import annotations

import atexit
import time
from typing import TextIO

from rich.console import Group
from rich.live import Live
from rich.text import Text

from executive.trace.story.story import Story
from executive.trace.terminal.console import console_for, is_live
from executive.trace.terminal.view import dashboard, event_line, story_lines
from executive.types import Decision, DecisionKind, Dispatched, Event, FaultInjected, Phase, Plan, Resumed, Started

_REFRESH = 0.1
"""Wall seconds between two pictures of the live view, unless something happens that a person waits for."""
_AT_ONCE = (Started, Resumed, Plan, Dispatched, Phase, FaultInjected)


class TerminalSink:
    """Tells people of a run on `stream`, as it happens, for as long as the stream takes it: a pipe may be closed."""

    def __init__(self, stream: TextIO) -> None:
        self._console = console_for(stream)
        self._story = Story()
        self._live: Live | None = None
        self._wanted = is_live(self._console)
        self._drawn = 0.0
        self._unread = False

    def write(self, event: Event) -> None:
        self._story.tell(event)
        if not self._unread:
            try:
                self._show(event)
            except OSError:
                self._unread = True

    def recall(self, event: Event) -> None:
        """Take in what an earlier process of this run told."""
        self._story.tell(event)

    def _show(self, event: Event) -> None:
        if not self._wanted:
            if line := event_line(event, self._story):
                self._console.print(line, soft_wrap=True)
        elif self._live is None:
            self._open()
        elif self._urgent(event) or time.monotonic() - self._drawn > _REFRESH:
            self._draw(self._live)

    def close(self) -> None:
        """Take the live view away and leave the story in its place."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()
            atexit.unregister(live.stop)
            self._console.print(Group(*story_lines(self._story, self._console.width)))

    def _open(self) -> None:
        # No thread draws it: it changes only when an event comes. Should the process end without `close`, the cursor
        # comes back all the same.
        self._live = Live(Text(""), console=self._console, auto_refresh=False, transient=True, vertical_overflow="crop")
        atexit.register(self._live.stop)
        self._live.start()
        self._draw(self._live)

    def _draw(self, live: Live) -> None:
        width, height = self._console.size
        live.update(Group(*dashboard(self._story, width, height - 1)), refresh=True)
        self._drawn = time.monotonic()

    @staticmethod
    def _urgent(event: Event) -> bool:
        payload = event.payload
        if isinstance(payload, Decision):
            return payload.kind is not DecisionKind.CONTINUE
        return isinstance(payload, _AT_ONCE)
