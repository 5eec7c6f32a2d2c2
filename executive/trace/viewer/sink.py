"""The run in the Rerun viewer: a sink that writes `trace.rrd` while the run goes on.

Bodies' shapes are stored once; then only the poses of bodies that moved, many at a time. What is logged at one moment
carries three stamps: the loop's cycle, the world's clock and the process's clock. The world's clock stands still while
the robot looks and thinks, and may be put back when a run is resumed: of what happens without its going on, each event
is shown a tick after the last, so that all can be told apart and comes in order.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from textwrap import wrap

import rerun as rr

from executive.belief import Thresholds
from executive.errors import InputError
from executive.trace import phrases
from executive.trace.story.story import Standing, Story
from executive.trace.viewer import memory, text_panels
from executive.trace.viewer.beliefs import Beliefs
from executive.trace.viewer.blueprint import (
    BELIEF,
    CURVES,
    LOG,
    LOOK,
    NOW,
    PHASE,
    PLAN,
    STATUS,
    WORDS,
    Shown,
    blueprint,
)
from executive.trace.viewer.colours import COLOUR_OF, LANES, PURPLE, REACHED, TO_GO
from executive.trace.viewer.log_panel import LOG_WIDTH, log_lines
from executive.trace.viewer.parts import Lane, stamp
from executive.trace.viewer.places import Places
from executive.trace.viewer.plan_graph import Row, plan_graph, plan_rows
from executive.trace.viewer.process import TRACE_FILE
from executive.trace.viewer.scene import Scene
from executive.trace.viewer.text_panels import plain
from executive.types import (
    COMPILE,
    Belief,
    Compared,
    Decision,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    Frame,
    Judged,
    Looked,
    Motion,
    Observation,
    Payload,
    Phase,
    Plan,
    PointCloud,
    PosesEstimated,
    Scenery,
    SkillResult,
    Started,
    Timing,
)
from executive.util.files import legible

APPLICATION = "executive"
_FRAMES_AT_ONCE, _FRAMES_LIVE = 64, 2
_TICK, _TICK_LIVE = timedelta(seconds=60), timedelta(seconds=0.2)
"""How long a row waits for others to be written with, unless a decision comes first."""
_APART = 1e-6
"""Seconds from one event to the next while the world's clock stands still."""
_PATIENCE = 5.0
"""Wall seconds to wait for a live viewer that does not take what it is sent."""


