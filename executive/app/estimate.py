"""The command `estimate`: it answers the atoms of a domain and additional questions about pictures or a video."""

from __future__ import annotations

import difflib
import json
import os
import re
import shlex
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from statistics import fmean
from typing import Any

from executive.app.config import EstimatorConfig
from executive.app.estimators import load_calibration, open_estimator
from executive.domain.loader import load_subject
from executive.errors import InputError, OptionError
from executive.s3e import S3E, Finding, observe
from executive.s3e.pictures import read_picture
from executive.types import Atom, Image

_LONGEST = 1_000
"""Characters of a pattern of atoms."""

OWN = "questions"
"""The group of additional questions; an atom's group is its predicate."""


@dataclass(frozen=True, slots=True)
class Item:
    """What is asked about: an atom of the domain, or an atom made up to stand for an additional question."""

    group: str
    name: str
    atom: Atom


@dataclass(frozen=True, slots=True)
class Estimate:
    """The answers of one look, and how many wall seconds they took."""

    findings: Mapping[Item, Finding]
    seconds: float

    @property
    def answered(self) -> bool:
        """Whether there is an answer to anything."""
        return any(finding.probability is not None for finding in self.findings.values())

    def curves(self) -> dict[str, dict[str, float | None]]:
        """Group -> name -> P(true), None where unanswered."""
        groups: dict[str, dict[str, float | None]] = {}
        for item, finding in self.findings.items():
            groups.setdefault(item.group, {})[item.name] = finding.probability
        return groups


