"""A made-up run with everything that a trace can contain: two tables, three boxes, an arm, a drop and a replan.

No simulator and no planner: the arm is two links solved in closed form, pictures are boxes painted far to near. What
the sinks get to see has the same shapes as the real thing.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw

from executive.types import (
    Atom,
    Belief,
    Camera,
    Cause,
    Compared,
    Condition,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    FaultInjected,
    FloatArray,
    Frame,
    Geometry,
    Image,
    Motion,
    Observation,
    OutcomeKind,
    Payload,
    Phase,
    Plan,
    Reason,
    Revised,
    Scenery,
    SkillResult,
    SkillStatus,
    Started,
    Step,
    Task,
    Timing,
    Verdict,
)

ITEMS = {"cereal-box": (0.09, 0.04, 0.22), "milk-carton": (0.07, 0.07, 0.20), "lemon": (0.06, 0.06, 0.06)}
TABLES = {"wood-table": (0.55, 0.45), "white-table": (0.55, -0.45)}
COLOURS = {
    "cereal-box": (0.85, 0.45, 0.15, 1.0),
    "milk-carton": (0.85, 0.9, 1.0, 1.0),
    "lemon": (0.95, 0.85, 0.2, 1.0),
    "wood-table": (0.55, 0.38, 0.22, 1.0),
    "white-table": (0.88, 0.88, 0.86, 1.0),
}
TABLE_TOP, TABLE_SIZE = 0.4, (0.5, 0.6, 0.04)
SHOULDER, LINKS, HAND = 0.75, (0.5, 0.5), 0.16
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4)]
    + [(1, 5, 7), (1, 7, 3)],
    dtype=np.uint32,
)


def task() -> Task:
    objects = {**dict.fromkeys(ITEMS, "item"), **dict.fromkeys(TABLES, "table")}
    atoms = [Atom("on-table", (item, table)) for item in ITEMS for table in TABLES]
    atoms += [Atom("robot-gripping", (item,)) for item in ITEMS] + [Atom("robot-gripper-empty")]
    goal = Condition.parse("on-table(milk-carton,white-table)", "on-table(cereal-box,white-table)")
    return Task("grocery", "breakfast", objects, tuple(sorted(atoms)), goal)


def pick(item: str, table: str) -> Step:
    before = Facts.parse(f"on-table({item},{table})", "robot-gripper-empty()")
    after = Facts.parse(f"robot-gripping({item})", f"not on-table({item},{table})", "not robot-gripper-empty()")
    return Step.strips("pick", (item, table), before, after)


def place(item: str, table: str) -> Step:
    after = Facts.parse(f"on-table({item},{table})", "robot-gripper-empty()", f"not robot-gripping({item})")
    return Step.strips("place", (item, table), Facts.parse(f"robot-gripping({item})"), after)


@dataclass
class Tape:
    """Takes down events; holds the made-up world."""

    cameras: tuple[Camera, ...]
    events: list[Event] = field(default_factory=list)
    cycle: int = 0
    time: float = 0.0
    wall: float = 0.0
    looks: int = 0
    action: int = 0
    hand: FloatArray = field(default_factory=lambda: np.array([0.4, 0.0, 0.9]))
    gripper: float = 0.08
    items: dict[str, FloatArray] = field(default_factory=dict)
    held: str | None = None

    def emit(self, payload: Payload, wall: float = 0.001) -> None:
        self.wall += wall
        self.events.append(Event(self.cycle, self.time, self.wall, payload))

    def joints(self) -> FloatArray:
        x, y, z = self.hand
        reach, height = math.hypot(x, y), z + HAND - SHOULDER
        distance = min(math.hypot(reach, height), sum(LINKS) - 1e-6)
        elbow = math.acos((distance**2 - LINKS[0] ** 2 - LINKS[1] ** 2) / (2 * LINKS[0] * LINKS[1]))
        lift = math.atan2(height, reach) + math.atan2(LINKS[1] * math.sin(elbow), LINKS[0] + LINKS[1] * math.cos(elbow))
        return np.array([math.atan2(y, x), lift, elbow])

    def poses(self) -> dict[str, FloatArray]:
        yaw, lift, elbow = self.joints()
        about_z = np.array([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)])
        shoulder = np.array([0, 0, SHOULDER])
        forearm = shoulder + LINKS[0] * _heading(yaw, lift)
        wrist = forearm + LINKS[1] * _heading(yaw, lift - elbow)
        poses = {
            "upper-arm": np.concatenate([shoulder, _times(about_z, _pitch(lift))]),
            "forearm": np.concatenate([forearm, _times(about_z, _pitch(lift - elbow))]),
            "hand": np.concatenate([wrist, about_z]),
        }
        for side, sign in (("left-finger", 1), ("right-finger", -1)):
            offset = sign * self.gripper / 2 * np.array([-math.sin(yaw), math.cos(yaw), 0])
            poses[side] = np.concatenate([wrist + offset - [0, 0, HAND * 0.6], about_z])
        return poses | {item: np.array([*where, 1.0, 0, 0, 0]) for item, where in self.items.items()}

    def frame(self) -> None:
        self.emit(Frame(self.poses(), self.joints(), self.gripper), wall=0.01)

    def look(self, cause: str, belief: Facts, doubt: float = 0.02, unanswered: Sequence[Atom] = ()) -> int:
        """Take a look; believe `belief`, all but certainly."""
        images = {camera.name: paint(camera, self) for camera in self.cameras}
        self.emit(Timing("observe", 0.11), wall=0.11)
        self.emit(Observation(self.looks, self.time, images, self.joints(), cause), wall=0.01)
        self.emit(Timing("estimate", 0.03), wall=0.03)
        silent = frozenset(unanswered)
        said = {atom: 1 - doubt if value else doubt for atom, value in belief.items() if atom not in silent}
        self.emit(Belief(self.looks, said, silent, "oracle"))
        self.looks += 1
        return self.looks - 1

    def move(self, target: FloatArray, phase: str, seconds: float = 1.2, planned: bool = True) -> None:
        self.emit(Phase(phase, "", seconds))
        start, bow = self.hand.copy(), np.array([0, 0, 0.12 if planned else 0.0])
        shares = np.linspace(0, 1, max(2, round(seconds * 10)))
        path = np.stack([start + (target - start) * s + bow * 4 * s * (1 - s) for s in shares])
        configurations = np.column_stack([path, np.zeros_like(path)])
        planner = "RRT*" if planned else "straight"
        self.emit(Motion(configurations, path, seconds, planner, 0.2, 1.3), wall=0.25 if planned else 0.02)
        for point in path[1:]:
            self.time += seconds / (len(path) - 1)
            self.hand = point
            if self.held:
                self.items[self.held] = point - [0, 0, 0.02]
            self.frame()

    def compare(self, what: str, expected: Facts, belief: Facts, look: int) -> Verdict:
        wrong = frozenset(atom for atom, value in expected.items() if atom in belief and belief[atom] is not value)
        unknown = frozenset(atom for atom in expected if atom not in belief)
        verdict = Verdict(frozenset(expected) - wrong - unknown, wrong, unknown)
        self.emit(Compared(what, expected, verdict, look))
        return verdict

    def dispatch(self, step: Step, index: int, facts: Facts, attempt: int = 1) -> None:
        self.cycle += 1
        self.action += 1
        self.compare("preconditions", step.precondition.facts, facts, self.looks - 1)
        self.emit(Dispatched(step, self.action, attempt, index))

    def result(self, step: Step, status: SkillStatus, reason: str, began: float, planned: float = 0.0) -> None:
        seconds = self.time - began
        self.emit(Timing("skill", 0.6))
        self.emit(SkillResult(step, status, reason, seconds, max(planned, seconds)))

    def plan(self, steps: Sequence[Step]) -> None:
        self.emit(Timing("plan", 0.31), wall=0.31)
        self.emit(Plan(tuple(steps), float(len(steps)), "fast-downward", 0.31))


def synthetic_events(run: str = "2025-01-31-1200-s3") -> list[Event]:
    """The whole run: the cereal is dropped onto the wrong table on its way, seen there, and fetched again."""
    return list(_events(run))


@functools.cache
def _events(run: str) -> tuple[Event, ...]:
    tape, the_task = Tape(_cameras()), task()
    tape.items = {item: np.array([0.5, y, 0.0]) for item, y in zip(ITEMS, (0.35, 0.55, -0.6), strict=True)}
    for item, where in tape.items.items():
        where[2] = TABLE_TOP + ITEMS[item][2] / 2
    tape.emit(Started(run, "grocery", the_task, "oracle", 3, {"fault": "drop@2", "threshold": 0.5}), wall=1.8)
    tape.emit(scenery(tape.cameras), wall=0.05)
    tape.frame()
    stands = {"cereal-box": "wood-table", "milk-carton": "wood-table", "lemon": "white-table"}
    true = [Atom("on-table", pair) for pair in stands.items()]
    facts = Facts.closed([*true, Atom("robot-gripper-empty")], the_task.atoms)
    tape.look("start", facts)
    tape.emit(Decision(DecisionKind.CONTINUE, (Cause(Reason.ALL_KNOWN),)))
    steps = [step for item in ("cereal-box", "milk-carton") for step in _fetch(item, "wood-table", "white-table")]
    tape.plan(steps)

    facts = _carry_out(tape, steps[0], 0, facts)
    facts = _drop(tape, steps[1], 1, facts)
    tape.plan(steps)
    facts = _retry(tape, steps[0], 0, facts)
    for index, step in enumerate(steps[1:], start=1):
        facts = _carry_out(tape, step, index, facts)

    tape.cycle += 1
    look = tape.look("confirm the goal", facts)
    tape.compare("goal", the_task.goal.facts, facts, look)
    causes = (Cause(Reason.GOAL_SEEN),)
    tape.emit(Decision(DecisionKind.STOP, causes, tuple(the_task.goal.facts), OutcomeKind.GOAL_REACHED))
    tape.emit(Ended(OutcomeKind.GOAL_REACHED, causes, True, (), tape.cycle, tape.action, 1, tape.looks))
    return tuple(tape.events)


def _fetch(item: str, source: str, target: str) -> tuple[Step, Step]:
    return pick(item, source), place(item, target)


def _carry_out(tape: Tape, step: Step, index: int, facts: Facts, attempt: int = 1) -> Facts:
    """One step that works: its effects are seen."""
    tape.dispatch(step, index, facts, attempt)
    began, after = tape.time, facts | step.unconditional
    _act(tape, step)
    tape.result(step, SkillStatus.DONE, "", began)
    _check(tape, step, after, after)
    tape.emit(Decision(DecisionKind.CONTINUE, (Cause(Reason.AS_EXPECTED),), tuple(step.unconditional)))
    return after


def _drop(tape: Tape, step: Step, index: int, facts: Facts) -> Facts:
    """The gripper opens on the way; the item falls back onto the table that it came from."""
    tape.dispatch(step, index, facts)
    began, item = tape.time, step.args[0]
    tape.move(np.array([0.5, 0.2, 0.85]), "transfer", 1.0)
    tape.emit(FaultInjected("drop", "drop@2", tape.action, "the gripper opened in mid-transfer"))
    tape.held, tape.gripper = None, 0.08
    rest = np.array([0.5, 0.25, TABLE_TOP + ITEMS[item][2] / 2])
    for share in np.linspace(0, 1, 5)[1:]:
        tape.items[item] = tape.items[item] * (1 - share) + rest * share
        tape.time += 0.1
        tape.frame()
    tape.result(step, SkillStatus.DROPPED, "the gripper closed on nothing", began, planned=4.0)
    seen = facts | Facts.parse(f"not robot-gripping({item})", f"on-table({item},wood-table)", "robot-gripper-empty()")
    _check(tape, step, facts | step.unconditional, seen)
    evidence = (Atom("on-table", (item, "white-table")), Atom("on-table", (item, "wood-table")))
    tape.emit(Decision(DecisionKind.REPLAN, (Cause(Reason.EFFECT_MISSING, evidence[:1]),), evidence))
    tape.emit(Revised(seen, Facts({atom: value for atom, value in seen.items() if facts[atom] is not value})))
    return seen


def _retry(tape: Tape, step: Step, index: int, facts: Facts) -> Facts:
    """The first look cannot tell, the second one shows that the grasp missed; then it is done again, and works."""
    tape.dispatch(step, index, facts)
    began, after, gripping = tape.time, facts | step.unconditional, Atom("robot-gripping", (step.args[0],))
    _act(tape, step, grasp=False)
    tape.result(step, SkillStatus.GRASP_MISSED, "the fingers met", began)
    look = tape.look(f"after {step}", facts, unanswered=[gripping])
    tape.compare("effects", after, facts.without([gripping]), look)
    tape.emit(Decision(DecisionKind.LOOK_AGAIN, (Cause(Reason.CANNOT_TELL, (gripping,), (1,)),), (gripping,)))
    _check(tape, step, after, facts)
    tape.emit(Decision(DecisionKind.RETRY, (Cause(Reason.RETRY, count=2, total=3),), (gripping,)))
    return _carry_out(tape, step, index, facts, attempt=2)


def _check(tape: Tape, step: Step, expected: Facts, seen: Facts) -> None:
    look = tape.look(f"after {step}", seen)
    tape.compare("effects", expected, seen, look)


def _act(tape: Tape, step: Step, grasp: bool = True) -> None:
    item = step.args[0]
    if step.action == "pick":
        target = tape.items[item].copy()
    else:
        x, y = TABLES[step.args[1]]
        spot = {"cereal-box": -0.1, "milk-carton": 0.05, "lemon": 0.2}[item]
        target = np.array([x, y + spot, TABLE_TOP + ITEMS[item][2] / 2])
    above = target + [0, 0, 0.25]
    tape.emit(Phase("plan", "RRT*", 0.2), wall=0.2)
    tape.move(above, "approach" if step.action == "pick" else "transfer", 2.0)
    tape.move(target + [0, 0, 0.02], "reach", 0.6, planned=False)
    tape.emit(Phase("grip" if step.action == "pick" else "release", "", 0.3))
    tape.time += 0.3
    if step.action == "pick":
        tape.gripper = 0.05 if grasp else 0.0
        tape.held = item if grasp else None
    else:
        tape.gripper, tape.held = 0.08, None
    tape.frame()
    tape.move(above, "lift" if step.action == "pick" else "retreat", 0.6, planned=False)


def scenery(cameras: tuple[Camera, ...]) -> Scenery:
    def box(body: str, size: Sequence[float], rgba: tuple[float, ...], centre: Sequence[float] = (0, 0, 0)) -> Geometry:
        vertices = (_CORNERS * np.array(size) + np.array(centre)).astype(np.float32)
        return Geometry(body, vertices, _FACES, (rgba[0], rgba[1], rgba[2], rgba[3]))

    grey, dark = (0.62, 0.65, 0.68, 1.0), (0.2, 0.22, 0.25, 1.0)
    tables = [
        box("", TABLE_SIZE, COLOURS[name], (x, y, TABLE_TOP - TABLE_SIZE[2] / 2)) for name, (x, y) in TABLES.items()
    ]
    arm = [
        box("", (0.2, 0.2, SHOULDER), dark, (0, 0, SHOULDER / 2)),
        box("upper-arm", (LINKS[0], 0.09, 0.09), grey, (LINKS[0] / 2, 0, 0)),
        box("forearm", (LINKS[1], 0.07, 0.07), grey, (LINKS[1] / 2, 0, 0)),
        box("hand", (0.06, 0.12, 0.05), dark, (0, 0, -0.05)),
        box("left-finger", (0.03, 0.015, 0.08), dark),
        box("right-finger", (0.03, 0.015, 0.08), dark),
    ]
    items = [box(item, size, COLOURS[item]) for item, size in ITEMS.items()]
    return Scenery(tuple(tables + arm + items), cameras)


def paint(camera: Camera, tape: Tape) -> Image:
    """Boxes in perspective, far to near; the picture agrees with the camera's pose, field of view and axes."""
    eye, axes = np.array(camera.pose[:3]), _matrix(camera.pose[3:])
    sky = np.linspace((70, 80, 95), (30, 32, 38), camera.height)[:, None, :].repeat(camera.width, axis=1)
    picture = Picture.fromarray(sky.astype(np.uint8))
    draw, focal = ImageDraw.Draw(picture), camera.height / 2 / math.tan(camera.fovy / 2)
    poses, faces = tape.poses(), []
    for geometry in scenery(()).geometries:
        pose = poses.get(geometry.body, np.array([0.0, 0, 0, 1, 0, 0, 0]))
        points = (geometry.vertices @ _matrix(pose[3:]).T + pose[:3] - eye) @ axes
        for shade, triangle in enumerate(geometry.faces):
            corners = points[triangle]
            if np.all(corners[:, 2] < -0.05):
                pixels = corners[:, :2] / -corners[:, 2:] * focal * [1, -1] + [camera.width / 2, camera.height / 2]
                colour = tuple(round(255 * c * (0.6 + 0.4 * (shade // 2) / 5)) for c in geometry.rgba[:3])
                faces.append((corners[:, 2].mean(), [(float(u), float(v)) for u, v in pixels], colour))
    for _, polygon, colour in sorted(faces, key=lambda face: face[0]):
        draw.polygon(polygon, fill=colour)
    return np.asarray(picture)


def _cameras() -> tuple[Camera, ...]:
    def camera(name: str, eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
        back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
        right = np.cross([0, 0, 1], back) / np.linalg.norm(np.cross([0, 0, 1], back))
        return Camera(name, (*eye, *_quaternion(np.column_stack([right, np.cross(back, right), back]))), 0.85, 320, 240)

    return camera("overview", (1.7, 0.0, 1.3), (0.4, 0, 0.5)), camera("side", (0.9, -1.3, 0.9), (0.5, 0, 0.45))


def _heading(yaw: float, lift: float) -> FloatArray:
    return np.array([math.cos(yaw) * math.cos(lift), math.sin(yaw) * math.cos(lift), math.sin(lift)])


def _pitch(lift: float) -> FloatArray:
    return np.array([math.cos(lift / 2), 0.0, -math.sin(lift / 2), 0.0])


def _times(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def _matrix(quaternion: Sequence[float] | FloatArray) -> FloatArray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _quaternion(matrix: FloatArray) -> tuple[float, ...]:
    w = math.sqrt(max(0.0, 1 + matrix.trace())) / 2
    x, y, z = (
        math.copysign(math.sqrt(max(0.0, 1 + 2 * matrix[i, i] - matrix.trace())) / 2, matrix[j, k] - matrix[k, j])
        for i, j, k in ((0, 2, 1), (1, 0, 2), (2, 1, 0))
    )
    return w, x, y, z
