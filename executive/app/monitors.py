"""Builds a run's monitor from its configuration.

Everything that is built here can be built by hand from `executive.belief`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from executive.app import sensor_fit
from executive.app.config import PLAIN, EstimatorConfig, MonitorConfig
from executive.belief import (
    EXACT,
    ActionModel,
    BayesMonitor,
    ConstrainedNetwork,
    Group,
    Monitor,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
    WitnessModel,
)
from executive.belief.action_model import process_noise
from executive.belief.bayes_filter import ACCIDENT
from executive.belief.place_priors import stated_priors
from executive.domain.loader import Domain
from executive.domain.places import read_places
from executive.errors import DomainError, InputError, OptionError
from executive.planning.invariants import broken, contradicted, survives_accidents
from executive.planning.literal_pairs import LiteralPairs
from executive.planning.mutex_groups import find_mutexes
from executive.planning.state_listing import MOST_ACTIONS, groups_of, is_complete, list_states, most_actions, steps
from executive.s3e import calibration_file
from executive.types import Atom, Step

MOST_PROVED, MOST_TIED = 2_000, 5_000
"""Proved implications, and states of the atoms that they tie together, up to which they are used: there is a belief
without them, too, and it is quick."""

log = logging.getLogger(__name__)


def open_monitor(
    config: MonitorConfig,
    domain: Domain,
    estimator: EstimatorConfig | None,
    seconds: float = 30.0,
    oracle: SensorModel | None = None,
    witnesses: Mapping[str, WitnessModel] = MappingProxyType({}),
    calibration: Path | None = None,
    places: Path | None = None,
    patience: float | None = None,
) -> Monitor:
    """Build a run's monitor, and find the task's mutex groups and, if there are few, its states for it.

    Args:
        estimator: the options of the estimator that it monitors; None for the oracle.
        seconds: the processor time that finding the mutex groups may take, and `patience` its wall time (by default
            as much).
        oracle: the oracle's sensor model, unless `calibration` has another one; without it, it is exact.
        witnesses: how those err that tell of atoms beside the estimator, by name.
        calibration: the file with the sensor model; by default, the estimator's, or the one in its model's folder.
        places: a file that says where things usually are, and better than the domain where it speaks of them.

    Raises:
        InputError: a file is damaged, `calibration`, or has too few looks for the error rate.
        DomainError: the domain's outcomes have a mistake.
        MissingError: Fast Downward's translator is not installed.
    """
    if config.kind == PLAIN:
        return plain_monitor(config, domain.task.atoms)
    # What is cheap to check comes first.
    counts = {} if domain.outcomes is None else sensor_fit.load_outcomes(domain.outcomes, domain.parsed.actions)
    sensor, thresholds = _sensor_model(config, domain, estimator, oracle or EXACT, calibration)
    learned = {} if places is None else read_places(places, domain)
    found = find_mutexes(domain.parsed, timeout=seconds, patience=patience, leaves_open=domain.leaves_open)
    # Over listed states nothing says which of their atoms are hidden.
    space = None if domain.task.visible else list_states(domain.parsed, found)
    moves = tuple(steps(domain.parsed)) if most_actions(domain.parsed) <= MOST_ACTIONS else ()
    proved = None
    if space is None and moves and is_complete(domain.parsed, found):
        proved = LiteralPairs.reachable(domain.task.atoms, moves, found.state)
    # Where :init may leave things open, what it does not name may be so all the same.
    network = _network(domain, groups_of(found, space), moves, None if domain.leaves_open else proved)
    actions = ActionModel(counts, process_noise(len(domain.task.atoms))) if config.memory else None
    carried, visibility = domain.looking.carried, domain.task.visibility
    prior = _prior(domain, network.groups, learned, places)
    if proved is not None:
        prior = dict.fromkeys(proved.never, ACCIDENT) | dict(prior)
    return BayesMonitor(network, sensor, actions, thresholds, carried, space, witnesses, visibility, prior)


def _prior(
    domain: Domain, groups: Sequence[Group], learned: Mapping[Atom, float], places: Path | None
) -> Mapping[Atom, float]:
    """Return how probable atoms are before the first look, of which something is stated. Of a group, either what was
    learned counts or what the domain says.

    Raises:
        InputError: it cannot be so.
    """
    parsed = domain.parsed
    told = {atom for group in groups if not learned.keys().isdisjoint(group.atoms) for atom in group.atoms}
    usual = {atom: value for atom, value in domain.priors.items() if atom not in told} | dict(learned)
    try:
        return stated_priors(groups, usual, parsed.unknown, parsed.oneof)
    except ValueError as error:
        if places is not None:
            raise InputError(str(error), file=places, key="priors") from None
        raise DomainError(str(error), file=domain.files[0], key="priors") from None


def _network(
    domain: Domain, groups: tuple[Group, ...], moves: Sequence[Step], proved: LiteralPairs | None
) -> MutexNetwork:
    """Return the task's atoms with what is known of its states."""
    stated, atoms = domain.parsed.invariants, domain.task.atoms
    if proved is not None and not groups:  # as where effects have conditions, of which the translator proves little
        groups = tuple(
            Group(group.atoms, group.exact and survives_accidents(group.at_least_one, moves))
            for group in proved.groups()
        )
    if stated:
        return _stated(domain, groups, moves)
    parts = [] if proved is None else list(proved.implications(groups))
    if not 0 < len(parts) <= MOST_PROVED:
        return MutexNetwork(atoms, groups)
    hard = tuple(part for part in parts if survives_accidents(part, moves))
    costly = tuple(part for part in parts if part not in set(hard))
    return ConstrainedNetwork(atoms, groups, hard, costly, MOST_TIED).reduced()


