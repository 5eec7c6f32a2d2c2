"""What a monitor makes of recorded looks; the closed loop is in benchmarks.closed_loop.

    python -m benchmarks.monitor                                    # made-up looks at states of the grocery domain
    python -m benchmarks.monitor --evaluation FOLDER --data FOLDER  # a model's looks, and what was done between them

Made up are random courses of actions, of which one in ten fails and after each of which someone may move an item, and
what eyes of known quality say of the states on the way: plain answers that are turned around at some rate, and graded
ones that are clear in some looks and muddled in others. A model's are those of an evaluation (`executive eval`) of a
collection; half of its episodes say how far it can be trusted, the others are judged.

- `state`: looks after which the whole state that would be planned from is right, of all.
- `wrong`, `unknown`: looks after which something that is told is wrong, or something is not told.
- `again`: the same with as many as three looks at a moment, as long as something is unknown; `looks` is how many.
- coverage: looks in which the truth of every atom of a predicate is in its conformal set, for the share that is asked.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from executive.domain import Domain, load_domain
from executive.lab import dataset, evaluation_store
from executive.monitor import EXACT, ActionModel, Eye, FusedMonitor, Monitor, Network, PlainMonitor, Reading
from executive.monitor.conformal import covered
from executive.mutex import find_mutexes
from executive.trust import fit, load_outcomes
from executive.types import Atom, Belief, Facts, SkillResult, SkillStatus, Step

FLIPS = (0.0, 0.02, 0.05, 0.1)
ASKED = (0.8, 0.9, 0.95)
MOST_LOOKS = 3

Answers = Mapping[Atom, float]
Ask = Callable[[Facts], Answers]
"""An eye: what it says of a state."""


class Moment(NamedTuple):
    """What was done, in turn, since the moment before; what is so; and what was answered, if that is recorded."""

    done: tuple[tuple[Step, SkillResult], ...]
    facts: Facts
    answers: Answers | None = None


Course = Sequence[Moment]


class Figures(NamedTuple):
    """Shares of the moments, and looks a moment."""

    state: float
    wrong: float
    unknown: float
    looks: float


def courses(domain: Domain, number: int, length: int, seed: int) -> list[Course]:
    """Random courses through the states of a domain of items, tables and a gripper."""
    return [_course(domain, length, np.random.default_rng([seed, each])) for each in range(number)]


def _course(domain: Domain, length: int, rng: np.random.Generator) -> Course:
    items = [name for name, kind in domain.task.objects.items() if kind == "item"]
    tables = [name for name, kind in domain.task.objects.items() if kind == "table"]
    where = {item: str(rng.choice(tables)) for item in items}

    def facts() -> Facts:
        true = {Atom("on-table", (item, place)) for item, place in where.items() if place in tables}
        true |= {Atom("robot-gripping", (item,)) for item, place in where.items() if place == "hand"}
        if "hand" not in where.values():
            true.add(Atom("robot-gripper-empty"))
        return Facts.closed(true, domain.task.atoms)

    course = [Moment((), facts())]
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
        course.append(Moment(((step, SkillResult(step, status)),), facts()))
    return course


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


def recorded(domain: Domain, evaluation: Path, data: Path) -> list[Course]:
    """The looks of an evaluation, episode by episode, with all that was done in between."""
    kept, manifest = evaluation_store.load(evaluation), dataset.read_manifest(data)
    collection, looks = dataset.digest(manifest["collection"]), {each: row for row, each in enumerate(kept.looks)}
    found: list[Course] = []
    for episode in range(manifest["statistics"]["episodes"]):
        course: list[Moment] = []
        done: list[tuple[Step, SkillResult]] = []
        step_number = 0
        for attempt in dataset.read_log(data, collection, episode).attempts:
            named = Atom.parse(attempt.action)
            step = domain.parsed.ground(named.predicate, named.args)
            done.append((step, SkillResult(step, SkillStatus(attempt.status))))
            step_number += attempt.done
            row = looks.get((episode, step_number)) if attempt.done else None
            if row is not None:
                said, true = kept.answers.probability[row], kept.answers.truth[row]
                answered = {a: float(p) for a, p in zip(kept.answers.atoms, said, strict=True) if not np.isnan(p)}
                truth = Facts(dict(zip(kept.answers.atoms, map(bool, true), strict=True)))
                course.append(Moment(tuple(done), truth, answered))
                done = []
        if course:
            found.append(course)
    return found


def flipping(flips: float, seed: int) -> Ask:
    """Plain answers, each turned around with the same chance."""
    rng = np.random.default_rng([seed, round(1000 * flips)])
    return lambda facts: {atom: float(value != (rng.random() < flips)) for atom, value in facts.items()}


def graded(seed: int, clear: float = 3.4, spread: float = 1.1) -> Ask:
    """Probabilities of an eye that sees some moments better than others, and says so as a rule."""
    rng = np.random.default_rng(seed)

    def ask(facts: Facts) -> Answers:
        clarity = max(0.0, rng.normal(clear, spread))
        odds = {atom: (1 if value else -1) * clarity + rng.normal(0.0, 1.6) for atom, value in facts.items()}
        return {atom: 1 / (1 + math.exp(-value)) for atom, value in odds.items()}

    return ask


def judged(monitor: Monitor, taken: Sequence[Course], ask: Ask | None = None, most_looks: int = 1) -> Figures:
    """How the monitor does on some courses; without an eye, on their recorded answers."""
    right = wrong = unknown = looks = moments = 0
    for course in taken:
        memory = monitor.begin()
        for cycle, moment in enumerate(course):
            for step, result in moment.done:
                memory = monitor.acted(memory, step, result)
            for _ in range(most_looks):
                answers = ask(moment.facts) if ask else moment.answers or {}
                memory, judgement = monitor.looked(memory, Belief(looks, answers), cycle)
                looks += 1
                if len(judgement.seen) == len(moment.facts):
                    break
            moments += 1
            right += judgement.state == moment.facts
            wrong += not moment.facts.entails(judgement.seen)
            unknown += len(judgement.seen) < len(moment.facts)
    return Figures(right / moments, wrong / moments, unknown / moments, looks / moments)


def settings(domain: Domain, network: Network, eye: Eye, actions: ActionModel) -> Iterator[tuple[str, Monitor]]:
    yield "plain threshold", PlainMonitor(domain.task.atoms)
    yield "+ consistency", FusedMonitor(network, eye, actions=None)
    yield "+ memory", FusedMonitor(network, eye, actions)


HEAD = (
    f"{'eye':<22}{'setting':<18}{'state':>8}{'wrong':>8}{'unknown':>9}   {'again: state':>13}{'wrong':>8}{'looks':>7}"
)


def row(eye: str, setting: str, one: Figures, more: Figures | None) -> str:
    line = f"{eye:<22}{setting:<18}{one.state:>8.1%}{one.wrong:>8.1%}{one.unknown:>9.1%}"
    return line if more is None else f"{line}   {more.state:>13.1%}{more.wrong:>8.1%}{more.looks:>7.2f}"


def labelled(taken: Sequence[Course], ask: Ask | None) -> list[tuple[Answers, Facts]]:
    return [(ask(m.facts) if ask else m.answers or {}, m.facts) for course in taken for m in course]


def coverage(network: Network, calibration: Sequence[Course], taken: Sequence[Course], ask: Ask | None) -> None:
    """Print asked and measured coverage of looks as a run without memory judges them."""
    trust = fit(labelled(calibration, ask), network)
    monitor = FusedMonitor(network, trust.eye, actions=None)
    looks = [
        (monitor.looked(monitor.begin(), Belief(-1, answers), 0)[1].belief.probability, facts)
        for answers, facts in labelled(taken, ask)
    ]
    names = sorted(trust.conformal.scores)
    print(f"\nconformal coverage over {len(looks)} looks ({len(trust.conformal.scores[names[0]])} to calibrate with)")
    print(f"{'asked':>8}" + "".join(f"{name:>24}" for name in names))
    for asked in ASKED:
        shares = covered(trust.conformal, 1 - asked, looks)
        print(f"{asked:>8.0%}" + "".join(f"{shares[name]:>24.1%}" for name in names))


def made_up(domain: Domain, network: Network, actions: ActionModel, number: int, seed: int) -> None:
    taken = courses(domain, number, 20, seed)
    print(f"made-up looks: {sum(map(len, taken))} moments of {number} courses\n{HEAD}")
    for flips in FLIPS:
        eye = Eye(other=Reading(flips, flips), alike=0.0) if flips else EXACT
        for setting, monitor in settings(domain, network, eye, actions):
            one, more = (judged(monitor, taken, flipping(flips, seed), most) for most in (1, MOST_LOOKS))
            print(row(f"{flips:.0%} flipped" if flips else "oracle", setting, one, more), flush=True)
    calibration = courses(domain, 200, 20, seed + 1)
    eye = fit(labelled(calibration, graded(seed)), network).eye
    for setting, monitor in settings(domain, network, eye, actions):
        one, more = (judged(monitor, taken, graded(seed + 2), most) for most in (1, MOST_LOOKS))
        print(row("graded, often muddled", setting, one, more), flush=True)
    coverage(network, calibration, courses(domain, 100, 20, seed + 3), graded(seed + 4))


def of_a_model(domain: Domain, network: Network, actions: ActionModel, taken: Sequence[Course]) -> None:
    calibration, rest = taken[::2], taken[1::2]
    eye = fit(labelled(calibration, None), network).eye
    print(f"a model's looks: {sum(map(len, rest))} moments of {len(rest)} episodes\n{HEAD}")
    for setting, monitor in settings(domain, network, eye, actions):
        print(row("model", setting, judged(monitor, rest), None), flush=True)
    coverage(network, calibration, rest, None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--courses", type=int, default=30, help="made-up courses of 20 actions")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--evaluation", type=Path, help="the folder of an evaluation of the grocery domain")
    parser.add_argument("--data", type=Path, help="the collection that it evaluates")
    arguments = parser.parse_args()
    if (arguments.evaluation is None) != (arguments.data is None):
        parser.error("--evaluation and --data go together")
    began, domain = time.perf_counter(), load_domain("grocery")
    network = Network(domain.task.atoms, find_mutexes(domain.parsed).groups)
    counts = {} if domain.outcomes is None else load_outcomes(domain.outcomes, domain.parsed.actions)
    if arguments.evaluation is None:  # skills in the made-up courses are not those that were measured
        made_up(domain, network, ActionModel(), arguments.courses, arguments.seed)
    else:
        taken = recorded(domain, arguments.evaluation, arguments.data)
        of_a_model(domain, network, ActionModel(counts), taken)
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
