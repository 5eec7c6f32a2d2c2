"""What a run would believe after each look of an evaluation, had it seen nothing before: the answers about all atoms at
once, weighed by how the estimator errs, and made consistent with what every state of the task keeps.

It is the monitor of a run (`executive.belief`) without any memory. Where objects change from episode to episode, each
has a task of its own."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from executive.app.config import EstimatorConfig, MonitorConfig
from executive.app.estimators import with_default_model
from executive.app.monitors import open_monitor
from executive.belief import BayesMonitor, SensorModel
from executive.domain.loader import Domain, Subject, load_domain
from executive.errors import InputError
from executive.lab.collection.dataset import Point
from executive.lab.config import EvalConfig
from executive.lab.evaluation.varying import Varying
from executive.types import Atom, Belief


class Posterior:
    """The belief after a single look.

    Args:
        subject: what is asked about.
        varying: what is known of the objects, where these are others in each episode.

    Raises:
        DomainError: the domain is one that no run could carry out.
        InputError: the estimator's calibration is damaged.
        MissingError: Fast Downward's translator is not installed.
    """

    def __init__(self, config: EvalConfig, subject: Subject, varying: Varying | None) -> None:
        self._where, self._varying, self._name = config.domain, varying, subject.task.name
        self._estimator = with_default_model(config.eye, subject)
        domain = load_domain(config.domain, config.problem)
        self._monitor = None if varying else open_single_look(domain, self._estimator)
        self._episode: int | None = None

    def of(self, point: Point, atoms: Sequence[Atom], answers: Belief) -> tuple[float | None, ...]:
        """Return the probability of each of the atoms that were asked about, given the answers to a look at a point; of
        one that no run of the task would ask about, its own answer."""
        monitor = self._of_episode(point) if self._varying else self._monitor
        assert monitor is not None
        _, judgement = monitor.looked(monitor.begin(), answers, 1)
        return tuple(judgement.probability.get(atom, answers.probability.get(atom)) for atom in atoms)

    def _of_episode(self, point: Point) -> BayesMonitor | None:
        assert self._varying is not None
        if self._episode != point.episode:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "problem.pddl"
                file.write_text(self._varying.problem(self._name, point), encoding="utf-8")
                self._monitor = open_single_look(load_domain(self._where, str(file)), self._estimator)
            self._episode = point.episode
        return self._monitor


def open_single_look(domain: Domain, estimator: EstimatorConfig | None) -> BayesMonitor:
    """Return a monitor with the task's mutex groups, its states where they can be listed, and how the estimator errs,
    as far as that is known: what a model's own folder says of other domains alone is not.

    Raises:
        InputError: the estimator's calibration is damaged.
        MissingError: Fast Downward's translator is not installed.
    """
    try:
        monitor = open_monitor(MonitorConfig(), domain, estimator)
    except InputError:
        if estimator is None or estimator.calibration is not None:  # that was asked for
            raise
        monitor = open_monitor(MonitorConfig(), domain, None, oracle=SensorModel())
    assert isinstance(monitor, BayesMonitor)  # what the default options are for
    return monitor
