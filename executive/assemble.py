"""From a configuration to a finished run: the one place where domain, world, skills, planner, estimator, faults and
sinks are put together. Everything that it builds could be built by hand; see README, "In Python"."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from executive.attention import Attention
from executive.domain import Domain, load_domain
from executive.errors import DomainError, InputError, nearest
from executive.eye import EyeConfig, open_eye, settled
from executive.faults import (
    Fault,
    FaultInjector,
    faulty_estimator,
    faulty_planner,
    faulty_skills,
    faulty_world,
    parse_fault,
)
from executive.loop import Executive
from executive.monitoring import MonitorConfig, open_monitor
from executive.planning import FastDownwardPlanner
from executive.policy import Settings
from executive.protocols import Estimator, Sink, Skill
from executive.trace import monitors
from executive.trace.events import EventLog
from executive.trace.limits import thresholds
from executive.trace.report import Collector, Summary, write_summary
from executive.types import Facts

if TYPE_CHECKING:
    from executive.s3e.estimator import S3E
    from executive.sim.truth import Truth
    from executive.sim.world import MujocoWorld

CONFIG = "config.toml"
"""The file in a run's folder that says what it was asked to do."""

ESTIMATORS = ("oracle", "vlm", "none")


@dataclass(frozen=True, slots=True)
class RunConfig:
    """All that decides how a run goes; `config.toml` in the run's folder holds the same.

    `domain` is a folder or a shipped domain's name. `faults` are in the grammar of `executive.faults`. `grasp_noise`
    is a standard deviation in m. `runs` is where the run's own folder is made, `name` what it is called. `tree` has
    the trees that motions are searched for with in the trace. `eye` says how the estimator "vlm" sees, `monitor` what
    is made of what is seen.
    """

    domain: str
    problem: str | None = None
    seed: int = 0
    estimator: str = "oracle"
    faults: tuple[str, ...] = ()
    home_pose: bool = True
    grasp_noise: float = 0.0
    max_replans: int | None = None
    max_actions: int | None = None
    runs: Path = Path("runs")
    name: str | None = None
    viewer: bool = True
    tree: bool = False
    eye: EyeConfig | None = None
    monitor: MonitorConfig = field(default_factory=MonitorConfig)

    def __post_init__(self) -> None:
        if self.estimator not in ESTIMATORS:
            raise InputError(
                f"no estimator {self.estimator!r}; {nearest(self.estimator, ESTIMATORS)}", key="--estimator"
            )
        if self.estimator != "vlm" and self.eye is not None:
            raise InputError(
                f"{self.estimator!r} asks no model; --vlm and --server go with --estimator vlm", key="--estimator"
            )
        if not 0.0 <= self.grasp_noise <= 1.0:
            raise InputError(f"a standard deviation in m, from 0 to 1, not {self.grasp_noise}", key="--grasp-noise")
        if self.name is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._\-]*", self.name):
            raise InputError(f"{self.name!r} is no folder name of letters, digits, '.', '_' and '-'", key="--name")

    def settings(self) -> Settings:
        limits = {"max_replans": self.max_replans, "max_actions": self.max_actions}
        return Settings(seed=self.seed, **{key: value for key, value in limits.items() if value is not None})


