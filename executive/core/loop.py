"""The closed loop: look, plan, do one step, look, compare, decide. All that changes in a run is the loop's `run_state`.

A *cycle* is one turn of the loop: a step's preconditions are checked, it is dispatched, looked at, compared, what
follows is decided and, where that asks for it, planned. Cycle 0 is the first look and the first plan. An *action* is a
step that was dispatched; a cycle whose step could not begin has none.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict

from executive.belief import Monitor
from executive.belief.interface import Judgement
from executive.core import policy
from executive.core.compare import compare
from executive.core.observer import Look, Observer
from executive.core.planner_queries import PlannerQueries
from executive.core.policy import OptimisticPlan
from executive.core.run_state import RunState
from executive.core.session import Session
from executive.core.settings import Settings
from executive.errors import InputError
from executive.protocols import PlaceSearch, Planner, Preparing, Skill
from executive.types import (
    Atom,
    Belief,
    Cause,
    Compared,
    Condition,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Facts,
    Judged,
    LookCause,
    NoPlan,
    Plan,
    Probed,
    Reason,
    Revised,
    SkillResult,
    Started,
    Step,
    Task,
    Verdict,
)


class Executive:
    """Carries one task to an end that has a name. An instance runs once.

    It receives its parts and builds none; `executive.app.assembly.make_executive` puts the usual ones together.

    Args:
        monitor: weighs the answers of each look into a belief.
        skills: by the name of the action that each carries out.
        session: delivers events to the sinks and dispatches steps.
        observer: takes the looks. Without one the executive is the blind baseline: it is given `initial`, never looks,
            assumes each step's effects and carries on whatever its skills report. At the end it claims the goal
            because it believes it, with `goal_seen` false because nobody looked.
        initial: what holds at first, for a blind executive; one that looks has to see it for itself.
        run_state: how the run stands, where another process began it.
        prepare: what has to be made ready before the first look.
        search: finds where to look first for what cannot be seen; without it, that is where it most probably is.
        domain, run: names for the trace.

    Raises:
        InputError: neither an observer nor initial facts.
    """

    def __init__(
        self,
        task: Task,
        planner: Planner,
        monitor: Monitor,
        skills: Mapping[str, Skill],
        session: Session,
        observer: Observer | None = None,
        settings: Settings | None = None,
        initial: Facts | None = None,
        domain: str = "",
        run: str = "",
        run_state: RunState | None = None,
        prepare: Iterable[Preparing] = (),
        search: PlaceSearch | None = None,
    ) -> None:
        self.is_blind = observer is None
        if observer is not None:
            self.observer = observer
        elif initial is None:
            raise InputError("an executive that does not look (it has no estimator) must be told the initial facts")
        self.monitor, self.skills, self._session = monitor, skills, session
        self.settings, self.domain, self.name, self._prepare = settings or Settings(), domain, run, prepare
        known = initial if self.is_blind and initial else Facts()
        self.run_state = run_state or RunState(task, task.goal, known, monitor.begin())
        self._emit, self.cancel = session.emit, session.cancel
        most = self.settings.max_goal_plans
        self.queries = PlannerQueries(planner, monitor, session, most, self._in_time, search)

    @property
    def seconds(self) -> float:
        """How many wall seconds the run has taken so far, in all its processes together."""
        return self._session.seconds

    @property
    def seconds_left(self) -> float:
        """How many wall seconds are left of the budget."""
        return max(0.0, self.settings.max_seconds - self.seconds)

    def run(self) -> Ended:
        """Run to the end. Whatever happens, `Ended` is emitted and the sinks are closed.

        Raises:
            ExecutiveError: a part found the set-up wrong or something missing; the trace ends with `crashed`.
        """
        decision, error = self._session.guard(self._live)
        return self._session.close(self.run_state.ended(decision), error)

    def _live(self) -> Decision:
        try:
            return self._until_stopped()
        except _TimeIsUpError as end:
            return self._decide(end.decision)

    def _until_stopped(self) -> Decision:
        name, questions = ("none", None) if self.is_blind else (self.observer.name, self.observer.questions)
        settings = asdict(self.settings)
        started = Started(self.name, self.domain, self.run_state.task, name, self.settings.seed, settings)
        self._session.cycle = self.run_state.cycle
        self._session.open(self.run_state.since or started, questions)
        self._session.prepare(self._prepare)
        decision = self._first_look()
        while decision.kind is not DecisionKind.STOP:
            self._session.check_cancelled()
            if decision.kind is DecisionKind.GIVE_UP_GOAL:
                decision = self._go_around(decision)
            elif decision.kind is DecisionKind.REPLAN or self.run_state.plan is None:
                decision = self._make_plan()
            elif self.run_state.todo:
                decision = self._turn()
            else:
                decision = self._finish()
        return decision

    def _first_look(self) -> Decision:
        """1. Look at the world; estimate every atom; that is the initial state."""
        if self.is_blind:
            self._emit(Belief.certain(self.run_state.known))
            return Decision(DecisionKind.CONTINUE, (Cause(Reason.INITIAL_STATE_GIVEN),))
        self._in_time()
        self._weigh(self.observer.look_at_all(self.run_state, LookCause.FIRST))
        while True:
            atoms, looks = self.run_state.task.atoms, self.run_state.moment.looks
            hidden = self.run_state.hidden
            decision = self._decide(policy.first(atoms, self.run_state.known, looks, self.settings, hidden))
            if decision.kind is not DecisionKind.LOOK_AGAIN:
                return decision
            self._in_time()
            self._weigh(self.observer.look_again(self.run_state, LookCause.FIRST, decision.evidence))

    def _make_plan(self) -> Decision:
        """2 and 5. Plan from what is believed."""
        answers = Counter[str]()
        self._look_first()
        while isinstance(plan := self.queries.plan(self.run_state, self.run_state.state), NoPlan):
            self._emit(plan)
            answers[plan.reason] += 1
            decision = policy.unplanned(
                plan, answers[plan.reason], self.run_state.uncertain_atoms(self.settings), self.settings
            )
            if self._decide(decision).kind is DecisionKind.LOOK_AGAIN:
                self._in_time()
                self._weigh(self.observer.look_again(self.run_state, LookCause.NO_PLAN, decision.evidence))
            elif decision.kind is DecisionKind.GIVE_UP_GOAL:
                if self.is_blind or (found := self.queries.optimistic(self.run_state)) is None:
                    return self._give_up(decision, is_stuck=bool(plan.without))
                self._decide(policy.optimistic(decision, found))
                return self._take_up_optimistic(found)
            elif decision.kind is not DecisionKind.REPLAN:
                return decision
        return self._take_up(plan, self.run_state.goal)

    def _look_first(self) -> None:
        """Where what the goal needs may be in several places out of view, decide where to look first."""
        if (order := self.queries.where_first(self.run_state)) is not None:
            self.run_state = self.run_state.searching(order)
            if order.places:
                self._decide(policy.look_first(order))

    def _reconsider(self) -> Decision | None:
        """Whether what the last step has shown calls for looking at another place next than the plan does."""
        run_state = self.run_state
        if not run_state.found_out or not run_state.todo:
            return None
        if (order := self.queries.where_first(run_state)) is None or not order.places:
            return None
        places = [place.condition for place in order.places]
        if run_state.first_place(run_state.left, run_state.state, places) in (places[0], None):
            return None
        self.run_state = run_state.searching(order)
        return self._decide(policy.look_elsewhere(order))

    def _turn(self) -> Decision:
        """3 and 4. One step: are its preconditions met, what is its outcome, and what follows?"""
        if stop := policy.exhausted(self.settings, **self.run_state.spent):
            return self._decide(stop)
        self._in_time()
        self.run_state = self.run_state.next_cycle()
        self._session.cycle = self.run_state.cycle
        step = self.run_state.left[0]
        if not self.is_blind and (decision := self._check(step) or self._see_first(step)):
            return decision
        self.run_state = self.run_state.dispatched()
        order = Dispatched(step, self.run_state.actions, self.run_state.attempt, self.run_state.todo[0])
        guard = None if self.is_blind else self.observer.guard(step)
        result = self._session.dispatch(order, self.skills, guard)
        if crash := policy.crashed(result):
            return self._decide(crash)
        return self._assume(result) if self.is_blind else self._judge(result)

    def _check(self, step: Step) -> Decision | None:
        """Check the step's preconditions, with a few more looks while they are unmet; None when it can begin."""
        waits = 0
        while True:
            known = self.run_state.known
            needed, verdict = self._compare_condition("preconditions", step.precondition, known)
            failures = self.run_state.failing(step, known)
            is_likely = self.run_state.compared(step.precondition, self.run_state.state)[1].satisfied
            decision = policy.before(step, needed, verdict, waits, failures, self.settings, is_likely)
            if decision is None or self._decide(decision).kind is DecisionKind.CONTINUE:
                return None
            if decision.kind is not DecisionKind.LOOK_AGAIN:
                self.run_state = self.run_state.failed(step, known, decision)
                return decision
            self._in_time()
            self.observer.begin_moment()
            self.run_state = self.run_state.waiting(self.monitor.acted(self.run_state.memory, None))
            self._weigh(self.observer.look(self.run_state, LookCause.BEFORE.about(step)))
            waits += 1

    def _see_first(self, step: Step) -> Decision | None:
        """Plan to see what cannot be seen yet, if it may be why the step fails; None when it can begin."""
        if not self.run_state.hidden or self.run_state.failing(step, self.run_state.known).ever == 1:
            return None
        _, verdict = self.run_state.compared(step.precondition, self.run_state.known)
        found = self.queries.to_see(self.run_state, verdict)
        return None if found is None else self._look_for(*found)

    def _judge(self, result: SkillResult) -> Decision:
        """Compare the step's expected effects with what is seen, and decide."""
        cause = LookCause.AFTER.about(result.step)
        self._in_time()
        self.observer.begin_moment()
        memory = self.monitor.acted(self.run_state.memory, result.step, result)
        self.run_state = self.run_state.acted(result, memory)
        self._weigh(self.observer.look(self.run_state, cause))
        while True:
            self._compare("effects", self.run_state.expected, self.run_state.seen)
            turn = self.run_state.turn(result)
            decision = self._decide(policy.after(turn, self.settings))
            if decision.kind is not DecisionKind.LOOK_AGAIN:
                break
            self._in_time()
            self._weigh(self.observer.look_again(self.run_state, cause, decision.evidence, surprised=not turn.doubts))
        self.run_state = self.run_state.judged(turn, decision)
        if turn.verdict.violated:
            self._emit(Revised(self.run_state.known, self.run_state.known.only(turn.verdict.violated)))
        if decision.kind is DecisionKind.CONTINUE:
            return self._reconsider() or decision
        return decision

    def _assume(self, result: SkillResult) -> Decision:
        """Believe the step's expected effects, in a run that does not look."""
        self.run_state = self.run_state.assumed()
        self._emit(Belief.certain(self.run_state.known))
        return self._decide(policy.assumed(result))

    def _finish(self) -> Decision:
        """6. Done means that the goal is seen to hold, in a full look."""
        if self.is_blind:
            return self._decide(policy.finish_blind(self.run_state.goal))
        cause, checks = LookCause.GOAL, 1
        if not self.run_state.asked_all:
            self._in_time()
            self._weigh(self.observer.look_at_all(self.run_state, cause))
        while True:
            self.run_state = run_state = self.run_state.whole_goal_seen()
            _, verdict = self._compare_condition("goal", run_state.goal, run_state.claimable(self.settings.claim))
            if (found := self.queries.to_see(run_state, verdict)) is not None:
                return self._look_for(*found)
            plan, whole = self.queries.with_given_up(run_state) if verdict.satisfied else (None, run_state.goal)
            unsure, dropped = run_state.unsure_of_goal(self.settings.sure), run_state.what_was_given_up(plan, whole)
            remembered = tuple(run_state.recalled(self.settings.claim))
            redo = self.queries.redo(run_state, verdict) if checks > self.settings.max_looks_again else None
            decision = self._decide(
                policy.finish(run_state.goal, verdict, unsure, checks, dropped, self.settings, redo, remembered)
            )
            if decision.kind is DecisionKind.REPLAN and redo is not None:
                return self._take_up_optimistic(redo)
            if decision.kind is not DecisionKind.LOOK_AGAIN:
                return decision if plan is None else self._take_up(plan, whole)
            self._in_time()
            self._weigh(self.observer.look_again(run_state, cause, decision.evidence))
            checks += 1

    def _look_for(self, atom: Atom, plan: Plan) -> Decision:
        """Take up a plan to see what the goal or a step hangs on."""
        self._decide(policy.look_for(atom))
        self.run_state = self.run_state.looking_for(atom)
        return self._take_up(plan, self.run_state.goal)

    def _take_up_optimistic(self, found: OptimisticPlan) -> Decision:
        self.run_state = self.run_state.assuming(found.state, found.doubted)
        return self._take_up(found.plan, self.run_state.goal)

    def _go_around(self, cause: Decision) -> Decision:
        """Leave out a step that fails again and again, where there is a plan for the goal without it, or move away what
        is in its way."""
        goal = self.run_state.goal
        plan = self.queries.probe(self.run_state, goal)
        if isinstance(plan, NoPlan):
            if (found := self.queries.clearing(self.run_state, self.run_state.state)) is None:
                return self._give_up(cause, is_stuck=True)
            self._decide(policy.clears(cause, found))
            return self._take_up(found.plan, goal)
        self._decide(policy.goes_around(cause))
        return self._take_up(plan, goal)

    def _give_up(self, cause: Decision, is_stuck: bool) -> Decision:
        """Drop from the goal what cannot be reached, and plan for the rest."""
        kept, plan, hangs = self.queries.largest(self.run_state)
        decision = policy.given_up(cause, self.run_state.goal, kept, is_stuck or hangs)
        self._emit(self.run_state.grounded(decision))
        self.run_state = self.run_state.giving_up(cause.causes)
        return decision if plan is None else self._take_up(plan, kept)

    def _take_up(self, plan: Plan, goal: Condition) -> Decision:
        if self.run_state.plan is not None and (
            stop := policy.exhausted(self.settings, replans=self.run_state.replans)
        ):
            self._emit(Probed(goal, plan))
            return self._decide(stop)
        self._emit(plan)
        self.run_state = self.run_state.planned(plan, goal)
        return Decision(DecisionKind.CONTINUE, (Cause(Reason.PLAN_FOUND, count=len(plan.steps)),))

    def _weigh(self, look: Look) -> None:
        """Have the monitor weigh one more look into the belief."""
        memory, judgement = self.monitor.looked(self.run_state.memory, look.answers, self.run_state.cycle)
        self._emit(_judged(judgement))
        self.run_state = self.run_state.looked(memory, judgement, look.answers, look.looked)

    def _in_time(self) -> float:
        """Check the budget of time, before anything that takes time, and return the seconds that are left of it.

        Raises:
            _TimeIsUpError: the budget of time is used up.
        """
        if stop := policy.exhausted(self.settings, seconds=self.seconds):
            raise _TimeIsUpError(stop)
        return self.seconds_left

    def _compare_condition(self, what: str, condition: Condition, facts: Facts) -> tuple[Facts, Verdict]:
        """The literals by which a condition is judged where `facts` hold, and the verdict on them."""
        expected, verdict = self.run_state.compared(condition, facts)
        self._emit(Compared(what, expected, verdict, self.run_state.moment.observation_id))
        return expected, verdict

    def _compare(self, what: str, expected: Facts, seen: Facts) -> Verdict:
        compared = Compared(what, expected, compare(expected, seen), self.run_state.moment.observation_id)
        self._emit(compared)
        return compared.verdict

    def _decide(self, decision: Decision) -> Decision:
        """Emit the decision with its grounds, unless it is still open which goals it gives up."""
        if decision.kind is not DecisionKind.GIVE_UP_GOAL:
            self._emit(self.run_state.grounded(decision))
        return decision


class _TimeIsUpError(Exception):
    """The run has no time left; `decision` ends it."""

    def __init__(self, decision: Decision) -> None:
        self.decision = decision
        super().__init__(decision.code)


def _judged(judgement: Judgement) -> Judged:
    return Judged(
        judgement.belief.observation_id,
        judgement.probability,
        judgement.seen,
        judgement.contradictions,
        judgement.overruled,
        judgement.remembered,
        judgement.came_about,
    )
