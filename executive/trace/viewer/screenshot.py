"""A picture of a trace, drawn by the Rerun viewer without a screen."""

from __future__ import annotations

import io
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from executive.errors import InputError, nearest
from executive.trace.viewer.blueprint import CYCLE, SIM_TIME
from executive.trace.viewer.process import headless_viewer, named_in_text, trace_file

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

_STRIP = 36
"""Height in pixels of the viewer's own title bar."""
_ALIKE, _PICTURES, _PAUSE = 3, 30, 0.25
"""Panels fill over several frames after a jump, and the viewer greets with notifications: a picture counts when so many
in a row are alike. So many are taken at most, with a pause in wall seconds between them."""
_MOMENT = 1e-3
"""Seconds within which things happened at the same moment of the world's clock (see `executive.trace.viewer.sink`)."""
_TRIES = 4
_PATIENCE, _READING = 120.0, 15.0
"""Wall seconds that a file may take to be read, and what was read to be laid out."""


def screenshot(
    trace: Path | str,
    png: Path | str,
    at_cycle: int | None = None,
    at_time: float | None = None,
    size: tuple[int, int] = (1600, 1000),
    panel: str | None = None,
) -> list[str]:
    """Draw a trace into a PNG file.

    Args:
        trace: a run's folder, or its `trace.rrd`.
        png: where the picture goes.
        at_cycle, at_time: the moment to show, as a cycle (its end) or in seconds of the world's clock; by default the
            end.
        size: width and height in pixels, of the whole viewer.
        panel: draw the panel of this name alone, and as large as that.

    Returns:
        What the viewer's panels complain of, one line each; empty when all is well.

    Raises:
        InputError: there is no trace, the viewer cannot read it, or it has no such cycle or panel.
        MissingError: there is no Vulkan driver to draw with.
        ViewerError: the viewer did not start or failed.
    """
    path = trace_file(trace)
    moment = _moment(path, at_cycle, at_time)  # first: what is no trace is known at once
    with named_in_text(path) as named, headless_viewer((size[0], size[1] + _STRIP)) as viewer:
        viewer.open([named])
        settle(viewer, path)
        view = None if panel is None else _view_id(viewer, path, panel)
        _arrange(viewer, view)
        viewer.set_time(SIM_TIME, duration=moment, play_state="paused")
        picture = still(viewer, view)
        views = viewer.get_state().views
    Path(png).write_bytes(picture if view else _without_strip(picture))
    return [f"{each.name}: {report.severity}: {report.summary}" for each in views for report in each.reports]


def settle(viewer: ViewerClient, path: Path) -> None:
    """Wait until the whole file has been read and its own layout has taken the place of the viewer's guess.

    Raises:
        InputError: that does not happen.
    """
    start = loaded = time.monotonic()
    last: set[str] = set()
    while True:
        state, now = viewer.get_state(), time.monotonic()
        views = {view.view_id for view in state.views}
        if state.recordings and not state.loading and views and views == last:
            return
        loaded = now if state.loading else loaded
        if now - start > _PATIENCE or now - loaded > _READING:
            raise InputError("the viewer cannot read it", file=path)
        last = views
        _taken(viewer, max_size=64)  # a frame has to be drawn for the layout to be taken up
        time.sleep(_PAUSE)


class _Stamp(NamedTuple):
    cycle: int
    time: float


def _moment(path: Path, cycle: int | None, seconds: float | None) -> float:
    """The moment on the world's clock that is the end of a cycle, or the last one before it passes `seconds`; without
    either, the end.

    Raises:
        InputError: the run has no such moment.
    """
    stamps = list(_stamps(path))
    if cycle is not None:
        known = sorted({stamp.cycle for stamp in stamps})
        stamps = [stamp for stamp in stamps if stamp.cycle == cycle]
        if not stamps:
            told = f"the run has cycles {known[0]} to {known[-1]}" if known else "the run has none"
            raise InputError(f"there is no cycle {cycle}; {told}", file=path)
    if seconds is not None:
        stamps = [stamp for stamp in stamps if stamp.time <= seconds + _MOMENT]
    return max((stamp.time for stamp in stamps), default=0.0)


def _stamps(path: Path) -> Iterator[_Stamp]:
    """When everything happened that a trace tells of.

    Raises:
        InputError: it cannot be read.
    """
    from rerun.chunk import RrdReader

    with warnings.catch_warnings(), named_in_text(path) as named:
        warnings.filterwarnings("ignore", "RRD file has no footer")  # a run that was killed
        try:
            for chunk in RrdReader(named).stream():
                batch = chunk.to_record_batch()
                if {CYCLE, SIM_TIME} <= set(batch.schema.names):
                    columns = [batch.column(name).cast("int64").to_pylist() for name in (CYCLE, SIM_TIME)]
                    for cycle, nanoseconds in zip(*columns, strict=True):
                        yield _Stamp(cycle, nanoseconds / 1e9)
        except RuntimeError as error:
            raise InputError("the viewer cannot read it", file=path) from error


def _view_id(viewer: ViewerClient, path: Path, panel: str) -> str:
    panels = {each.name: each.view_id for each in viewer.get_state().views}
    if panel not in panels:
        raise InputError(f"no panel {panel!r}; {nearest(panel, panels)}", file=path)
    return panels[panel]


def _arrange(viewer: ViewerClient, view: str | None) -> None:
    """Leave out the bar at the top, which tells of the machine and not of the run, and give `view` all the room."""
    blueprint = dict(viewer.get_blueprint().blueprint)
    blueprint["/top_panel"] = {"PanelBlueprint": {"state": "Hidden"}}
    if view is not None:
        viewport = blueprint["/viewport"]["ViewportBlueprint"]
        blueprint["/viewport"] = {"ViewportBlueprint": {**viewport, "maximized": view}}
    viewer.set_blueprint(blueprint, of="recording")


def still(viewer: ViewerClient, view: str | None = None) -> bytes:
    """The whole viewer or one view of it as PNG, once nothing in it changes any more."""
    picture, alike = b"", 0
    for _ in range(_PICTURES):
        last, picture = picture, _taken(viewer, view)
        alike = alike + 1 if picture == last else 1
        if alike == _ALIKE:
            break
        time.sleep(_PAUSE)
    return picture


def _taken(viewer: ViewerClient, view: str | None = None, max_size: int | None = None) -> bytes:
    """One picture. On a machine that is busy, drawing by software may take longer than the viewer waits for itself."""
    for _ in range(_TRIES - 1):
        try:
            return viewer.take_screenshot(view, max_size=max_size)
        except (TimeoutError, RuntimeError):
            time.sleep(_PAUSE)
    return viewer.take_screenshot(view, max_size=max_size)


def _without_strip(png: bytes) -> bytes:
    from PIL import Image as Picture

    buffer = io.BytesIO()
    with Picture.open(io.BytesIO(png)) as picture:
        picture.crop((0, _STRIP, picture.width, picture.height)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
