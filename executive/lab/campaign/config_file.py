"""A campaign, read from its file; every mistake in it is named with file and key.

    title = "Drops at random"
    seeds = 100                         # 0 to 99; or a list of seeds
    minutes = 20                        # on the wall's clock; an episode that takes longer is ended

    [[domains]]
    domain = "grocery"                  # a name, or a folder beside this file
    problems = ["breakfast"]            # without any, the domain's own; "FOLDER/*.pddl" for all files of a folder

    [faults]                            # what is broken, under a name
    "drop 0.3" = ["drop:p=0.3"]

    [estimators]                        # who looks; the name is enough where it says it
    none = {}
    small = { estimator = "vlm", vlm = "FOLDER" }

    [monitors]                          # what is made of looks: plain, consistent, full, or options of `run`: alpha,
    full = {}                           # threshold, memory, max_looks_again, max_questions, guard
    doubtful = { alpha = 0.05, max_looks_again = 1 }

    [run]                               # other options of `run` for all episodes
    grasp_noise = 0.004

Each domain's problems meet all faults with all seeds, and each of these is played by every *configuration*: an
estimator with a monitor. One that does not look has no monitor, and is one configuration.
"""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.app.config import ESTIMATORS, PRESETS, EstimatorConfig, MonitorConfig, RunConfig, preset
from executive.app.estimators import with_default_model
from executive.app.options import C, make, options, read_values
from executive.app.worlds import parse_faults
from executive.domain.loader import load_domain
from executive.errors import InputError, OptionError, nearest
from executive.lab.campaign.design import Campaign, Configuration, Episode, Place
from executive.util.files import home, read_toml
from executive.util.validation import first_mistake

LARGEST = 1_000_000
"""Episodes of a campaign."""

_HEAD = 1 << 20
"""Bytes of each of a model's files that go into its digest."""


def read_campaign(file: Path) -> Campaign:
    """Read a campaign's file, and check that there is all that it names.

    Raises:
        InputError: the first mistake, in one line with file and key.
        DomainError: a domain that it names has a mistake.
    """
    return _Reader(file).campaign()


def check(episodes: Iterable[Episode]) -> None:
    """Whether there is a model for each of these episodes that needs one.

    Raises:
        InputError: there is none.
    """
    asked = {
        (each.place.where, each.place.which, each.configuration.eye)
        for each in episodes
        if each.configuration.kind == "vlm"
    }
    for where, which, estimator in sorted(asked, key=str):
        with_default_model(estimator or EstimatorConfig(), load_domain(where, which).subject)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Domain(_Table):
    domain: str
    problems: list[str] = []


class _File(_Table):
    title: str = Field(min_length=1)
    about: str = ""
    seeds: int | list[int]
    minutes: float = Field(default=20.0, gt=0.0, le=100_000.0)
    domains: list[_Domain] = Field(min_length=1)
    faults: dict[str, list[str]] = {"no faults": []}
    estimators: dict[str, dict[str, Any]] = {"oracle": {}}
    monitors: dict[str, dict[str, Any]] = {"full": {}}
    run: dict[str, Any] = {}


_PATIENCE = ("max_looks_again", "max_questions", "guard")
"""Options of a run that a monitor's table may have: they say how much is looked at."""

_RUN = [
    name
    for name, each in options(RunConfig).items()
    if len(each.path) == 1
    # What the campaign says itself, what depends on the machine's speed, and where the run is kept.
    and name not in ("domain", "problem", "seed", "estimator", "faults", "max_seconds", "patience")
    and name not in ("runs", "name", "viewer", "tree")
]
"""Options of a run that all episodes have in common."""