class RerunSink:
    """Writes what happens into `trace.rrd` in the run's folder.

    Args:
        run: the run's folder; made when it is missing.
        viewer: the address of a viewer that is to show the run while it goes on, such as
            `rerun+http://127.0.0.1:9876/proxy`.
        thresholds: by predicate, above and below what an atom is taken for true and false; `""` is for all others.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(
        self, run: Path | str, viewer: str | None = None, thresholds: Mapping[str, Thresholds] | None = None
    ) -> None:
        path = Path(run) / TRACE_FILE
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=path) from None
        # A file grows by a kilobyte with each piece that is written; a live viewer should not have to wait for more.
        pieces = rr.ChunkBatcherConfig.DEFAULT()
        pieces.flush_tick = _TICK_LIVE if viewer else _TICK
        name = legible(path.parent.resolve().name)
        memory.sweep()  # those of earlier runs
        self._record = rr.RecordingStream(APPLICATION, recording_id=name, batcher_config=pieces)
        self._record.set_log_time_enabled(False)  # `wall` says when, and repeats
        self._record.set_log_tick_enabled(False)
        self._record.set_sinks(rr.FileSink(path), *([rr.GrpcSink(viewer)] if viewer else []))
        self._story = Story()
        self._arranged: object = None
        self._time = -_APART
        self._texts: dict[str, str] = {}
        self._rows: list[Row] = []
        self._scene = Scene(self._record, _FRAMES_LIVE if viewer else _FRAMES_AT_ONCE)
        self._beliefs = Beliefs(self._record, thresholds or {})
        self._places = Places(self._record)
        self._action = Lane(self._record, [NOW, "action"])
        self._phase = Lane(self._record, [NOW, PHASE])
        self._taken_up = Lane(self._record, [NOW, "plan"])
        self._seen = Lane(self._record, [NOW, "seen"])
        self._fault = Lane(self._record, [NOW, "fault"])
        self._goal: Lane | None = None

    def write(self, event: Event) -> None:
        self._story.tell(event)
        self._time = max(event.time, self._time + _APART)
        payload, event = event.payload, replace(event, time=self._time)
        if isinstance(payload, Frame):
            self._scene.frame(event, payload)
            return
        if isinstance(payload, SkillResult):
            self._scene.flush()
        self._beliefs.tell(event)
        stamp(self._record, event)
        match payload:
            case Started():
                self._places.begin(payload)
                self._scene.begin(payload.task.objects)
                self._record.send_recording_name(plain(payload.run))
            case Scenery():
                self._scene.show(payload)
            case Observation():
                self._scene.show_pictures(payload)
            case PosesEstimated():
                self._scene.show_poses(payload)
            case PointCloud():
                self._scene.show_cloud(payload)
            case Judged():
                self._places.show(payload)
                self._show_look()
            case Looked():
                self._show_look()
            case Plan():
                self._taken_up.enter(f"plan {len(self._story.plans)}", LANES[len(self._story.plans) % len(LANES)])
            case Dispatched():
                self._action.enter(phrases.step(payload.step))
                self._scene.begin_action()
            case Phase():
                self._phase.enter(payload.name)
            case FaultInjected():
                self._fault.enter(payload.spec, PURPLE)
            case Motion():
                self._scene.show_motion(payload)
            case Timing() if payload.stage == COMPILE:
                self._phase.leave()
            case SkillResult():
                self._phase.leave()
            case Compared():
                self._show_comparison(payload)
            case Decision():
                self._fault.leave()
            case Ended():
                self._show_end(payload)
        self._show_goal()
        for line in log_lines(payload, self._story):
            text = plain(" ".join(line.text.split())).strip(" ,:")
            for part in wrap(text, LOG_WIDTH, subsequent_indent="    ", break_on_hyphens=False):  # the viewer does not
                self._record.log(LOG, rr.TextLog(part, level=line.level, color=line.colour))
        if isinstance(payload, Plan | Dispatched | SkillResult | Compared | Decision | Ended):
            rows = plan_rows(self._story)
            if rows != self._rows:
                self._rows = rows
                self._record.log(PLAN, *plan_graph(rows))
        self._show_texts(payload)
        if isinstance(payload, Decision):
            self._flush()  # a run that is killed can be looked at up to its last decision

    def recall(self, event: Event) -> None:
        """Take in what an earlier process of this run recorded."""
        self.write(event)

    def close(self) -> None:
        self._scene.flush()
        self._beliefs.close()
        self._flush()
        self._record.disconnect()

    def _flush(self) -> None:
        with contextlib.suppress(RuntimeError, ConnectionError, TimeoutError):  # a viewer that was closed takes no more
            self._record.flush(timeout_sec=_PATIENCE)

    def _arrange(self, is_over: bool = False) -> None:
        """Lay the panels out, once it is known what there is to show, again when a camera shows up later, and at the
        end, when it is known how long the run was and which atoms tell its story."""
        story, cameras, pictures = self._story, self._scene.cameras, self._scene.pictures
        arranged = len(cameras), len(pictures), is_over
        if arranged != self._arranged:
            self._arranged = arranged
            shown = Shown(cameras, pictures, is_blind=story.is_blind, places=self._places.height)
            if is_over:
                goal = story.started.task.goal.atoms if story.started else ()
                words, curves = self._beliefs.telling(goal, WORDS, CURVES)
                shown = replace(shown, words=words, curves=curves, seconds=self._time)
            memory.send_blueprint(self._record, APPLICATION, blueprint(shown))

    def _show_look(self) -> None:
        seeing = self._story.seeing
        look = seeing.last
        if seeing.glance is not None and (look is None or seeing.glance.id > look.id):
            look = seeing.glance
        if look is not None:
            self._scene.show_look(look, seeing.seen_in, seeing.blinded)

    def _show_comparison(self, compared: Compared) -> None:
        standings = {line.standing for line in self._story.atoms()}
        worst = next((each for each in Standing if each in standings), Standing.EXPECTED)
        if compared.what != "preconditions" or worst is not Standing.EXPECTED:
            self._seen.enter(str(worst), COLOUR_OF[worst])
        self._beliefs.amiss(compared.verdict.violated | compared.verdict.unknown)

    def _show_goal(self) -> None:
        """How much of the goal is seen to hold, or is assumed to."""
        count = self._story.goal_count
        if count is not None:
            held, total = count
            self._goal = self._goal or Lane(self._record, [NOW, "goal-assumed" if self._story.is_blind else "goal"])
            self._goal.enter(f"{held} of {total}", REACHED if held == total else TO_GO)

    def _show_end(self, ended: Ended) -> None:
        self._action.leave()
        self._phase.leave()
        self._fault.leave()
        started, result = self._story.started, self._story
        self._record.send_property(
            "episode",
            rr.AnyValues(
                domain=started.domain if started else "",
                problem=started.task.problem if started else "",
                seed=started.seed if started else -1,
                estimator=started.estimator if started else "",
                outcome=str(ended.outcome),
                goal_seen=ended.goal_seen,
                unreached=len(ended.unreached),
                cycles=ended.cycles,
                actions=ended.actions,
                replans=ended.replans,
                retries=result.retries,
                looks=ended.looks,
                glances=result.glances,
                faults=len(result.faults),
                fault_specs=", ".join(plain(fault.spec) for _, fault in result.faults),
                sim_seconds=result.time,
            ),
        )

    def _show_texts(self, payload: Payload) -> None:
        """The panels that are text, each when it says something new."""
        self._tell(STATUS, text_panels.status(self._story))
        if isinstance(payload, Belief | Judged | Compared | Ended):
            self._arrange(isinstance(payload, Ended))
            self._tell(BELIEF, text_panels.belief(self._story))
        if isinstance(payload, Looked | Judged | Compared | Decision | Ended):
            self._tell(LOOK, text_panels.look(self._story))

    def _tell(self, panel: str, text: str) -> None:
        if self._texts.get(panel, "") != text:
            self._texts[panel] = text
            self._record.log(panel, rr.TextDocument(text, media_type="text/markdown"))
