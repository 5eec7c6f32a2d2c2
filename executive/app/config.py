"""A run's configuration, and the folder that keeps it."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import time
from dataclasses import dataclass, field
from pathlib import Path

from executive.app.estimators import EstimatorConfig
from executive.app.monitors import MonitorConfig
from executive.core.settings import Settings
from executive.domain.loader import Domain, is_pddl
from executive.errors import InputError, nearest
from executive.util.atomic_write import write_atomic
from executive.util.files import check_writable, legible, read_toml, reason

CONFIG = "config.toml"
"""The file in a run's folder with its configuration."""

ESTIMATORS = ("oracle", "vlm", "none")

MUJOCO, SYMBOLIC_WORLD = WORLDS = ("mujoco", "symbolic")
"""The simulator, and the symbolic world, which plays any planning task without one."""

PATIENCE = 900.0
"""The default time limit of a look, a plan or an action, in wall seconds."""


@dataclass(frozen=True, slots=True)
class RunConfig:
    """The options of a run; `config.toml` in the run's folder has the same.

    Attributes:
        domain: a folder, or a shipped domain's name.
        problem: one of the domain's problems; without it, its default. Where `domain` is a PDDL file, another one.
        world: one of `WORLDS`; without it, the simulator, or the symbolic world where `domain` is a PDDL file.
        no_effect: in the symbolic world, how often an action does nothing, without its skill noticing.
        exogenous: in the symbolic world, how often another agent does something after an action.
        flip: in the symbolic world, how often an answer is the opposite of what is so.
        estimator: one of `ESTIMATORS`; without it, "vlm", or "oracle" in the symbolic world.
        faults: specifications in the grammar of `executive.faults`.
        home_pose: whether skills end at the home pose.
        grasp_noise: the standard deviation of grasp positions, in m.
        max_replans, max_actions, max_cycles, max_looks, max_seconds, max_looks_again, max_questions: limits of
            `executive.core.settings.Settings`.
        patience: the time limit of a look, a plan or an action, in wall seconds.
        guard: whether the hold guard looks at what is carried while it is carried.
        runs: the folder in which the run's folder is made.
        name: the name of the run's folder.
        viewer: whether the run is recorded for the Rerun viewer.
        tree: whether the recording has the search trees of motion planning.
        eye: the options of the estimator "vlm".
        monitor: the options of the monitor.

    Raises:
        InputError: a value is not valid, or two options exclude each other.
    """

    domain: str
    problem: str | None = None
    seed: int = 0
    estimator: str = ""
    faults: tuple[str, ...] = ()
    home_pose: bool = True
    grasp_noise: float = 0.0
    max_replans: int | None = None
    max_actions: int | None = None
    max_cycles: int | None = None
    max_looks: int | None = None
    max_seconds: float | None = None
    patience: float = PATIENCE
    max_looks_again: int | None = None
    max_questions: int | None = None
    guard: bool = True
    runs: Path = Path("runs")
    name: str | None = None
    viewer: bool = True
    tree: bool = False
    eye: EstimatorConfig | None = None
    monitor: MonitorConfig = field(default_factory=MonitorConfig)
    world: str = ""
    no_effect: float = 0.0
    exogenous: float = 0.0
    flip: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "world", self.world or (SYMBOLIC_WORLD if is_pddl(self.domain) else MUJOCO))
        is_symbolic = self.world == SYMBOLIC_WORLD
        object.__setattr__(self, "estimator", self.estimator or ("oracle" if is_symbolic else "vlm"))
        if self.world not in WORLDS:
            raise InputError(f"no world {self.world!r}; {nearest(self.world, WORLDS)}", key="--world")
        for name, most in {"no_effect": 1.0, "exogenous": 1.0, "flip": 0.49}.items():
            value, key = getattr(self, name), f"--{name.replace('_', '-')}"
            if not 0.0 <= value <= most:
                raise InputError(f"a share from 0 to {most:g}, not {value:g}", key=key)
            if value and not is_symbolic:
                raise InputError(f"goes with --world {SYMBOLIC_WORLD}", key=key)
        if is_symbolic and self.estimator == "vlm":
            raise InputError("the symbolic world has no pictures for a model", key="--estimator")
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
        if not 0.0 < self.patience < math.inf:
            raise InputError(f"seconds above zero, not {self.patience}", key="--patience")
        for name in ("seed", "max_replans", "max_actions", "max_cycles", "max_looks", "max_looks_again"):
            value, key = getattr(self, name), f"--{name.replace('_', '-')}"
            if value is not None and not 0 <= value < 2**63:  # TOML has no larger ones
                raise InputError(f"{value} is not a number from 0 to 2^63 - 1", key=key)
        if self.max_seconds is not None and not 0.0 <= self.max_seconds < math.inf:
            raise InputError(f"seconds from zero on, not {self.max_seconds}", key="--max-seconds")
        if self.max_questions is not None and self.max_questions < 1:
            raise InputError(f"at least one question a look, not {self.max_questions}", key="--max-questions")
        if self.name is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._\-]*", self.name):
            raise InputError(f"{self.name!r} is no folder name of letters, digits, '.', '_' and '-'", key="--name")

    def settings(self) -> Settings:
        names = (
            "max_replans",
            "max_actions",
            "max_cycles",
            "max_looks",
            "max_seconds",
            "max_looks_again",
            "max_questions",
        )
        limits = {name: value for name in names if (value := getattr(self, name)) is not None}
        if not self.guard:
            limits["guard_looks"] = 0
        return Settings(seed=self.seed, **limits)


