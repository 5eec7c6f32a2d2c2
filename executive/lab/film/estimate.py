"""The command `estimate` with a video whose truth is known: its answers, and how good they are."""

from __future__ import annotations

import json
import math
import shlex
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from executive.app.estimate import Session
from executive.domain.loader import load_domain, load_subject
from executive.errors import DomainError, OptionError
from executive.lab.evaluation.posterior import open_single_look
from executive.lab.film import scoring
from executive.lab.film.drawn import DrawnFilm
from executive.lab.film.frames import read_truth
from executive.lab.film.memory import FilmMemory
from executive.lab.film.watch import Seen, Watched, watch
from executive.types import Atom, Image
from executive.util.files import reason


def tell_scored_video(
    session: Session,
    domain: str,
    problem: str | None,
    video: Path,
    pictures: Iterable[tuple[float, Image]],
    truth: Path,
    every: float,
    out: Path,
    as_json: bool,
) -> bool:
    """Ask about a video frame by frame, print how good the answers are, and leave a plot and a Rerun recording in the
    folder `out`, which is made if need be; whether there was any answer.

    Raises:
        InputError: the video breaks off, the truth is damaged or says nothing of a frame, or a file cannot be written.
    """
    atoms = [item.atom for item in session.items]
    frames = read_truth(truth, load_subject(domain, problem).task.atoms).only(atoms)
    memory = _memory(session, domain, problem, atoms)
    new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(f"cannot be made ({reason(error)})", file=out, option="out") from None
    plot, recording = out / f"{video.stem}-estimate.png", out / f"{video.stem}-estimate.rrd"
    found: list[tuple[float, int, Any, Any, float]] = []
    answers: list[dict[str, Any]] = []
    began = time.perf_counter()
    try:
        with DrawnFilm(plot, recording, frames, video.name) as drawn:
            for seen in watch(session.estimator, frames, video.name, pictures, memory):
                drawn.add(seen)
                found.append((seen.time, seen.row, seen.probability, seen.remembered, seen.seconds))
                if as_json:
                    answers.append(_answer(seen, frames.atoms))
    finally:
        if not found:  # what nothing was found of leaves nothing behind
            recording.unlink(missing_ok=True)
            if new:
                out.rmdir()
    watched = Watched.of(video.name, frames, found)
    document = scoring.scored([watched])
    answered = not bool(np.isnan(watched.probability).all())
    if as_json:
        files = {"video": str(video), "truth": str(truth), "every": every, "plot": str(plot)}
        head = {**session.head(), **files, "recording": str(recording)}
        seconds = round(time.perf_counter() - began, 3)
        print(json.dumps({**head, "seconds": seconds, **document, "answers": answers}, indent=2))
        return answered
    name = session.estimator.backend.name
    print(scoring.tabled(None, {name: document}))
    print(f"\n{scoring.memory_table({name: document})}")
    print(f"\nplot: {plot}\nrecording: {recording} (to play it: rerun {shlex.quote(str(recording))})")
    return answered


def _memory(session: Session, domain: str, problem: str | None, atoms: list[Atom]) -> FilmMemory | None:
    """The memory of a domain that a robot has; None for a folder of PDDL alone, and where not all atoms are asked."""
    try:
        loaded = load_domain(domain, problem)
    except DomainError:
        return None
    return FilmMemory(open_single_look(loaded, session.config)) if set(atoms) == set(loaded.task.atoms) else None


def _answer(seen: Seen, atoms: tuple[Atom, ...]) -> dict[str, Any]:
    def known(values: Any) -> dict[str, float | None]:
        return {str(atom): None if math.isnan(v) else round(float(v), 6) for atom, v in zip(atoms, values, strict=True)}

    return {
        "time": round(seen.time, 6),
        "seconds": round(seen.seconds, 3),
        "atoms": known(seen.probability),
        "with_memory": known(seen.remembered),
    }
