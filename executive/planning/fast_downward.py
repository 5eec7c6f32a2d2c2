"""Fast Downward: a task is grounded once, and every call is answered by its search alone.

Small tasks are grounded in this process (`executive.planning.sas_task`), larger ones by Fast Downward's translator
(`executive.planning.translation`). Fast Downward is GPL-3 and runs in processes of its own
(`executive.planning.programs`). Only what it calls proven counts as unsolvable, and every plan is carried out on paper
before it is handed out.
"""

from __future__ import annotations

import contextlib
import math
import re
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from executive.domain.pddl import Schema
from executive.planning.goal_order import State, by_goals, replay
from executive.planning.operator_templates import NoLiteralsError, is_literal
from executive.planning.programs import SasFile, find_search
from executive.planning.sas_task import GroundedTask, SasTask, size
from executive.planning.translation import TranslatedTask, TranslatorError
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan, Step

ENGINE = "fast-downward"

SOLVED, UNSOLVABLE = 0, 11
"""Exit codes of the search; UNSOLVABLE only where that is proven."""

_GAVE_UP = {
    12: "the search cannot tell whether there is a plan",
    22: "the search ran out of memory",
    23: "",
    24: "the search ran out of memory",
    -signal.SIGXCPU: "",
}
"""Exit codes of a search that gave up, and why."""

MOST_GROUNDED = 50_000
"""Grounded actions that a task of literals may have at most to be grounded in this process."""

MOST_WRITTEN_OUT = 4_000
"""The same for a task of other formulas, each of which has to be written out."""


@dataclass(frozen=True, slots=True)
class _Search:
    """One way to search."""

    name: str
    text: str


GREEDY = _Search("lazy_greedy(ff())", "let(relaxed, {ff}, lazy_greedy([relaxed], preferred=[relaxed]))")
LAMA = _Search(
    "lama-first",
    "let(landmarks, {landmarks}, let(relaxed, {ff},"
    " lazy_greedy([relaxed, landmarks], preferred=[relaxed, landmarks], reopen_closed=false)))",
)
_LMCUT = _Search("astar(lmcut())", "astar(lmcut())")
_CONDITIONAL = _Search("astar(hmax())", "astar(hmax())")
_BLIND = _Search("astar(blind())", "astar(blind())")
"""LM-cut takes no conditional effects; where there are axioms, blind search alone proves anything. All searches are
deterministic."""

_LEAST = "eager_greedy([lmcut()], bound=0)"
"""Works out one heuristic value and ends: no state is worth going on from."""

EVALUATORS = {
    "ff": "ff()",
    "landmarks": "landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=false)",
}
_WITH_COSTS = {name: f"eval_modify_costs({text}, cost_type=plusone)" for name, text in EVALUATORS.items()}
"""Where actions have costs, a greedy search takes each to cost one more, so that many free ones do not lead astray."""

_FEW = 100
"""Grounded actions up to which the search for the shortest plan is as quick as any."""

_MANY = 5_000
"""Grounded actions up to which LM-cut is asked at all."""

_LARGE = 20_000
"""Grounded actions above which the first plan is taken as it is: another search would take seconds."""

_NEAR = 2.0
"""A plan that may be dearer than the best one by so much at most is worth a search for the best one."""

_EASY = 2_000
"""Expanded states up to which a search is so quick that another one may find a better plan."""

UNREACHABLE = "the goal cannot be reached from this state"

_Found: TypeAlias = "tuple[_Search, tuple[Step, ...]]"


