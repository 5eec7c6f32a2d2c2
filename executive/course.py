"""How a run stands: one frozen value, and what each thing that can happen makes of it. Pure.

The loop holds the latest of these and nothing else that changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from executive.belief import Known, Moment
from executive.compare import compare, outlook, progress
from executive.policy import Turn
from executive.types import Decision, DecisionKind, Ended, Facts, OutcomeKind, Plan, SkillResult, Step, Task


@dataclass(frozen=True, slots=True)
class Course:
    """The course of a run so far.

    `goal` is what is still gone for: the task's goal without what was given up. `todo` are the positions of the plan's
    steps that are left, `attempt` counts the tries at the first of them. `moment` are the looks since the last action.
    `failures` counts how often a step failed from the same known facts; `stuck` are the steps that were given up on,
    and what was known then; `given_up_why` is why some of the goal was given up last. A *cycle* is a turn of the loop,
    an *action* a dispatched step, a *replan* a plan that was taken up after the first.
    """

    task: Task
    goal: Facts
    known: Known
    moment: Moment
    plan: tuple[Step, ...] | None = None
    todo: tuple[int, ...] = ()
    attempt: int = 1
    cycle: int = 0
    actions: int = 0
    replans: int = 0
    looks: int = 0
    failures: Mapping[tuple[Step, Facts], int] = field(default_factory=lambda: MappingProxyType({}))
    stuck: Mapping[Step, Facts] = field(default_factory=lambda: MappingProxyType({}))
    given_up_why: str = ""

    @classmethod
    def of(cls, task: Task, told: Facts) -> Course:
        """The start of a run that was `told` some facts."""
        known = Known(told)
        return cls(task, task.goal, known, Moment(known, Facts()))

    @property
    def left(self) -> tuple[Step, ...]:
        """The steps that are left, in order."""
        return tuple(self.plan[position] for position in self.todo) if self.plan else ()

    @property
    def state(self) -> Facts:
        """A complete state to plan from: what is not known counts as false."""
        return self.known.state(self.task.atoms)

    @property
    def given_up(self) -> Facts:
        return self.task.goal.without(self.goal)

    @property
    def is_stuck(self) -> bool:
        """Whether a step was given up on when just this was known."""
        return self.known.facts in self.stuck.values()

    def failed_before(self, step: Step, known: Facts) -> int:
        return self.failures.get((step, known), 0)

    def leads_nowhere(self, plan: Plan) -> bool:
        """Whether the plan hangs on a step that was given up on when just this was known."""
        return any(self.stuck.get(step) == self.known.facts for step in plan.steps)

    # What can happen.

    def next_cycle(self) -> Course:
        return replace(self, cycle=self.cycle + 1)

    def looked(self, seen: Facts, observation_id: int) -> Course:
        """One more look at the same moment. What its looks say together becomes what is known."""
        moment = self.moment.looked(seen, observation_id)
        known = moment.before.updated(moment.settled, self.cycle)
        return replace(self, moment=moment, known=known, looks=self.looks + 1)

    def waiting(self) -> Course:
        """From here on the world is expected to change: what the next look shows counts, not what earlier ones did."""
        return replace(self, moment=Moment(self.known, Facts(), (), self.moment.observation_id))

    def trusting_last_look(self) -> Course:
        """What the last look alone showed becomes what is known; all of the goal, if it showed that."""
        goal = self.task.goal if self.moment.last.entails(self.task.goal) else self.goal
        return replace(self, known=self.known.updated(self.moment.last, self.cycle), goal=goal)

    def giving_up(self, why: str) -> Course:
        """Some of the goal is about to be left out of what is planned for."""
        return replace(self, given_up_why=why)

    def planned(self, plan: Plan, goal: Facts) -> Course:
        """A plan for `goal`, the task's or what is left of it, is taken up."""
        replans, todo = self.replans + (self.plan is not None), tuple(range(len(plan.steps)))
        return replace(self, goal=goal, plan=plan.steps, todo=todo, attempt=1, replans=replans)

    def dispatched(self) -> Course:
        """The next step is handed to its skill: its effects are expected, and that all else stays."""
        expected = progress(self.known.facts, self.left[0])
        moment = Moment(self.known, expected, (), self.moment.observation_id)
        return replace(self, moment=moment, actions=self.actions + 1)

    def assumed(self) -> Course:
        """Nobody looks: what was expected of the step becomes what is known."""
        return replace(self, known=Known(self.moment.expected), todo=self.todo[1:], attempt=1)

    def judged(self, turn: Turn, decision: Decision) -> Course:
        """The dispatched step came out as `turn` says, and `decision` was taken on it."""
        if turn.rest is None:
            return replace(self.failed(turn.step, self.moment.before.facts, decision), attempt=self.attempt + 1)
        return replace(self, todo=tuple(self.todo[1:][position] for position in turn.rest), attempt=1)

    def failed(self, step: Step, known: Facts, decision: Decision) -> Course:
        """The step failed when `known` was known."""
        failures = {**self.failures, (step, known): self.failed_before(step, known) + 1}
        stuck = {**self.stuck, step: self.known.facts} if decision.kind is DecisionKind.GIVE_UP_GOAL else self.stuck
        return replace(self, failures=MappingProxyType(failures), stuck=MappingProxyType(dict(stuck)))

    # What it amounts to.

    def turn(self, result: SkillResult) -> Turn:
        """Everything that is to be decided upon after the dispatched step was looked at."""
        step, *left = self.left
        moment, state = self.moment, self.state
        verdict = compare(moment.expected, moment.settled)
        view = outlook(step, left, state, self.goal, surprised=bool(verdict.violated))
        doubts = sorted(view.needed - moment.settled.keys())
        return Turn(
            step=step,
            result=result,
            expected=moment.expected,
            verdict=verdict,
            doubts={atom: self.known.age(atom, self.cycle) for atom in doubts},
            planned=len(left),
            rest=view.rest,
            repeatable=view.repeatable,
            looks=len(moment.looks),
            attempt=self.attempt,
            failures=self.failed_before(step, moment.before.facts) + 1,
        )

    def ended(self, decision: Decision) -> Ended:
        """How the run ends. The goal was seen if the last look alone, with no action after it, shows all of it."""
        if decision.outcome is None:
            raise ValueError(f"a run does not end with {decision.kind!r}")
        goal, reached = self.task.goal, decision.outcome is OutcomeKind.GOAL_REACHED
        return Ended(
            decision.outcome,
            decision.reason,
            goal_seen=reached and bool(self.moment.looks) and self.moment.last.entails(goal),
            unreached=goal.without(compare(goal, self.known.facts).holds).literals(),
            cycles=self.cycle,
            actions=self.actions,
            replans=self.replans,
            looks=self.looks,
        )
