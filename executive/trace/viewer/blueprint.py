"""How the viewer is laid out: where what happens is to be seen at a glance.

On the left what the world and the robot do: the scene and the cameras' pictures; the plan, with each replan below the
last; what was going on when, and what was believed. On the right what the robot makes of it: where the run stands,
belief against expectation (behind it what the last look changed), how probable the atoms in play were, and the log. All
panels speak of the world's clock, and their axes show the whole run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from executive.types import Camera, FloatArray

CYCLE, SIM_TIME, WALL = "cycle", "sim_time", "wall"
"""The timelines: cycles of the loop, the world's clock, on which the layout opens, and the process's clock."""

WORLD, CAMERAS, PLAN, LOG = "world", "world/cameras", "plan", "log"
DEPTH = "depth"
BELIEF, LOOK, STATUS, NOW, BELIEVED = "belief", "look", "status", "now", "believed"
PROBABILITY, ANSWERS, THRESHOLDS = "probability", "answers", "thresholds"
PHASE = "phase"
PLACES = "places"

_END, _LEGEND = 0.1, 0.95
"""How far the time axes go on after a run's end, as parts of it: for the last state of each lane to be seen, and for
the legend to stand beside the curves."""
_PHASES = 30.0
"""Seconds of a run whose phases can be told apart."""

GRAPH_WIDTH, GRAPH_HEIGHT = 1040.0, 228.0
"""What the plan's panel shows, in its own units; the plan is laid out within (see
`executive.trace.viewer.plan_graph`)."""

PLACES_WIDTH = 640.0
"""What the panel of places shows across, in its own units."""

WORDS, CURVES = 6, 4
"""How many atoms there is room for in a window of 1280x800 pixels: lanes, and names of curves."""


@dataclass(frozen=True)
class Shown:
    """What there is to lay out: cameras of the scene, those with pictures, the atoms to show as `words` and as `curves`
    (entities such as `on-table/lemon/wood-table`; None: whatever comes), the run's length in seconds of the world's
    clock (None: it goes on), whether nobody looks, and how high the bars are that say where things may be (0: there are
    none)."""

    cameras: Sequence[Camera] = ()
    pictures: Sequence[str] = ()
    words: Sequence[str] | None = None
    curves: Sequence[str] | None = None
    seconds: float | None = None
    is_blind: bool = False
    places: float = 0.0


def blueprint(shown: Shown) -> rrb.Blueprint:
    """Return the layout."""
    axis = _time_axis(shown.seconds, _END)
    seen = [_pictures(shown.pictures)] if shown.pictures else []
    space: list[rrb.View | rrb.Container] = [*([_scene(shown.cameras)] if shown.cameras else []), *seen]
    phases = [] if shown.seconds is None or shown.seconds <= _PHASES else [f"- /{NOW}/{PHASE}"]
    world = rrb.Vertical(
        *([rrb.Horizontal(*space, column_shares=[40, 60][: len(space)])] if space else []),
        rrb.GraphView(
            origin=PLAN,
            name="plan",
            visual_bounds=rrb.VisualBounds2D(x_range=[0, GRAPH_WIDTH], y_range=[0, GRAPH_HEIGHT]),
        ),
        rrb.Horizontal(
            rrb.StateTimelineView(
                origin=NOW,
                contents=["+ $origin/**", *phases],
                name="what was going on",
                time_view=axis,
            ),
            rrb.StateTimelineView(
                origin=BELIEVED,
                contents=_entities([BELIEVED], shown.words),
                name="what was assumed" if shown.is_blind else "what was believed",
                time_view=axis,
            ),
        ),
        row_shares=[36, 26, 38] if space else [38, 62],
    )
    return rrb.Blueprint(
        rrb.Horizontal(world, _mind(shown), column_shares=[62, 38]),
        rrb.TimePanel(state="collapsed", timeline=SIM_TIME, play_state="following"),
        collapse_panels=True,
        auto_layout=False,
        auto_views=False,
    )


def _mind(shown: Shown) -> rrb.Container:
    run = rrb.TextDocumentView(origin=STATUS, name="run")
    log = rrb.TextLogView(origin=LOG, name="decisions and faults", columns=_log_columns())
    if shown.is_blind:  # there is no look to tell of, and what is assumed has no probability
        belief = rrb.TextDocumentView(origin=BELIEF, name="what is assumed")
        return rrb.Vertical(run, belief, log, row_shares=[18, 30, 52])
    return rrb.Vertical(
        run,
        rrb.Tabs(
            *([_places(shown.places)] if shown.places else []),
            rrb.TextDocumentView(origin=BELIEF, name="belief against expectation"),
            rrb.TextDocumentView(origin=LOOK, name="what the last look changed"),
        ),
        rrb.TimeSeriesView(
            origin="/",
            contents=[*_entities([PROBABILITY, ANSWERS], shown.curves), f"+ /{THRESHOLDS}/**"],
            name="P(true)",
            axis_x=_time_axis(shown.seconds, _LEGEND),
            axis_y=rrb.ScalarAxis(range=(-0.05, 1.05)),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
        ),
        log,
        row_shares=[17, 28, 26, 29],
    )


def _places(height: float) -> rrb.Spatial2DView:
    bounds = rrb.VisualBounds2D(x_range=[0, PLACES_WIDTH], y_range=[0, height])
    return rrb.Spatial2DView(origin=PLACES, name="where things may be", visual_bounds=bounds)


def _time_axis(seconds: float | None, after: float) -> rrb.TimeAxis | None:
    """From the run's beginning to its end, and on for a part of its length."""
    if not seconds:
        return None
    start, end = (rr.TimeRangeBoundary.absolute(seconds=at) for at in (-0.01 * seconds, seconds * (1 + after)))
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _entities(roots: Sequence[str], atoms: Sequence[str] | None) -> list[str]:
    """Return the query for some atoms below each of these roots."""
    below = ["**"] if atoms is None else atoms
    return [f"+ /{root}/{path}" for path in below for root in roots]


