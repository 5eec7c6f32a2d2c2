"""What meets the same faults in the closed loop: estimators of known and unknown quality, with monitors that build on
each other. Every episode is a run that `executive run` would repeat, by the command in its row."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from executive.app import sensor_fit
from executive.app.config import EstimatorConfig, MonitorConfig
from executive.app.estimators import shipped
from executive.app.sensor_fit import SensorFit
from executive.belief.conformal import Conformal
from executive.belief.sensor_model import ErrorModel, SensorModel
from executive.domain.loader import load_domain
from executive.lab.campaign.config_file import model_digest
from executive.lab.campaign.design import Campaign, Configuration, Place
from executive.s3e import Calibration

FLIPS = (0.02, 0.05, 0.1)
PLAIN, CONSISTENT, REMEMBERING, FULL = "plain threshold", "+ consistency", "+ memory", "+ looking again"
SETTINGS = (PLAIN, CONSISTENT, REMEMBERING, FULL)
ORACLE, SHIPPED = "oracle", "shipped model"
FAULTS = {
    "mujoco": ("drop:p=0.15", "miss:p=0.1", "shove:p=0.05"),
    "symbolic": ("no-effect:p=0.25", "exogenous:p=0.05"),
}
"""By the world in which they happen."""

PREDICATES = ("on-table", "robot-gripping", "robot-gripper-empty")

_JUDGES = {
    PLAIN: MonitorConfig(threshold=0.5),
    CONSISTENT: MonitorConfig(memory=False),
    REMEMBERING: MonitorConfig(),
    FULL: MonitorConfig(),
}


class Looking(NamedTuple):
    """An estimator: by its name, how it comes to err, and the file with its sensor model (None: as far as what
    it is made of says)."""

    name: str
    kind: str
    faults: tuple[str, ...] = ()
    calibration: Path | None = None


def flipped(share: float) -> str:
    return f"{share:.0%} flipped"


def oracles(folder: Path) -> list[Looking]:
    """The oracle as it is, and with shares of its answers turned around; calibration files go into the folder."""
    made = [Looking(ORACLE, "oracle")]
    for share in FLIPS:
        file = folder / f"flipped-{share:g}.json"
        error_models = dict.fromkeys(PREDICATES, ErrorModel(share, share))
        model = SensorModel(error_models, correlation_within=0.0)
        sensor_fit.save(file, "grocery", SensorFit(model, Conformal(), 0))
        made.append(Looking(flipped(share), "oracle", (f"estimator:wrong,share={share:g}@0-",), file))
    return made


def spoiled(way: str, known: SensorFit, folder: Path) -> Looking:
    """The shipped model whose pictures are spoiled, such as blurred=5, with what was learned of it."""
    draft = sensor_fit.save(folder / "draft.json", "grocery", known, Calibration.load(Path(str(shipped("grocery")))))
    file = folder / f"{way}-{zlib.crc32(draft.read_bytes()):08x}.json"  # another calibration is another configuration
    draft.replace(file)
    how, _, amount = way.partition("=")
    return Looking(f"model, {how} {amount}", "vlm", (f"camera:{how},amount={amount}@0-",), file)


def campaign(
    world: str, places: Sequence[Place], estimators: Sequence[Looking], seeds: int, faults: Sequence[str] | None = None
) -> Campaign:
    """All estimators with all settings in one of the worlds, with its `FAULTS` where none are given."""
    return Campaign(
        title="What a monitor is worth",
        seeds=tuple(range(seeds)),
        places=tuple(places),
        configurations=tuple(_configuration(estimator, setting) for estimator in estimators for setting in SETTINGS),
        faults=MappingProxyType({"faults": tuple(faults or FAULTS[world])}),
        options=MappingProxyType({"max_actions": 60, "world": world}),
    )


def grocery(problems: Sequence[str | None]) -> list[Place]:
    """Problems of the grocery domain; None is its default, six items on three tables.

    Raises:
        InputError: there is no such problem.
    """
    domains = [load_domain("grocery", name) for name in problems]
    return [
        Place("grocery", name or domain.task.problem, "grocery", name, domain.fingerprint())
        for name, domain in zip(problems, domains, strict=True)
    ]


def _configuration(estimator: Looking, setting: str) -> Configuration:
    judge, model = _JUDGES[setting], ""
    calibration = None if setting == PLAIN else estimator.calibration
    eye = EstimatorConfig(calibration=calibration) if estimator.kind == "vlm" or calibration is not None else None
    if estimator.kind == "vlm":
        model = model_digest(Path(str(shipped("grocery"))))
    return Configuration(
        estimator.name,
        setting,
        estimator.kind,
        eye,
        judge,
        model,
        {} if setting == FULL else {"max_looks_again": 0},
        estimator.faults,
    )
