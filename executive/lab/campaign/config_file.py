"""A campaign, read from its file; every mistake in it is named with file and key.

    title = "Drops at random"
    seeds = 100                         # 0 to 99; or a list of seeds
    minutes = 20                        # on the wall's clock; an episode that takes longer is ended

    [[domains]]
    domain = "grocery"                  # a name, or a folder beside this file
    problems = ["breakfast"]            # without any, the domain's own

    [faults]                            # what is broken, under a name
    "drop 0.3" = ["drop:p=0.3"]

    [estimators]                        # who looks; the name is enough where it says it
    none = {}
    small = { estimator = "vlm", vlm = "FOLDER" }

    [monitors]                          # what is made of looks: plain, consistent, full, or options of `run`: alpha,
    full = {}                           # threshold, memory, trust, max_looks_again, max_questions, guard
    doubtful = { alpha = 0.05, max_looks_again = 1 }

    [run]                               # other options of `run` for all episodes
    grasp_noise = 0.004

Each domain's problems meet all faults with all seeds, and each of these is played by every *configuration*: an
estimator with a monitor. One that does not look has no monitor, and is one configuration.
"""

from __future__ import annotations

import hashlib
import os
import reprlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.app.config import ESTIMATORS
from executive.app.estimators import EstimatorConfig, with_default_model
from executive.app.monitors import PRESETS, MonitorConfig, preset
from executive.app.worlds import parse_faults
from executive.domain.loader import load_domain
from executive.errors import InputError, nearest
from executive.lab.campaign.design import Campaign, Configuration, Episode, Place
from executive.util.files import home, read_toml

LARGEST = 1_000_000
"""Episodes of a campaign."""

_HEAD = 1 << 20
"""Bytes of each of a model's files that tell it from another model."""


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
    eyes = {(each.place, each.configuration.eye) for each in episodes if each.configuration.kind == "vlm"}
    for place, eye in sorted(eyes, key=str):
        with_default_model(eye or EstimatorConfig(), load_domain(place.where, place.which).subject)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Domain(_Table):
    domain: str
    problems: list[str] = []


class _Estimator(_Table):
    estimator: str | None = None
    vlm: str | None = None
    server: str | None = None
    translator: str = "templates"
    llm: str | None = None
    instructions: bool | str = True
    per_image: bool = False
    calibration: str | None = None
    cameras: list[str] = []
    abstention: bool = True


class _Monitor(_Table):
    alpha: float | None = None
    threshold: float | None = None
    memory: bool = True
    trust: str | None = None
    max_looks_again: int | None = Field(default=None, ge=0)
    max_questions: int | None = Field(default=None, ge=1)
    guard: bool = True


class _Run(_Table):
    home_pose: bool = True
    grasp_noise: float = 0.0
    max_replans: int | None = Field(default=None, ge=0)
    max_actions: int | None = Field(default=None, ge=1)
    max_cycles: int | None = Field(default=None, ge=1)
    max_looks: int | None = Field(default=None, ge=1)
    max_looks_again: int | None = Field(default=None, ge=0)
    max_questions: int | None = Field(default=None, ge=1)
    guard: bool = True


class _File(_Table):
    title: str = Field(min_length=1)
    about: str = ""
    seeds: int | list[int]
    minutes: float = Field(default=20.0, gt=0.0, le=100_000.0)
    domains: list[_Domain] = Field(min_length=1)
    faults: dict[str, list[str]] = {"no faults": []}
    estimators: dict[str, _Estimator] = {"oracle": _Estimator()}
    monitors: dict[str, _Monitor] = {"full": _Monitor()}
    run: _Run = _Run()


_PATIENCE = ("max_looks_again", "max_questions", "guard")
"""What a monitor's table says of looking, and not of what is made of looks."""

