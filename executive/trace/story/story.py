"""What has happened so far: the one fold over a run's events, which terminal, viewer, reports and scores are made from.

No decision uses it. The plan's marks follow from the events alone: a step is current from its
dispatch on, failed when its skill or a look says so, done when its effects were seen (or, for an executive that does
not look, when it went on), and what a new plan leaves of the old one is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

from executive.trace.story.costs import Costs
from executive.trace.story.last_look import Looks
from executive.types import (
    COMPILE,
    Atom,
    Belief,
    Blinded,
    Compared,
    Condition,
    Contradiction,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    Facts,
    FaultInjected,
    Guarded,
    Judged,
    Moved,
    NoPlan,
    Observation,
    Phase,
    Plan,
    Resumed,
    SkillResult,
    Started,
    Step,
    Task,
    Timing,
)

Remark: TypeAlias = FaultInjected | Decision | NoPlan | Contradiction | Guarded | Blinded | Moved | Resumed
"""What is worth telling at one point of the story: a fault, that there is no plan, a decision that is not routine,
answers that cannot all be so, a doubt about what is carried, a camera that is left out, the arm out of the way, that
another process goes on from here."""


class Mark(StrEnum):
    PENDING = "pending"
    CURRENT = "current"
    DONE = "done"
    FAILED = "failed"
    SKIPPED = "skipped"  # its effects held already
    DROPPED = "dropped"  # a new plan took its place, or the run ended first


@dataclass
class StepLine:
    """A step of a plan, how it stands, which action of the run it was, and what went wrong: the status that its skill
    reports, a literal that is seen instead, or the run's outcome."""

    step: Step
    mark: Mark = Mark.PENDING
    action: int | None = None
    attempt: int = 0
    result: SkillResult | None = None
    note: str = ""
    cut_off: bool = False
    """The process ended while the skill was at work."""
    remarks: list[Remark] = field(default_factory=list)


@dataclass
class PlanLine:
    """The `number`-th plan of the run, from 1; `remarks` came before its first step."""

    number: int
    lines: list[StepLine]
    plan: Plan
    remarks: list[Remark] = field(default_factory=list)


class Standing(StrEnum):
    """How an atom's probability stands against what was expected."""

    SURPRISE = "surprise"
    DOUBT = "doubt"
    EXPECTED = "as expected"


@dataclass(frozen=True)
class AtomLine:
    """One row of belief against expectation."""

    atom: Atom
    expected: bool
    probability: float | None
    standing: Standing