class Run:
    """One run, put together and ready to `execute`. A context manager that frees what it holds.

    Args:
        seeing: the eye of an estimator "vlm", where it is open already.
        view: the address of a Rerun viewer that is to show the run while it goes on.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the configuration has one, or the run's folder exists.
        MissingError: the machine lacks something.
    """

    def __init__(
        self,
        config: RunConfig,
        sinks: Sequence[Sink] = (),
        seeing: S3E | None = None,
        view: str | None = None,
    ) -> None:
        self.config = config
        self.domain = load_domain(config.domain, config.problem)
        injected = parse_faults(self.domain, config.faults)
        planner = FastDownwardPlanner(self.domain.parsed)
        planner.warm_up()  # unified-planning takes seconds to import; meanwhile all else is made
        eye = None
        if config.estimator == "vlm":
            eye = settled(config.eye or EyeConfig(), self.domain.subject)
        self.monitor = None if config.estimator == "none" else open_monitor(config.monitor, self.domain, eye)
        # A model takes long to load and may be none: before anything that would have to be undone.
        if eye is not None and seeing is None:
            seeing = open_eye(eye, self.domain.subject)
        self.world, self.truth = _stage(self.domain, config, injected)
        self.folder = _make_folder(config, self.domain)
        self._collector = Collector()
        try:
            self.executive = self._put_together(planner, injected, seeing, sinks, view)
        except BaseException:  # Ctrl-C, too: a run that never began leaves no folder
            shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.world.close()

    def cancel(self) -> None:
        """Have the arm stop and the run end as interrupted; safe to call from a signal handler."""
        self.executive.cancel()

    def execute(self) -> Summary:
        """Carry the task out, score it by the simulator's truth, and write `summary.json`."""
        self.executive.run()
        goal = self.domain.task.goal
        goal_true = self.truth.of(tuple(goal)).entails(goal)
        summary = self._collector.summary(goal_true)
        write_summary(self.folder, summary)
        return summary

    def _put_together(
        self,
        planner: FastDownwardPlanner,
        injected: Sequence[Fault],
        seeing: S3E | None,
        sinks: Sequence[Sink],
        view: str | None,
    ) -> Executive:
        config = self.config
        recorders: list[Sink] = [EventLog(self.folder), self._collector]
        if config.viewer:
            from executive.trace.viewer import RerunSink

            recorders.append(RerunSink(self.folder, view, thresholds(self.monitor)))
        if self.monitor is not None:
            monitors.save(self.folder, self.monitor)
        estimator, initial = _eye(self.domain, config, self.truth, seeing)
        faults = FaultInjector(injected, self.world, config.seed)
        return Executive(
            self.domain.task,
            faulty_planner(planner, faults),
            faulty_world(self.world, faults),
            faulty_skills(load_skills(self.domain), faults),
            None if estimator is None else faulty_estimator(estimator, faults),
            sinks=(*recorders, *sinks),
            settings=config.settings(),
            faults=faults,
            initial=initial,
            domain=self.domain.name,
            run=self.folder.name,
            monitor=self.monitor,
            attention=load_attention(self.domain, self.world),
            moves=load_moves(self.domain),
        )


def run(config: RunConfig, sinks: Sequence[Sink] = ()) -> Summary:
    """Put a run together and carry it out."""
    with Run(config, sinks) as prepared:
        return prepared.execute()


def load_skills(domain: Domain) -> Mapping[str, Skill]:
    """Each action's skill, from the entry-point group `executive.skills`."""
    points = {point.name: point for point in entry_points(group="executive.skills")}
    return {action: points[skill].load() for action, skill in domain.skills.items()}


def load_moves(domain: Domain) -> Mapping[str, Skill]:
    """The skills that bring the arm out of the way, in turn, from the same group."""
    points = {point.name: point for point in entry_points(group="executive.skills")}
    return {name: points[name].load() for name in domain.looking.moves}


def load_attention(domain: Domain, world: MujocoWorld) -> Attention:
    """Where to look for what.

    Raises:
        DomainError: the domain names a camera that the scene does not have.
    """
    looking, cameras = domain.looking, [camera.name for camera in world.spec.cameras]
    for key, names in {"guard": looking.guard, **{f"closer.{name}": of for name, of in looking.closer.items()}}.items():
        for name in names:
            if name not in cameras:
                message = f"the scene has no camera {name!r}; {nearest(name, cameras)}"
                raise DomainError(message, file=domain.files[0], key=f"looking.{key}")
    return Attention(looking.closer, looking.carried, looking.guard)


