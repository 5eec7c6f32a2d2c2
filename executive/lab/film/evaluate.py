"""Experiment 2 of the paper: an estimator is evaluated on films against the truth of each frame.

One or several worker processes watch a film each; what they found is kept, so that an interrupted evaluation goes on
with the films that are missing.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from executive.app.estimators import open_estimator, with_default_model
from executive.domain.loader import load_domain, load_subject
from executive.errors import InputError, OptionError
from executive.lab.common.process_pool import ReportProgress, WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.lab.config import EvalConfig
from executive.lab.evaluation import published, store
from executive.lab.evaluation.evaluate import row_name
from executive.lab.evaluation.posterior import open_single_look
from executive.lab.film import scoring
from executive.lab.film.drawn import DrawnFilm
from executive.lab.film.frames import read_truth
from executive.lab.film.memory import FilmMemory
from executive.lab.film.record import TRUTH, VIDEO, films_in, read_about
from executive.lab.film.watch import Watched, watch
from executive.s3e import S3E, Backend
from executive.s3e.video import read_frames
from executive.types import Atom
from executive.util.arrays import parse_arrays
from executive.util.atomic_write import write_atomic
from executive.util.files import read_bytes, read_json

KEPT, SAME, TABLES, ANSWERS = ".films", "same.json", "tables.md", "answers"


class Clip(NamedTuple):
    """A film to watch: its folder, the problem that it was made of as an option says it, its name, and its frames."""

    folder: Path
    problem: str | None
    name: str
    frames: int


class FilmEvaluator:
    """The estimator that is to be measured, and the films, checked.

    Raises:
        DomainError: the domain has a mistake.
        InputError: there is no film, one is damaged or of another domain, or an option does not go with films.
        MissingError: the machine lacks something.
    """

    def __init__(self, config: EvalConfig, out: Path) -> None:
        self.config, self._out, self._cancelled = config, out, False
        for name in ("paraphrases", "disturb"):
            if getattr(config, name):
                raise OptionError("is for collected pictures, and not for films", option=name)
        subject = load_subject(config.domain, config.problem)
        with_default_model(config.eye, subject)
        self.published = published.read(subject.pddl.parent)
        self.clips = []
        for folder in films_in(config.data):
            about = read_about(folder)
            if about["domain"] != subject.name:
                why = f"is a film of the domain {about['domain']!r}, and not of {subject.name!r}"
                raise InputError(why, file=folder)
            config.eye.check_cameras([about["camera"]])
            self.clips.append(Clip(folder, about.get("problem_option"), folder.resolve().name, about["frames"]))
        if config.looks is not None:
            self.clips = self.clips[: config.looks]
        if not self.clips:
            raise InputError("holds no film", file=config.data)

    def cancel(self) -> None:
        """Makes `run` stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    @property
    def watcher(self) -> Callable[[], Watcher]:
        """Makes what watches a film in a worker process."""
        return partial(Watcher, self.config, self._out / KEPT)

    def run(
        self, pool: WorkerPool[Clip, dict[str, Any]], watching: Callable[[Progress], None] = lambda progress: None
    ) -> dict[str, Any] | None:
        """Watch all films, and return the document that `evaluation.json` holds; None when cancelled. `watching` is
        called several times a second.

        Raises:
            InputError: a film is damaged.
        """
        kept = self._kept()
        missing = [clip for clip in self.clips if not (kept / f"{clip.name}.npz").exists()]
        wanted = sum(clip.frames for clip in self.clips)
        there, began = wanted - sum(clip.frames for clip in missing), time.monotonic()
        waiting, abouts = iter(missing), {}
        done = there
        for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled):
            for each in ended:
                abouts[each.job.name] = each.value()
                done += each.job.frames
            now = done + int(pool.running_progress)
            watching(Progress(now, wanted, now - there, time.monotonic() - began))
        if done < wanted:
            return None
        if about := next(iter(abouts.values()), None):
            write_atomic(kept / SAME, json.dumps({**read_json(kept / SAME), "about": about}).encode())
        return self._finish(kept, read_json(kept / SAME)["about"])

    def _kept(self) -> Path:
        """Return the folder of what was found already: empty where that was of another evaluation."""
        kept = self._out / KEPT
        same = {"command": self.config.command, "films": [str(clip.folder.resolve()) for clip in self.clips]}
        if os.path.isfile(kept / SAME) and {**read_json(kept / SAME), "about": None} != {**same, "about": None}:
            shutil.rmtree(kept)
        kept.mkdir(parents=True, exist_ok=True)
        if not (kept / SAME).exists():
            write_atomic(kept / SAME, json.dumps(same).encode())
        return kept

    def _finish(self, kept: Path, about: Mapping[str, Any]) -> dict[str, Any]:
        watched = [load_watched(kept / f"{clip.name}.npz", clip.name) for clip in self.clips]
        seconds = np.concatenate([each.seconds for each in watched])
        document = {
            "name": about["name"],
            "films": len(watched),
            **scoring.scored(watched),
            "seconds_per_look": round(float(np.median(seconds)), 4),
            "about": {**about, "command": self.config.command},
        }
        answers = self._out / ANSWERS
        shutil.rmtree(answers, ignore_errors=True)
        (kept / SAME).unlink()
        kept.rename(answers)
        write_atomic(self._out / store.RESULTS, (json.dumps(document, indent=2) + "\n").encode())
        return document

    def tell(self, document: Mapping[str, Any], beside: Sequence[Mapping[str, Any]] = ()) -> str:
        """Write the tables into the folder, and return them as text."""
        named = {}
        for number, each in enumerate((document, *beside)):
            name = each["name"] if each["name"] not in named else f"{each['name']} #{number + 1}"
            named[name] = each
        text = f"{scoring.tabled(self.published, named)}\n\n{scoring.memory_table(named)}"
        write_atomic(self._out / TABLES, f"{text}\n".encode())
        return text