def _pictures(names: Sequence[str]) -> rrb.Container:
    """Return the first camera large, the others small beside it."""
    first, *others = [_picture(name) for name in names]
    if len(others) < 2:
        return rrb.Horizontal(first, *others)
    return rrb.Horizontal(first, rrb.Grid(*others, grid_columns=1 if len(others) == 2 else 2))


def _picture(name: str) -> rrb.Spatial2DView:
    """Return what a camera saw, without what it measured: that is in space."""
    return rrb.Spatial2DView(origin=f"{CAMERAS}/{name}", name=name, contents=["+ $origin/**", f"- $origin/{DEPTH}"])


def _scene(cameras: Sequence[Camera]) -> rrb.Spatial3DView:
    eye, target = viewpoint(cameras)
    # What was measured of the room is grey noise around it: of interest are the points of what was found.
    notes = [f"- /{CAMERAS}/{camera.name}/{note}" for camera in cameras for note in ("border", "caption", DEPTH)]
    return rrb.Spatial3DView(
        origin=WORLD,
        contents=["+ $origin/**", *notes],
        name="scene",
        background=rrb.Background(color=(56, 62, 72)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def viewpoint(cameras: Sequence[Camera]) -> tuple[FloatArray, FloatArray]:
    """Return where to look from and at, both (3,) in m: at what the cameras look at, from beside and above the first
    one.

    Cameras are placed to show where the action is; their optical axes meet there.
    """
    positions = np.array([camera.pose[:3] for camera in cameras])
    axes = np.array([_forward(camera) for camera in cameras])
    target = positions[0] + axes[0]
    if len(cameras) > 1:
        # The point with the least sum of squared distances to all axes; a little weight keeps parallel axes solvable.
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        target = np.linalg.solve(
            across.sum(axis=0) + 1e-6 * np.eye(3), (across @ positions[:, :, None]).sum(axis=0)[:, 0] + 1e-6 * target
        )
    away = positions[0] - target
    turn = math.radians(35.0)
    aside = np.array(
        [
            math.cos(turn) * away[0] - math.sin(turn) * away[1],
            math.sin(turn) * away[0] + math.cos(turn) * away[1],
            away[2] * 1.1,
        ]
    )
    return target + aside * 1.05, target


def _forward(camera: Camera) -> FloatArray:
    w, x, y, z = camera.pose[3:]
    return -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _log_columns() -> rrb.TextLogColumns:
    return rrb.TextLogColumns(
        timeline_columns=[encodings.TimelineColumn(CYCLE)],
        text_log_columns=[encodings.TextLogColumn(encodings.TextLogColumnKind.Body)],
    )
