"""Evaluations in the form of the package `s3e` 0.5: a folder with a prediction set for each look, and what was true."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from executive.errors import InputError
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.metrics import Answers
from executive.s3e import Prediction, PredictionSet
from executive.s3e.backends.interface import YES_NO
from executive.types import Atom
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json

TRUTH = "truth.json"
"""The atoms that are true in each look, by the name of its file; the others of the file are false."""

_LARGEST = 100_000_000


def is_folder_of_prediction_sets(folder: Path) -> bool:
    """Whether a folder has prediction sets with their truth."""
    return os.path.isfile(folder / TRUTH)


def write(folder: Path, evaluation: Evaluation) -> Path:
    """Write the looks of an evaluation. An evaluation keeps probabilities: the masses are these and what is left of 1.

    Raises:
        InputError: there is something in the folder, or it cannot be written.
    """
    answers = evaluation.answers
    if not answers.has_columns:
        raise InputError("has other objects in each episode, which prediction sets with one truth do not tell")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError("is not empty; choose another folder", file=folder)
        truth = {}
        for (episode, step), said, true in zip(evaluation.looks, answers.probability, answers.truth, strict=True):
            name = f"episode-{episode:05d}-step-{step:03d}.json"
            told = {
                atom: Prediction("", 0.0, 0.0, 0.0, 1.0) if np.isnan(p) else Prediction("", float(p), 1.0 - float(p))
                for atom, p in zip(answers.atoms, said, strict=True)
            }
            PredictionSet(told, YES_NO).write(folder / name)
            truth[name] = [str(atom) for atom, is_true in zip(answers.atoms, true, strict=True) if is_true]
        write_atomic(folder / TRUTH, (json.dumps(truth, indent=1) + "\n").encode())  # last: the folder is whole with it
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=folder) from None
    return folder


def read(folder: Path) -> Evaluation:
    """Read a folder of prediction sets as an evaluation in which each look is an episode of its own, unless its name
    says which it is of.

    Raises:
        InputError: the first mistake: a file is missing or damaged, or has other atoms than the first.
    """
    file = folder / TRUTH
    truth = read_json(file, largest=_LARGEST)
    if not (isinstance(truth, dict) and truth):
        raise InputError("expected the true atoms of each look by the name of its file", file=file)
    atoms: tuple[Atom, ...] = ()
    said, true, looks = [], [], []
    for number, (name, told) in enumerate(truth.items()):
        if not (isinstance(told, list) and all(isinstance(each, str) for each in told)):
            raise InputError("expected a list of atoms", file=file, key=name)
        if Path(name).name != name:
            raise InputError("is no name of a file in this folder", file=file, key=name)
        found = PredictionSet.read(folder / name).belief()
        here = tuple(sorted({*found.probability, *found.unanswered}))
        atoms = atoms or here
        if odd := set(atoms) ^ set(here):
            raise InputError(f"has other atoms than the first look ({min(odd)})", file=folder / name)
        if unasked := sorted(set(told) - {str(atom) for atom in atoms}):
            raise InputError(f"says that {unasked[0]!r:.60} is true, which nobody was asked", file=file, key=name)
        said.append([found.probability.get(atom, np.nan) for atom in atoms])
        true.append([str(atom) in told for atom in atoms])
        looks.append(_look(name, number))
    answers = Answers(atoms, np.array(said, dtype=float), np.array(true, dtype=bool))
    return Evaluation(
        folder.name, {"model": "", "calibrated": False}, answers, tuple(looks), np.zeros(len(looks), bool),
        np.zeros(len(looks)),
    )  # fmt: skip


def _look(name: str, number: int) -> tuple[int, int]:
    """The episode and step that a file's name tells; else the number of the file, and 0."""
    parts = Path(name).stem.split("-")
    if len(parts) == 4 and (parts[0], parts[2]) == ("episode", "step") and (parts[1] + parts[3]).isdecimal():
        return int(parts[1]), int(parts[3])
    return number, 0
