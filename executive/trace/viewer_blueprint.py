"""How the viewer is laid out: where what happens is to be seen at a glance.

Three rows: the scene, the cameras' pictures and what is believed; the plan, with each replan below the last; what was
going on when, how probable the atoms in play were, and the log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from executive.types import Camera, FloatArray

CYCLE, SIM_TIME, WALL = "cycle", "sim_time", "wall"
"""The timelines: cycles of the loop, the world's clock, and the process's clock, both since the run began."""

WORLD, CAMERAS, PLAN, LOG = "world", "world/cameras", "plan", "log"
BELIEF, STATUS, NOW, BELIEVED, PROBABILITY = "belief", "status", "now", "believed", "probability"

GRAPH_WIDTH, GRAPH_HEIGHT = 1560.0, 200.0
"""What the plan's panel shows, in its own units; the plan is laid out within (see `executive.trace.viewer_plan`)."""


def blueprint(cameras: Sequence[Camera], pictures: Sequence[str]) -> rrb.Blueprint:
    """The layout for these cameras of the scene and these pictures."""
    top: list[rrb.View | rrb.Container] = [_scene(cameras)] if cameras else []
    shares = [34.0] if cameras else []
    if pictures:
        top.append(_pictures(pictures))
        shares.append(38.0 if len(pictures) > 2 else 20.0)
    documents = (
        rrb.TextDocumentView(origin=STATUS, name="run"),
        rrb.TextDocumentView(origin=BELIEF, name="belief against expectation"),
    )
    top.append(rrb.Vertical(*documents, row_shares=[42, 58]))
    shares.append(28.0)
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*top, column_shares=shares),
            rrb.GraphView(
                origin=PLAN,
                name="plan",
                visual_bounds=rrb.VisualBounds2D(x_range=[0, GRAPH_WIDTH], y_range=[0, GRAPH_HEIGHT]),
            ),
            rrb.Horizontal(
                rrb.StateTimelineView(origin=NOW, name="what was going on"),
                rrb.Tabs(
                    rrb.StateTimelineView(origin=BELIEVED, name="what was believed"),
                    rrb.TimeSeriesView(
                        origin=PROBABILITY,
                        name="P(true)",
                        axis_y=rrb.ScalarAxis(range=(-0.05, 1.05)),
                        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
                    ),
                ),
                rrb.TextLogView(origin=LOG, name="decisions and faults", columns=_log_columns()),
                column_shares=[34, 24, 42],
            ),
            row_shares=[46, 21, 33],
        ),
        rrb.TimePanel(state="collapsed", timeline=SIM_TIME, play_state="following"),
        collapse_panels=True,
        auto_layout=False,
        auto_views=False,
    )


def _pictures(names: Sequence[str]) -> rrb.Container:
    """The first camera large, the others small beside it."""
    first, *others = [rrb.Spatial2DView(origin=f"{CAMERAS}/{name}", name=name) for name in names]
    if len(others) < 2:
        return rrb.Vertical(first, *others)
    return rrb.Horizontal(first, rrb.Grid(*others, grid_columns=1 if len(others) == 2 else 2))


def _scene(cameras: Sequence[Camera]) -> rrb.Spatial3DView:
    eye, target = viewpoint(cameras)
    return rrb.Spatial3DView(
        origin=WORLD,
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
        timeline_columns=[encodings.TimelineColumn(CYCLE), encodings.TimelineColumn(SIM_TIME)],
        text_log_columns=[
            encodings.TextLogColumn(encodings.TextLogColumnKind.LogLevel),
            encodings.TextLogColumn(encodings.TextLogColumnKind.Body),
        ],
    )