def check_folder(config: RunConfig) -> None:
    """Check, before anything is loaded, that the run's folder can be made.

    Raises:
        InputError: nothing can be written there, or there is a run of that name.
    """
    check_writable(config.runs, "--runs")
    if config.name is not None and os.path.lexists(config.runs / config.name):
        raise _taken(config.runs / config.name)


def _taken(folder: Path) -> InputError:
    return InputError("there is a run of this name already; choose another with --name", file=folder)


def make_folder(config: RunConfig, domain: Domain) -> Path:
    """Make the run's folder, with its configuration in it, and return it."""
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
        except (OSError, ValueError) as error:
            raise InputError(f"cannot be made: {reason(error)}", file=folder, key="--runs") from error
        write_atomic(folder / CONFIG, _toml(config).encode())
        return folder
    raise _taken(config.runs / names[0])


def read_config(run: Path) -> RunConfig:
    """Read the configuration of a run from its folder.

    Raises:
        InputError: there is none in it, or a damaged one.
    """
    from pydantic import TypeAdapter, ValidationError

    file = run / CONFIG
    if not os.path.exists(file):
        raise InputError("is missing: the run's configuration is not known", file=file)
    said = read_toml(file)
    try:
        return TypeAdapter(RunConfig).validate_python(said)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(first["msg"], file=file, key=".".join(map(str, first["loc"]))) from None
    except InputError as error:
        raise InputError(error.message, file=file, key=error.key) from None


def _toml(config: RunConfig) -> str:
    lines = ["# All that decides how this run went.", *_settings(config)]
    for name, table in (("eye", config.eye), ("monitor", config.monitor)):
        lines += ["", f"[{name}]", *_settings(table)] if table is not None else []
    return "\n".join(lines) + "\n"


def _written(value: object) -> object:
    """Return the value as it is in the file, without lone surrogates, which paths may have and TOML may not."""
    if isinstance(value, tuple):
        return [_written(each) for each in value]
    return legible(str(value)) if isinstance(value, str | Path) else value


def _settings(config: RunConfig | EstimatorConfig | MonitorConfig) -> list[str]:
    """Return a line for each option that is set, as TOML: JSON strings, numbers, booleans and arrays of them are."""
    values = {field.name: getattr(config, field.name) for field in dataclasses.fields(config)}
    return [
        f"{name} = {json.dumps(_written(value))}".replace("\x7f", "\\u007f")
        for name, value in values.items()
        if value is not None and not isinstance(value, EstimatorConfig | MonitorConfig)
    ]
