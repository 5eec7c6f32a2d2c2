"""What a campaign is: problems, faults, seeds, and configurations that all meet the same of these.

A *configuration* is an estimator with a monitor; one that does not look has no monitor. The file that says all this is
read by `executive.lab.campaign.config_file`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from executive.app.config import EstimatorConfig, MonitorConfig
from executive.app.run import RunConfig
from executive.trace.record.codec import encode


@dataclass(frozen=True, slots=True)
class Place:
    """A problem of a domain by name; `where` and `which` are a run's arguments for them, `files` the digest of their
    files. `options` of `RunConfig` override those of the campaign."""

    domain: str
    problem: str
    where: str
    which: str | None = None
    files: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.domain}/{self.problem}"


@dataclass(frozen=True, slots=True)
class Configuration:
    """An estimator with a monitor: their names, and their settings of a run. One that does not look has no monitor."""

    estimator: str
    monitor: str = ""
    kind: str = "oracle"
    eye: EstimatorConfig | None = None
    monitor_config: MonitorConfig = field(default_factory=MonitorConfig)
    model: str = ""
    """The digest of the estimator's model."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of `RunConfig` that override those of the campaign."""
    faults: tuple[str, ...] = ()
    """Faults of this configuration alone, which are not scored: an estimator that errs, or bad pictures."""

    def __str__(self) -> str:
        return f"{self.estimator}, {self.monitor}" if self.monitor else self.estimator


@dataclass(frozen=True, slots=True)
class Episode:
    """One run of a campaign."""

    place: Place
    faults: str
    configuration: Configuration
    seed: int
    config: RunConfig

    @property
    def key(self) -> tuple[str, ...]:
        """The values of `KEYS`, which identify it in its campaign."""
        who = self.configuration
        return (self.place.domain, self.place.problem, self.faults, who.estimator, who.monitor, str(self.seed))


KEYS = ("domain", "problem", "faults", "estimator", "monitor", "seed")


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign. `options` are those of `RunConfig` that hold for all episodes, `minutes` the wall-clock limit of
    one."""

    title: str
    seeds: tuple[int, ...]
    places: tuple[Place, ...]
    configurations: tuple[Configuration, ...]
    faults: Mapping[str, tuple[str, ...]]
    options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    minutes: float = 20.0
    about: str = ""

    def episodes(self) -> Iterator[Episode]:
        """All episodes, seed by seed, so that a part of them is a smaller campaign of the same kind."""
        for seed in self.seeds:
            for place in self.places:
                for faults, specs in self.faults.items():
                    for who in self.configurations:
                        config = RunConfig(
                            place.where,
                            place.which,
                            seed,
                            who.kind,
                            (*specs, *who.faults),
                            eye=who.eye,
                            monitor=who.monitor_config,
                            viewer=False,
                            **{**self.options, **place.options, **who.options},
                        )
                        yield Episode(place, faults, who, seed, config)

    @property
    def size(self) -> int:
        """The number of episodes."""
        return len(self.seeds) * len(self.places) * len(self.faults) * len(self.configurations)

    def described(self) -> dict[str, Any]:
        """Everything that episodes depend on, by the names in their keys; it is kept in the manifest."""
        configurations = {
            str(who): {
                "estimator": who.kind,
                "eye": None if who.eye is None else _named(_told(encode(who.eye))),
                "model": who.model,
                "monitor": None if who.kind == "none" else _named(encode(who.monitor_config)),
                "options": dict(who.options),
                **({"faults": list(who.faults)} if who.faults else {}),
            }
            for who in self.configurations
        }
        return {
            "places": {str(place): place.files for place in self.places},
            "faults": {name: list(specs) for name, specs in self.faults.items()},
            "contenders": configurations,
            "options": {**self.options, "policies": [_policy(each) for each in self.options.get("policies", ())]}
            if self.options.get("policies")
            else {name: value for name, value in self.options.items() if name != "policies"},
        }


def _policy(said: str) -> str:
    """A policy with what is in its file in place of where that is."""
    action, _, file = said.partition("=")
    content = Path(file).read_bytes() if os.path.isfile(file) else b""
    return f"{action}={hashlib.sha256(content).hexdigest()}"


def _named(options: dict[str, Any]) -> dict[str, Any]:
    """Options with the base names of files and folders: results do not depend on their location."""
    told = {key: options.get(key) for key in ("vlm", "calibration", "trust", "instructions")}
    paths = {key: Path(value) for key, value in told.items() if isinstance(value, str)}
    return {**options, **{key: path.name for key, path in paths.items() if os.path.exists(path)}}


def _told(eye: dict[str, Any]) -> dict[str, Any]:
    """An estimator's options without later ones that have their default, so that an older campaign still matches."""
    later: dict[str, Any] = {"cameras": [], "abstention": True}
    return {key: value for key, value in eye.items() if key not in later or value != later[key]}
