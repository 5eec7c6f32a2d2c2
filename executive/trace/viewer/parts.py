"""Small parts of the viewer's sink: lanes of states, meshes, cameras, stamps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import rerun as rr

from executive.trace.viewer.blueprint import CYCLE, SIM_TIME, WALL
from executive.trace.viewer.colours import LANES, Colour
from executive.trace.viewer.text_panels import plain
from executive.types import Camera, Event, Geometry


class Lane:
    """A lane of states over time. A state that has no colour of its own gets one by its first word."""

    def __init__(
        self, record: rr.RecordingStream, entity: Sequence[object], colours: Mapping[str, Colour] | None = None
    ) -> None:
        self._record, self._entity = record, rr.new_entity_path(list(entity))
        self._colours = dict(colours or {})
        self._hues: dict[str, Colour] = {}
        self._state = ""
        if self._colours:
            self._style()

    def enter(self, state: str, colour: Colour | None = None) -> None:
        state = plain(state)
        if state == self._state:
            return
        self._state = state
        if colour is not None and state not in self._colours:
            self._colours[state] = colour
            self._style()
        self._paint(state)
        self._record.log(self._entity, rr.StateChange(state=state))

    def enter_all(self, states: Sequence[tuple[Event, str]]) -> None:
        """Enter many states, each at its event."""
        if states:
            self._state = states[-1][1]
            self._paint(*(state for _, state in states))
            changes = rr.StateChange.columns(state=[state for _, state in states])
            self._record.send_columns(self._entity, time_columns([event for event, _ in states]), changes)

    def leave(self) -> None:
        self.enter("")

    def _paint(self, *states: str) -> None:
        for state in states:
            if state and state not in self._colours:
                hue = self._hues.setdefault(state.split(" ")[0], LANES[len(self._hues) % len(LANES)])
                self._colours[state] = hue
                self._style()

    def _style(self) -> None:
        style = rr.StateConfiguration(values=list(self._colours), colors=list(self._colours.values()))
        self._record.log(self._entity, style, static=True)


def stamp(record: rr.RecordingStream, event: Event) -> None:
    """What is logged next happened at this event."""
    record.set_time(CYCLE, sequence=event.cycle)
    record.set_time(SIM_TIME, duration=event.time)
    record.set_time(WALL, duration=event.wall)


def time_columns(events: Sequence[Event]) -> list[rr.TimeColumn]:
    """The stamps of many events, for rows that are sent at once."""
    return [
        rr.TimeColumn(CYCLE, sequence=[event.cycle for event in events]),
        rr.TimeColumn(SIM_TIME, duration=[event.time for event in events]),
        rr.TimeColumn(WALL, duration=[event.wall for event in events]),
    ]


def mesh(geometry: Geometry) -> rr.Mesh3D:
    """Return a shape in its body's frame, in one colour."""
    return rr.Mesh3D(
        vertex_positions=geometry.vertices,
        triangle_indices=geometry.faces,
        albedo_factor=[round(255 * part) for part in geometry.rgba],
    )


def pinhole(camera: Camera) -> tuple[rr.Pinhole, rr.Transform3D, rr.TransformAxes3D]:
    """A camera where it stands; its pictures belong on the same entity."""
    lens = rr.Pinhole(
        focal_length=camera.height / 2 / math.tan(camera.fovy / 2),
        width=camera.width,
        height=camera.height,
        camera_xyz=rr.ViewCoordinates.RUB,
        image_plane_distance=0.1,
    )
    w, x, y, z = camera.pose[3:]
    stand = rr.Transform3D(translation=camera.pose[:3], quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
    return lens, stand, rr.TransformAxes3D(axis_length=0.0)
