"""What the viewer's file holds, and that it survives what happens to the process that writes it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from executive.errors import InputError
from executive.trace.viewer.blueprint import viewpoint
from executive.trace.viewer.process import TRACE_FILE, inspect, trace_file
from executive.trace.viewer.sink import RerunSink
from executive.types import (
    Decision,
    DecisionKind,
    EstimatedPose,
    Event,
    FaultInjected,
    Frame,
    Lump,
    Observation,
    Phase,
    PointCloud,
    PosesEstimated,
    Scenery,
)
from executive.util.requirements import has_display
from tests.executive.trace.synthetic import ITEMS, scenery, synthetic_events
from tests.fakes import recorded

STAMPS = {"cycle", "sim_time", "wall"}


def written(run: Path, some: list[Event], close: bool = True) -> Path:
    sink = RerunSink(run)
    for event in some:
        sink.write(event)
    if close:
        sink.close()
    return run / TRACE_FILE


class Contents:
    """The rows of a trace by entity, and what its texts say."""

    def __init__(self, trace: Path) -> None:
        self.static: Counter[str] = Counter()
        self.moving: Counter[str] = Counter()
        self.indexes: set[str] = set()
        self.texts: list[str] = []
        for chunk in RrdReader(trace).stream():
            entity, batch = str(chunk.entity_path), chunk.to_record_batch()
            (self.static if chunk.is_static else self.moving)[entity] += batch.num_rows
            if not chunk.is_static and not entity.startswith("/__"):
                self.indexes |= {name for name in batch.schema.names if name in {*STAMPS, "log_time", "log_tick"}}
            for name in batch.schema.names:
                if name.endswith(":text"):
                    self.texts += [str(cell) for row in batch.column(name).to_pylist() for cell in row or ()]


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> Contents:
    return Contents(written(tmp_path_factory.mktemp("run"), synthetic_events()))


def test_the_worlds_clock_shows_each_event_in_its_order(tmp_path: Path) -> None:
    """Also those that happen while it stands still, and those after it was put back in a run that was resumed."""
    times, cycles = list[int](), list[int]()
    some = synthetic_events()
    put_back = [*some[:60], *(replace(event, cycle=event.cycle + some[60].cycle) for event in some[40:])]
    for chunk in RrdReader(written(tmp_path, put_back)).stream():
        if chunk.entity_path in ("/plan", "/status", "/belief"):
            times += chunk.to_record_batch().column("sim_time").cast("int64").to_pylist()
            cycles += chunk.to_record_batch().column("cycle").cast("int64").to_pylist()
    assert len(set(times)) > 20
    told = [cycle for _, cycle in sorted(zip(times, cycles, strict=True))]
    assert told == sorted(told)
    assert max(times) / 1e9 == pytest.approx(some[-1].time, abs=1e-3)


def test_each_shape_is_stored_once(contents: Contents) -> None:
    shapes = [entity for entity in contents.static if entity.startswith("/world/") and "part-" in entity]
    assert len(shapes) == len(scenery(()).geometries)
    assert all(contents.static[entity] == 1 for entity in shapes)
    assert not any(contents.moving[entity] for entity in shapes)


def test_only_bodies_that_move_are_logged_again(contents: Contents) -> None:
    frames = sum(isinstance(event.payload, Frame) for event in synthetic_events())
    rows = {body: contents.moving[f"/world/item/{body}"] for body in ITEMS}
    assert rows["lemon"] == 1, "nobody touches it"
    assert 1 < rows["cereal-box"] < frames
    assert contents.moving["/world/robot/hand"] > rows["cereal-box"]


def test_every_row_can_be_found_on_every_timeline(contents: Contents) -> None:
    assert contents.indexes == STAMPS


def test_pictures_are_on_their_camera(contents: Contents) -> None:
    for camera in ("overview", "side"):
        assert contents.static[f"/world/cameras/{camera}"] >= 1
        assert contents.moving[f"/world/cameras/{camera}"] == 10


def test_depth_and_estimated_poses_are_in_space(tmp_path: Path) -> None:
    events = synthetic_events()
    look = next(event for event in events if isinstance(event.payload, Observation))
    assert isinstance(look.payload, Observation)
    (camera, image), *_ = look.payload.images.items()
    depth = {camera: np.full(image.shape[:2], 800, np.uint16)}
    item = next(iter(ITEMS))
    pose = EstimatedPose(np.array([0.4, 0, 0.9, 1, 0, 0, 0]), 1e-6 * np.eye(6), 0.001, (camera,))
    unknown = Lump(np.full(3, 0.5), np.full(3, 0.03))
    news = [
        replace(look, payload=replace(look.payload, depth=depth)),
        replace(look, payload=PosesEstimated({item: pose}, (), (unknown,), {"side": "no depth"})),
        replace(look, payload=PosesEstimated({}, (item,))),
    ]
    shown = Contents(written(tmp_path, [*events[: events.index(look)], *news]))
    assert shown.moving[f"/world/cameras/{camera}/depth"] == 1
    assert shown.moving[f"/world/estimated/{item}"] == 2, "it is there, and then cleared"
    assert shown.moving[f"/world/estimated/{item}/uncertainty"] == 1
    assert shown.moving["/world/estimated/unknown"] == 2
    assert any("side" in text and "no depth" in text for text in shown.texts)


def test_what_was_measured_and_where_identical_items_came_from_are_in_space(tmp_path: Path) -> None:
    events = synthetic_events()
    look = next(event for event in events if isinstance(event.payload, Observation))
    one, other, *_ = ITEMS
    steps = []
    for number in range(4):
        moving = EstimatedPose(np.array([0.1 * number, 0, 0.9, 1, 0, 0, 0]), 1e-6 * np.eye(6), 0.001, ())
        still = replace(moving, pose=np.array([0.4, 0.4, 0.9, 1, 0, 0, 0]))
        sure = 1.0 - 0.15 * number
        identity = {one: {one: sure, other: 1 - sure}, other: {one: 1 - sure, other: sure}}
        steps.append(replace(look, payload=PointCloud(np.zeros((5, 3), np.float32), np.zeros((5, 3), np.uint8))))
        steps.append(replace(look, payload=PosesEstimated({one: moving, other: still}, identity=identity)))
    shown = Contents(written(tmp_path, [*events[: events.index(look) + 1], *steps]))
    assert shown.moving["/world/estimated/points"] == 4
    assert shown.moving[f"/world/estimated/tracks/{one}"] == 4, "it grows as the item moves"
    assert shown.moving[f"/world/estimated/tracks/{other}"] == 1
    assert shown.moving[f"/world/estimated/tracks/{one}/label"] == 4


def test_atoms_that_never_changed_nor_surprised_are_left_out(contents: Contents) -> None:
    curves = {entity for entity in contents.moving if entity.startswith("/probability/")}
    assert "/probability/on-table/cereal-box/white-table" in curves
    assert not any("lemon" in entity for entity in curves)
    assert contents.moving["/probability/on-table/cereal-box/white-table"] == 10, "from the first look on"


def test_the_log_tells_faults_decisions_and_plans(contents: Contents) -> None:
    for line in (
        "fault drop@2: the gripper opened in mid-transfer",
        "replan: on-table(cereal-box,white-table) not seen as expected",
        "plan 2, 4 steps",
        "place cereal-box white-table reports dropped (the gripper closed on nothing)",
        "goal-reached: the goal is seen to hold",
    ):
        assert line in " ".join(" ".join(contents.texts).split()), "in as many lines as it takes"


def test_rerun_itself_finds_nothing_wrong(tmp_path: Path) -> None:
    trace = written(tmp_path, synthetic_events())
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(trace)]
    check = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert check.returncode == 0, check.stderr


def test_what_the_viewer_cannot_draw_never_reaches_it(tmp_path: Path) -> None:
    rogue = "naïve 漢字 \N{ROBOT FACE} \x1b[2J \ud800"
    some = [
        synthetic_events()[0],
        Event(0, 0.0, 0.1, Phase(rogue)),
        Event(0, 0.0, 0.1, FaultInjected(rogue, rogue, 1, rogue)),
        Event(0, 0.0, 0.2, Decision(DecisionKind.REPLAN, recorded(rogue))),
    ]
    texts = Contents(written(tmp_path, some)).texts
    assert "replan: naïve ?? ? ?[2J ?" in texts
    assert all(each.isascii() or each in "ï·✓✗►○" for text in texts for each in text)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_killed_in_the_middle_it_can_still_be_read(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from executive.trace.viewer.sink import RerunSink\n"
        "from executive.types import Decision\n"
        "from tests.executive.trace.synthetic import synthetic_events\n"
        "sink = RerunSink(sys.argv[1])\n"
        "for event in synthetic_events():\n"
        "    sink.write(event)\n"
        "    if event.cycle == 5 and isinstance(event.payload, Decision):\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    run = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, check=False, timeout=120)
    assert run.returncode == -signal.SIGKILL
    contents = Contents(tmp_path / TRACE_FILE)
    assert "plan 2, 4 steps" in contents.texts
    assert contents.moving["/world/cameras/overview"] == 7, "every look until then"
    assert contents.static["/world/item/lemon/part-10"] == 1


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        RerunSink(tmp_path / "file" / "run")


def test_no_trace_to_open(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no trace for the viewer here"):
        trace_file(tmp_path)


def test_without_a_display_it_is_said_what_to_do_instead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path, [])
    monkeypatch.setattr("executive.trace.viewer.process.has_display", lambda: False)
    with pytest.raises(Exception, match=r"no display here; use: executive inspect .* --web, or .* --png FILE"):
        inspect(tmp_path)
    assert not has_display({}, "linux")
    assert has_display({"WAYLAND_DISPLAY": "wayland-0"}, "linux")
    assert has_display({}, "darwin")


def test_the_scene_is_looked_at_where_the_cameras_look() -> None:
    (start,) = (event.payload for event in synthetic_events() if isinstance(event.payload, Scenery))
    eye, target = viewpoint(start.cameras)
    assert np.linalg.norm(target - [0.45, 0, 0.47]) < 0.15, "between what the two cameras were pointed at"
    assert eye[2] > target[2]
    one, _ = viewpoint(start.cameras[:1])
    assert np.isfinite(one).all()
    twin, _ = viewpoint((start.cameras[0], start.cameras[0]))
    assert np.isfinite(twin).all()


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted in /proc")
def test_a_recording_that_was_closed_leaves_no_thread_behind(tmp_path: Path) -> None:
    # In a process of its own: threads of other tests may end while these are counted.
    script = """
import gc, sys
from pathlib import Path
from tests.executive.trace.synthetic import synthetic_events
from tests.executive.trace.viewer.test_sink import written
for number in range(4):
    written(Path(sys.argv[1]) / str(number), synthetic_events())
    gc.collect()
    print(len(list(Path("/proc/self/task").iterdir())))
"""
    command = [sys.executable, "-c", script, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    counts = [int(line) for line in run.stdout.split()]
    assert len(counts) == 4
    assert counts[-1] == counts[0]
