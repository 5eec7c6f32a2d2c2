"""What episodes come to, and which of the figures that were to be reached are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any, NamedTuple

from benchmarks.monitored.configurations import FULL, ORACLE, PLAIN, flipped
from benchmarks.monitored.looks import Coverage, Line
from executive.faults.catalogue import PHYSICAL, SYMBOLIC
from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.results import claimed, succeeded


@dataclass(frozen=True, slots=True)
class Score:
    """Some episodes of one configuration; shares are of episodes (`success`, `false_success`) or of actions (`missed`,
    `alarms`), None where there was no such action."""

    episodes: int
    success: float
    false_success: float
    missed: float | None
    alarms: float | None
    needless: float
    replans: float
    actions: float
    looks: float
    questions: float
    delay: float | None
    seconds: float


HEADS = (
    "episodes", "success", "false", "missed", "alarms", "needless", "replans", "actions", "looks/action",
    "questions/look", "delay s",
)  # fmt: skip
WIDTHS = (9, 8, 7, 8, 8, 9, 8, 8, 13, 15, 8)

Who = tuple[str, str]
"""An estimator and a setting."""


class Target(NamedTuple):
    """Something that was to be reached, as a line of text, with the figure that is held against it."""

    what: str
    asked: str
    figure: str
    reached: bool


def score(rows: Sequence[Row]) -> Score:
    """The figures of some episodes that could be played."""

    def total(name: str) -> int:
        return sum(getattr(row, name) or 0 for row in rows)

    number = len(rows)
    delays = [
        s.noticed for row in rows for s in row.strikes if s.kind in (*PHYSICAL, *SYMBOLIC) and s.noticed is not None
    ]
    return Score(
        episodes=number,
        success=sum(map(succeeded, rows)) / number,
        false_success=sum(claimed(row) and not row.goal_true for row in rows) / number,
        missed=total("missed") / total("failed") if total("failed") else None,
        alarms=total("alarms") / total("quiet") if total("quiet") else None,
        needless=total("needless") / number,
        replans=total("replans") / number,
        actions=total("actions") / number,
        looks=total("looks") / max(1, total("actions")),
        questions=total("questions") / max(1, total("looks")),
        delay=fmean(delays) if delays else None,
        seconds=sum(row.wall_seconds for row in rows),
    )


def scores(rows: Sequence[Row]) -> dict[Who, Score]:
    """By estimator and setting, in the order of their first episodes; those that failed to be played are left out."""
    groups: dict[Who, list[Row]] = {}
    for row in rows:
        if row.outcome != FAILED:
            groups.setdefault((row.estimator, row.monitor), []).append(row)
    return {who: score(members) for who, members in groups.items()}


def table(found: Mapping[Who, Score]) -> str:
    """A line for each estimator and setting."""
    lines = [f"{'estimator':<24}{'setting':<18}" + "".join(f"{h:>{w}}" for h, w in zip(HEADS, WIDTHS, strict=True))]
    for (estimator, setting), each in found.items():
        told = (
            f"{each.episodes}",
            *map(_share, (each.success, each.false_success, each.missed, each.alarms)),
            *(f"{value:.2f}" for value in (each.needless, each.replans)),
            f"{each.actions:.1f}",
            f"{each.looks:.2f}",
            f"{each.questions:.1f}",
            "-" if each.delay is None else f"{each.delay:.2f}",
        )
        lines.append(f"{estimator:<24}{setting:<18}" + "".join(f"{t:>{w}}" for t, w in zip(told, WIDTHS, strict=True)))
    return "\n".join(lines)


def of_loop(world: str, found: Mapping[Who, Score]) -> list[Target]:
    """What issue 5 asks of the closed loop."""
    targets = []
    noisy = flipped(0.05)
    oracle, full, plain = found.get((ORACLE, FULL)), found.get((noisy, FULL)), found.get((noisy, PLAIN))
    if oracle and full and plain:
        figure = f"{_share(full.success)}, the oracle {_share(oracle.success)}, plain {_share(plain.success)}"
        reached = oracle.success - full.success <= 0.03
        targets.append(Target(f"{world}: success, {noisy}", "within 3 points of the oracle", figure, reached))
        figure = f"{full.needless:.2f}, plain {plain.needless:.2f}"
        targets.append(Target(f"{world}: needless replans, {noisy}", "at most 0.3", figure, full.needless <= 0.3))
    for estimator in dict.fromkeys(estimator for estimator, _ in found):
        full, plain = found.get((estimator, FULL)), found.get((estimator, PLAIN))
        if full and plain:
            figure = f"{_share(full.false_success)}, plain {_share(plain.false_success)}"
            targets.append(
                Target(f"{world}: false success, {estimator}", "at most 1 %", figure, full.false_success <= 0.01)
            )
    return targets


def of_looks(lines: Sequence[Line], covered: Sequence[Coverage]) -> list[Target]:
    """What it asks of looks."""
    targets = []
    for estimator in dict.fromkeys(line.estimator for line in lines if line.estimator.startswith("model, ")):
        state = {line.setting: line.once.state for line in lines if line.estimator == estimator}
        plain, best = state[PLAIN], state["+ memory"]
        figure = f"{_share(plain)} to {_share(best)}"
        targets.append(Target(f"whole state, {estimator}", "up by 20 points", figure, best - plain >= 0.2))
    for estimator in dict.fromkeys(each.estimator for each in covered):
        worst = max(
            (each for each in covered if each.estimator == estimator), key=lambda each: abs(each.measured - each.asked)
        )
        figure = (
            f"{_share(worst.measured)} of {worst.predicate} where {worst.asked:.0%} was asked, and nearer elsewhere"
        )
        near = abs(worst.measured - worst.asked) <= 0.02
        targets.append(Target(f"conformal coverage, {estimator}", "within 2 points", figure, near))
    return targets


def told(targets: Sequence[Target]) -> str:
    """The targets as text."""
    width = max((len(each.what) for each in targets), default=0)
    return "\n".join(
        f"{each.what:<{width}}  {each.asked:<30}{'reached' if each.reached else 'NOT REACHED':<13}{each.figure}"
        for each in targets
    )


def document(found: Mapping[Who, Score]) -> list[dict[str, Any]]:
    """The scores as JSON."""
    return [
        {"estimator": estimator, "setting": setting, **asdict(each)} for (estimator, setting), each in found.items()
    ]


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.1%}"
