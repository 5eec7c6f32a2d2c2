"""A recording for the viewer that is small enough to be kept in git: what `executive run` leaves as trace.rrd, with
less of everything that nobody misses."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from executive.protocols import Sink
from executive.sim.viewer_geometry import merged
from executive.trace.viewer.blueprint import WALL
from executive.trace.viewer.sink import RerunSink
from executive.types import (
    Decision,
    Event,
    FaultInjected,
    Geometry,
    Image,
    LookCause,
    Observation,
    PointCloud,
    Scenery,
)

SMALLER = 0.4
"""How wide and high pictures are, of what they were."""
CELL, FEW = 0.01, 200
"""Vertices that fall into one cell of this size (m) are one; shapes with few vertices stay as they are."""


class Small:
    """A sink that leaves a recording for the viewer with smaller pictures and fewer triangles, and without pictures of
    glances at what is carried while all is well."""

    def __init__(self) -> None:
        self._viewer: Sink | None = None
        self._amiss = False

    def begin(self, viewer: Sink) -> None:
        """Pass on what happens from now on."""
        self._viewer = viewer

    def write(self, event: Event) -> None:
        if self._viewer is None or isinstance(event.payload, PointCloud):
            return
        match event.payload:
            case FaultInjected():
                self._amiss = True
            case Decision():
                self._amiss = False
            case Observation(images=images) as look:
                told = self._amiss or not look.cause.startswith(LookCause.GLANCE)
                small = {name: smaller(image) for name, image in images.items() if told}
                event = replace(event, payload=replace(look, images=small, depth={}))
            case Scenery(cameras=cameras) as scenery:
                fewer = [
                    replace(each, width=round(each.width * SMALLER), height=round(each.height * SMALLER))
                    for each in cameras
                ]
                shapes = [coarse(shape) for shape in joined(scenery.geometries)]
                event = replace(event, payload=replace(scenery, geometries=tuple(shapes), cameras=tuple(fewer)))
        self._viewer.write(event)

    def close(self) -> None:
        if self._viewer is not None:
            self._viewer.close()


def smaller(image: Image) -> Image:
    size = round(image.shape[1] * SMALLER), round(image.shape[0] * SMALLER)
    return np.asarray(Picture.fromarray(image).resize(size, Picture.Resampling.LANCZOS))


def joined(shapes: Sequence[Geometry]) -> Iterator[Geometry]:
    """Shapes of one body and one colour as one."""
    groups: dict[tuple[str, object], list[Geometry]] = {}
    for shape in shapes:
        groups.setdefault((shape.body, shape.rgba), []).append(shape)
    return map(merged, groups.values())


def coarse(shape: Geometry) -> Geometry:
    """A shape with fewer triangles."""
    if len(shape.vertices) <= FEW:
        return shape
    cells = np.floor(shape.vertices / CELL).astype(int)
    _, group, sizes = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    vertices = np.stack([np.bincount(group, shape.vertices[:, axis]) / sizes for axis in range(3)], axis=1)
    faces = group[shape.faces]
    thin = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return replace(shape, vertices=vertices.astype(np.float32), faces=faces[~thin].astype(np.uint32))


class OneLayout(RerunSink):
    """Lays the panels out at the end alone, when everything is known: each layout takes 0.1 MB of a file."""

    def _arrange(self, is_over: bool = False) -> None:
        if is_over:
            super()._arrange(is_over)


def compact(trace: Path, file: Path) -> None:
    """Write a recording without the process's clock, in few large pieces in place of many small ones."""
    rrd, slim = [sys.executable, "-m", "rerun", "rrd"], trace.with_suffix(".slim.rrd")
    for command in (
        ["filter", "--drop-timeline", WALL, str(trace), "-o", str(slim)],
        ["optimize", str(slim), "-o", str(file)],
    ):
        subprocess.run([*rrd, *command], check=True, capture_output=True)
    print(f"{file.name}: {file.stat().st_size // 1024} kB")