@dataclass
class Story:
    """The state of a run as a watcher knows it. Feed every event to `tell`, in order."""

    began: Event | None = None
    """The event that starts the run; `latest` is the last one so far."""
    latest: Event | None = None
    started: Started | None = None
    ended: Ended | None = None
    plans: list[PlanLine] = field(default_factory=list)
    no_plan: NoPlan | None = None
    phase: str = ""
    compiling: str = ""
    """What is made ready at this moment."""
    probability: dict[Atom, float] = field(default_factory=dict)
    compared: Compared | None = None
    compared_step: Step | None = None
    decisions: list[tuple[Event, Decision]] = field(default_factory=list)
    faults: list[tuple[Event, FaultInjected]] = field(default_factory=list)
    opening: list[Remark] = field(default_factory=list)
    """What was worth telling before there was a plan."""
    cycle: int = 0
    time: float = 0.0
    actions: int = 0
    looks: int = 0
    """Those that decisions are made on; `glances` are the guard's."""
    glances: int = 0
    seeing: Looks = field(default_factory=Looks)
    costs: Costs = field(default_factory=Costs)
    left: tuple[Step, ...] = ()
    """The steps of the plan that come after the one that was dispatched last."""
    _current: StepLine | None = None
    _unreached: tuple[str, ...] | None = None
    """What `unreached` says, until there is news of what is believed."""
    _cycle: list[Event] = field(default_factory=list)

    @property
    def plan(self) -> PlanLine | None:
        """The plan that is being carried out."""
        return self.plans[-1] if self.plans else None

    @property
    def current(self) -> StepLine | None:
        """The step that was dispatched last, of whichever plan."""
        return self._current

    @property
    def at_work(self) -> bool:
        """Whether a skill is carrying out a step."""
        return self._current is not None and self._current.mark is Mark.CURRENT and self._current.result is None

    @property
    def replans(self) -> int:
        return max(0, len(self.plans) - 1)

    @property
    def retries(self) -> int:
        return sum(decision.kind is DecisionKind.RETRY for _, decision in self.decisions)

    def unreached(self) -> tuple[str, ...]:
        """Return the parts of the goal that the last looks did not show."""
        if self.started is None:
            return ()
        if self._unreached is None:
            self._unreached = self._to_reach(self.started.task)
        return self._unreached

    def _to_reach(self, task: Task) -> tuple[str, ...]:
        known = {atom: probability >= 0.5 for atom, probability in self.probability.items()}
        held = task.derived.complete(known, task.goal.atoms)
        return tuple(str(part) for part in task.goal.conjuncts if part.truth(held) is not True)

    @property
    def is_blind(self) -> bool:
        """Whether nobody looks."""
        return self.started is not None and self.started.is_blind

    @property
    def goal_count(self) -> tuple[int, int] | None:
        """How many parts of the goal are believed to hold, and how many there are; None before the first look."""
        if self.started is None or not self.probability:
            return None
        goal = self.started.task.goal
        total = len(goal.facts) + len(goal.choices)  # its conjuncts, none of which has to be made for that
        return total - len(self.unreached()), total

    @property
    def is_routine(self) -> bool:
        """Whether all that happened in this cycle is one step, done and seen to be done."""
        payloads = [event.payload for event in self._cycle]
        decisions = [each.kind for each in payloads if isinstance(each, Decision)]
        results = [each.done for each in payloads if isinstance(each, SkillResult)]
        return decisions == [DecisionKind.CONTINUE] and results == [True] and not any(map(_is_news, payloads))

    def tell(self, event: Event) -> None:
        """Take in the next event."""
        if event.cycle != self.cycle:
            self._cycle.clear()
        if isinstance(event.payload, _TELLING):
            self._cycle.append(event)
        self.cycle, self.time, self.latest = event.cycle, event.time, event
        self.seeing.tell(event)
        self.costs.tell(event)
        match event.payload:
            case Started() as started:
                self.started, self.began = started, event
                self._unreached = None
            case Resumed() as resumed:
                self._resume(resumed)
            case Observation():
                if self.at_work:
                    self.glances += 1
                else:
                    self.looks += 1
                    self.phase = "look"
            case Belief(probability=probability, unanswered=unanswered) if not self.at_work:  # a glance is the guard's
                self.probability.update(probability)
                self._unreached = None
                for atom in unanswered:
                    self.probability.pop(atom, None)
            case Judged() as judged:
                self.probability.update({a: p for a, p in judged.probability.items() if a in judged.seen})
                self._unreached = None
                for contradiction in judged.contradictions:
                    self._remark(contradiction)
            case Guarded(held=held) as guarded:
                if held is False:
                    self._remark(guarded)
            case Blinded() | Moved() as news:
                self._remark(news)
            case Plan() as plan:
                self._replace(plan)
            case NoPlan() as no_plan:
                self.no_plan = no_plan
                self._remark(no_plan)
            case Dispatched() as dispatched:
                self._dispatch(dispatched)
            case Phase(name=name, detail=detail):
                self.phase = name
                self.compiling = detail if name == COMPILE else ""
            case Timing(stage=stage) if stage == COMPILE:
                self.phase = self.compiling = ""
            case FaultInjected() as fault:
                self.faults.append((event, fault))
                self._remark(fault)
            case SkillResult() as result:
                self._finish(result)
            case Compared() as compared:
                self._compare(compared)
            case Decision() as decision:
                self._decide(event, decision)
            case Ended() as ended:
                self._end(ended)

    def atoms(self) -> list[AtomLine]:
        """The last comparison, surprises first, then doubts, then what is as expected (true before false)."""
        if self.compared is None:
            return []
        verdict, lines = self.compared.verdict, []
        for atom, expected in self.compared.expected.items():
            standing = Standing.EXPECTED
            if atom in verdict.violated:
                standing = Standing.SURPRISE
            elif atom in verdict.unknown:
                standing = Standing.DOUBT
            lines.append(AtomLine(atom, expected, self.probability.get(atom), standing))
        rank = list(Standing)
        return sorted(lines, key=lambda line: (rank.index(line.standing), not line.expected, line.atom))

    def _resume(self, resumed: Resumed) -> None:
        """What was at work when the process ended was cut off."""
        self.ended, self.phase = None, ""
        if self._current is not None and self._current.mark is Mark.CURRENT:
            self._current.mark, self._current.cut_off = Mark.FAILED, True
        self._remark(resumed)

    def _replace(self, plan: Plan) -> None:
        if self.plans:
            self._drop_rest()
        self.plans.append(PlanLine(len(self.plans) + 1, [StepLine(step) for step in plan.steps], plan))
        self.no_plan, self.phase, self.left = None, "plan", plan.steps

    def _drop_rest(self) -> None:
        for line in self.plans[-1].lines:
            if line.mark in (Mark.PENDING, Mark.CURRENT):
                line.mark = Mark.FAILED if line.mark is Mark.CURRENT else Mark.DROPPED

    def _dispatch(self, dispatched: Dispatched) -> None:
        self.actions = dispatched.action
        lines = self.plans[-1].lines if self.plans else []
        for line in lines[: dispatched.index]:
            if line.mark is Mark.PENDING:
                line.mark = Mark.SKIPPED
            elif line.mark is Mark.CURRENT:
                line.mark = Mark.DONE
        if dispatched.index < len(lines):
            self._current = lines[dispatched.index]
        else:
            self._current = StepLine(dispatched.step)
        self._current.mark, self._current.result = Mark.CURRENT, None
        self._current.note, self._current.cut_off = "", False
        self.left = tuple(line.step for line in lines[dispatched.index + 1 :])
        self._current.action, self._current.attempt = dispatched.action, dispatched.attempt
        self.phase = ""

    def _finish(self, result: SkillResult) -> None:
        if self._current is not None:
            self._current.result = result
            if not result.done:
                self._current.mark = Mark.FAILED
                self._current.note = str(result.status)

    def _compare(self, compared: Compared) -> None:
        self.compared, self.compared_step = compared, self._subject(compared)
        line = self._current
        if compared.what != "effects" or line is None or line.result is None:
            return
        wrong = sorted(compared.verdict.violated & frozenset(line.step.affects))
        if wrong:
            line.mark = Mark.FAILED
            line.note = line.note or f"{'not ' * compared.expected[wrong[0]]}{wrong[0]}"
        elif not compared.verdict.unknown & frozenset(line.step.affects):
            line.mark, line.note, line.cut_off = Mark.DONE, "", False  # whatever its skill says: it is seen to be done

    def _subject(self, compared: Compared) -> Step | None:
        """The step that a comparison is about."""
        if compared.what == "effects":
            return self._current.step if self._current else None
        for line in self.plans[-1].lines if self.plans else ():
            if line.mark is not Mark.DONE and _is_of(compared.expected, line.step.precondition):
                return line.step
        return None

    def _decide(self, event: Event, decision: Decision) -> None:
        self.decisions.append((event, decision))
        line = self._current
        routine = decision.kind is DecisionKind.CONTINUE
        if routine and line and line.result and line.mark is Mark.CURRENT:
            line.mark = Mark.DONE
        told_later = decision.kind is DecisionKind.STOP  # by the end of the run
        if not told_later and (not routine or (line and line.result and not line.result.done)):
            self._remark(decision)

    def _remark(self, remark: Remark) -> None:
        plan = self.plan
        if plan is None:
            self.opening.append(remark)
        elif self._current is not None and any(line is self._current for line in plan.lines):
            self._current.remarks.append(remark)
        else:
            plan.remarks.append(remark)

    def _end(self, ended: Ended) -> None:
        self.ended, self.phase = ended, ""
        if self.plans:
            if self._current is not None and self._current.mark is Mark.CURRENT:
                reached = ended.outcome.claims_goal
                self._current.mark = Mark.DONE if reached else Mark.FAILED
                self._current.note = "" if reached else str(ended.outcome)
            self._drop_rest()


def _is_of(expected: Facts, condition: Condition) -> bool:
    """Return whether these may be the literals by which a condition was judged."""
    return expected == condition.literals or (bool(condition.choices) and condition.atoms.issuperset(expected))


_TELLING = (Blinded, Compared, Decision, FaultInjected, Guarded, Judged, Moved, NoPlan, Plan, SkillResult)


def _is_news(payload: object) -> bool:
    """Return whether an event is out of the ordinary."""
    match payload:
        case FaultInjected() | Blinded() | Moved() | Plan() | NoPlan():
            return True
        case Compared(verdict=verdict):
            return not verdict.satisfied
        case Guarded(held=held):
            return held is False
        case Judged(contradictions=contradictions, overruled=overruled):
            return bool(contradictions or overruled)
    return False