class Watcher:
    """Watches one film after the other in a worker process, which opens its own estimator with its first one.

    Args:
        folder: where to leave a film's answers, plot and recording.
    """

    def __init__(self, config: EvalConfig, folder: Path) -> None:
        self._config, self._folder = config, folder
        self._backend: Backend | None = None

    def __call__(self, clip: Clip, tell: ReportProgress) -> dict[str, Any]:
        about = read_about(clip.folder)
        config, camera = self._config, str(about["camera"])
        domain = load_domain(config.domain, clip.problem)
        eye = self._estimator(clip)
        frames = read_truth(clip.folder / TRUTH, domain.task.atoms)
        memory = FilmMemory(open_single_look(domain, with_default_model(config.eye, domain.subject)))
        pictures = read_frames(clip.folder / VIDEO, 1.0 / about["fps"])
        plot, recording = self._folder / f"{clip.name}.png", self._folder / f"{clip.name}.rrd"
        found = []
        with DrawnFilm(plot, recording, frames, camera) as drawn:
            for seen in watch(eye, frames, camera, pictures, memory):
                drawn.add(seen)
                found.append((seen.time, seen.row, seen.probability, seen.remembered, seen.seconds))
                tell(float(len(found)))
        watched = Watched.of(clip.name, frames, found)
        save_watched(self._folder / f"{clip.name}.npz", watched)
        told = config.eye.instructions
        described = {
            "translator": config.eye.translator,
            "per_image": config.eye.per_image,
            "instructions": told if isinstance(told, str) else told and domain.subject.instructions is not None,
            "paraphrases": None,
            "rename": True,
            "disturb": [],
            "data": {"home_pose": False},  # the paper's rows for films do not tell poses apart
        }
        name = row_name(eye.backend.name, {**described, "instructions": False})
        return {"name": name, "model": eye.backend.name, "system_prompt": eye.questions.system, **described}

    def _estimator(self, clip: Clip) -> S3E:
        """The estimator with the questions about a film's problem; the model is loaded once."""
        subject, backend = load_subject(self._config.domain, clip.problem), self._backend
        if backend is None:
            eye = open_estimator(self._config.eye, subject)
        else:
            eye = open_estimator(self._config.eye, subject, lambda model: backend)
        self._backend = eye.backend
        return eye


def save_watched(file: Path, watched: Watched) -> None:
    """Write what was found in a film, whole or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        atoms=np.array([str(atom) for atom in watched.atoms]),
        times=watched.times,
        probability=watched.probability,
        remembered=watched.remembered,
        truth=watched.truth,
        mid_pose=watched.mid_pose,
        seconds=watched.seconds,
    )
    write_atomic(file, buffer.getvalue())


def load_watched(file: Path, name: str) -> Watched:
    """Return what `save_watched` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        kept = parse_arrays(read_bytes(file, largest=1_000_000_000))
        atoms = tuple(Atom.parse(str(atom)) for atom in kept["atoms"])
        return Watched(
            name, atoms, kept["times"], kept["probability"], kept["remembered"], kept["truth"], kept["mid_pose"],
            kept["seconds"],
        )  # fmt: skip
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"is damaged ({error})", file=file) from None


def load_document(folder: Path) -> dict[str, Any]:
    """Return the document of another evaluation of films.

    Raises:
        InputError: the folder holds none.
    """
    found = read_json(folder / store.RESULTS) if os.path.isfile(folder / store.RESULTS) else None
    if not isinstance(found, dict) or not {"name", scoring.FRAMES, scoring.MID_POSES} <= found.keys():
        raise InputError("holds no evaluation of films", file=folder)
    return found
