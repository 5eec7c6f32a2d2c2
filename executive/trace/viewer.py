"""The run in the Rerun viewer: a sink that writes `trace.rrd` while the run goes on.

Bodies' shapes are stored once; then only the poses of bodies that moved, many at a time. What is logged at one moment
carries three stamps: the loop's cycle, the world's clock and the process's clock.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import rerun as rr

from executive.errors import InputError
from executive.monitor import Thresholds
from executive.trace import documents, viewer_blueprint, viewer_freed
from executive.trace.documents import plain
from executive.trace.story import Standing, Story
from executive.trace.viewer_beliefs import Beliefs
from executive.trace.viewer_blueprint import BELIEF, LOG, LOOK, NOW, PLAN, STATUS
from executive.trace.viewer_colours import COLOUR_OF, LANES, STAGES
from executive.trace.viewer_log import log_lines
from executive.trace.viewer_parts import Lane, stamp
from executive.trace.viewer_plan import plan_graph
from executive.trace.viewer_process import TRACE_FILE
from executive.trace.viewer_scene import Scene
from executive.types import (
    Belief,
    Compared,
    Decision,
    Dispatched,
    Ended,
    Event,
    Frame,
    Judged,
    Looked,
    Motion,
    Observation,
    Payload,
    Phase,
    Plan,
    Scenery,
    SkillResult,
    Started,
    Timing,
)

APPLICATION = "executive"
_FRAMES_AT_ONCE, _FRAMES_LIVE = 64, 2
_STAGE_NAMES = {"observe": "look", "estimate": "judge", "plan": "plan", "guard": "guard"}
"""The stages of the loop as the viewer calls them; "move" is what skills do."""
_TICK, _TICK_LIVE = timedelta(seconds=60), timedelta(seconds=0.2)
"""How long a row waits for others to be written with, unless a decision comes first."""
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
        # A file grows by a kilobyte with each piece that is written; whoever looks on does not want to wait for more.
        pieces = rr.ChunkBatcherConfig.DEFAULT()
        pieces.flush_tick = _TICK_LIVE if viewer else _TICK
        name = path.parent.resolve().name
        viewer_freed.sweep()  # those of earlier runs
        self._record = rr.RecordingStream(APPLICATION, recording_id=name, batcher_config=pieces)
        self._record.set_log_time_enabled(False)  # `wall` says when, and repeats
        self._record.set_log_tick_enabled(False)
        self._record.set_sinks(rr.FileSink(path), *([rr.GrpcSink(viewer)] if viewer else []))
        self._story = Story()
        self._arranged: object = None
        self._texts: dict[str, str] = {}
        self._scene = Scene(self._record, _FRAMES_LIVE if viewer else _FRAMES_AT_ONCE)
        self._beliefs = Beliefs(self._record, thresholds or {})
        self._action = Lane(self._record, [NOW, "action"])
        self._phase = Lane(self._record, [NOW, "phase"])
        self._taken_up = Lane(self._record, [NOW, "plan"])
        self._seen = Lane(self._record, [NOW, "seen"])
        self._stage = Lane(self._record, [NOW, "stage"], STAGES)

    def write(self, event: Event) -> None:
        self._story.tell(event)
        payload = event.payload
        if isinstance(payload, Frame):
            self._scene.frame(event, payload)
            return
        if isinstance(payload, SkillResult):
            self._scene.flush()
        self._beliefs.tell(event)
        stamp(self._record, event)
        match payload:
            case Started():
                self._scene.begin(payload.task.objects)
                self._record.send_recording_name(plain(payload.run))
            case Scenery():
                self._scene.show(payload)
            case Observation():
                self._scene.show_pictures(payload)
            case Looked() | Judged():
                self._show_look()
            case Plan():
                self._taken_up.enter(f"plan {len(self._story.plans)}", LANES[len(self._story.plans) % len(LANES)])
            case Dispatched():
                self._action.enter(documents.spoken(payload.step))
                self._stage.enter("move")
                self._scene.begin_action()
            case Phase():
                self._phase.enter(payload.name)
            case Motion():
                self._scene.show_motion(payload)
            case Timing():
                self._show_stage(event, payload)
            case SkillResult():
                self._phase.leave()
                self._stage.leave()
            case Compared():
                self._show_comparison(payload)
            case Ended():
                self._show_end(payload)
        for line in log_lines(payload, self._story):
            text = plain(" ".join(line.text.split())).strip(" ,:")
            self._record.log(LOG, rr.TextLog(text, level=line.level, color=line.colour))
        if isinstance(payload, Plan | Dispatched | SkillResult | Compared | Decision | Ended):
            self._record.log(PLAN, *plan_graph(self._story))
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

    def _arrange(self) -> None:
        """Lay the panels out, once it is known what there is to show, and again when a camera shows up later."""
        shown = len(self._scene.cameras), len(self._scene.pictures)
        if shown != self._arranged:
            self._arranged = shown
            layout = viewer_blueprint.blueprint(self._scene.cameras, self._scene.pictures)
            viewer_freed.send_blueprint(self._record, APPLICATION, layout)

    def _show_stage(self, event: Event, timing: Timing) -> None:
        """A stage is told of when it is over; it began so much earlier on the process's clock."""
        began, name = replace(event, wall=max(0.0, event.wall - timing.seconds)), _STAGE_NAMES.get(timing.stage, "")
        if timing.stage == "guard":
            self._stage.enter_all([(began, name), (event, "move")])
        elif timing.stage != "skill":
            self._stage.enter_all([(began, name or timing.stage), (event, "")])

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
        self._beliefs.show(compared.verdict.violated | compared.verdict.unknown)

    def _show_end(self, ended: Ended) -> None:
        self._action.leave()
        self._phase.leave()
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
        self._tell(STATUS, documents.status(self._story))
        if isinstance(payload, Belief | Judged | Compared | Ended):
            self._arrange()
            self._tell(BELIEF, documents.belief(self._story))
        if isinstance(payload, Looked | Judged | Compared | Decision | Ended):
            self._tell(LOOK, documents.look(self._story))

    def _tell(self, panel: str, text: str) -> None:
        if self._texts.get(panel, "") != text:
            self._texts[panel] = text
            self._record.log(panel, rr.TextDocument(text, media_type="text/markdown"))