def _stated(domain: Domain, groups: tuple[Group, ...], moves: Sequence[Step]) -> MutexNetwork:
    """Return the task's atoms with the mutex groups and what the domain states."""
    stated, atoms = domain.parsed.invariants, domain.task.atoms
    check_invariants(domain, groups)
    parts = [part for each in stated.values() for part in each.conjuncts]
    hard = tuple(part for part in parts if survives_accidents(part, moves))
    costly = tuple(part for part in parts if part not in hard)
    try:
        if costly:  # some state has to keep all of them, even so
            ConstrainedNetwork(atoms, groups, tuple(parts))
        network = ConstrainedNetwork(atoms, groups, hard, costly)
    except ValueError:
        raise DomainError("no state at all keeps these", file=domain.files[0], key="invariants") from None
    for name, each in stated.items():
        if network.unused_among(each):
            log.warning("invariant %s ties too many atoms together; answers are not made consistent with it", name)
    return network


def check_invariants(domain: Domain, groups: Sequence[Group]) -> None:
    """Check what a domain states that every state keeps.

    Raises:
        DomainError: the problem's :init contradicts it, or an action breaks it.
    """
    if (name := contradicted(domain.parsed)) is not None:
        message = f"is contradicted by the :init of {domain.files[2].name}"
        raise DomainError(message, file=domain.files[0], key=f"invariants.{name}")
    if (found := broken(domain.parsed, groups)) is not None:
        where = ", ".join(found.before.literals()[:6])
        message = f"{found.step} breaks it where {where}; what rules that out, if anything, is an invariant, too"
        raise DomainError(message, file=domain.files[0], key=f"invariants.{found.name}")


def plain_monitor(config: MonitorConfig, atoms: Sequence[Atom]) -> ThresholdMonitor:
    """Build the monitor that needs nothing but the atoms."""
    assert config.threshold is not None
    return ThresholdMonitor(atoms, Thresholds(config.threshold, config.threshold))


def _sensor_model(
    config: MonitorConfig,
    domain: Domain,
    estimator: EstimatorConfig | None,
    oracle: SensorModel,
    calibration: Path | None,
) -> tuple[SensorModel, Mapping[str, Thresholds]]:
    """Return the estimator's sensor model, and the thresholds for the requested error rate."""
    named = config.trust or calibration or (None if estimator is None else estimator.calibration)
    if estimator is None and named is None:
        if config.alpha is not None:
            message = (
                "needs `estimator` vlm, or `calibration` where a fault makes the oracle err: the oracle has no error "
                "rate"
            )
            raise OptionError(message, option="alpha")
        return oracle, {}
    default = sensor_fit.default_file(estimator.vlm) if estimator is not None and estimator.server is None else None
    known, file = None, None
    for file in filter(None, (named, default)):  # one that only corrects probabilities says nothing of error rates
        document, file = calibration_file.read(file), calibration_file.place(file)
        if document.domains:
            known = sensor_fit.of(document, domain.name, file)
            break
    if known is None:
        if config.alpha is not None:
            message = (
                f"the model's error rates are not known: there is no {calibration_file.FILE} with them in its folder; "
                "make one with executive calibrate, or name one with `calibration`"
            )
            raise OptionError(message, option="alpha")
        return SensorModel(), {}
    if config.alpha is None:
        return known.sensor_model, {}
    unmeasured = sorted({atom.predicate for atom in domain.task.atoms} - known.conformal.scores.keys())
    if unmeasured:
        raise OptionError(f"has no calibration looks about {', '.join(unmeasured)}", file=file, option="alpha")
    try:
        return known.sensor_model, known.conformal.thresholds(config.alpha)
    except ValueError as error:
        raise OptionError(str(error), file=file, option="alpha") from None
