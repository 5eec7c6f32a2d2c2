"""What a campaign is: problems, faults, seeds, and contenders that all meet the same of these.

A *contender* is an estimator with a monitor; one that does not look has no monitor. The file that says all this is read
by `executive.lab.campaign.config_file`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from executive.app.estimators import EstimatorConfig
from executive.app.monitors import MonitorConfig
from executive.app.run import RunConfig
from executive.trace.record.codec import encode


@dataclass(frozen=True, slots=True)
class Place:
    """A problem of a domain, by their names; `where` and `which` are what a run calls them, `files` tells whether they
    are what they were."""

    domain: str
    problem: str
    where: str
    which: str | None = None
    files: str = ""

    def __str__(self) -> str:
        return f"{self.domain}/{self.problem}"


@dataclass(frozen=True, slots=True)
class Contender:
    """An estimator with a monitor, by their names and as a run has them. One that does not look has no monitor."""

    estimator: str
    monitor: str = ""
    kind: str = "oracle"
    eye: EstimatorConfig | None = None
    judge: MonitorConfig = field(default_factory=MonitorConfig)
    model: str = ""
    """Tells whether the eye's model is what it was."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Other options of `RunConfig` that it has for itself."""
    faults: tuple[str, ...] = ()
    """What is broken for it alone, and is no strike: an eye that errs, say, or bad pictures."""

    def __str__(self) -> str:
        return f"{self.estimator}, {self.monitor}" if self.monitor else self.estimator


@dataclass(frozen=True, slots=True)
class Episode:
    """One run of a campaign."""

    place: Place
    faults: str
    contender: Contender
    seed: int
    config: RunConfig

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from all others of its campaign, in the order of `KEYS`."""
        who = self.contender
        return (self.place.domain, self.place.problem, self.faults, who.estimator, who.monitor, str(self.seed))


KEYS = ("domain", "problem", "faults", "estimator", "monitor", "seed")


@dataclass(frozen=True, slots=True)
class Campaign:
    """Everything that a campaign plays. `options` are those of `RunConfig` that hold for all episodes, `minutes` how
    long one may take on the wall's clock."""

    title: str
    seeds: tuple[int, ...]
    places: tuple[Place, ...]
    contenders: tuple[Contender, ...]
    faults: Mapping[str, tuple[str, ...]]
    options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    minutes: float = 20.0
    about: str = ""

    def episodes(self) -> Iterator[Episode]:
        """All of them, seed by seed: what is there after a while is a smaller campaign of the same kind."""
        for seed in self.seeds:
            for place in self.places:
                for faults, specs in self.faults.items():
                    for who in self.contenders:
                        config = RunConfig(
                            place.where,
                            place.which,
                            seed,
                            who.kind,
                            (*specs, *who.faults),
                            eye=who.eye,
                            monitor=who.judge,
                            viewer=False,
                            **{**self.options, **who.options},
                        )
                        yield Episode(place, faults, who, seed, config)

    @property
    def size(self) -> int:
        """How many episodes there are."""
        return len(self.seeds) * len(self.places) * len(self.faults) * len(self.contenders)

    def described(self) -> dict[str, Any]:
        """What decides an episode, by the names that its key has."""
        contenders = {
            str(who): {
                "estimator": who.kind,
                "eye": None if who.eye is None else _named(_told(encode(who.eye))),
                "model": who.model,
                "monitor": None if who.kind == "none" else _named(encode(who.judge)),
                "options": dict(who.options),
                **({"faults": list(who.faults)} if who.faults else {}),
            }
            for who in self.contenders
        }
        return {
            "places": {str(place): place.files for place in self.places},
            "faults": {name: list(specs) for name, specs in self.faults.items()},
            "contenders": contenders,
            "options": dict(self.options),
        }


def _named(options: dict[str, Any]) -> dict[str, Any]:
    """Options with the names of files and folders alone: where they lie makes no difference."""
    told = {key: options.get(key) for key in ("vlm", "calibration", "trust", "instructions")}
    paths = {key: Path(value) for key, value in told.items() if isinstance(value, str)}
    return {**options, **{key: path.name for key, path in paths.items() if os.path.exists(path)}}


def _told(eye: dict[str, Any]) -> dict[str, Any]:
    """What an eye's options are, without those that came later and say nothing: a campaign that was begun before is
    still the same."""
    later: dict[str, Any] = {"cameras": [], "abstention": True}
    return {key: value for key, value in eye.items() if key not in later or value != later[key]}
