"""Courses of actions with looks in between: made up, or those of a collection; and estimators of known quality.

Made up are random courses, of which one action in ten fails and after each of which someone may move an item.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from executive.domain.loader import Domain
from executive.lab.collection import dataset
from executive.lab.evaluation.evaluate import Evaluation
from executive.types import Atom, Facts, SkillResult, SkillStatus, Step

Answers = Mapping[Atom, float]
Ask = Callable[[Facts], Answers]
"""An estimator: what it says of a state."""


class Moment(NamedTuple):
    """What was done, in turn, since the moment before; what is so; and what was answered, if that is recorded."""

    done: tuple[tuple[Step, SkillResult], ...]
    facts: Facts
    answers: Answers | None = None


RunState = Sequence[Moment]


def courses(domain: Domain, number: int, length: int, seed: int) -> list[RunState]:
    """Random courses through the states of a domain of items, tables and a gripper."""
    return [_course(domain, length, np.random.default_rng([seed, each])) for each in range(number)]


def recorded(domain: Domain, evaluation: Evaluation, data: Path) -> list[RunState]:
    """The looks of an evaluation, episode by episode, with all that was done in between.

    Raises:
        InputError: the collection is damaged.
    """
    manifest = dataset.read_manifest(data)
    collection, looks = dataset.digest(manifest["collection"]), {each: row for row, each in enumerate(evaluation.looks)}
    said = evaluation.answers
    found: list[RunState] = []
    for episode in sorted({episode for episode, _ in evaluation.looks}):
        run_state: list[Moment] = []
        done: list[tuple[Step, SkillResult]] = []
        step_number = 0
        for attempt in dataset.read_log(data, collection, episode).attempts:
            named = Atom.parse(attempt.action)
            step = domain.parsed.ground(named.predicate, named.args)
            done.append((step, SkillResult(step, SkillStatus(attempt.status))))
            step_number += attempt.done
            row = looks.get((episode, step_number)) if attempt.done else None
            if row is not None:
                pairs = zip(said.atoms, said.probability[row], strict=True)
                answered = {atom: float(value) for atom, value in pairs if not np.isnan(value)}
                truth = Facts(dict(zip(said.atoms, map(bool, said.truth[row]), strict=True)))
                run_state.append(Moment(tuple(done), truth, answered))
                done = []
        if run_state:
            found.append(run_state)
    return found


def flipping(flips: float, seed: int) -> Ask:
    """Plain answers, each turned around with the same chance."""
    rng = np.random.default_rng([seed, round(1000 * flips)])
    return lambda facts: {atom: float(value != (rng.random() < flips)) for atom, value in facts.items()}


def graded(seed: int, clear: float = 3.4, spread: float = 1.1) -> Ask:
    """Probabilities of an estimator that sees some moments better than others, and says so as a rule."""
    rng = np.random.default_rng(seed)

    def ask(facts: Facts) -> Answers:
        clarity = max(0.0, rng.normal(clear, spread))
        odds = {atom: (1 if value else -1) * clarity + rng.normal(0.0, 1.6) for atom, value in facts.items()}
        return {atom: 1 / (1 + math.exp(-value)) for atom, value in odds.items()}

    return ask


def _course(domain: Domain, length: int, rng: np.random.Generator) -> RunState:
    items = [name for name, kind in domain.task.objects.items() if kind == "item"]
    tables = [name for name, kind in domain.task.objects.items() if kind == "table"]
    where = {item: str(rng.choice(tables)) for item in items}

    def facts() -> Facts:
        true = {Atom("on-table", (item, place)) for item, place in where.items() if place in tables}
        true |= {Atom("robot-gripping", (item,)) for item, place in where.items() if place == "hand"}
        if "hand" not in where.values():
            true.add(Atom("robot-gripper-empty"))
        return Facts.closed(true, domain.task.atoms)

    run_state = [Moment((), facts())]
    for _ in range(length):
        held = next((item for item in items if where[item] == "hand"), "")
        lying = [item for item in items if where[item] in tables]
        if not held and not lying:
            break
        item = held or str(rng.choice(lying))
        action, table = ("place", str(rng.choice(tables))) if held else ("pick", where[item])
        step = domain.parsed.ground(action, (item, table))
        status = _carried_out(step, where, tables, rng)
        if rng.random() < 0.05:
            shoved = str(rng.choice([other for other in items if where[other] != "hand"]))
            where[shoved] = str(rng.choice(tables))
        run_state.append(Moment(((step, SkillResult(step, status)),), facts()))
    return run_state


def _carried_out(step: Step, where: dict[str, str], tables: Sequence[str], rng: np.random.Generator) -> SkillStatus:
    """Do the step, or fail: nine times in ten it works, else nothing happens or the item ends up somewhere. Skills tell
    half of the time when that is so."""
    item, chance = step.args[0], rng.random()
    if chance < 0.9:
        where[item] = "hand" if step.action == "pick" else step.args[1]
        return SkillStatus.DONE
    noticed = rng.random() < 0.5
    if chance < 0.95:
        return SkillStatus.NO_PATH if noticed else SkillStatus.DONE
    where[item] = str(rng.choice([*tables, "floor"]))
    return SkillStatus.DROPPED if noticed else SkillStatus.DONE
