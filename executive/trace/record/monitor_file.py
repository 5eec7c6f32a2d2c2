"""The monitor of a run beside its record, in `monitor.json`: what was made of its looks can be worked out once more,
whatever has become of the domain, of the model and of what is known about it since."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from executive.belief import (
    ActionModel,
    BayesMonitor,
    Chances,
    ConstrainedNetwork,
    ErrorModel,
    Group,
    Monitor,
    MutexNetwork,
    SensorModel,
    StateSpace,
    ThresholdMonitor,
    Thresholds,
    WitnessModel,
)
from executive.errors import InputError, nearest
from executive.trace.record.codec import decode, encode
from executive.types import Atom, Condition, DerivedRules, SkillStatus, Visibility
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json

FILE = "monitor.json"
_LARGEST = 20_000_000
_LARGEST_STATES = 200_000_000
_FORMAT = 1


@dataclass(frozen=True, slots=True)
class _Plain:
    thresholds: Thresholds


@dataclass(frozen=True, slots=True)
class _Carried:
    """A predicate, and where its arguments stand among a step's."""

    predicate: str
    positions: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _SensorModel:
    """A `SensorModel` under the file's own keys."""

    readings: Mapping[str, ErrorModel] = field(default_factory=dict)
    other: ErrorModel = field(default_factory=ErrorModel)
    alike: float = 0.2
    lasting: float = 0.0
    atoms: Mapping[Atom, ErrorModel] = field(default_factory=dict)
    correlations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Witness:
    sensor: _SensorModel
    shared: float


@dataclass(frozen=True, slots=True)
class _Fused:
    groups: tuple[Group, ...]
    eye: _SensorModel
    thresholds: Mapping[str, Thresholds]
    unrest: float | None
    """The action model's process noise; None for a monitor without memory."""
    counts: Mapping[str, Mapping[str, tuple[float, ...]]]
    """By action and by what its skill reports."""
    carried: Mapping[str, _Carried] = field(default_factory=dict)
    states: str = ""
    """The listed states' bits, compressed, as text; nothing where none are listed."""
    rules: Mapping[Atom, Condition] = field(default_factory=dict)
    """How derived atoms follow from those of the listed states, or from those that say what can be seen."""
    witnesses: Mapping[str, _Witness] = field(default_factory=dict)
    visible: Mapping[Atom, Condition] = field(default_factory=dict)
    constraints: tuple[Condition, ...] = ()
    costly: tuple[Condition, ...] = ()
    prior: Mapping[Atom, float] = field(default_factory=dict)


def save(run: Path | str, monitor: Monitor) -> Path | None:
    """Write `monitor.json` into the run's folder. A monitor that is none of Executive's own is not kept."""
    kind = next((kind for kind, each in _KINDS.items() if isinstance(monitor, each.monitor)), None)
    if kind is None:
        return None
    kept = encode(_KINDS[kind].write(monitor))
    text = json.dumps({"format": _FORMAT, "kind": kind, **kept}, indent=1) + "\n"
    return write_atomic(Path(run) / FILE, text.encode())


def load(run: Path | str, atoms: Sequence[Atom]) -> Monitor:
    """Return the monitor that a run with these atoms had.

    Raises:
        InputError: there is none in its folder, or a damaged one.
    """
    file = Path(run) / FILE
    if not file.exists():
        raise InputError("is missing: it is not known what was made of the run's looks", file=file)
    said = read_json(file, largest=_LARGEST)
    try:
        if not isinstance(said, dict) or said.get("format") != _FORMAT:
            raise ValueError(f"expected format {_FORMAT}")
        if said.get("kind") not in _KINDS:
            raise ValueError(f"no monitor {said.get('kind')!r}; {nearest(str(said.get('kind')), _KINDS)}")
        kind = _KINDS[said["kind"]]
        return kind.read(decode(kind.kept, said), atoms)
    except ValueError as error:
        raise InputError(f"is damaged: {error}", file=file) from None


def described(monitor: Monitor) -> str:
    """Return a monitor in a few words."""
    match monitor:
        case ThresholdMonitor(thresholds=Thresholds(low=low, high=high)):
            return f"threshold {high:g}" if low == high else f"thresholds {low:g} and {high:g}"
        case BayesMonitor():
            parts = ["consistency"] if monitor.network.groups or monitor.space is not None else []
            parts += ["memory"] if monitor.actions is not None else []
            told = " and ".join(parts) or "neither consistency nor memory"
            return f"{told}, thresholds by predicate" if monitor.thresholds else told
    return type(monitor).__name__