class FastDownwardPlanner:
    """Plans for one task from any of its states.

    The first plan comes from a greedy search. It is taken where it is proven to be one of the cheapest; otherwise
    another search may better it, where little is to be gained or lost by that. The steps are put into the order in
    which the problem file names the goals (`executive.planning.goal_order`). Cost is what the problem's metric says,
    else the number of steps.

    The same state and goal give the same plan, as long as the time limit does not come in between. Not to be called
    from two threads at once.
    """

    name = ENGINE

    def __init__(self, schema: Schema, *, timeout: float = 30.0, optimal: bool = False) -> None:
        """
        Args:
            timeout: the wall time in seconds that one call of `plan` may take.
            optimal: only a plan that is proven to be one of the cheapest will do.
        """
        if not timeout > 0:
            raise ValueError(f"timeout: expected seconds above zero, got {timeout}")
        self._schema, self._timeout, self._optimal = schema, timeout, optimal
        self._rules = schema.task.derived
        self._atoms = frozenset(schema.task.atoms)
        self._lock = threading.Lock()
        self._asked = False
        self._program: Path | None = None
        self._grounded: GroundedTask | None = None
        self._translated: TranslatedTask | None = None
        literal = all(is_literal(schema, name) for name in schema.actions)
        if not self._rules and size(schema) <= (MOST_GROUNDED if literal else min(MOST_GROUNDED, MOST_WRITTEN_OUT)):
            self._grounded = GroundedTask(schema)

    def warm_up(self) -> None:
        """Do in the background what the first call of `plan` needs; that call goes on with it."""

        def prepare() -> None:
            with contextlib.suppress(Exception):  # the same error is raised by `plan`, where somebody can see it
                self._prepared(frozenset(), self._schema.task.goal, lambda: self._asked, self._timeout)

        threading.Thread(target=prepare, name="planner-warm-up", daemon=True).start()

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        """A plan from `state` to `goal`, or why there is none; see `executive.protocols.Planner`.

        Raises:
            ValueError: an atom that the task does not have.
            MissingError: Fast Downward is not installed.
        """
        unknown = (state.keys() | goal.atoms) - self._atoms - self._rules.rules.keys()
        if unknown:
            raise ValueError(f"the task has no atom {', '.join(map(str, sorted(unknown)))}")
        started = time.perf_counter()
        limit = min(self._timeout, seconds)
        until, self._asked = started + limit, True
        true = state.true - self._rules.rules.keys()
        if goal.truth(State(true, self._rules)):
            return Plan((), 0.0, ENGINE, time.perf_counter() - started)
        order = list(dict.fromkeys(atom for atom in (*self._schema.goals, *goal.facts) if atom in goal.facts))
        found = self._found(true, goal, order, avoid, until)
        if isinstance(found, tuple):
            way, steps = found
            steps = by_goals(true, steps, goal, order, lambda: time.perf_counter() >= until, self._rules)
            end = replay(true, steps, self._rules)
            if end is not None and goal.truth(State(end, self._rules)):
                cost = sum(step.cost for step in steps)
                return Plan(steps, float(cost), f"{ENGINE} {way.name}", time.perf_counter() - started)
            found = NoPlan(NoPlanReason.CRASHED, "the engine's plan does not reach the goal")
        detail = found.detail
        if found.reason is NoPlanReason.TIMED_OUT:
            detail = f"neither a plan nor a proof that there is none within {round(limit, 2):g} s"
            detail += f" ({found.detail})" if found.detail else ""
        return replace(found, detail=detail, planner=ENGINE, seconds=time.perf_counter() - started)

    def _found(
        self, true: frozenset[Atom], goal: Condition, order: list[Atom], avoid: frozenset[Step], until: float
    ) -> _Found | NoPlan:
        task = self._prepared(true, goal, lambda: time.perf_counter() >= until, until - time.perf_counter())
        if isinstance(task, NoPlan):
            return task
        text = task.text(true, goal, order, avoid)
        if text is None:
            return NoPlan(NoPlanReason.UNSOLVABLE, UNREACHABLE)
        assert self._program is not None
        with SasFile(self._program, text) as file:
            return _Question(file, task, bool(goal.choices) or task.axioms, until).answer(self._optimal)

    def _prepared(
        self, true: frozenset[Atom], goal: Condition, stop: Callable[[], bool], seconds: float
    ) -> SasTask | NoPlan:
        """The task, ready for a question about a state and a goal, or why it is not: where it is to `stop` before that,
        or is not its turn within so many `seconds`, the next call goes on from there."""
        if not self._lock.acquire(timeout=min(seconds, threading.TIMEOUT_MAX) if seconds > 0 else 0):
            return NoPlan(NoPlanReason.TIMED_OUT)
        until = time.perf_counter() + seconds
        try:
            self._program = self._program or find_search()  # what is missing is said before anything takes time
            if self._grounded is not None:
                try:
                    return self._grounded if self._grounded.ground(stop) else NoPlan(NoPlanReason.TIMED_OUT)
                except NoLiteralsError:
                    self._grounded = None
            self._translated = self._translated or TranslatedTask(self._schema)
            if not self._translated.covers(true, goal):
                self._translated.ground(true, goal, until - time.perf_counter())
            return self._translated
        except TranslatorError as failure:
            return NoPlan(NoPlanReason.TIMED_OUT if failure.late else NoPlanReason.CRASHED, str(failure))
        except BaseException:  # what was interrupted in the middle of an action cannot go on
            self._grounded = None if self._grounded is None else GroundedTask(self._schema)
            raise
        finally:
            self._lock.release()