class _Reader:
    def __init__(self, file: Path) -> None:
        self._path = file
        said = read_toml(file)
        try:
            self._said = _File.model_validate(said)
        except ValidationError as error:
            self._misread(error)

    def campaign(self) -> Campaign:
        said = self._said
        for table in ("faults", "estimators", "monitors"):
            names = getattr(said, table)
            if not names:
                self._fail(table, "is empty; leave it out, or name one")
            for name in names:
                if not name.strip() or not name.isprintable() or len(name) > 60:
                    self._fail(table, f"{name!r} is no name of up to 60 characters")
        made = Campaign(
            title=" ".join(said.title.split()),
            seeds=self._seeds(),
            places=self._places(),
            configurations=self._configurations(),
            faults=MappingProxyType({name: tuple(specs) for name, specs in said.faults.items()}),
            options=MappingProxyType(self._options()),
            minutes=said.minutes,
            about=" ".join(said.about.split()),
        )
        if made.size > LARGEST:
            self._fail("seeds", f"makes {made.size:,} episodes; a campaign has at most {LARGEST:,}")
        try:
            next(made.episodes())
        except InputError as error:
            self._fail("run", str(error))
        return made

    def _seeds(self) -> tuple[int, ...]:
        seeds = self._said.seeds
        if isinstance(seeds, int):
            if not 1 <= seeds <= LARGEST:
                self._fail("seeds", f"{seeds} is not a number of seeds from 1 on")
            return tuple(range(seeds))
        if not seeds or min(seeds) < 0 or len(set(seeds)) < len(seeds):
            self._fail("seeds", "a list of different seeds from 0 on is expected")
        return tuple(seeds)

    def _places(self) -> tuple[Place, ...]:
        places: dict[str, Place] = {}
        for number, said in enumerate(self._said.domains):
            where = str(self._beside(said.domain))
            for which in self._problems(said.problems, f"domains.{number}.problems") or (None,):
                domain = load_domain(where, which)
                name = which if which is not None and which in said.problems else domain.task.problem
                place = Place(domain.name, name, where, which, domain.fingerprint())
                if str(place) in places:
                    self._fail(f"domains.{number}", f"{place} is named twice")
                places[str(place)] = place
                for name, specs in self._said.faults.items():
                    try:
                        parse_faults(domain, specs)
                    except InputError as error:
                        self._fail(f"faults.{name}", f"in {place}: {error.message}")
        return tuple(places.values())

    def _problems(self, said: Iterable[str], key: str) -> list[str]:
        """The problems that are named; a pattern such as FOLDER/*.pddl stands for all files that it fits, in order."""
        found = []
        for name in said:
            if "*" not in name:
                found.append(name)
                continue
            files = sorted(glob.glob(str(self._path.parent / name))) or sorted(glob.glob(name))
            if not files:
                self._fail(key, f"there is no file {name}")
            found += files
        return found

    def _configurations(self) -> tuple[Configuration, ...]:
        made, monitors = [], {title: self._monitor_options(title) for title in self._said.monitors}
        for name, said in self._said.estimators.items():
            key = f"estimators.{name}"
            kind = said.get("estimator", name)
            if kind not in ESTIMATORS:
                self._fail(key, f"say which estimator it is; {nearest(str(kind), ESTIMATORS)}")
            eye, model = self._eye({each: said[each] for each in said if each != "estimator"}, kind, key)
            if kind == "none":
                made.append(Configuration(name, "", kind))
                continue
            for title, chosen in monitors.items():
                monitor = self._monitor(title, chosen)
                # What one monitor for all is called goes without saying.
                told = title if len(self._said.monitors) > 1 else ""
                others = {each: value for each, value in chosen.items() if each in _PATIENCE}
                made.append(Configuration(name, told, kind, eye, monitor, model, others))
        return tuple(made)

    def _eye(self, said: Mapping[str, Any], kind: str, key: str) -> tuple[EstimatorConfig | None, str]:
        if kind != "vlm" and said.keys() - ({"calibration"} if kind == "oracle" else set()):
            self._fail(key, f"{kind!r} asks no model; its options go with vlm")
        chosen = read_values(EstimatorConfig, said, self._path, key)
        if kind != "vlm":
            return (self._made(EstimatorConfig, self._with_files(chosen, ("calibration",)), key) if said else None), ""
        files = ("instructions", "calibration") if "server" in chosen else ("vlm", "instructions", "calibration")
        eye = self._made(EstimatorConfig, self._with_files(chosen, files), key)
        folders = {}
        for place in self._said.domains:
            with suppress(InputError):  # no model comes with the domain; `check` says so when one is needed
                found = with_default_model(eye, load_domain(str(self._beside(place.domain))).subject)
                folders[found.vlm] = found.server is None
        digests = (model_digest(home(folder)) for folder, here in folders.items() if folder and here)
        return eye, " ".join(filter(None, digests))

    def _monitor_options(self, name: str) -> dict[str, Any]:
        said, key = self._said.monitors[name], f"monitors.{name}"
        chosen = read_values(RunConfig, {each: said[each] for each in said if each in _PATIENCE}, self._path, key)
        others = {each: said[each] for each in said if each not in _PATIENCE}
        valid = [*options(MonitorConfig), *_PATIENCE]
        return {**chosen, **read_values(MonitorConfig, others, self._path, key, valid)}

    def _monitor(self, name: str, said: Mapping[str, Any]) -> MonitorConfig:
        chosen = {each: said[each] for each in said if each not in _PATIENCE}
        if not chosen and name in PRESETS:
            return preset(name)
        if not said:
            message = f"say what it does, or name one of Executive's own; {nearest(name, PRESETS)}"
            self._fail(f"monitors.{name}", message)
        return self._made(MonitorConfig, self._with_files(chosen, ("trust",)), f"monitors.{name}")

    def _options(self) -> dict[str, Any]:
        """Return what all episodes have in common, with defaults."""
        chosen = read_values(RunConfig, self._said.run, self._path, "run", _RUN)
        said = (each.partition("=") for each in chosen.get("policies", ()))
        chosen["policies"] = tuple(f"{action}{sign}{self._beside(file)}" for action, sign, file in said)
        return {name: chosen.get(name, options(RunConfig)[name].default) for name in _RUN}

    def _made(self, model: type[C], values: Mapping[str, Any], key: str) -> C:
        try:
            return make(model, values)
        except OptionError as error:
            self._fail(f"{key}.{error.option}", error.message)

    def _with_files(self, values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
        """Return the values with those files beside the campaign's file that are there."""
        found = {
            name: type(value)(self._beside(value))
            for name, value in values.items()
            if name in names and not isinstance(value, bool)
        }
        return {**values, **found}

    def _beside(self, name: str | Path) -> Path:
        """What lies beside the campaign's file, if it is there; else what a command line would mean by it."""
        there = self._path.parent / name
        return there if os.path.exists(there) else Path(name)

    def _misread(self, error: ValidationError) -> NoReturn:
        path, message = first_mistake(error, _File)
        self._fail(".".join(path), message)

    def _fail(self, key: str, message: str) -> NoReturn:
        raise InputError(message, file=self._path, key=key)


def model_digest(folder: Path) -> str:
    """Tells a model from another one in the same folder, without reading all of it: names, sizes, and how each file
    begins. Nothing for a model that is elsewhere."""
    if not os.path.isdir(folder):
        return ""
    content = hashlib.sha256()
    for file in sorted(path for path in folder.iterdir() if path.is_file()):
        with file.open("rb") as stream:
            content.update(f"{file.name} {file.stat().st_size} ".encode() + stream.read(_HEAD))
    return content.hexdigest()