class Session:
    """A model, ready to be shown pictures and asked about some of a domain's atoms.

    Args:
        domain, problem: as of `executive.domain.loader.load_subject`.
        config: which model, and how it is asked.
        atoms: patterns over atoms as they are printed, such as `on-table(*,wood-table)` or a predicate's name alone;
            without any, all atoms, unless there are questions.
        questions: additional questions in words.

    Raises:
        InputError: an argument is invalid; one line says which.
        MissingError: the model needs a package that is not installed.
    """

    def __init__(
        self,
        domain: str | Path,
        problem: str | None,
        config: EstimatorConfig,
        atoms: Sequence[str] = (),
        questions: Sequence[str] = (),
    ) -> None:
        subject = load_subject(domain, problem)
        if not subject.task.atoms:
            raise InputError("has no atoms to estimate: no objects fit any of its predicates", file=subject.name)
        chosen = choose(subject.task.atoms, atoms) if atoms or not questions else ()
        own = _own_atoms(questions, subject.task.atoms)
        self.config = config
        self.estimator: S3E = open_estimator(config, subject)
        self.calibrated = load_calibration(config) is not None
        self.estimator.questions = replace(self.estimator.questions, text={**self.estimator.questions.text, **own})
        self.items = (
            *(Item(atom.predicate, str(atom), atom) for atom in chosen),
            *(Item(OWN, question, atom) for atom, question in own.items()),
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What went wrong when questions were worded, a line each."""
        return self.estimator.questions.warnings

    def look(self, images: Mapping[str, Image]) -> Estimate:
        """Ask about pictures, each by its name."""
        begin = time.perf_counter()
        findings = self.estimator.ask(observe(images), [item.atom for item in self.items])
        return Estimate({item: findings[item.atom] for item in self.items}, time.perf_counter() - begin)

    def watch(self, name: str, frames: Iterable[tuple[float, Image]]) -> Iterator[tuple[float, Image, Estimate]]:
        """Ask about frames of a video, one by one: when each was shown (s), the frame, and what was found."""
        for moment, image in frames:
            yield moment, image, self.look({name: image})

    def head(self) -> dict[str, Any]:
        """Return the fields of the document that hold for all answers."""
        calibrated = {"calibrated": True} if self.calibrated else {}
        return {"model": self.estimator.backend.name, "system_prompt": self.estimator.questions.system, **calibrated}

    def document(self, images: Sequence[Path], estimate: Estimate) -> dict[str, Any]:
        """Return all that was asked and answered in one look, as JSON: enough for an outsider to ask the same again."""
        seconds = round(estimate.seconds, 3)
        return {**self.head(), "images": [str(image) for image in images], "seconds": seconds, **answers(estimate)}


def tell_look(session: Session, files: Sequence[Path], images: Mapping[str, Image], as_json: bool) -> bool:
    """Ask about pictures and print the answers on stdout; whether there was any."""
    estimate = session.look(images)
    if as_json:
        print(json.dumps(session.document(files, estimate), indent=2))
        return estimate.answered
    from executive.trace.terminal.answers import Line, print_answers

    count = len(files)
    asked = "one by one" if session.config.per_image and count > 1 else "together" if count > 1 else ""
    shown = f"{count} picture{'s' * (count > 1)} {asked}".rstrip()
    print(f"{session.estimator.backend.name}, {shown}, {estimate.seconds:.1f} s\n")
    lines = [
        Line(
            item.group,
            item.name,
            "" if item.group == OWN else found.question,
            found.probability,
            "" if found.probability is not None else why_unanswered(found),
        )
        for item, found in estimate.findings.items()
    ]
    print_answers(lines, sys.stdout)
    return estimate.answered


def tell_video(
    session: Session, video: Path, frames: Iterable[tuple[float, Image]], every: float, out: Path, as_json: bool
) -> bool:
    """Ask about a video frame by frame, print what changes on stdout, and leave a plot and a Rerun recording in the
    folder `out`, which is made if need be; whether there was any answer. What was found before a video breaks off is
    drawn and recorded, too; where nothing was, no file is left.

    Raises:
        InputError: the video breaks off, or the files cannot be written.
    """
    from executive.trace.report.chart import Chart
    from executive.trace.viewer.video import Film

    chart, told = Chart(), _Changes()
    plot, recording = out / f"{video.stem}-estimate.png", out / f"{video.stem}-estimate.rrd"
    document: list[dict[str, Any]] = []
    begin, answered, new = time.perf_counter(), False, not os.path.exists(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(f"cannot be made ({error.strerror})", file=out, option="out") from None
    try:
        with Film(recording) as film:
            for moment, image, estimate in session.watch(video.name, frames):
                curves = estimate.curves()
                film.add(moment, {video.name: image}, curves)
                chart.add(moment, image, curves)
                answered = answered or estimate.answered
                if as_json:
                    document.append(
                        {"time": round(moment, 6), "seconds": round(estimate.seconds, 3), **answers(estimate)}
                    )
                else:
                    print(f"{moment:8.2f} s  {told.line(curves)}", flush=True)
    finally:
        if chart.times:
            chart.draw(plot)
        else:
            recording.unlink(missing_ok=True)
            if new:
                out.rmdir()
    if as_json:
        seconds = round(time.perf_counter() - begin, 3)
        files = {"video": str(video), "every": every, "plot": str(plot), "recording": str(recording)}
        whole = {**session.head(), **files, "seconds": seconds, "frames": document}
        print(json.dumps(whole, indent=2))
    else:
        print(f"\nplot: {plot}\nrecording: {recording} (to play it: rerun {shlex.quote(str(recording))})")
    return answered


class _Changes:
    """What changed since the last frame, in words."""

    def __init__(self) -> None:
        self._before: dict[str, bool | None] = {}

    def line(self, curves: Mapping[str, Mapping[str, float | None]]) -> str:
        now = {
            name: None if probability is None else probability >= 0.5
            for members in curves.values()
            for name, probability in members.items()
        }
        said = {True: "true", False: "false", None: "unanswered"}
        # At first, what is true and what is unanswered; what is false is the rest.
        changed = [name for name, truth in now.items() if truth is not self._before.get(name, False)]
        self._before = now
        return "; ".join(f"{name} {said[now[name]]}" for name in changed) or "-"


def answers(estimate: Estimate) -> dict[str, Any]:
    """Return the answers of one look, as JSON: `atoms` by their names and, if there are any, one's own `questions`."""
    atoms = {item.name: _answer(finding) for item, finding in estimate.findings.items() if item.group != OWN}
    own = {item.name: _answer(finding) for item, finding in estimate.findings.items() if item.group == OWN}
    return {"atoms": atoms, **({OWN: own} if own else {})}


def read_images(files: Sequence[Path]) -> dict[str, Image]:
    """Pictures by name: a file's own name without its ending, numbered where two would have the same one.

    Raises:
        InputError: one of them is no picture.
    """
    images: dict[str, Image] = {}
    for file in files:
        name, number = file.stem, 2
        while name in images:
            name, number = f"{file.stem}-{number}", number + 1
        images[name] = read_picture(file)
    return images


def choose(atoms: Sequence[Atom], patterns: Sequence[str]) -> tuple[Atom, ...]:
    """The atoms that match any of the patterns (`*` is any text, `?` one character, `[ab]` one of these), in order; all
    of them where there is no pattern. A name without parentheses means all atoms of that predicate.

    Raises:
        InputError: a pattern matches nothing; names the nearest atom.
    """
    matched: set[Atom] = set()
    for pattern in patterns:
        if len(pattern) > _LONGEST:
            raise OptionError(f"a pattern has {len(pattern):,} characters, and may have {_LONGEST:,}", option="atoms")
        plain = re.sub(r"\s+", "", pattern).lower()
        wanted = plain if "(" in plain else f"{plain}(*)"
        found = [atom for atom in atoms if fnmatchcase(str(atom).lower(), wanted)]
        if not found:
            names = {str(atom).lower(): str(atom) for atom in atoms}
            near = difflib.get_close_matches(plain, names, n=1, cutoff=0.0)
            predicates = ", ".join(dict.fromkeys(atom.predicate for atom in atoms))
            raise OptionError(
                f"no atom matches {pattern!r}; the nearest is {names[near[0]]}, and the predicates are: {predicates}",
                option="atoms",
            )
        matched.update(found)
    return tuple(atom for atom in atoms if atom in matched) if patterns else tuple(atoms)


def _own_atoms(questions: Sequence[str], atoms: Sequence[Atom]) -> dict[Atom, str]:
    """An atom for each question, none of which the domain has."""
    predicate, taken = "own-question", {atom.predicate for atom in atoms}
    while predicate in taken:
        predicate += "-"
    own = {}
    for number, question in enumerate(dict.fromkeys(questions), start=1):
        if not question.strip() or not question.isprintable():
            raise OptionError(f"{question!r} is not a line of text", option="question")
        own[Atom(predicate, (f"number-{number}",))] = question.strip()
    return own


def why_unanswered(finding: Finding) -> str:
    """Return why there is no probability, in a few words."""
    errors = list(dict.fromkeys(view.answer.error for view in finding.views if view.answer.error))
    if errors:
        return "; ".join(errors)
    mass = fmean(view.answer.yes_mass + view.answer.no_mass for view in finding.views)
    rather = next((f"; it would rather say {view.answer.said}" for view in finding.views if view.answer.said), "")
    return f"only {mass:.0%} of the probability is on either answer{rather}"


def _answer(finding: Finding) -> dict[str, Any]:
    """One item's part of the document; masses are means where pictures were shown one by one, and each is there."""
    views = [view.answer for view in finding.views]
    document: dict[str, Any] = {
        "question": finding.question,
        "prompt": views[0].prompt,
        "probability": finding.probability,
        "yes_mass": fmean(answer.yes_mass for answer in views),
        "no_mass": fmean(answer.no_mass for answer in views),
        "answered": finding.probability is not None,
    }
    if finding.probability is None:
        document["why"] = why_unanswered(finding)
    if len(views) > 1:
        document["views"] = [
            {"image": ", ".join(view.cameras), "yes_mass": view.answer.yes_mass, "no_mass": view.answer.no_mass}
            for view in finding.views
        ]
    return document
