"""A replay beside its record: where the two do the same, and where they part."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from executive.app.config import MonitorConfig
from executive.app.monitors import open_monitor, plain_monitor
from executive.belief import Monitor, ThresholdMonitor
from executive.errors import InputError
from executive.replay.engine import Replay, replay
from executive.replay.record import Record, same_causes
from executive.trace.record.log import read_events
from executive.trace.record.monitor_file import described, load
from executive.types import Decision


class Row(NamedTuple):
    """Two decisions of one cycle side by side, None where one side has no more of them."""

    cycle: int
    recorded: Decision | None
    replayed: Decision | None

    @property
    def agree(self) -> bool:
        """Whether both sides do the same, for whatever reason."""
        left, right = self.recorded, self.replayed
        return left is not None and right is not None and (left.kind, left.outcome) == (right.kind, right.outcome)

    @property
    def same(self) -> bool:
        """Whether they also give the same reason."""
        left, right = self.recorded, self.replayed
        return self.agree and left is not None and right is not None and same_causes(left, right)


@dataclass(frozen=True, slots=True)
class Comparison:
    """A run and its replay: what was made of the looks in each, in words, and their decisions side by side. There is
    one record for each process that had the run, and a replay of each."""

    records: tuple[Record, ...]
    replays: tuple[Replay, ...]
    names: tuple[str, str]
    rows: tuple[Row, ...]

    @property
    def decisions(self) -> int:
        """How many were recorded."""
        return sum(len(record.decisions) for record in self.records)

    @property
    def agree(self) -> bool:
        """Whether both do the same, as far as the record goes."""
        return not any(replayed.parted for replayed in self.replays) and all(row.agree for row in self.rows)

    @property
    def left(self) -> int:
        """How many of the recorded decisions the replay does not come to."""
        return self.decisions - sum(row.recorded is not None for row in self.rows)

    @property
    def ends(self) -> tuple[str, ...]:
        """Where the two part, and why the record is over if the run is not; nothing where all came to its end."""
        last = len(self.replays) - 1
        said = [each for number, each in enumerate(self.replays) if each.end and (each.parted or number == last)]
        return tuple(f"{'here the two part' if each.parted else 'the record ends'}: {each.end}" for each in said)


def compare_run(folder: Path, wanted: MonitorConfig | None = None) -> Comparison:
    """Decide once more from the record of a run: with the monitor that it had, or with the one that is `wanted`.

    Raises:
        InputError: the folder holds no run, a damaged one, or none in which a monitor decided anything.
        DomainError: the domain is needed for the monitor, and is not as it was.
    """
    records = Record.all(read_events(folder, images=False))
    started = records[0].started
    atoms = started.task.atoms
    if started.is_blind:
        if wanted is not None:
            raise InputError("nobody looked in this run: what is made of looks decides nothing", file=folder)
        then: Monitor = ThresholdMonitor(atoms)
        names = ("nobody looks", "nobody looks")
    else:
        then = load(folder, atoms)
        names = (described(then), described(then))
    replays = [replay(record, then) for record in records]
    if wanted is not None:
        other = _opened(wanted, folder, records[0])
        replays = [replay(record, other, before) for record, before in zip(records, replays, strict=True)]
        names = (names[0], described(other))
    rows = [row for record, again in zip(records, replays, strict=True) for row in side_by_side(record, again)]
    return Comparison(records, tuple(replays), names, tuple(rows))


def _opened(wanted: MonitorConfig, folder: Path, record: Record) -> Monitor:
    """The monitor that a run with this configuration would have had. Only a threshold needs nothing but the atoms."""
    from executive.app.config import PLAIN, EstimatorConfig, read_config
    from executive.app.estimators import with_default_model
    from executive.app.worlds import oracle_sensor_model
    from executive.domain.loader import load_domain

    if wanted.kind == PLAIN:
        return plain_monitor(wanted, record.started.task.atoms)
    config = read_config(folder)
    domain = load_domain(config.domain, config.problem)
    if domain.task.atoms != record.started.task.atoms:
        raise InputError("was another task when it was recorded; only --threshold needs none", file=domain.folder)
    eye = with_default_model(config.eye or EstimatorConfig(), domain.subject) if config.estimator == "vlm" else None
    calibration = None if config.eye is None else config.eye.calibration
    return open_monitor(wanted, domain, eye, oracle=oracle_sensor_model(config), calibration=calibration)


def side_by_side(record: Record, replayed: Replay) -> list[Row]:
    """Return the decisions of both, cycle by cycle. What is decided beyond the end of a record is left out."""
    mine = replayed.decisions
    if record.cut and not replayed.parted:
        mine = mine[: len(record.decisions)]
    last = max((each.cycle for each in mine), default=-1)
    sides: dict[int, tuple[list[Decision], list[Decision]]] = {}
    for side, decisions in enumerate((record.decisions, mine)):
        for cycle, decision in decisions:
            if cycle <= last:
                sides.setdefault(cycle, ([], []))[side].append(decision)
    return [Row(cycle, *pair) for cycle, both in sorted(sides.items()) for pair in zip_longest(*both)]
