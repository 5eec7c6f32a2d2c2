"""What a monitor makes of looks, and how well conformal prediction keeps its promise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.monitored.courses import Answers, Ask, RunState
from executive.app.sensor_fit import SensorFit, fit
from executive.belief import ActionModel, BayesMonitor, Monitor, MutexNetwork, SensorModel, ThresholdMonitor
from executive.belief.conformal import Conformal, look_scores
from executive.domain.loader import Domain
from executive.types import Belief, Facts

ASKED = (0.8, 0.9, 0.95)
MOST_LOOKS = 3
SPLITS = 200


class Figures(NamedTuple):
    """Shares of the moments, and looks a moment: the whole state that would be planned from is right; something that is
    told is wrong; something is not told."""

    state: float
    wrong: float
    unknown: float
    looks: float


class Line(NamedTuple):
    """An estimator with a setting: with one look at each moment, and with as many as `MOST_LOOKS` while something is
    unknown (None where there is but one)."""

    estimator: str
    setting: str
    once: Figures
    again: Figures | None


class Coverage(NamedTuple):
    """The share of looks in which the truth of each atom of a predicate is in its conformal set: asked and measured."""

    estimator: str
    predicate: str
    asked: float
    measured: float


def judged(monitor: Monitor, taken: Sequence[RunState], ask: Ask | None = None, most_looks: int = 1) -> Figures:
    """How the monitor does on some courses; without an estimator, on their recorded answers."""
    right = wrong = unknown = looks = moments = 0
    for run_state in taken:
        memory = monitor.begin()
        for cycle, moment in enumerate(run_state):
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


def settings(
    domain: Domain, network: MutexNetwork, sensor: SensorModel, actions: ActionModel
) -> Iterator[tuple[str, Monitor]]:
    yield "plain threshold", ThresholdMonitor(domain.task.atoms)
    yield "+ consistency", BayesMonitor(network, sensor, actions=None)
    yield "+ memory", BayesMonitor(network, sensor, actions)


def trusted(network: MutexNetwork, taken: Sequence[RunState], ask: Ask | None = None) -> SensorFit:
    """How far an estimator can be trusted, by what it says of some courses."""
    return fit([look for run_state in taken for look in _labelled(run_state, ask)], network)


def coverage(name: str, network: MutexNetwork, taken: Sequence[RunState], ask: Ask | None = None) -> list[Coverage]:
    """Measured as a run without memory judges looks. What the answers are worth is learned from every third course; the
    others calibrate and are judged, in `SPLITS` random halves: courses are as good as exchangeable, looks of one are
    not, and a single split would say more about chance than about the method."""
    sensor = trusted(network, taken[::3], ask).sensor_model
    monitor = BayesMonitor(network, sensor, actions=None)
    scored = []
    for number, run_state in enumerate(taken):
        if number % 3:
            looks = [
                (monitor.looked(monitor.begin(), Belief(-1, answers), 0)[1].belief.probability, facts)
                for answers, facts in _labelled(run_state, ask)
            ]
            scored.append([look_scores(probability, facts) for probability, facts in looks])
    names = sorted({name for run_state in scored for look in run_state for name in look})
    shares: dict[tuple[str, float], list[float]] = {}
    rng = np.random.default_rng(0)
    for _ in range(SPLITS):
        order = rng.permutation(len(scored))
        half = len(scored) // 2
        for predicate in names:
            known, new = (
                [look[predicate] for place in places for look in scored[place] if predicate in look]
                for places in (order[:half], order[half:])
            )
            conformal = Conformal({predicate: tuple(known)})
            for asked in ASKED:
                held = np.array(new) <= conformal.quantile(predicate, 1.0 - asked)
                shares.setdefault((predicate, asked), []).append(float(held.mean()))
    return [Coverage(name, predicate, asked, float(np.mean(each))) for (predicate, asked), each in shares.items()]


def head() -> str:
    title = f"{'estimator':<24}{'setting':<18}{'state':>8}{'wrong':>8}{'unknown':>9}"
    return f"{title}   {f'{MOST_LOOKS} looks: state':>16}{'wrong':>8}{'looks':>7}"


def told(line: Line) -> str:
    once, again = line.once, line.again
    text = f"{line.estimator:<24}{line.setting:<18}{once.state:>8.1%}{once.wrong:>8.1%}{once.unknown:>9.1%}"
    return text if again is None else f"{text}   {again.state:>16.1%}{again.wrong:>8.1%}{again.looks:>7.2f}"


def told_coverage(found: Sequence[Coverage]) -> str:
    names = sorted({each.predicate for each in found})
    lines = [f"{'estimator':<24}{'asked':>8}" + "".join(f"{name:>24}" for name in names)]
    table = {(each.estimator, each.asked, each.predicate): each.measured for each in found}
    for estimator, asked in dict.fromkeys((each.estimator, each.asked) for each in found):
        lines.append(
            f"{estimator:<24}{asked:>8.0%}" + "".join(f"{table[estimator, asked, name]:>24.1%}" for name in names)
        )
    return "\n".join(lines)


def _labelled(run_state: RunState, ask: Ask | None) -> list[tuple[Answers, Facts]]:
    return [(ask(moment.facts) if ask else moment.answers or {}, moment.facts) for moment in run_state]
