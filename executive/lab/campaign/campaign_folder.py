"""The folder of a campaign: the episodes that are there, those that are missing, and the work of playing these.

An episode depends on its seed and on the campaign's file alone, not on the worker that plays it, nor on the time: a
campaign that was killed resumes with the missing episodes, and one may be extended by more seeds, faults or
configurations. The manifest's key for configurations is `contenders`, as in former versions.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from pydantic import BaseModel, ValidationError

from executive.app.config import RunConfig
from executive.app.options import options
from executive.errors import InputError, OptionError, nearest
from executive.lab.campaign.design import Campaign, Episode
from executive.lab.campaign.episode import FAILED, Row, row_of
from executive.lab.campaign.rows import Rows, read_rows
from executive.lab.collection.collect import DECIDING, version_of
from executive.lab.collection.dataset import write_atomically
from executive.lab.common.folder_lock import lock, remove_partial
from executive.lab.common.process_pool import WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.util.files import legible, read_json
from executive.util.validation import first_mistake

MANIFEST, WORK = "campaign.json", ".work"
FORMAT = 1

_VERSIONS = (*DECIDING, "torch", "transformers", "unified-planning", "up-fast-downward")


class CampaignFolder:
    """A campaign in its checked folder, with the episodes that are there. A context manager that locks the folder.

    Args:
        command: the command that resumes it.
        warn: receives a line per damaged row.

    Raises:
        InputError: the folder holds something else, or another process plays in it.
    """

    def __init__(
        self, campaign: Campaign, out: Path, command: str, warn: Callable[[str], None] = lambda line: None
    ) -> None:
        self.campaign, self.out = campaign, out
        self._cancelled = False
        what = _what(campaign)
        _check_folder(out, what)
        self._lock = lock(out, "playing a campaign", command)
        try:
            remove_partial(out)
            self._rows = Rows(out, warn)
            document = {
                "format": FORMAT,
                "title": campaign.title,
                "about": campaign.about,
                "command": legible(command),
                "seeds": list(campaign.seeds),
                "episodes": campaign.size,
                "campaign": what,
            }
            write_atomically(out / MANIFEST, (json.dumps(document, indent=2) + "\n").encode())
            self._clear()
        except OSError as error:
            self.close()
            raise InputError(f"cannot be written to ({error.strerror})", file=out) from None
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> CampaignFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._clear()
        self._rows.__exit__()
        self.close()

    def close(self) -> None:
        """Releases the lock of the folder."""
        self._lock.release()

    def cancel(self) -> None:
        """Makes `play` stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    @property
    def work(self) -> Path:
        """The folder of running episodes; emptied before and afterwards."""
        folder = self.out / WORK
        folder.mkdir(exist_ok=True)
        return folder

    def wanted(self, only: Collection[str] = (), seeds: int | None = None) -> list[Episode]:
        """The episodes of the first `seeds` seeds and of the configurations in `only`; by default, all.

        Raises:
            InputError: there is no such configuration.
        """
        names = {name: who for who in self.campaign.configurations for name in (str(who), who.estimator)}
        for name in only:
            if name not in names:
                raise OptionError(f"no configuration {name!r}; {nearest(name, names)}", option="only")
        chosen = frozenset(self.campaign.seeds[:seeds])
        return [
            episode
            for episode in self.campaign.episodes()
            if episode.seed in chosen
            and (not only or {str(episode.configuration), episode.configuration.estimator} & {*only})
        ]

    def missing(self, wanted: Sequence[Episode]) -> list[Episode]:
        """Those of the episodes that have no row yet."""
        return [episode for episode in wanted if episode.key not in self._rows.known]

    def retry(self) -> None:
        """Makes failed episodes count as missing."""
        for key, row in list(self._rows.known.items()):
            if row.outcome == FAILED:
                del self._rows.known[key]

    def play(
        self,
        wanted: Sequence[Episode],
        pool: WorkerPool[Episode, Row],
        watch: Callable[[Progress], None] = lambda progress: None,
    ) -> bool:
        """Plays the missing episodes; returns whether none is missing now. `watch` is called a few times a second.

        Raises:
            InputError: rows cannot be written any more.
        """
        left, began = self.missing(wanted), time.monotonic()
        waiting, new, there = iter(left), 0, len(wanted) - len(left)
        watch(Progress(there, len(wanted), 0, 0.0))
        for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled, tries=1):
            for each in ended:
                self._rows.add(row_of(each))
            new += len(ended)
            watch(Progress(there + new, len(wanted), new, time.monotonic() - began))
        return new == len(left)

    def _clear(self) -> None:
        shutil.rmtree(self.out / WORK, ignore_errors=True)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Reads the manifest of a campaign's folder.

    Raises:
        InputError: there is no campaign in it, or the file is damaged.
    """
    file = folder / MANIFEST
    if not os.path.exists(file):
        raise InputError(f"holds no campaign: it has no {MANIFEST}", file=folder)
    said = read_json(file)
    try:
        return _Manifest.model_validate(said).model_dump()
    except ValidationError as error:
        key, message = first_mistake(error, _Manifest)
        raise InputError(f"is damaged: {message}", file=file, key=".".join(key) or None) from None


class _What(BaseModel):
    places: dict[str, str]
    faults: dict[str, list[str]]
    contenders: dict[str, dict[str, Any]]
    options: dict[str, Any]
    versions: dict[str, str]


class _Manifest(BaseModel):
    format: Literal[1]
    title: str
    about: str
    command: str
    seeds: list[int]
    episodes: int
    campaign: _What


def _what(campaign: Campaign) -> dict[str, Any]:
    return {**campaign.described(), "versions": {name: version_of(name) for name in _VERSIONS}}


def _check_folder(out: Path, what: Mapping[str, Any]) -> None:
    if os.path.exists(out) and not out.is_dir():
        raise InputError("is not a folder", file=out)
    if not os.path.exists(out) or all(entry.name.startswith(".") for entry in out.iterdir()):
        return
    if not (out / MANIFEST).exists():
        message = f"is not empty and holds no campaign (no {MANIFEST}); choose another folder with --out"
        raise InputError(message, file=out)
    there, played = read_manifest(out)["campaign"], list(read_rows(out, lambda line: None).values())
    difference = _difference(_of_these(there, played), what) if played else None
    if difference is not None:
        raise InputError(f"holds another campaign ({difference}); choose another folder with --out", file=out)


def _of_these(what: Mapping[str, Any], rows: Sequence[Row]) -> dict[str, Any]:
    """The description of those places, faults and configurations that have rows."""
    used = {
        "places": {f"{row.domain}/{row.problem}" for row in rows},
        "faults": {row.faults for row in rows},
        "contenders": {f"{row.estimator}, {row.monitor}" if row.monitor else row.estimator for row in rows},
    }
    return {**what, **{kind: {name: what[kind].get(name) for name in names} for kind, names in used.items()}}


def _difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """The first contradiction between two campaigns in words; what only one of them has is none."""
    for kind, word in (("places", "the files of"), ("faults", "the faults"), ("contenders", "the configuration")):
        for name, value in here[kind].items():
            if name in there[kind] and there[kind][name] != value:
                return f"{word} {name!r} {'was another one' if kind == 'contenders' else 'were others'}"
    for kind in ("options", "versions"):
        for name, value in here[kind].items():
            former = there[kind].get(name)
            if former is None and kind == "options":  # an option that there was not yet
                former = options(RunConfig)[name].default
            if former != value:
                return f"{name.replace('_', ' ')} is {former} there and {value} here"
    return None