def parse_faults(domain: Domain, specs: Sequence[str]) -> list[Fault]:
    """What is to be broken, of what there is in this problem and its scene.

    Raises:
        InputError: it is no such fault, or names what is not there.
    """
    from executive.sim.spec import read_scene

    scene = read_scene(domain.scene)
    items = [item.name for item in scene.items if item.name in domain.task.objects]
    tables, cameras = ([thing.name for thing in things] for things in (scene.tables, scene.cameras))
    return [parse_fault(spec, items, tables, cameras) for spec in specs]


def _stage(domain: Domain, config: RunConfig, faults: Sequence[Fault]) -> tuple[MujocoWorld, Truth]:
    from executive.sim.truth import Truth
    from executive.sim.world import MujocoWorld

    task = domain.task
    # What the problem's :init says of where things stand sets the stage; the robot has to see it for itself.
    placed = {atom.args[0]: atom.args[1] for atom in sorted(task.declared) if domain.relations[atom.predicate] == "on"}
    world = MujocoWorld(
        domain.scene,
        task.objects,
        seed=config.seed,
        placed=placed,
        grasp_noise=config.grasp_noise,
        home_pose=config.home_pose,
        blockings=sum(fault.kind == "block" for fault in faults),
        keep_trees=config.tree,
    )
    return world, Truth(world, domain.relations, task.parameters, domain.folder / "domain.toml")


def _eye(
    domain: Domain, config: RunConfig, truth: Truth, seeing: Estimator | None
) -> tuple[Estimator | None, Facts | None]:
    """The estimator; for the blind baseline none, and what it is told instead."""
    if config.estimator == "none":
        return None, truth.of(domain.task.atoms)
    if seeing is not None:
        return seeing, None
    from executive.sim.truth import Oracle

    return Oracle(truth), None


def _make_folder(config: RunConfig, domain: Domain) -> Path:
    """The run's folder, with its configuration in it."""
    if config.name is not None:
        names = [config.name]
    else:
        stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{domain.name}-{domain.task.problem}-{config.seed}"
        names = [stem, *(f"{stem}-{index}" for index in range(2, 100))]
    for name in names:
        folder = config.runs / name
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"cannot be made: {error.strerror}", file=folder) from error
        (folder / CONFIG).write_text(_toml(config), encoding="utf-8")
        return folder
    raise InputError("there is a run of this name already; choose another with --name", file=config.runs / names[0])


def read_config(run: Path) -> RunConfig:
    """The configuration of a run, from its folder.

    Raises:
        InputError: there is none in it, or a damaged one.
    """
    from pydantic import TypeAdapter, ValidationError

    file = run / CONFIG
    try:
        said = tomllib.loads(file.read_text(encoding="utf-8"))
        return TypeAdapter(RunConfig).validate_python(said)
    except FileNotFoundError:
        raise InputError("is missing: it is not known what the run was asked to do", file=file) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from None
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(first["msg"], file=file, key=".".join(map(str, first["loc"]))) from None
    except InputError as error:
        raise InputError(error.message, file=file, key=error.key) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not TOML: {error}", file=file) from None


def _toml(config: RunConfig) -> str:
    lines = ["# All that decides how this run went.", *_settings(config)]
    for name, table in (("eye", config.eye), ("monitor", config.monitor)):
        lines += ["", f"[{name}]", *_settings(table)] if table is not None else []
    return "\n".join(lines) + "\n"


def _settings(config: RunConfig | EyeConfig | MonitorConfig) -> list[str]:
    """A line for everything that is set. A JSON string, number, boolean or array of strings is a TOML one."""
    values = {field.name: getattr(config, field.name) for field in dataclasses.fields(config)}
    return [
        f"{name} = {json.dumps(str(value) if isinstance(value, Path) else value)}"
        for name, value in values.items()
        if value is not None and not isinstance(value, EyeConfig | MonitorConfig)
    ]
