"""The loop with the usual session and observer around it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from executive.belief import Monitor, ThresholdMonitor
from executive.core.attention import Attention
from executive.core.loop import Executive
from executive.core.observer import CameraObserver
from executive.core.run_state import RunState
from executive.core.session import Session
from executive.core.settings import Settings
from executive.protocols import Estimator, FaultSource, PlaceSearch, Planner, Preparing, Sink, Skill, Witness, World
from executive.types import Facts, Task


def make_executive(
    task: Task,
    planner: Planner,
    world: World,
    skills: Mapping[str, Skill],
    estimator: Estimator | None,
    sinks: Sequence[Sink] = (),
    settings: Settings | None = None,
    faults: FaultSource | None = None,
    initial: Facts | None = None,
    domain: str = "",
    run: str = "",
    monitor: Monitor | None = None,
    attention: Attention | None = None,
    moves: Mapping[str, Skill] | None = None,
    run_state: RunState | None = None,
    prepare: Iterable[Preparing] = (),
    witness: Witness | None = None,
    search: PlaceSearch | None = None,
) -> Executive:
    """Put the closed loop together, ready to `run`.

    Args:
        skills: by the name of the action that each carries out.
        estimator: judges the atoms of each look. Without one the executive is the blind baseline: it is given
            `initial`, never looks and assumes each step's effects.
        sinks: receive every event. One that raises is dropped with a warning, and nothing else changes.
        faults: breaks things on purpose.
        initial: what holds at first, for a blind executive; one that looks has to see it for itself.
        domain, run: names for the trace.
        monitor: weighs the answers of each look into a belief; without one, each answer is thresholded.
        attention: which cameras show what best.
        moves: skills that bring the arm out of the way, by name, the mildest first.
        run_state: how the run stands, where another process began it.
        prepare: what has to be made ready before the first look.
        witness: what tells of atoms at a look beside the estimator; the monitor knows how it errs.
        search: finds where to look first for what cannot be seen; without it, that is where it most probably is.

    Raises:
        InputError: neither an estimator nor initial facts.
    """
    settings = settings or Settings()
    session = Session(sinks, world, settings.seed, faults)
    observer = CameraObserver(estimator, world, session, settings, attention, moves, witness) if estimator else None
    monitor = monitor or ThresholdMonitor(task.atoms)
    return Executive(
        task, planner, monitor, skills, session, observer, settings, initial, domain, run, run_state, prepare, search
    )
