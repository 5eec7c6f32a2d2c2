"""One episode: the whole executive in a world of atoms, and what it came to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from benchmarks.places.settings import DRAWERS, WANTED, Setting
from executive.app.assembly import make_executive
from executive.app.config import EXPECTED, MonitorConfig
from executive.app.monitors import open_monitor
from executive.app.planners import open_planner
from executive.belief import BayesMonitor
from executive.core.settings import Settings
from executive.domain.loader import Domain, load_domain
from executive.faults import FaultInjector, parse_fault
from executive.planning.place_search import ExpectedCostSearch
from executive.symbolic import SymbolicSkill, SymbolicWorld
from executive.symbolic.world import SymbolicEstimator
from executive.types import Atom, Belief, Dispatched, Event, FaultInjected, SkillResult

DOMAIN = Path(__file__).parent / "domain"


class Episode(NamedTuple):
    """What an episode came to: whether the goal was claimed and is so, how many drawers were opened and at which cost,
    how many of them a second time though nothing that was wanted was in it and nothing was moved since, how many
    actions there were, and how long the longest decision took, in wall seconds from the answers of a look to the next
    action."""

    claimed: bool
    true: bool
    opened: int
    cost: float
    twice: int
    actions: int
    decision: float


class Arena:
    """What is the same in all episodes of a setting."""

    def __init__(self, setting: Setting, search: str) -> None:
        self.setting = setting
        self.domain: Domain = load_domain(DOMAIN, setting.problem)
        self._planner = open_planner(self.domain)
        monitor = open_monitor(MonitorConfig(), self.domain, None)
        assert isinstance(monitor, BayesMonitor)
        self._monitor = BayesMonitor(
            monitor.network,
            monitor.sensor_model,
            monitor.actions,
            visibility=monitor.visibility,
            prior=setting.prior(),
        )
        self._search = ExpectedCostSearch(self.domain.parsed) if search == EXPECTED else None

    def costs(self) -> Mapping[str, float]:
        """Return what it costs to open each drawer, and to close it again."""
        cost = self.domain.parsed.cost
        return {drawer: cost("pull", (drawer,)) + cost("push", (drawer,)) for drawer in DRAWERS}

    def play(self, seed: int) -> Episode:
        """Play one episode to its end."""
        domain, setting = self.domain, self.setting
        task = domain.task
        true = setting.true_atoms(domain, seed)
        world = SymbolicWorld(
            task.atoms, true, domain.draw_action, seed=seed, rules=task.derived, visibility=task.visibility
        )
        faults = [parse_fault(spec, task.objects, (), ()) for spec in setting.faults]
        score = _Score(world)
        ended = make_executive(
            task,
            self._planner,
            world,
            dict.fromkeys(domain.parsed.actions, SymbolicSkill()),
            SymbolicEstimator(world),
            [score],
            Settings(seed=seed),
            FaultInjector(faults, world, seed),
            monitor=self._monitor,
            search=self._search,
        ).run()
        costs = self.costs()
        is_so = task.goal.truth(world.state) is True
        return Episode(
            ended.outcome.claims_goal,
            is_so,
            len(score.opened),
            sum(costs[each] for each in score.opened),
            score.twice,
            ended.actions,
            score.longest,
        )


@dataclass
class _Score:
    """Counts what is opened, by the truth, and times decisions."""

    world: SymbolicWorld
    opened: list[str] = field(default_factory=list)
    twice: int = 0
    longest: float = 0.0
    _since: float | None = None
    _untouched: set[str] = field(default_factory=set)

    def write(self, event: Event) -> None:
        match event.payload:
            case Belief():
                self._since = event.wall
            case Dispatched() if self._since is not None:
                self.longest, self._since = max(self.longest, event.wall - self._since), None
            case FaultInjected(kind="relocate"):
                self._untouched.clear()
            case SkillResult(step=step) as result if step.action == "pull" and result.done:
                (drawer,) = step.args
                if not self.world.state[Atom("open", (drawer,))]:
                    return  # it did nothing
                inside = any(self.world.state[Atom("at", (item, drawer))] for item in WANTED)
                self.twice += drawer in self._untouched and not inside
                self._untouched.add(drawer)
                self.opened.append(drawer)

    def close(self) -> None:
        """Nothing is open."""
