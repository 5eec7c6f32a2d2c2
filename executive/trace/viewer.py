"""The run in the Rerun viewer: a sink that writes `trace.rrd` while the run goes on.

Bodies' shapes are stored once; then only the poses of bodies that moved, many at a time. What is logged at one moment
carries three stamps: the loop's cycle, the world's clock and the process's clock.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr

from executive.errors import InputError
from executive.trace import documents, viewer_blueprint
from executive.trace.documents import plain
from executive.trace.pictures import to_jpeg
from executive.trace.story import Standing, Story
from executive.trace.viewer_blueprint import (
    BELIEF,
    BELIEVED,
    CAMERAS,
    CYCLE,
    LOG,
    NOW,
    PLAN,
    PROBABILITY,
    SIM_TIME,
    STATUS,
    WALL,
    WORLD,
)
from executive.trace.viewer_colours import AMBER, BLUE, COLOUR_OF, DIM, GREEN, GREY, LANES, PURPLE, RED, WHITE, Colour
from executive.trace.viewer_parts import Lane, mesh, pinhole, time_columns
from executive.trace.viewer_plan import plan_graph
from executive.trace.viewer_process import TRACE_FILE
from executive.types import (
    Atom,
    Belief,
    Camera,
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    FloatArray,
    Frame,
    Motion,
    NoPlan,
    Observation,
    Phase,
    Plan,
    Questions,
    Scenery,
    SkillResult,
    Started,
    Timing,
)

APPLICATION = "executive"
_FRAMES_AT_ONCE = 64
_PATIENCE = 5.0
"""Wall seconds to wait for a live viewer that does not take what it is sent."""
_STILL = 2e-4
"""A body whose pose (m, quaternion) differs by no more than this from what was logged last has not moved."""


class RerunSink:
    """Writes what happens into `trace.rrd` in the run's folder.

    Args:
        run: the run's folder; made when it is missing.
        viewer: the address of a viewer that is to show the run while it goes on, such as
            `rerun+http://127.0.0.1:9876/proxy`.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, run: Path | str, viewer: str | None = None) -> None:
        path = Path(run) / TRACE_FILE
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None
        self._record = rr.RecordingStream(APPLICATION, recording_id=path.parent.resolve().name)
        self._record.set_log_time_enabled(False)  # `wall` says when, and repeats
        self._record.set_log_tick_enabled(False)
        self._record.set_sinks(rr.FileSink(path), *([rr.GrpcSink(viewer)] if viewer else []))
        self._at_once = 4 if viewer else _FRAMES_AT_ONCE
        self._story = Story()
        self._arranged, self._status = False, ""
        self._cameras: Sequence[Camera] = ()
        self._pictures: Sequence[str] = ()
        self._frames: list[tuple[Event, Frame]] = []
        self._poses: dict[str, FloatArray] = {}
        self._path: list[tuple[FloatArray, Colour]] = []
        self._beliefs = _Beliefs(self._record)
        self._action = Lane(self._record, [NOW, "action"])
        self._phase = Lane(self._record, [NOW, "phase"])
        self._taken_up = Lane(self._record, [NOW, "plan"])
        self._seen = Lane(self._record, [NOW, "seen"])
        self._stage = Lane(self._record, [NOW, "stage"])

    def write(self, event: Event) -> None:
        self._story.tell(event)
        payload = event.payload
        if isinstance(payload, Frame):
            self._frames.append((event, payload))
        if len(self._frames) >= self._at_once or isinstance(payload, SkillResult):
            self._send_frames()
        if isinstance(payload, Frame):
            return
        self._record.set_time(CYCLE, sequence=event.cycle)
        self._record.set_time(SIM_TIME, duration=event.time)
        self._record.set_time(WALL, duration=event.wall)
        match payload:
            case Started():
                self._record.send_recording_name(plain(payload.run))
            case Scenery():
                self._show_scenery(payload)
            case Questions():
                for warning in payload.warnings:
                    self._say(warning, "QUESTION", AMBER)
            case Observation():
                self._show_pictures(payload)
            case Belief():
                self._arrange()
                self._beliefs.add(event, payload)
                self._show_belief()
            case Plan():
                name = f"plan {len(self._story.plans)}"
                self._taken_up.enter(name, LANES[len(self._story.plans) % len(LANES)])
                self._say(f"{name}: {len(payload.steps)} steps", "PLAN", WHITE)
                self._show_plan()
            case NoPlan():
                self._say(f"no plan: {payload.reason} {payload.detail}", "PLAN", RED)
            case Dispatched():
                self._action.enter(documents.spoken(payload.step))
                self._stage.enter("skill")
                self._path.clear()
                self._show_plan()
            case Phase():
                self._phase.enter(payload.name)
            case Motion():
                self._show_motion(payload)
            case FaultInjected():
                self._say(f"{payload.spec}: {payload.detail}", "FAULT", PURPLE)
            case Timing():
                self._show_stage(event, payload)
            case SkillResult():
                if not payload.done:
                    self._say(f"{payload.step}: {payload.status}, {payload.reason}", "SKILL", RED)
                self._show_plan()
            case Compared():
                self._show_comparison(payload)
            case Decision():
                self._say(documents.log_line(payload), "DECISION", _colour(payload))
                self._show_plan()
            case Ended():
                self._show_end(payload)
        self._show_status()
        if isinstance(payload, Decision):
            self._flush()  # a run that is killed can be looked at up to its last decision

    def close(self) -> None:
        self._send_frames()
        self._flush()
        self._record.disconnect()

    def _flush(self) -> None:
        with contextlib.suppress(RuntimeError, ConnectionError, TimeoutError):  # a viewer that was closed takes no more
            self._record.flush(timeout_sec=_PATIENCE)

    def _show_scenery(self, scenery: Scenery) -> None:
        self._cameras = scenery.cameras
        self._record.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for index, geometry in enumerate(scenery.geometries):
            entity = [*self._body(geometry.body), plain(geometry.name) or f"part-{index}"]
            self._record.log(entity, mesh(geometry), static=True)
        for camera in scenery.cameras:
            self._record.log([*CAMERAS.split("/"), plain(camera.name)], *pinhole(camera), static=True)

    def _body(self, body: str) -> list[object]:
        """Where a body hangs in the tree: among the task's objects by their type, or else part of the robot."""
        if not body:
            return [WORLD, "room"]
        objects = self._story.started.task.objects if self._story.started else {}
        return [WORLD, plain(objects.get(body, "robot")), plain(body)]

    def _show_pictures(self, observation: Observation) -> None:
        self._pictures = [plain(name) for name in observation.images]
        for name, image in zip(self._pictures, observation.images.values(), strict=True):
            picture = rr.EncodedImage(contents=to_jpeg(image), media_type="image/jpeg")
            self._record.log([*CAMERAS.split("/"), name], picture)

    def _arrange(self) -> None:
        """Lay the panels out, once it is known what there is to show."""
        if not self._arranged:
            self._arranged = True
            self._record.send_blueprint(viewer_blueprint.blueprint(self._cameras, self._pictures))

    def _send_frames(self) -> None:
        moves: dict[str, list[tuple[Event, FloatArray]]] = {}
        for event, frame in self._frames:
            for body, pose in frame.poses.items():
                last = self._poses.get(body)
                if last is None or np.abs(pose - last).max() > _STILL:
                    self._poses[body] = pose
                    moves.setdefault(body, []).append((event, pose))
        self._frames.clear()
        for body, rows in moves.items():
            poses = np.stack([pose for _, pose in rows]).astype(np.float32)
            transforms = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, [4, 5, 6, 3]])
            self._record.send_columns(
                rr.new_entity_path(self._body(body)), time_columns([event for event, _ in rows]), transforms
            )

    def _show_motion(self, motion: Motion) -> None:
        """All motions of the current action: those that were searched for, and the straight ones between."""
        straight = "straight" in motion.planner.lower() or len(motion.configurations) <= 2
        self._path.append((motion.end_effector, AMBER if straight else BLUE))
        strips, colours = [path for path, _ in self._path], [colour for _, colour in self._path]
        self._record.log([WORLD, "motion"], rr.LineStrips3D(strips, colors=colours, radii=0.003))

    def _show_stage(self, event: Event, timing: Timing) -> None:
        """A stage is told of when it is over; it began so much earlier on the process's clock."""
        if timing.stage != "skill":
            self._stage.enter_all([(replace(event, wall=event.wall - timing.seconds), timing.stage)])

    def _show_plan(self) -> None:
        self._record.log(PLAN, *plan_graph(self._story))

    def _show_comparison(self, compared: Compared) -> None:
        standings = {line.standing for line in self._story.atoms()}
        worst = next((each for each in Standing if each in standings), Standing.EXPECTED)
        if compared.what != "preconditions" or worst is not Standing.EXPECTED:
            self._seen.enter(str(worst), COLOUR_OF[worst])
        self._beliefs.show(compared.verdict.violated | compared.verdict.unknown)
        self._show_belief()

    def _show_belief(self) -> None:
        self._record.log(BELIEF, rr.TextDocument(documents.belief(self._story), media_type="text/markdown"))

    def _show_end(self, ended: Ended) -> None:
        self._action.leave()
        self._show_plan()
        self._say(f"{ended.outcome}: {ended.reason}", "END", GREEN if ended.goal_seen else RED)
        started = self._story.started
        self._record.send_property(
            "episode",
            rr.AnyValues(
                domain=started.domain if started else "",
                problem=started.task.problem if started else "",
                seed=started.seed if started else -1,
                estimator=started.estimator if started else "",
                outcome=str(ended.outcome),
                goal_seen=ended.goal_seen,
                actions=ended.actions,
                replans=ended.replans,
                looks=ended.looks,
                faults=len(self._story.faults),
            ),
        )

    def _show_status(self) -> None:
        status = documents.status(self._story)
        if status != self._status:
            self._status = status
            self._record.log(STATUS, rr.TextDocument(status, media_type="text/markdown"))

    def _say(self, text: str, level: str, colour: Colour) -> None:
        self._record.log(LOG, rr.TextLog(plain(" ".join(text.split())).strip(" ,:"), level=level, color=colour))


