"""Assembles and executes a run from its configuration: the one place where domain, world, skills, planner, estimator,
monitor, faults and sinks come together. Everything that it builds can be built by hand; see README, "In Python"."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from executive.app.assembly import make_executive
from executive.app.config import (
    CONFIG,
    DEPTH,
    EXPECTED,
    EstimatorConfig,
    RunConfig,
    check_folder,
    make_folder,
    read_config,
)
from executive.app.estimators import open_estimator, with_default_model
from executive.app.identity import answered_by_tracks, asked_by_tags, trusting_tracks
from executive.app.monitors import open_monitor
from executive.app.planners import open_planner
from executive.app.resume import PastRun
from executive.app.worlds import make_setting, oracle_sensor_model
from executive.core.loop import Executive
from executive.core.run_state import RunState
from executive.core.time_limits import limit_estimator, limit_planner, limit_preparing, limit_skills
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.faults import (
    Fault,
    FaultInjector,
    faulty_estimator,
    faulty_planner,
    faulty_skills,
    faulty_world,
)
from executive.planning.feasible import FeasiblePlanner
from executive.planning.place_search import ExpectedCostSearch
from executive.protocols import Planner, Preparing, Recalling, Sink, Warming
from executive.relations.kinds import RelationKind, read_relation_kinds
from executive.trace.record import monitor_file
from executive.trace.record.frames import FrameLog
from executive.trace.record.log import EventLog
from executive.trace.record.snapshots import Snapshots
from executive.trace.record.thresholds import thresholds
from executive.trace.report.summary import SUMMARY_FILE, Collector, Summary, write_summary
from executive.types import Facts
from executive.util import requirements
from executive.util.profile import stage

if TYPE_CHECKING:
    from executive.app.depth_witness import DepthWitness
    from executive.app.marks import Marker
    from executive.belief import WitnessModel
    from executive.s3e import S3E, Backend
    from executive.s3e.backends.own_process import OwnProcess

__all__ = [
    "CONFIG",
    "Run",
    "RunConfig",
    "read_config",
    "resume",
    "run",
]


_FINDING_GROUPS, _ON_A_BUSY_MACHINE = 30.0, 4.0
"""Processor seconds that finding the mutex groups may take, and how many times as many wall seconds."""


class Run:
    """One assembled run, ready to `execute`. A context manager that frees what it holds.

    Args:
        vlm: an opened estimator for the configuration's "vlm"; without it, one is opened.
        view: the address of a Rerun viewer that shows the run live.
        folder: the folder of a run to resume (see `resume`); without it, a new folder is made.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the configuration has one, or the run's folder exists; or the run in `folder` cannot be resumed.
        MissingError: the machine lacks a package or a library.
    """

    _own: OwnProcess | None = None
    """The model, where this run has opened it."""

    _depth: DepthWitness | None = None
    """What depth tells, where poses are estimated."""

    def __init__(
        self,
        config: RunConfig,
        sinks: Sequence[Sink] = (),
        vlm: S3E | None = None,
        view: str | None = None,
        folder: Path | None = None,
    ) -> None:
        self.config = config
        if folder is None:
            check_folder(config)
        if config.viewer and view is not None:
            from executive.trace.viewer.late_sink import preload

            preload()
        log = None if folder is None else EventLog(folder, self._stop_recording_failed)  # locks the folder
        self._past = None if folder is None else PastRun.of(folder)
        with stage("read the domain"):
            self.domain = load_domain(config.domain, config.problem)
            setting = make_setting(self.domain, config)
        if self._past is not None:
            self._past.check(self.domain.task)
        estimator_config = None
        if config.estimator == "vlm":
            estimator_config = with_default_model(config.eye or EstimatorConfig(), self.domain.subject)
        self.monitor = None
        try:
            # Loading the model takes longest, and goes on in its own process while all else is set up.
            if estimator_config is not None and vlm is None:
                with stage("start the model's process"):
                    vlm = open_estimator(estimator_config, self.domain.subject, self._in_own_process)
            planner = open_planner(self.domain, config.planner)
            planner.warm_up()  # in the background
            if config.estimator != "none":
                patience = min(config.patience, config.settings().max_seconds)
                oracle = oracle_sensor_model(config)
                calibration = None if config.eye is None else config.eye.calibration
                with stage("find mutex groups"):
                    self.monitor = open_monitor(
                        config.monitor,
                        self.domain,
                        estimator_config,
                        min(_FINDING_GROUPS, patience),
                        oracle,
                        self._witness_models(),
                        calibration,
                        config.places,
                        min(_ON_A_BUSY_MACHINE * _FINDING_GROUPS, patience),
                    )
            first_observation = 0 if self._past is None else self._past.observations
            with stage("build the world"):
                self._stage = setting.open(first_observation)
        except BaseException:  # Ctrl-C too: the model's process ends with the run that it was opened for
            self._close_model()
            raise
        self.world, self.truth = self._stage.world, self._stage.truth
        self.folder = make_folder(config, self.domain) if folder is None else folder
        self._collector = Collector()
        try:
            if self._own is not None:
                with stage("set up the arm and the trace"):
                    self._warm_up()
                with stage("wait for the model"):  # before the run's clock begins: loading is no part of its time
                    self._own.ready()
            with stage("set up the arm and the trace"):
                self.executive = self._assemble(planner, setting.faults, vlm, sinks, view, log)
        except BaseException:  # Ctrl-C too: a run that never began leaves no folder, model or world
            self._close_model()
            if self._depth is not None:
                self._depth.close()
            self.world.close()
            if folder is None:
                shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with stage("close"):
            for sink in self._sinks:
                sink.close()
            self._close_model()
            if self._depth is not None:
                self._depth.close()
            self.world.close()
            requirements.give_back_memory()

    def _in_own_process(self, model: str) -> Backend:
        """Have a model loaded in a process of its own, while the rest of the run is set up."""
        from executive.s3e.backends.checkpoint import find
        from executive.s3e.backends.own_process import OwnProcess

        find(model)  # what is wrong with its files is said at once
        self._own = OwnProcess(model)
        return self._own

    def _warm_up(self) -> None:
        """Do what the first look and the first step would do first, while the model loads."""
        parts: tuple[object, ...] = (self.world, *self._stage.skills.values(), *self._stage.moves.values())
        for part in parts:
            if isinstance(part, Warming):
                part.warm_up(self.world.handle)
        requirements.give_back_memory()

    def _close_model(self) -> None:
        if self._own is not None:
            self._own.close()

    def cancel(self, why: str = "") -> None:
        """Stop the arm and end the run as interrupted; safe to call from a signal handler."""
        self.executive.cancel(why)

    def _stop_recording_failed(self, why: str) -> None:
        """End the run because its record cannot be written; it can be resumed once there is room again."""
        self.executive.cancel(why)

    def execute(self) -> Summary:
        """Execute the task, score the result against ground truth, and write `summary.json`."""
        if self._past is None or not self._past.is_over:  # otherwise it was killed between its end and its summary
            with stage("believe and decide"):
                self.executive.run()
        goal = self.domain.task.goal
        true = self.domain.task.derived.complete(self.truth.of(self.domain.task.atoms))
        goal_true = goal.truth(true) is True
        summary = self._collector.summary(goal_true)
        write_summary(self.folder, summary)
        return summary

    def _assemble(
        self,
        planner: Planner,
        injected: Sequence[Fault],
        vlm: S3E | None,
        sinks: Sequence[Sink],
        view: str | None,
        log: EventLog | None,
    ) -> Executive:
        config = self.config
        faults = FaultInjector(injected, self.world, config.seed)
        identical: Sequence[Sequence[str]] = ()
        if config.poses == DEPTH:
            self._depth, identical = self._estimate_poses(faults)
        if self.monitor is not None and identical and not config.marks:
            self.monitor = trusting_tracks(self.monitor, identical)
        recorders: list[Sink] = [
            Snapshots(self.folder, self.world, self._stop_recording_failed),
            log or EventLog(self.folder, self._stop_recording_failed),
            FrameLog(self.folder),
            self._collector,
        ]
        if config.viewer and view is not None:
            from executive.trace.viewer.sink import RerunSink

            recorders.append(RerunSink(self.folder, view, thresholds(self.monitor)))
        elif config.viewer:
            from executive.trace.viewer.late_sink import LateSink

            recorders.append(LateSink(self.folder, thresholds(self.monitor)))
        if self.monitor is not None:
            monitor_file.save(self.folder, self.monitor)
        self._sinks = (*recorders, *sinks)
        run_state = self._restore()
        estimator, initial = None, None
        if config.estimator == "none":  # the blind baseline is given the true initial state instead
            initial = self.truth.of(self.domain.task.atoms)
        else:
            estimator = vlm or self._stage.oracle
            if self._depth is not None and identical:
                from executive.app.localizer import localize

                depth = self._depth
                estimator = answered_by_tracks(
                    estimator,
                    localize(self.world),
                    asked_by_tags(estimator) if config.marks else lambda _, atoms: depth.told(atoms),
                    identical,
                    undecided=config.marks,
                )
        skills, moves = self._stage.skills, self._stage.moves
        preparing = [each for each in (*skills.values(), *moves.values(), self.world) if isinstance(each, Preparing)]
        return make_executive(
            self.domain.task,
            limit_planner(faulty_planner(self._feasible(planner), faults), config.patience),
            faulty_world(self.world, faults, self._marker(vlm, identical)),
            limit_skills(faulty_skills(skills, faults), config.patience, left=self._seconds_left),
            None
            if estimator is None
            else limit_estimator(
                faulty_estimator(estimator, faults),
                config.patience,
                self._seconds_left,
                end=(lambda: None) if self._own is None else self._own.end,
            ),
            sinks=self._sinks,
            settings=config.settings(),
            faults=faults,
            initial=initial,
            domain=self.domain.name,
            run=self.folder.name,
            monitor=self.monitor,
            attention=self._stage.attention,
            moves=moves,
            run_state=run_state,
            prepare=limit_preparing(preparing, self._seconds_left),
            witness=self._depth if self._sees_depth() else None,
            search=ExpectedCostSearch(self.domain.parsed) if config.search == EXPECTED else None,
        )

    def _sees_depth(self) -> bool:
        """Whether depth tells of atoms beside the model; the oracle knows already."""
        return self.config.poses == DEPTH and self.config.estimator == "vlm"

    def _witness_models(self) -> Mapping[str, WitnessModel]:
        """Return how those err that tell of atoms beside the estimator, by name."""
        if not self._sees_depth():
            return {}
        from executive.app.depth_witness import NAME, witness_model

        return {NAME: witness_model(self._relation_kinds())}

    def _estimate_poses(self, faults: FaultInjector) -> tuple[DepthWitness, Sequence[Sequence[str]]]:
        """Have skills act on what depth cameras see; return what that tells of atoms, and which items are identical."""
        from executive.app.depth_witness import DepthWitness
        from executive.app.localizer import estimate_poses

        scenes, identical = estimate_poses(self.world, faults, self._stage.placed, self.config.film)
        return DepthWitness(self.world, scenes, self._relation_kinds(), identical, self.config.marks), identical

    def _marker(self, vlm: S3E | None, identical: Sequence[Sequence[str]]) -> Marker | None:
        """Return what draws tags into the pictures, if these are asked for."""
        if not self.config.marks:
            return None
        from executive.app.marks import marker

        assert vlm is not None  # RunConfig has checked it
        return marker(self.world.localizer, vlm, self.domain.subject, identical)

    def _relation_kinds(self) -> Mapping[str, RelationKind]:
        return read_relation_kinds(self.domain.relations, self.domain.task.parameters, self.domain.files[0])

    def _seconds_left(self) -> float:
        """Return how many wall seconds the run has left."""
        return self.executive.seconds_left

    def _feasible(self, planner: Planner) -> Planner:
        """Return the planner without steps that put an item on a table it does not fit on."""
        if not self._stage.too_large:
            return planner
        return FeasiblePlanner(planner, self.domain.parsed.giving(self._stage.too_large), self._stage.too_large)

    def _restore(self) -> RunState | None:
        """Restore the world from its last snapshot, replay the record to the sinks, and return the run state; None for
        a new run.

        Raises:
            InputError: there is no snapshot of the world to resume from.
        """
        past, task = self._past, self.domain.task
        if past is None or past.started is None:
            return None
        since = past.resumed(past.restore(self.world))
        for event in past.events(images=True):
            for sink in self._sinks:
                if isinstance(sink, Recalling):
                    sink.recall(event)
        if self.monitor is None:
            return RunState(task, task.goal, past.assumed()).resumed(since)
        return RunState(task, task.goal, Facts(), past.memory(self.monitor)).resumed(since)


def run(config: RunConfig, sinks: Sequence[Sink] = ()) -> Summary:
    """Assemble a run and execute it."""
    with Run(config, sinks) as prepared:
        return prepared.execute()


def resume(folder: Path, sinks: Sequence[Sink] = (), view: str | None = None) -> Run:
    """Assemble a run whose process ended before the run did, so that it continues in its folder: the simulated world is
    that of the last snapshot, the robot looks first, and nothing that is done is done again.

    Raises:
        InputError: the run has ended by itself, another process is executing it, or `folder` is no run's folder.
    """
    config, past = read_config(folder), PastRun.of(folder)
    if past.ended is not None and past.is_over and (folder / SUMMARY_FILE).exists():
        raise InputError(f"the run has ended: {past.ended.outcome}", file=folder)
    return Run(config, sinks, view=view, folder=folder)
