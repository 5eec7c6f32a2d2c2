"""Pictures over time and how probable things were meanwhile, as a Rerun recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType, TracebackType

import rerun as rr
import rerun.blueprint as rrb

from executive.errors import InputError
from executive.trace.record.pictures import to_jpeg
from executive.trace.viewer.text_panels import plain
from executive.types import Image

APPLICATION = "executive-estimate"
TIME = "time"
_AT_ONCE = 256
"""How many values of a curve are kept before they are written."""

_IN_A_COLUMN = 5
"""How many views of curves are above each other; more are in two columns."""

_PICTURES, _PROBABILITY = "pictures", "probability"


class Film:
    """Writes a recording that can be played: the pictures beside a curve for each thing that was estimated.

    Use it as a context manager; what was added is in the file even when the block ends by an error.

    Args:
        colours: name -> RGB in 0..255 of its curve in each group; the viewer chooses those of other names.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, file: Path | str, colours: Mapping[str, tuple[int, int, int]] = MappingProxyType({})) -> None:
        self.file, self._colours = Path(file), colours
        try:
            self.file.touch()
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=file) from None
        self._record = rr.RecordingStream(APPLICATION)
        self._record.set_sinks(rr.FileSink(self.file))
        self._curves: dict[tuple[str, str], list[tuple[float, float]]] = {}
        """Of each curve what is not in the file yet: times and values."""

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._write_curves()
        self._record.flush()
        self._record.disconnect()

    def add(self, time: float, pictures: Mapping[str, Image], curves: Mapping[str, Mapping[str, float | None]]) -> None:
        """What was seen at `time` seconds, and what it was taken for: group -> name -> P(true), None where unknown."""
        if not self._curves:
            self._record.send_blueprint(_blueprint(list(pictures), list(curves), alike=bool(self._colours)))
        self._record.set_time(TIME, duration=time)
        for name, picture in pictures.items():
            encoded = rr.EncodedImage(contents=to_jpeg(picture), media_type="image/jpeg")
            self._record.log([_PICTURES, plain(name)], encoded)
        for group, members in curves.items():
            for name, probability in members.items():
                entity = _entity(group, name)
                if (group, name) not in self._curves:
                    self._curves[group, name] = []
                    stepped = rr.components.InterpolationMode.StepAfter
                    colour = self._colours.get(name)
                    style = rr.SeriesLines(names=plain(name), interpolation_mode=stepped, colors=colour)
                    self._record.log(entity, style, static=True)
                # Not a number is a gap in the curve.
                self._curves[group, name].append((time, math.nan if probability is None else probability))
        if max(map(len, self._curves.values()), default=0) >= _AT_ONCE:
            self._write_curves()

    def _write_curves(self) -> None:
        """Write what was kept of the curves, a column each: one by one, numbers take ten times as much room."""
        for (group, name), points in self._curves.items():
            if points:
                times, values = zip(*points, strict=True)
                self._record.send_columns(
                    _entity(group, name),
                    indexes=[rr.TimeColumn(TIME, duration=times)],
                    columns=rr.Scalars.columns(scalars=values),
                )
                points.clear()


def _entity(group: str, name: str) -> str:
    return rr.new_entity_path([_PROBABILITY, plain(group), plain(name)])


def _blueprint(pictures: list[str], groups: list[str], alike: bool) -> rrb.Blueprint:
    """The layout. Where the curves of all groups are `alike`, the first group's legend is that of all: each hides a
    part of its curves."""
    seen = [rrb.Spatial2DView(origin=f"{_PICTURES}/{plain(name)}", name=plain(name)) for name in pictures]
    curves = [
        rrb.TimeSeriesView(
            origin=f"{_PROBABILITY}/{plain(group)}",
            name=f"P({plain(group)})",
            axis_y=rrb.ScalarAxis(range=(-0.05, 1.05)),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=not alike or not number),
        )
        for number, group in enumerate(groups)
    ]
    many = len(curves) > _IN_A_COLUMN
    side_by_side = rrb.Grid(*curves, grid_columns=2) if many else rrb.Vertical(*curves)
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*seen), side_by_side, column_shares=[45, 55]),
        rrb.TimePanel(state="collapsed", timeline=TIME),
        collapse_panels=True,
        auto_layout=False,
        auto_views=False,
    )