class _Question:
    """A task with a state and a goal, written down and to be searched."""

    def __init__(self, file: SasFile, task: SasTask, axioms: bool, until: float) -> None:
        self._file, self._task, self._until, self._axioms = file, task, until, axioms
        self._expanded = 0

    def answer(self, optimal: bool) -> _Found | NoPlan:
        """What the searches find, one after the other."""
        best = _BLIND if self._axioms else _CONDITIONAL if self._task.conditional else _LMCUT
        if optimal:
            return self._search(best)
        if best is _LMCUT and len(self._task) <= _FEW:
            found = self._search(best, 0.5)
            return self._search(LAMA) if _failed(found) else found
        first = self._search(GREEDY, 0.2)
        if not isinstance(first, NoPlan):
            return self._bettered(first, best)
        found = self._search(LAMA, 0.8 if self._axioms else 1.0) if _failed(first) else first
        return self._search(_BLIND) if self._axioms and _failed(found) else found

    def _bettered(self, first: _Found, best: _Search) -> _Found:
        """The first plan, or a cheaper one that is found with little effort."""
        cost, others = _cost(first), []
        if best is _LMCUT and len(self._task) <= _MANY:
            least = self._least()
            if cost <= least:
                return first
            if cost - least <= _NEAR:
                found = self._search(_LMCUT, 0.25)
                if not isinstance(found, NoPlan):
                    return found
        if self._expanded <= _EASY and len(self._task) <= _LARGE:
            others = [self._search(LAMA, 0.25)]
        return min([first, *(other for other in others if not isinstance(other, NoPlan))], key=_cost)

    def _search(self, way: _Search, share: float = 1.0) -> _Found | NoPlan:
        """What a search finds within a share of the time that is left."""
        left = self._until - time.perf_counter()
        if left <= 0:
            return NoPlan(NoPlanReason.TIMED_OUT)
        try:
            text = way.text.format(**(_WITH_COSTS if self._task.costs else EVALUATORS))
            answer = self._file.search(text, left * share)
        except (OSError, ValueError) as error:
            return NoPlan(NoPlanReason.CRASHED, f"{type(error).__name__}: {error}")
        ended = answer.ended
        self._expanded = _number(r"Expanded (\d+) state", ended.said) or 0
        if ended.code == SOLVED:
            return way, tuple(self._task.step(name) for name in answer.plan)
        if ended.code == UNSOLVABLE:
            return NoPlan(NoPlanReason.UNSOLVABLE, UNREACHABLE)
        if ended.expired or ended.code in _GAVE_UP:
            return NoPlan(NoPlanReason.TIMED_OUT, "" if ended.expired else _GAVE_UP[ended.code])
        return NoPlan(NoPlanReason.CRASHED, f"the engine ended with exit code {ended.code}: {ended.last_words}")

    def _least(self) -> float:
        """What every plan costs at least, by LM-cut in the first state; 0 where that is not told in time."""
        left = self._until - time.perf_counter()
        said = self._file.search(_LEAST, max(0.0, left / 4)).ended.said
        return (_number(r"Initial heuristic value for lmcut\S*: (\d+)", said) or 0) / self._task.scale


def _failed(found: _Found | NoPlan) -> bool:
    """Whether a search has neither a plan nor a proof that there is none."""
    return isinstance(found, NoPlan) and found.reason is not NoPlanReason.UNSOLVABLE


def _cost(found: _Found) -> float:
    return sum(step.cost for step in found[1])


def _number(pattern: str, said: str) -> int | None:
    told = re.search(pattern, said)
    return None if told is None else int(told[1])
