"""An evaluation on disk: its scores in `evaluation.json`, and every answer in `answers.npz`."""

from __future__ import annotations

import glob
import io
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from executive.errors import InputError, OptionError
from executive.lab.collection.dataset import write_atomically
from executive.lab.common.folder_lock import LOCK, lock, remove_partial
from executive.lab.config import EvalConfig
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.kept_looks import command_of
from executive.lab.evaluation.metrics import Answers, never_true, scores
from executive.types import Atom
from executive.util.arrays import parse_arrays
from executive.util.files import check_writable, read_bytes, read_json

RESULTS, ANSWERS, KEPT = "evaluation.json", "answers.npz", ".looks.jsonl"
GROUP = "group: "
"""What the arrays of looks that are scored apart begin with."""

_LARGEST = 1_000_000_000


def document(evaluation: Evaluation) -> dict[str, Any]:
    """The scores of an evaluation as JSON: all of it, each predicate, each atom, and apart the looks after
    which the state is what the action's effects say (`expected`) and those after which it is not (`surprising`)."""
    answers, surprising = evaluation.answers, evaluation.surprising
    parts = {"expected": answers.where(~surprising), "surprising": answers.where(surprising)}
    # Where objects change, atoms may be thousands, each in a few looks.
    each = answers.atoms if answers.has_columns else ()
    made = {
        "name": evaluation.name,
        "looks": answers.looks,
        **scores(answers).document(),
        "seconds_per_look": round(evaluation.seconds_per_look, 4),
        "never_true": [str(atom) for atom in never_true(answers)] if answers.has_columns else [],
        "about": dict(evaluation.about),
        "looks_by_action": {name: {"looks": part.looks, **scores(part).document()} for name, part in parts.items()},
        "predicates": {name: scores(answers.of(name)).document() for name in answers.predicates},
        "atoms": {str(atom): scores(answers.of(atom)).document() for atom in each},
    }
    made |= _apart(evaluation, answers)
    if evaluation.posterior is not None:
        believed = replace(answers, probability=evaluation.posterior)
        made["posterior"] = {**scores(believed).document(), **_apart(evaluation, believed)}
    return made


def _apart(evaluation: Evaluation, answers: Answers) -> dict[str, Any]:
    """The scores of looks at so many objects and of subsets, and those of combinations that training saw and did not,
    where objects change."""
    made: dict[str, Any] = {}
    if evaluation.groups:
        chosen = {name: answers.where(looks) for name, looks in evaluation.groups.items()}
        made["groups"] = {name: {"looks": part.looks, **scores(part).document()} for name, part in chosen.items()}
    if evaluation.held_out is not None:
        apart = {
            "seen": answers.only(~evaluation.held_out & answers.asked),
            "held out": answers.only(evaluation.held_out),
        }
        made["combinations"] = {name: scores(part).document() for name, part in apart.items()}
    return made


def save(folder: Path, evaluation: Evaluation) -> dict[str, Any]:
    """Write both files, and return the document."""
    made = document(evaluation)
    answers = evaluation.answers
    arrays: dict[str, npt.NDArray[Any]] = {
        "atoms": np.array([str(atom) for atom in answers.atoms]),
        "probability": answers.probability,
        "truth": answers.truth,
        "looks": np.array(evaluation.looks, dtype=np.int64).reshape(-1, 2),
        "surprising": evaluation.surprising,
        "seconds": evaluation.seconds,
        **{f"{GROUP}{name}": looks for name, looks in evaluation.groups.items()},
    }
    if answers.which is not None:
        arrays["which"] = answers.which
    if evaluation.held_out is not None:
        arrays["held_out"] = evaluation.held_out
    if evaluation.posterior is not None:
        arrays["posterior"] = evaluation.posterior
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomically(folder / ANSWERS, buffer.getvalue())
    write_atomically(folder / RESULTS, (json.dumps(made, indent=2) + "\n").encode())
    return made


def load(folder: Path) -> Evaluation:
    """What `save` wrote.

    Raises:
        InputError: the folder holds no evaluation, or a damaged one.
    """
    if not os.path.isfile(folder / RESULTS):
        raise InputError(f"holds no evaluation: it has no {RESULTS}", file=folder)
    told = read_json(folder / RESULTS)
    if not (isinstance(told, dict) and isinstance(told.get("name"), str) and isinstance(told.get("about"), dict)):
        raise InputError("is not what Executive wrote: it says no name, or nothing about it", file=folder / RESULTS)
    try:
        kept = parse_arrays(read_bytes(folder / ANSWERS, largest=_LARGEST))
        atoms = tuple(Atom.parse(str(atom)) for atom in kept["atoms"])
        which = _array(kept, "which", "i", 2) if "which" in kept else None
        answers = Answers(atoms, _array(kept, "probability", "f", 2), _array(kept, "truth", "b", 2), which)
        groups = {key.removeprefix(GROUP): _array(kept, key, "b", 1) for key in kept if key.startswith(GROUP)}
        held_out = _array(kept, "held_out", "b", 2) if "held_out" in kept else None
        posterior = _array(kept, "posterior", "f", 2) if "posterior" in kept else None
        looks = tuple((int(episode), int(step)) for episode, step in _array(kept, "looks", "i", 2))
        surprising, seconds = _array(kept, "surprising", "b", 1), _array(kept, "seconds", "f", 1)
        counts = {len(looks), len(surprising), len(seconds), *map(len, groups.values())}
        if counts != {answers.looks} or (held_out is not None and held_out.shape != answers.truth.shape):
            raise ValueError("its arrays are not of the same looks")
        if posterior is not None:
            replace(answers, probability=posterior)  # says what is wrong with it
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"is damaged ({error})", file=folder / ANSWERS) from None
    return Evaluation(told["name"], told["about"], answers, looks, surprising, seconds, groups, held_out, posterior)


def _array(kept: Mapping[str, npt.NDArray[Any]], name: str, kind: str, dimensions: int) -> Any:
    array = kept[name]
    if array.dtype.kind != kind or array.ndim != dimensions:
        raise ValueError(f"{name} is {array.dtype} {array.shape}")
    return array


def default_folder(config: EvalConfig) -> Path:
    """Where an evaluation goes that is not told where: where the same was left unfinished, or a new folder."""
    wanted = replace(config, looks=None).command
    names = f"*-{glob.escape(Path(config.domain).name)}-{glob.escape(config.data.resolve().name)}"
    for folder in sorted(Path("evaluations").glob(names), reverse=True):
        if not (folder / RESULTS).exists() and command_of(folder / KEPT) == wanted:
            return folder
    parts = (time.strftime("%Y%m%d-%H%M%S"), Path(config.domain).name, config.data.resolve().name)
    return Path("evaluations") / "-".join(parts)


@contextmanager
def claimed(folder: Path, command: str) -> Iterator[Path]:
    """Make the folder that an evaluation is to be written to, hold it, and remove it again if it stays
    empty. A former evaluation in it will be written over.

    Raises:
        InputError: it holds something else, another process works in it, or it cannot be made.
    """
    new = not os.path.exists(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / RESULTS).is_file() and any(not each.name.startswith(".") for each in folder.iterdir()):
            raise OptionError(
                "holds something else than an evaluation; choose another folder", file=folder, option="out"
            )
    except OSError as error:
        raise OptionError(f"cannot be made ({error.strerror})", file=folder, option="out") from None
    check_writable(folder, "out")
    held = lock(folder, "evaluating", command)
    try:
        remove_partial(folder)
        yield folder
    finally:
        if new and all(each.name == LOCK for each in folder.iterdir()):
            shutil.rmtree(folder, ignore_errors=True)
        held.release()