_TABLES: Mapping[str, type[_Table]] = {"domains": _Domain, "estimators": _Estimator, "monitors": _Monitor, "run": _Run}


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
            options=MappingProxyType(said.run.model_dump()),
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
            for which in said.problems or (None,):
                domain = load_domain(where, which)
                place = Place(domain.name, which or domain.task.problem, where, which, domain.fingerprint())
                if str(place) in places:
                    self._fail(f"domains.{number}", f"{place} is named twice")
                places[str(place)] = place
                for name, specs in self._said.faults.items():
                    try:
                        parse_faults(domain, specs)
                    except InputError as error:
                        self._fail(f"faults.{name}", f"in {place}: {error.message}")
        return tuple(places.values())

    def _configurations(self) -> tuple[Configuration, ...]:
        made = []
        for name, said in self._said.estimators.items():
            kind = said.estimator or name
            key = f"estimators.{name}"
            if kind not in ESTIMATORS:
                self._fail(key, f"say which estimator it is; {nearest(kind, ESTIMATORS)}")
            eye, model = self._eye(said, kind, key)
            if kind == "none":
                made.append(Configuration(name, "", kind))
                continue
            for title, options in self._said.monitors.items():
                monitor = self._monitor(title, options)
                # What one monitor for all is called goes without saying.
                told = title if len(self._said.monitors) > 1 else ""
                others = {key: getattr(options, key) for key in _PATIENCE if key in options.model_fields_set}
                made.append(Configuration(name, told, kind, eye, monitor, model, others))
        return tuple(made)

    def _eye(self, said: _Estimator, kind: str, key: str) -> tuple[EstimatorConfig | None, str]:
        options = said.model_dump(exclude={"estimator"})
        if kind != "vlm":
            if said.model_fields_set - {"estimator"}:
                self._fail(key, f"{kind!r} asks no model; options of an eye go with vlm")
            return None, ""
        if said.vlm is not None and said.server is None:
            options["vlm"] = str(self._beside(said.vlm))
        if isinstance(said.instructions, str):
            options["instructions"] = str(self._beside(said.instructions))
        options["cameras"] = tuple(said.cameras)
        if said.calibration is not None:
            options["calibration"] = self._beside(said.calibration)
        try:
            eye = EstimatorConfig(**options)
        except InputError as error:
            self._fail(key, error.message)
        folders = {}
        for place in self._said.domains:
            with suppress(InputError):  # no model comes with the domain; `check` says so when one is needed
                found = with_default_model(eye, load_domain(str(self._beside(place.domain))).subject)
                folders[found.vlm] = found.server is None
        digests = (model_digest(home(folder)) for folder, here in folders.items() if folder and here)
        return eye, " ".join(filter(None, digests))

    def _monitor(self, name: str, said: _Monitor) -> MonitorConfig:
        key = f"monitors.{name}"
        if said.model_fields_set <= {*_PATIENCE} and name in PRESETS:
            return preset(name)
        if not said.model_fields_set:
            self._fail(key, f"say what it does, or name one of Executive's own; {nearest(name, PRESETS)}")
        trust = None if said.trust is None else self._beside(said.trust)
        try:
            return MonitorConfig(said.alpha, said.threshold, said.memory, trust)
        except InputError as error:
            self._fail(key, error.message)

    def _beside(self, name: str) -> Path:
        """What lies beside the campaign's file, if it is there; else what a command line would mean by it."""
        there = self._path.parent / name
        return there if os.path.exists(there) else Path(name)

    def _misread(self, error: ValidationError) -> NoReturn:
        # A misspelt key is also a missing one: the first is what to say.
        first = min(error.errors(), key=lambda entry: entry["type"] != "extra_forbidden")
        key = tuple(str(part) for part in first["loc"] if part not in ("int", "list[int]"))
        if first["type"] == "extra_forbidden":
            table = _File if len(key) == 1 else _TABLES[key[0]]
            self._fail(".".join(key), f"unknown key; {nearest(key[-1], table.model_fields)}")
        if first["type"] == "missing":
            self._fail(".".join(key), "is missing")
        should = first["msg"].partition(" should ")[2] or first["msg"]
        self._fail(".".join(key), f"should {should}, got {reprlib.repr(first['input'])}")

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
