"""Whole states from the answers of a first look, in three ways: each answer thresholded, the most probable state that
the mutex groups allow, and the most probable one of all states that the actions can lead to.

How often a model errs is counted on its looks at other problems than the one at hand: for each predicate, and for each
atom as far as it was asked often enough. A look counts as right where the whole state is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.viplan.recorded import Look, Run, Tasks
from executive.belief import ErrorModel, Group, MutexNetwork, StateSpace
from executive.belief.sensor_model import AnswerCounts
from executive.planning.mutex_groups import find_mutexes
from executive.planning.state_listing import groups_of, steps
from executive.s3e.reliability import expected_calibration_error
from executive.types import Atom

BINS = 15


class Decoded(NamedTuple):
    """One first look: whether the whole state is right in each way, and the marginals of the last with the truth."""

    run: Run
    thresholded: bool
    groups: bool
    legal: bool
    marginals: tuple[tuple[float, bool], ...]


class Belief(NamedTuple):
    """What is known of a problem from its PDDL alone."""

    network: MutexNetwork
    space: StateSpace | None


class Counts:
    """How a model's answers came out, by problem and in all."""

    def __init__(self, runs: Iterable[tuple[Run, Sequence[Look]]]) -> None:
        self._of: dict[tuple[str, str], AnswerCounts] = {}
        self._all = AnswerCounts()
        for run, looks in runs:
            own = AnswerCounts.of(
                (atom, answer.yes, answer.truth)
                for look in looks
                for atom, answer in look.answers.items()
                if answer.yes is not None
            )
            self._of[run.unit] = self._of.get(run.unit, AnswerCounts()) + own
            self._all += own

    def elsewhere(self, unit: tuple[str, str]) -> AnswerCounts:
        """Return the counts on all problems but this one."""
        return self._all - self._of.get(unit, AnswerCounts())


def decode(runs: Sequence[Run], tasks: Tasks) -> Iterator[Decoded]:
    """Yield every first look that asks about the whole state, decoded."""
    looks = [(run, run.looks[0]) for run in runs if run.looks and run.looks[0].kind == "all"]
    beliefs: dict[tuple[str, str], Belief] = {}
    for model in dict.fromkeys(run.model for run, _ in looks):
        own = [(run, look) for run, look in looks if run.model == model]
        counts = Counts((run, [look]) for run, look in own)
        for run, look in own:
            if run.unit not in beliefs:
                beliefs[run.unit] = believed(tasks, run)
            yield _decoded(run, look, beliefs[run.unit], counts.elsewhere(run.unit))


def believed(tasks: Tasks, run: Run) -> Belief:
    """Work out what the PDDL of a run's problem says of its states."""
    schema = tasks.schema(run)
    atoms = schema.task.atoms
    space = StateSpace.reachable(atoms, tuple(steps(schema)), schema.task.declared, schema.task.derived)
    groups = groups_of(find_mutexes(schema, leaves_open=False), space)
    if space is not None:
        groups = tuple(Group(group.atoms, space.always_one(group)) for group in groups)
    return Belief(MutexNetwork(atoms, groups), space)


def evidence(look: Look, atoms: Iterable[Atom], counts: AnswerCounts) -> dict[Atom, float]:
    """Return the log-likelihood ratio of each answer about these atoms."""
    known: dict[Atom, ErrorModel] = {}
    for atom in atoms:
        if atom in look.answers and look.answers[atom].yes is not None:
            known[atom] = counts.error_model(atom)
    return {atom: model.evidence(float(bool(look.answers[atom].yes))) for atom, model in known.items()}


def _decoded(run: Run, look: Look, belief: Belief, counts: AnswerCounts) -> Decoded:
    atoms = belief.network.atoms
    asked = [atom for atom in atoms if atom in look.answers]
    truth = {atom: look.answers[atom].truth for atom in asked}
    weights = evidence(look, asked, counts)

    def right(true: frozenset[Atom]) -> bool:
        return all((atom in true) is value for atom, value in truth.items())

    by_groups = belief.network.solve(weights)
    by_all = by_groups if belief.space is None else belief.space.solve(weights)
    return Decoded(
        run,
        all(look.answers[atom].yes is value for atom, value in truth.items()),
        right(by_groups.best),
        right(by_all.best),
        tuple((by_all.marginal[atom], value) for atom, value in truth.items()),
    )


def figures(decoded: Sequence[Decoded]) -> dict[str, Any]:
    """Return how many whole states are right, each way, and the Brier score and calibration error of marginals."""
    pairs = [pair for each in decoded for pair in each.marginals]
    brier = float(np.mean([(probability - truth) ** 2 for probability, truth in pairs])) if pairs else math.nan
    return {
        "states": len(decoded),
        "thresholded": sum(each.thresholded for each in decoded),
        "groups": sum(each.groups for each in decoded),
        "legal": sum(each.legal for each in decoded),
        "brier": brier,
        "ece": expected_calibration_error(pairs, BINS),
    }


def table(decoded: Sequence[Decoded]) -> list[dict[str, Any]]:
    """Return the figures of each model and split."""
    kept: dict[tuple[str, str], list[Decoded]] = {}
    for each in decoded:
        kept.setdefault((each.run.model, each.run.split), []).append(each)
    return [{"model": model, "split": split, **figures(members)} for (model, split), members in sorted(kept.items())]


def printed(decoded: Sequence[Decoded]) -> str:
    """Return the table as text, the sum of all last."""
    rows: list[Mapping[str, Any]] = [*table(decoded), {"model": "all", "split": "", **figures(decoded)}]
    lines = [
        f"{'model':<36}{'split':<8}{'states':>7}{'thresholded':>12}{'groups':>8}{'legal':>7}{'Brier':>8}{'ECE':>8}"
    ]
    lines += [
        f"{row['model']:<36}{row['split']:<8}{row['states']:>7}{row['thresholded']:>12}{row['groups']:>8}{row['legal']:>7}"
        f"{row['brier']:>8.4f}{row['ece']:>8.4f}"
        for row in rows
    ]
    return "\n".join(lines)
