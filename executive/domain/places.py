"""A file that says where things usually are, as `executive calibrate --places` writes it and a run reads it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NoReturn

from executive.domain.loader import Domain
from executive.domain.pddl import Fragment, StatedPrior, ground_priors
from executive.errors import InputError
from executive.types import Atom
from executive.util.atomic_write import write_atomic
from executive.util.files import read_toml

TABLE = "priors"


def read_places(file: Path, domain: Domain) -> Mapping[Atom, float]:
    """Return how probable atoms of a domain's problem are at first, as the file says. Objects that the problem does not
    have are passed over: the file may have been learned on others.

    Raises:
        InputError: the file cannot be read, or says what cannot be meant.
    """
    table = read_toml(file).get(TABLE)
    if not isinstance(table, dict):
        raise InputError('expected probabilities of atoms, such as "(at cup shelf)" = 0.4', file=file, key=TABLE)
    stated = []
    for text, value in table.items():
        fail = partial(_fail, file, text)
        if isinstance(value, bool) or not isinstance(value, int | float):
            fail(f"expected a probability from 0 to 1, got {value!r}")
        stated.append(StatedPrior(Fragment(text, fail), float(value)))
    return ground_priors(stated, domain.parsed, lenient=True)


def write_places(file: Path, priors: Mapping[Atom, float], runs: int) -> Path:
    """Write a file that `read_places` reads, whole or not at all, and return it."""
    lines = [f"# Where things were when a run began, in {runs} runs, with one observation more that is spread evenly."]
    lines += [f"runs = {runs}", "", f"[{TABLE}]"]
    lines += [f'"({" ".join((atom.predicate, *atom.args))})" = {value:.4f}' for atom, value in sorted(priors.items())]
    return write_atomic(file, ("\n".join(lines) + "\n").encode())


def _fail(file: Path, text: str, message: str) -> NoReturn:
    raise InputError(message, file=file, key=f"{TABLE}: {text}")
