"""How the viewer is laid out: where what happens is to be seen at a glance.

On the left what the world and the robot do: the scene, the cameras' pictures with what the last look changed below
them; the plan, with each replan below the last; what was going on when. On the right what the robot makes of it: where
the run stands, belief against expectation, how probable the atoms in play were, and the log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from executive.types import Camera, FloatArray

CYCLE, SIM_TIME, WALL = "cycle", "sim_time", "wall"
"""The timelines: cycles of the loop, the world's clock, and the process's clock, both since the run began.

The layout opens on the last one. Looking and planning take no time of a simulated world, so that on its clock all that
a look showed and all that was decided falls on one moment."""

WORLD, CAMERAS, PLAN, LOG = "world", "world/cameras", "plan", "log"
BELIEF, LOOK, STATUS, NOW, BELIEVED = "belief", "look", "status", "now", "believed"
PROBABILITY, ANSWERS, THRESHOLDS = "probability", "answers", "thresholds"

GRAPH_WIDTH, GRAPH_HEIGHT = 1040.0, 204.0
"""What the plan's panel shows, in its own units; the plan is laid out within (see `executive.trace.viewer_plan`)."""


def blueprint(cameras: Sequence[Camera], pictures: Sequence[str]) -> rrb.Blueprint:
    """The layout for these cameras of the scene and these pictures."""
    look = rrb.TextDocumentView(origin=LOOK, name="what the last look changed")
    seen: rrb.View | rrb.Container = look
    if cameras and pictures:
        seen = rrb.Vertical(_pictures(pictures), look, row_shares=[60, 40])
    elif pictures:
        seen = rrb.Horizontal(_pictures(pictures), look, column_shares=[62, 38])
    world = rrb.Vertical(
        rrb.Horizontal(_scene(cameras), seen, column_shares=[46, 54]) if cameras else seen,
        rrb.GraphView(
            origin=PLAN,
            name="plan",
            visual_bounds=rrb.VisualBounds2D(x_range=[0, GRAPH_WIDTH], y_range=[0, GRAPH_HEIGHT]),
        ),
        rrb.Horizontal(
            rrb.StateTimelineView(origin=NOW, name="what was going on"),
            rrb.StateTimelineView(origin=BELIEVED, name="what was believed"),
            column_shares=[50, 50],
        ),
        row_shares=[45, 24, 31],
    )
    mind = rrb.Vertical(
        rrb.TextDocumentView(origin=STATUS, name="run"),
        rrb.TextDocumentView(origin=BELIEF, name="belief against expectation"),
        rrb.TimeSeriesView(
            origin="/",
            contents=[f"+ /{root}/**" for root in (PROBABILITY, ANSWERS, THRESHOLDS)],
            name="P(true)",
            axis_y=rrb.ScalarAxis(range=(-0.05, 1.05)),
            plot_legend=rrb.PlotLegend(visible=False),
        ),
        rrb.TextLogView(origin=LOG, name="decisions and faults", columns=_log_columns()),
        row_shares=[21, 28, 19, 32],
    )
    return rrb.Blueprint(
        rrb.Horizontal(world, mind, column_shares=[65, 35]),
        rrb.TimePanel(state="collapsed", timeline=WALL, play_state="following"),
        collapse_panels=True,
        auto_layout=False,
        auto_views=False,
    )


def _pictures(names: Sequence[str]) -> rrb.Container:
    """The first camera large, the others small beside it."""
    first, *others = [rrb.Spatial2DView(origin=f"{CAMERAS}/{name}", name=name) for name in names]
    if len(others) < 2:
        return rrb.Horizontal(first, *others)
    return rrb.Horizontal(first, rrb.Grid(*others, grid_columns=1 if len(others) == 2 else 2))


def _scene(cameras: Sequence[Camera]) -> rrb.Spatial3DView:
    eye, target = viewpoint(cameras)
    notes = [f"- /{CAMERAS}/{camera.name}/{note}" for camera in cameras for note in ("border", "caption")]
    return rrb.Spatial3DView(
        origin=WORLD,
        contents=["+ $origin/**", *notes],
        name="scene",
        background=rrb.Background(color=(56, 62, 72)),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def viewpoint(cameras: Sequence[Camera]) -> tuple[FloatArray, FloatArray]:
    """Where to look from and at, both (3,) in m: at what the cameras look at, from beside and above the first one.

    Whoever placed the cameras knew where the action is; their optical axes meet there.
    """
    eyes = np.array([camera.pose[:3] for camera in cameras])
    axes = np.array([_forward(camera) for camera in cameras])
    target = eyes[0] + axes[0]
    if len(cameras) > 1:
        # The point with the least sum of squared distances to all axes; a little weight keeps parallel axes solvable.
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        target = np.linalg.solve(
            across.sum(axis=0) + 1e-6 * np.eye(3), (across @ eyes[:, :, None]).sum(axis=0)[:, 0] + 1e-6 * target
        )
    away = eyes[0] - target
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
        text_log_columns=[
            encodings.TextLogColumn(encodings.TextLogColumnKind.LogLevel),
            encodings.TextLogColumn(encodings.TextLogColumnKind.Body),
        ],
    )
