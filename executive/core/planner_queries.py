"""What the loop asks its planner: for a plan around steps that are stuck, for the part of the goal that can be reached,
and for plans from states that are less probable than the believed one. Nothing here decides anything.

Every answer that is not carried out is emitted as `Probed`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from executive.belief import Monitor
from executive.core.compare import progress
from executive.core.policy import ClearingPlan, OptimisticPlan, largest_reachable
from executive.core.run_state import RunState, StuckSteps
from executive.core.session import Session
from executive.protocols import PlaceSearch, Planner
from executive.types import (
    ALWAYS,
    Atom,
    Condition,
    Facts,
    NoPlan,
    NoPlanReason,
    Plan,
    Probed,
    SearchOrder,
    Step,
    Verdict,
)

MOST_TO_SEE, TO_SEE_SECONDS = 8, 5.0
"""How many atoms it is asked for at a time how to see them, and how many seconds that may take for each."""


class PlannerQueries:
    """Asks the planner on behalf of the loop.

    Args:
        monitor: knows which states are possible.
        most: how often the planner may be asked for parts of a goal, and how many less probable states are tried.
        in_time: returns how many wall seconds are left, and raises an error where there are none.
        search: finds where to look first for what cannot be seen; without it, that is where it most probably is.
    """

    def __init__(
        self,
        planner: Planner,
        monitor: Monitor,
        session: Session,
        most: int,
        in_time: Callable[[], float],
        search: PlaceSearch | None = None,
    ) -> None:
        self.planner, self._monitor, self._session, self._most = planner, monitor, session, most
        self._search = search
        self._in_time, self._emit = in_time, session.emit

    def where_first(self, run_state: RunState) -> SearchOrder | None:
        """Where to look first for what the goal needs; None where nothing that it may need is out of view."""
        monitor, memory, judgement, hidden = self._monitor, run_state.memory, run_state.judgement, run_state.hidden
        if self._search is None or judgement is None or not hidden:
            return None
        if run_state.moment.search is not None:
            return run_state.moment.search
        if judgement.thresholded:
            return None

        def supposing(literals: Facts) -> tuple[Mapping[Atom, float], Facts]:
            told = monitor.supposing(memory, literals) if literals else None
            if told is None:
                return judgement.probability, judgement.state
            return told.probability, judgement.state | told.state.only(hidden)

        with self._session.stage("plan"):
            order = self._search.order(supposing, run_state.goal, hidden)
        self._emit(order)
        return order

    def plan(self, run_state: RunState, state: Facts) -> Plan | NoPlan:
        """A plan for the goal without the steps that were given up on, or at least not in the same circumstances. It
        looks first where that was found to be best."""
        answer = self._whole(run_state, state)
        order = run_state.moment.search
        places = [] if order is None else [place.condition for place in order.places]
        if isinstance(answer, NoPlan) or run_state.first_place(answer.steps, state, places) in (*places[:1], None):
            return answer
        self._emit(probed(run_state.goal, answer))
        there = self._plan(run_state, places[0], state, StuckSteps.NEVER, TO_SEE_SECONDS)
        self._emit(probed(places[0], there))
        if isinstance(there, NoPlan) or (around := self._and_back(run_state, there)) is None:
            return answer
        return around

    def _whole(self, run_state: RunState, state: Facts) -> Plan | NoPlan:
        goal = run_state.goal
        answer = self._plan(run_state, goal, state, StuckSteps.NEVER)
        if isinstance(answer, NoPlan) and answer.without:
            self._emit(probed(goal, answer))
            answer = self._plan(run_state, goal, state, StuckSteps.IF_CHANGED)
        if isinstance(answer, NoPlan) and (found := self.clearing(run_state, state)) is not None:
            self._emit(probed(goal, answer))
            return found.plan
        return answer

    def clearing(self, run_state: RunState, state: Facts) -> ClearingPlan | None:
        """A plan for the goal that first moves away what is in the way of a step, and has this step afterwards."""
        goal = run_state.goal
        for step, stuck in run_state.stuck.items() if not run_state.holds(goal, state) else ():
            for atom in stuck.in_the_way if not stuck.for_good else ():
                if (plan := self._around(run_state, state, step, Condition.literal(atom, False))) is not None:
                    return ClearingPlan(atom, plan)
        return None

    def _around(self, run_state: RunState, state: Facts, step: Step, away: Condition) -> Plan | None:
        """A plan for the goal by way of what has to be so for a stuck step to be done. Where the goal wants back what
        was in the way, it stays away until then."""
        goal, first = run_state.goal, Plan((), 0.0, "", 0.0)
        meanwhile = away & Condition.of(step.unconditional)
        if run_state.holds(away, state):
            return self._in_turn(run_state, state, first, (meanwhile, goal))
        answer = self._plan(run_state, away, state, StuckSteps.NEVER)
        self._emit(probed(away, answer))
        if isinstance(answer, NoPlan):
            return None
        whole = self._in_turn(run_state, state, answer, (goal,))
        return whole or self._in_turn(run_state, state, answer, (meanwhile, goal))

    def _in_turn(self, run_state: RunState, state: Facts, plan: Plan, goals: Sequence[Condition]) -> Plan | None:
        """A plan from `state` with what follows to reach some goals one after the other, with steps that are stuck
        where what they hang on has changed by then."""
        for goal in goals:
            then = state
            for step in plan.steps:
                then = progress(then, step, run_state.task.derived)
            rest = self._plan(run_state, goal, then, StuckSteps.IF_CHANGED)
            self._emit(probed(goal, rest))
            if isinstance(rest, NoPlan):
                return None
            seconds = plan.seconds + rest.seconds
            plan = Plan((*plan.steps, *rest.steps), plan.cost + rest.cost, rest.planner, seconds)
        return plan

    def probe(self, run_state: RunState, goal: Condition, allowed: StuckSteps = StuckSteps.NEVER) -> Plan | NoPlan:
        """Return whether `goal` can be reached from what is believed."""
        if run_state.holds(goal, run_state.state):
            return Plan((), 0.0, "", 0.0)
        answer = self._plan(run_state, goal, run_state.state, allowed)
        self._emit(probed(goal, answer))
        return answer

    def largest(self, run_state: RunState) -> tuple[Condition, Plan | None, bool]:
        """The largest part of the goal that can be reached, a plan for it, and whether a stuck step limits it."""
        kept, plan, hangs = self._largest(run_state, StuckSteps.NEVER)
        return self._largest(run_state, StuckSteps.IF_CHANGED) if hangs and kept == ALWAYS else (kept, plan, hangs)

    def with_given_up(self, run_state: RunState) -> tuple[Plan | None, Condition]:
        """A plan for what was given up, too, or for the first part of it that does not depend on a stuck step, and the
        goal that it reaches."""
        goal, wanted = run_state.goal, run_state.task.goal
        given_up = run_state.given_up.conjuncts
        if not given_up:
            return None, goal
        answer = self.probe(run_state, wanted, StuckSteps.LAST_RESORT)
        for part in given_up if answer.without and len(given_up) > 1 else ():
            if isinstance(answer, Plan):
                break
            wanted = run_state.task.goal.only((*goal.conjuncts, part))
            answer = self.probe(run_state, wanted, StuckSteps.LAST_RESORT)
        return (None, goal) if isinstance(answer, NoPlan) else (answer, wanted)

    def optimistic(self, run_state: RunState) -> OptimisticPlan | None:
        """Return a plan for a goal that cannot be reached from the believed state, from a less probable one."""
        for atom in run_state.possible[: self._most]:
            self._in_time()
            if (found := self._as_if(run_state, atom, self._monitor.state_with(run_state.memory, atom))) is not None:
                return found
        return None

    def redo(self, run_state: RunState, verdict: Verdict) -> OptimisticPlan | None:
        """A plan that brings about once more a literal of the goal that looks support, but too weakly for a claim.

        Each literal is tried once.
        """
        judgement = run_state.judgement
        answered = judgement.belief.probability if judgement else {}
        doubted = [atom for atom in sorted(verdict.unknown & answered.keys()) if atom not in run_state.tried]
        if verdict.violated or not verdict.holds or not doubted:
            return None
        return self._as_if(run_state, doubted[0], self._monitor.state_without(run_state.memory, doubted[0]))

    def to_see(self, run_state: RunState, verdict: Verdict) -> tuple[Atom, Plan] | None:
        """One of the atoms that a condition hangs on and that cannot be seen now, and a plan to see it, the cheapest,
        which ends where the goal holds. Each is gone to see twice at most."""
        unknown = sorted(verdict.unknown & run_state.hidden)
        wanted = [atom for atom in unknown if run_state.tried.count(atom) < 2]
        if verdict.violated or not wanted:
            return None
        found: list[tuple[float, Atom, Plan]] = []
        for atom in wanted[:MOST_TO_SEE]:
            there = run_state.task.visible[atom]
            plan = self._plan(run_state, there, run_state.state, StuckSteps.NEVER, TO_SEE_SECONDS)
            self._emit(probed(there, plan))
            if isinstance(plan, Plan) and plan.steps:
                found.append((plan.cost, atom, plan))
        for _, atom, plan in sorted(found, key=lambda each: each[:2]):
            if (whole := self._and_back(run_state, plan)) is not None:
                return atom, whole
        return None

    def _and_back(self, run_state: RunState, plan: Plan) -> Plan | None:
        """Return the plan with what has to follow for the goal to hold."""
        state = run_state.state
        for step in plan.steps:
            state = progress(state, step, run_state.task.derived)
        if run_state.holds(run_state.goal, state):
            return plan
        back = self._plan(run_state, run_state.goal, state, StuckSteps.NEVER)
        self._emit(probed(run_state.goal, back))
        if isinstance(back, NoPlan):
            return None
        return replace(plan, steps=(*plan.steps, *back.steps), cost=plan.cost + back.cost)

    def _as_if(self, run_state: RunState, atom: Atom, state: Facts | None) -> OptimisticPlan | None:
        if state is None or run_state.holds(run_state.goal, state):
            return None
        plan = self.plan(run_state, state)
        self._emit(probed(run_state.goal, plan))
        return None if isinstance(plan, NoPlan) else OptimisticPlan(atom, state, plan)

    def _largest(self, run_state: RunState, allowed: StuckSteps) -> tuple[Condition, Plan | None, bool]:
        without: set[str] = set()

        def plan_for(part: Condition) -> Plan | None:
            answer = self.probe(run_state, part, allowed)
            without.update(answer.without)
            return None if isinstance(answer, NoPlan) else answer

        kept, plan = largest_reachable(run_state.goal, plan_for, self._most)
        return kept, plan, bool(without)

    def _plan(
        self, run_state: RunState, goal: Condition, state: Facts, allowed: StuckSteps, most: float = math.inf
    ) -> Plan | NoPlan:
        """Ask the planner; where its plan contains a stuck step, ask for one without it, and so on."""
        avoid: frozenset[Step] = frozenset()
        while True:
            left = self._in_time()
            with self._session.stage("plan"):
                answer = self.planner.plan(state, goal, avoid, min(left, most))
            answer = replace(answer, without=tuple(sorted(map(str, avoid))))
            stuck = frozenset() if isinstance(answer, NoPlan) else run_state.stuck_among(answer.steps, state, allowed)
            if not stuck:
                return answer
            self._emit(probed(goal, answer))
            if stuck <= avoid:  # the planner does not do without them
                return NoPlan(NoPlanReason.UNSOLVABLE, without=answer.without)
            avoid |= stuck


def probed(goal: Condition, answer: Plan | NoPlan) -> Probed:
    """Return an answer that is not carried out."""
    return Probed(goal, None, answer) if isinstance(answer, NoPlan) else Probed(goal, answer)