class _Beliefs:
    """What was believed over time of the atoms in play (those that changed, or were not as expected), each from the
    start on: P(true) as a curve, and in words as a lane."""

    def __init__(self, record: rr.RecordingStream) -> None:
        self._record = record
        self._past: dict[Atom, list[tuple[Event, float | None]]] = {}
        self._shown: dict[Atom, Lane] = {}

    def add(self, event: Event, belief: Belief) -> None:
        answers: dict[Atom, float | None] = {**belief.probability, **dict.fromkeys(belief.unanswered)}
        for atom, probability in answers.items():
            past = self._past.setdefault(atom, [])
            past.append((event, probability))
            if atom in self._shown:
                self._log(atom, probability)
            elif _word(past[0][1]) != _word(probability):
                self.show([atom])

    def show(self, atoms: Iterable[Atom]) -> None:
        for atom in sorted(set(atoms) - self._shown.keys()):
            self._shown[atom] = Lane(self._record, _entity(BELIEVED, atom), _WORDS)
            stepped = rr.components.InterpolationMode.StepAfter
            style = rr.SeriesLines(names=str(atom), interpolation_mode=stepped)
            self._record.log(_entity(PROBABILITY, atom), style, static=True)
            past = self._past.get(atom, [])
            self._shown[atom].enter_all([(event, _word(probability)) for event, probability in past])
            known = [(event, probability) for event, probability in past if probability is not None]
            if known:
                curve = rr.Scalars.columns(scalars=[probability for _, probability in known])
                times = time_columns([event for event, _ in known])
                self._record.send_columns(rr.new_entity_path(_entity(PROBABILITY, atom)), times, curve)

    def _log(self, atom: Atom, probability: float | None) -> None:
        self._shown[atom].enter(_word(probability))
        if probability is not None:
            self._record.log(_entity(PROBABILITY, atom), rr.Scalars(probability))


def _entity(root: str, atom: Atom) -> list[object]:
    """`root/on-table/lemon/wood-table`, which the viewer prints without escapes."""
    return [root, atom.predicate, *atom.args]


_WORDS = {"true": GREEN, "likely": (110, 150, 110), "unsure": AMBER, "unlikely": DIM, "false": (58, 62, 70)}


def _word(probability: float | None) -> str:
    """A probability in one word: five shares of it, and nothing where there is none."""
    if probability is None:
        return ""
    return next(word for word, least in zip(_WORDS, (0.9, 0.6, 0.4, 0.1, 0.0), strict=True) if probability >= least)


def _colour(decision: Decision) -> Colour:
    if documents.is_routine(decision):
        return GREY
    return GREEN if decision.kind is DecisionKind.STOP and decision.outcome == "goal-reached" else AMBER
