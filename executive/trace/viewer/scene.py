"""The scene in the viewer: bodies where they are, what the hand holds, where the arm is about to go, what each camera
saw and whether it took part in the last look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from executive.trace.record.pictures import jpegs
from executive.trace.story.last_look import LookLine
from executive.trace.viewer.blueprint import CAMERAS, DEPTH, WORLD
from executive.trace.viewer.colours import AMBER, BLUE, CYAN, DIM, RED, WHITE, Colour
from executive.trace.viewer.grasp_detection import Grip
from executive.trace.viewer.parts import mesh, pinhole, stamp, time_columns
from executive.trace.viewer.poses import PoseMarks
from executive.trace.viewer.text_panels import plain
from executive.types import (
    Camera,
    Event,
    FloatArray,
    Frame,
    LookKind,
    Motion,
    Observation,
    PointCloud,
    PosesEstimated,
    Scenery,
)

_STILL = 2e-4
"""A body whose pose (m, quaternion) differs by no more than this from what was logged last has not moved."""
_NOWHERE = np.full(7, np.nan)
_MARGIN = 0.006
"""m between an item and the box that is drawn around it in the hand."""
_DEPTHS, _FILL = (400.0, 2500.0), 0.3
"""mm from black to white, and the size of the points of a cloud as a share of what would leave no gaps."""
_DIRECT = frozenset({"straight", "line"})
"""What the arm calls motions that nothing had to be searched for."""


class Scene:
    """Logs what there is to see in space.

    Args:
        at_once: how many frames are sent together.
    """

    def __init__(self, record: rr.RecordingStream, at_once: int) -> None:
        self._record, self._at_once = record, at_once
        self._objects: Mapping[str, str] = {}
        self._boxes: dict[str, tuple[FloatArray, FloatArray]] = {}
        self._entities: dict[str, list[object]] = {}
        self._frames: list[tuple[Event, Mapping[str, FloatArray]]] = []
        self._poses: dict[str, FloatArray] = {}
        self._path: list[tuple[FloatArray, Colour]] = []
        self._grip = Grip(())
        self._pose_marks: PoseMarks | None = None
        self._sizes: dict[str, tuple[int, int]] = {}
        self._marked: dict[str, tuple[Colour, str]] = {}
        self.cameras: Sequence[Camera] = ()
        self.pictures: Sequence[str] = ()

    def begin(self, objects: Mapping[str, str]) -> None:
        """The task's objects by their types: whatever else moves is the robot."""
        self._objects = objects

    def show(self, scenery: Scenery) -> None:
        """Every shape, stored once."""
        self.cameras = scenery.cameras
        self._record.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        corners: dict[str, list[FloatArray]] = {}
        for index, geometry in enumerate(scenery.geometries):
            entity = [*self._body(geometry.body), plain(geometry.name) or f"part-{index}"]
            self._record.log(entity, mesh(geometry), static=True)
            if self._owner(geometry.body) and len(geometry.vertices):
                corners.setdefault(geometry.body, []).extend((geometry.vertices.min(0), geometry.vertices.max(0)))
        self._grip = Grip(tuple(corners))
        self._boxes = {body: (np.min(of, axis=0), np.max(of, axis=0)) for body, of in corners.items()}
        for camera in scenery.cameras:
            self._record.log(_camera(camera.name), *pinhole(camera), static=True)

    def frame(self, event: Event, frame: Frame) -> None:
        """Keep a frame until enough of them are there to be sent together."""
        poses = {body: pose for body, pose in frame.poses.items() if body in self._entities}
        self._frames.append((event, poses))
        before, now = self._grip.holds, self._grip.told(poses)
        if now != before:
            stamp(self._record, event)
            self._show_held(before, now)
        if len(self._frames) >= self._at_once:
            self.flush()

    def flush(self) -> None:
        """Send the frames that are still here."""
        moves: dict[str, list[tuple[int, FloatArray]]] = {}
        for number, (_, frame) in enumerate(self._frames):
            now = np.reshape([*frame.values()], (-1, 7))
            last = np.reshape([self._poses.get(body, _NOWHERE) for body in frame], (-1, 7))
            still = np.abs(now - last).max(axis=1, initial=0.0) <= _STILL  # nothing is, compared with nowhere
            for body, stays in zip(frame, still, strict=True):
                if not stays:
                    self._poses[body] = frame[body]
                    moves.setdefault(body, []).append((number, frame[body]))
        times: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # the arm's links have theirs in common
        for body, rows in moves.items():
            poses = np.stack([pose for _, pose in rows]).astype(np.float32)
            transforms = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, [4, 5, 6, 3]])
            when = tuple(number for number, _ in rows)
            if when not in times:
                times[when] = time_columns([self._frames[number][0] for number in when])
            self._record.send_columns(rr.new_entity_path(self._body(body)), times[when], transforms)
        self._frames.clear()

    def show_pictures(self, observation: Observation) -> None:
        self.pictures = list(dict.fromkeys([*self.pictures, *map(plain, observation.images)]))
        for name, encoded in jpegs(observation).items():
            height, width = observation.images[name].shape[:2]
            self._sizes[plain(name)] = width, height
            self._record.log(_camera(name), rr.EncodedImage(contents=encoded, media_type="image/jpeg"))
        for name, depth in observation.depth.items():
            # Beside the picture, so that either can be looked at; in a view of space it would be a cloud of points.
            cloud = rr.DepthImage(
                depth, meter=1000.0, depth_range=_DEPTHS, colormap="grayscale", point_fill_ratio=_FILL
            )
            self._record.log([*_camera(name), DEPTH], cloud)

    def show_poses(self, estimate: PosesEstimated) -> None:
        """Where items are taken to be."""
        self._marks().show(estimate)

    def show_cloud(self, cloud: PointCloud) -> None:
        """What depth cameras measured of them."""
        self._marks().show_cloud(cloud)

    def _marks(self) -> PoseMarks:
        if self._pose_marks is None:
            boxes = {self._owner(body): box for body, box in self._boxes.items()}
            self._pose_marks = PoseMarks(self._record, boxes)
        return self._pose_marks

    def show_look(self, look: LookLine, seen_in: Mapping[str, int], blinded: Mapping[str, str]) -> None:
        """Which cameras took part in a look: a frame around their pictures, and a word where a picture is an old one or
        tells nothing. A glance at what is carried is marked on its own cameras alone."""
        glance, cameras = look.kind is LookKind.GUARD, {plain(camera) for camera in look.cameras}
        for name, size in self._sizes.items():
            took_part, why = name in cameras, blinded.get(name, "")
            if glance and not took_part:
                continue
            colour, caption = (AMBER, "glance") if glance else (BLUE, "") if took_part else (DIM, "")
            if why:
                colour, caption = RED, "left out"
            elif not took_part:
                caption = f"of look {seen_in.get(name, look.id)}"
            if self._marked.get(name) != (colour, caption):
                self._marked[name] = colour, caption
                self._mark(name, size, colour, caption)

    def _mark(self, name: str, size: tuple[int, int], colour: Colour, caption: str) -> None:
        width, height = size
        border = rr.Boxes2D(
            mins=[[1, 1]], sizes=[[width - 2, height - 2]], colors=colour, radii=rr.Radius.ui_points(1.5)
        )
        self._record.log([*_camera(name), "border"], border)
        below = rr.Points2D(
            [[width / 2, height * 0.78]], radii=0.0, colors=WHITE, labels=[plain(caption)], show_labels=bool(caption)
        )
        self._record.log([*_camera(name), "caption"], below)
        if any(plain(camera.name) == name for camera in self.cameras):
            self._record.log(_camera(name), rr.Pinhole.from_fields(color=colour))

    def begin_action(self) -> None:
        """What the arm did before is over."""
        if self._path:
            self._record.log([WORLD, "motion"], rr.Clear(recursive=True))
        self._path.clear()

    def show_motion(self, motion: Motion) -> None:
        """All motions of the current action: those that were searched for, and the straight ones between. Of a search,
        its tree, if it was asked for."""
        colour = AMBER if motion.planner.lower() in _DIRECT else BLUE
        self._path.append((motion.end_effector, colour))
        strips, colours = [path for path, _ in self._path], [colour for _, colour in self._path]
        radius = rr.Radius.ui_points(2.0)
        self._record.log([WORLD, "motion", "path"], rr.LineStrips3D(strips, colors=colours, radii=radius))
        if motion.tree is not None:
            tree = rr.LineStrips3D(list(motion.tree), colors=(*CYAN, 110), radii=rr.Radius.ui_points(0.6))
            self._record.log([WORLD, "motion", "tree"], tree)

    def _owner(self, body: str) -> str:
        """The task's object that a body is, or is a part of (`lemon/peel`); nothing for the robot and the room."""
        return next((name for name in (body, body.split("/")[0]) if name in self._objects), "")

    def _body(self, body: str) -> list[object]:
        """Return where a body with a shape hangs in the tree: among the task's objects by their type, or as part of the
        robot. All hang side by side, for all poses are the world's."""
        if body not in self._entities:
            owner = self._owner(body)
            kind = "room" if not body else self._objects[owner] if owner else "robot"
            names = ([owner] if owner else []) + ([body] if body else [])
            paths: list[list[object]] = [[WORLD, plain(kind), plain(name).replace("/", "-")] for name in names]
            taken = [str(path) for path in self._entities.values()]
            self._entities[body] = next((path for path in paths if str(path) not in taken), [WORLD, plain(kind)])
        return self._entities[body]

    def _show_held(self, before: str, now: str) -> None:
        if before in self._boxes:
            self._record.log([*self._body(before), "held"], rr.Clear(recursive=False))
        if now in self._boxes:
            low, high = self._boxes[now]
            around = rr.Boxes3D(
                mins=[low - _MARGIN],
                sizes=[high - low + 2 * _MARGIN],
                colors=CYAN,
                radii=rr.Radius.ui_points(1.5),
                labels=[plain(f"held: {self._owner(now)}")],
                show_labels=True,
            )
            self._record.log([*self._body(now), "held"], around)


def _camera(name: str) -> list[object]:
    return [*CAMERAS.split("/"), plain(name)]
