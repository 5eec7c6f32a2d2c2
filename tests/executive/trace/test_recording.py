"""The viewer's file of a real run, with a drop and a recovery: what is in it, how large it is, and pictures of it.

The pictures are left in the folder that PICTURES names, where it names one: `make test` has them in build/pictures.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image as Picture
from rerun.chunk import RrdReader

from executive.app.run import RunConfig, run
from executive.trace.viewer.process import TRACE_FILE
from executive.trace.viewer.screenshot import screenshot
from executive.types import Ended, Event, FaultInjected, Frame, Motion, Scenery
from tests.executive.trace.viewer.test_screenshot import draws
from tests.fakes import Recorder

FALLING = 0.16
"""Seconds after the gripper has opened, when the item is between hand and table."""
LARGEST, ACTIONS = 10e6, 20
"""Bytes that a run of so many actions may take."""


class Recorded(NamedTuple):
    folder: Path
    events: list[Event]

    def only(self, kind: type) -> list[Event]:
        return [event for event in self.events if isinstance(event.payload, kind)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    recorder, runs = Recorder(), tmp_path_factory.mktemp("runs")
    config = RunConfig(
        "grocery", problem="breakfast", estimator="oracle", faults=("drop@4",), runs=runs, name="breakfast", tree=True
    )
    run(config, [recorder])
    return Recorded(runs / "breakfast", recorder.events)


class Rows(NamedTuple):
    static: Counter[str]
    moving: Counter[str]
    properties: dict[str, object]


@pytest.fixture(scope="module")
def rows(recorded: Recorded) -> Rows:
    found = Rows(Counter(), Counter(), {})
    for chunk in RrdReader(recorded.folder / TRACE_FILE).stream():
        entity, batch = str(chunk.entity_path), chunk.to_record_batch()
        (found.static if chunk.is_static else found.moving)[entity] += batch.num_rows
        if entity == "/__properties/episode":
            found.properties.update({name: batch.column(name)[0].as_py()[0] for name in batch.schema.names[1:]})
    return found


def test_rerun_itself_finds_nothing_wrong(recorded: Recorded) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recorded.folder / TRACE_FILE)]
    check = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert check.returncode == 0, check.stderr


def test_twenty_actions_fit_into_ten_megabytes(recorded: Recorded) -> None:
    """Shapes are there once; all else grows with the actions at most."""
    trace = recorded.folder / TRACE_FILE
    shapes = sum(chunk.to_record_batch().nbytes for chunk in RrdReader(trace).stream() if chunk.is_static)
    (ended,) = recorded.only(Ended)
    assert isinstance(ended.payload, Ended)
    growing = trace.stat().st_size - shapes
    assert shapes + ACTIONS * growing / ended.payload.actions < LARGEST


def test_every_shape_is_stored_once_and_followed_where_it_moves(recorded: Recorded, rows: Rows) -> None:
    (scenery,) = (event.payload for event in recorded.only(Scenery))
    assert isinstance(scenery, Scenery)
    shapes = {entity: count for entity, count in rows.static.items() if entity.startswith("/world/")}
    shapes = {entity: count for entity, count in shapes.items() if not entity.startswith("/world/cameras")}
    assert sum(shapes.values()) == len(scenery.geometries)
    assert {entity.split("/")[2] for entity in shapes} == {"item", "robot", "room"}
    frames = len(recorded.only(Frame))
    assert 1 < rows.moving["/world/item/cereal-box"] < frames
    assert rows.moving["/world/item/lemon"] == 1, "nobody touches it"
    assert rows.moving["/world/robot/wrist_3_link"] > rows.moving["/world/item/cereal-box"]


def test_what_is_carried_is_shown_as_held(rows: Rows) -> None:
    """Taken up and put down; dropped, taken up again and put down."""
    held = {entity: count for entity, count in rows.moving.items() if entity.endswith("/held")}
    assert held == {"/world/item/milk-carton/held": 2, "/world/item/cereal-box/held": 4}


def test_a_campaign_can_be_searched_by_what_came_of_its_runs(recorded: Recorded, rows: Rows) -> None:
    (ended,) = recorded.only(Ended)
    assert isinstance(ended.payload, Ended)
    said = {name.split(":")[-1]: value for name, value in rows.properties.items()}
    assert said["outcome"] == "goal-reached"
    assert said["goal_seen"] is True
    assert (said["actions"], said["replans"], said["looks"]) == (ended.payload.actions, 1, ended.payload.looks)
    assert (said["faults"], said["fault_specs"]) == (1, "drop@4")
    assert (said["domain"], said["problem"], said["seed"], said["estimator"]) == ("grocery", "breakfast", 0, "oracle")
    assert said["sim_seconds"] == pytest.approx(ended.time)


def test_a_search_is_told_with_its_tree(recorded: Recorded) -> None:
    motions = [event.payload for event in recorded.only(Motion)]
    assert motions
    for motion in motions:
        assert isinstance(motion, Motion)
        assert (motion.tree is not None) == (motion.planner == "RRT*")


@draws
@pytest.mark.parametrize("name", ["drop", "recovery"])
def test_a_picture_of_it(recorded: Recorded, tmp_path: Path, name: str) -> None:
    """The item in the air, and the end, when it is where it belongs; no panel complains of anything."""
    (fault,) = recorded.only(FaultInjected)
    folder = Path(os.environ.get("PICTURES") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.png"
    moment = fault.time + FALLING if name == "drop" else None
    assert screenshot(recorded.folder, file, at_time=moment) == []
    with Picture.open(file) as picture:
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 1000