def _fused(monitor: BayesMonitor) -> _Fused:
    counts: dict[str, dict[str, tuple[float, ...]]] = {}
    for (action, status), each in (monitor.actions.counts if monitor.actions else {}).items():
        counts.setdefault(action, {})[status.value] = tuple(each)
    unrest = None if monitor.actions is None else monitor.actions.process_noise
    carried = {action: _Carried(*said) for action, said in monitor.carried.items()}
    witnesses = {name: _Witness(_kept(each.sensor), each.shared) for name, each in monitor.witnesses.items()}
    eye = _kept(monitor.sensor_model)
    kept = _Fused(monitor.network.groups, eye, monitor.thresholds, unrest, counts, carried, witnesses=witnesses)
    if isinstance(monitor.network, ConstrainedNetwork):
        kept = replace(kept, constraints=monitor.network.constraints, costly=monitor.network.costly)
    if monitor.prior:
        kept = replace(kept, prior=dict(monitor.prior))
    if monitor.visibility:
        seen = monitor.visibility
        kept = replace(kept, visible=seen.conditions, rules=seen.rules.rules)
    if monitor.space is None:
        return kept
    return replace(kept, states=_compressed(monitor.space), rules=monitor.space.rules.rules)


def _kept(sensor: SensorModel) -> _SensorModel:
    return _SensorModel(
        sensor.error_models,
        sensor.other,
        sensor.correlation_within,
        sensor.correlation_across,
        sensor.atoms,
        sensor.correlations,
    )


def _sensor(kept: _SensorModel) -> SensorModel:
    return SensorModel(kept.readings, kept.other, kept.alike, kept.lasting, kept.atoms, kept.correlations)


def _compressed(space: StateSpace) -> str:
    return base64.b64encode(zlib.compress(space.packed.tobytes(), 9)).decode()


def _listed(text: str, atoms: Sequence[Atom], rules: Mapping[Atom, Condition]) -> StateSpace:
    """
    Raises:
        ValueError: the text is none of `_compressed`.
    """
    try:
        inflate = zlib.decompressobj()
        data = inflate.decompress(base64.b64decode(text, validate=True), _LARGEST_STATES)
    except zlib.error as error:
        raise ValueError(f"states: {error}") from None
    if inflate.unconsumed_tail:
        raise ValueError("states: there are too many")
    known = tuple(sorted(atoms))
    width = (len(known) + 7) // 8
    if not width or len(data) % width:
        raise ValueError("states: they are of another task")
    packed = np.frombuffer(data, dtype=np.uint8).reshape(-1, width)
    return StateSpace(known, packed, DerivedRules(rules))


def _monitor(kept: _Fused, atoms: Sequence[Atom]) -> BayesMonitor:
    actions = None
    if kept.unrest is not None:
        counts = {}
        for action, statuses in kept.counts.items():
            for status, numbers in statuses.items():
                if len(numbers) != len(Chances._fields):
                    raise ValueError(f"counts: {action}: {status}: expected three numbers")
                counts[action, SkillStatus(status)] = Chances(*numbers)
        actions = ActionModel(counts, kept.unrest)
    carried = {action: (said.predicate, said.positions) for action, said in kept.carried.items()}
    network = MutexNetwork(tuple(atoms), kept.groups)
    if kept.constraints or kept.costly:
        network = ConstrainedNetwork(tuple(atoms), kept.groups, kept.constraints, kept.costly)
    space = _listed(kept.states, atoms, kept.rules) if kept.states else None
    witnesses = {name: WitnessModel(_sensor(each.sensor), each.shared) for name, each in kept.witnesses.items()}
    visibility = Visibility(kept.visible, DerivedRules(kept.rules)) if kept.visible else Visibility()
    sensor, prior = _sensor(kept.eye), kept.prior
    return BayesMonitor(network, sensor, actions, kept.thresholds, carried, space, witnesses, visibility, prior)


class _Kind(NamedTuple):
    """A kind of monitor, what is kept of one, and how it is written and read."""

    monitor: type
    kept: type
    write: Callable[[Any], Any]
    read: Callable[[Any, Sequence[Atom]], Monitor]


_KINDS: Mapping[str, _Kind] = {
    ThresholdMonitor.kind: _Kind(
        ThresholdMonitor,
        _Plain,
        lambda monitor: _Plain(monitor.thresholds),
        lambda kept, atoms: ThresholdMonitor(atoms, kept.thresholds),
    ),
    BayesMonitor.kind: _Kind(BayesMonitor, _Fused, _fused, _monitor),
}

KINDS = frozenset(_KINDS)
"""The kinds of monitors that a record can keep."""
