"""The run state: one frozen value, with a transition for each thing that can happen. Pure.

The loop holds the latest of these and nothing else that changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from executive.belief.interface import Judgement, Memory
from executive.core.attention import questions
from executive.core.compare import compare, progress, relevant_facts, remaining_plan
from executive.core.policy import Failures, GivenUp, StepOutcome, UncertainAtoms
from executive.core.settings import Settings
from executive.types import (
    ALWAYS,
    NEVER,
    Atom,
    Belief,
    Cause,
    Condition,
    Decision,
    DecisionKind,
    Ended,
    Facts,
    Ground,
    Looked,
    OutcomeKind,
    Plan,
    Resumed,
    SearchOrder,
    SkillResult,
    Step,
    Task,
    Verdict,
)

MIN_PROBABILITY = 0.02
"""An atom that is less probable than this is not planned with."""


class StuckSteps(Enum):
    """When a plan may contain a step that was given up on. One that was given up on twice may be in none."""

    NEVER = "never"
    IF_CHANGED = "if a relevant fact has changed since"
    LAST_RESORT = "if nothing else is left to do: as before, or if any action was carried out since"


class Stuck(NamedTuple):
    """A step that was given up on: the relevant facts then, those about the objects in its way among them, after how
    many actions of the run that was, how often by now, and these objects, where they are known."""

    facts: Facts
    actions: int
    times: int
    blockers: tuple[str, ...] = ()

    @property
    def for_good(self) -> bool:
        """Whether it was given up on so often that it is in no plan any more."""
        return self.times > (_MOST_BLOCKED if self.blockers else 1)

    @property
    def in_the_way(self) -> tuple[Atom, ...]:
        """The facts that kept the step from being done: those that are about the objects in its way, and first those
        that say where they are in relation to something else."""
        about = (atom for atom in self.facts.true if not set(self.blockers).isdisjoint(atom.args))
        return tuple(sorted(about, key=lambda atom: (-len(atom.args), atom)))


_MOST_BLOCKED = 4
"""How often a step may be blocked, each time after something was moved out of its way."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The time between two actions, in which the world stays as it is: what was expected and what was known before, how
    many looks there were, which atoms they asked about, and the number of the last observation. `assumed` is what the
    plan takes to be so of what could not be seen before. `search` is where to look first, once that was asked."""

    expected: Facts = field(default_factory=Facts)
    before: Facts = field(default_factory=Facts)
    looks: int = 0
    asked: frozenset[Atom] = frozenset()
    observation_id: int = -1
    assumed: Facts = field(default_factory=Facts)
    search: SearchOrder | None = None


@dataclass(frozen=True, slots=True)
class RunState:
    """All that changes while a run goes on.

    Attributes:
        goal: the task's goal without the parts that were given up.
        known: the facts that were given or ever seen, as they are believed now.
        memory: the monitor's own state.
        judgement: the belief after the looks at this `moment`; None before the first one.
        source: the last look that asked about an atom, with its cameras.
        todo: the positions of the plan's steps that are left; `attempt` counts the tries at the first of them.
        report: the report of this cycle's skill.
        cycle, actions, replans, looks: how many there were. A *cycle* is a turn of the loop, an *action* a dispatched
            step, a *replan* a plan after the first.
        failures: how often each step failed, by the relevant facts.
        stuck: the steps that were given up on.
        given_up_why: why parts of the goal were given up last.
        tried: the atoms for which a plan from a less probable state was carried out.
        since: how far another process had come, where one began the run.
        supposed: what is planned with of what could not be seen, in place of what is most probable.
    """

    task: Task
    goal: Condition
    known: Facts
    memory: Memory = None
    judgement: Judgement | None = None
    moment: Moment = Moment()
    source: Mapping[Atom, tuple[int, tuple[str, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    plan: tuple[Step, ...] | None = None
    todo: tuple[int, ...] = ()
    attempt: int = 1
    report: SkillResult | None = None
    cycle: int = 0
    actions: int = 0
    replans: int = 0
    looks: int = 0
    failures: Mapping[Step, Mapping[Facts, int]] = field(default_factory=lambda: MappingProxyType({}))
    stuck: Mapping[Step, Stuck] = field(default_factory=lambda: MappingProxyType({}))
    given_up_why: tuple[Cause, ...] = ()
    tried: tuple[Atom, ...] = ()
    since: Resumed | None = None
    supposed: Facts = field(default_factory=Facts)

    @property
    def left(self) -> tuple[Step, ...]:
        """The steps that are left, in order."""
        return tuple(self.plan[position] for position in self.todo) if self.plan else ()

    @property
    def state(self) -> Facts:
        """A complete state to plan from, as the monitor believes it; for one that does not look, as it is known. What
        cannot be seen is as it is supposed to be."""
        if self.judgement is None:
            return Facts.closed(self.known.true, self.task.atoms)
        return self.judgement.state | self.supposed if self.supposed else self.judgement.state

    @property
    def seen(self) -> Facts:
        """What the looks at this moment tell."""
        return self.judgement.seen if self.judgement and self.moment.looks else Facts()

    @property
    def expected(self) -> Facts:
        """What was expected of the atoms that this moment's looks are about."""
        return self.moment.expected.only(self.moment.asked | self.seen.keys())

    @property
    def asked_all(self) -> bool:
        """Whether the looks at this moment asked about every atom."""
        return self.moment.looks > 0 and self.moment.asked.issuperset(self.askable)

    @property
    def askable(self) -> tuple[Atom, ...]:
        """The atoms that may be asked about: all but those that cannot be seen as far as is known, or expected."""
        visibility = self.task.visibility
        if not visibility:
            return self.task.atoms
        covered = visibility.covered(self.known)
        if self.moment.expected:
            covered &= visibility.covered(self.moment.expected)
        return tuple(atom for atom in self.task.atoms if atom not in covered)

    @property
    def hidden(self) -> frozenset[Atom]:
        """The atoms that are not seen, and of which it is not known that they can be."""
        return self.task.visibility.hidden(self.known) - self.seen.keys()

    @property
    def found_out(self) -> tuple[Atom, ...]:
        """The atoms that this moment's looks tell and that could not be seen before the last action."""
        return tuple(atom for atom in self.moment.assumed if atom in self.seen)

    @property
    def given_up(self) -> Condition:
        return self.task.goal.without(self.goal.conjuncts)

    def failing(self, step: Step, known: Facts) -> Failures:
        """Return how often the step has failed, if it fails now, with `known` known before it."""
        before = self.failures.get(step, {})
        return Failures(before.get(relevant_facts(step, known), 0) + 1, sum(before.values()) + 1)

    def stuck_among(self, steps: Iterable[Step], state: Facts, allowed: StuckSteps) -> frozenset[Step]:
        """Return those of the steps, carried out in order from a complete state, that are stuck and not `allowed`."""
        found = set()
        for step in steps if self.stuck else ():
            if (stuck := self.stuck.get(step)) is not None:
                changed = allowed is not StuckSteps.NEVER and not state.entails(stuck.facts)
                later = allowed is StuckSteps.LAST_RESORT and self.actions > stuck.actions
                if stuck.for_good or not (changed or later):
                    found.add(step)
            state = progress(state, step, self.task.derived)
        return frozenset(found)

    def questions(self, most: int) -> tuple[Atom, ...]:
        """Return what a look at this moment should ask about: what the last step changed, what the next one needs, what
        is in doubt, and the goal."""
        left = self.left[1:] if self.report else self.left
        matters = (
            self.report.step.affects if self.report else (),
            self._asked_for(left[0].precondition) if left else (),
            self._asked_for(self.goal),
        )
        probability = self.judgement.probability if self.judgement else {}
        return questions(self.askable, matters, probability, most)

    def uncertain_atoms(self, settings: Settings) -> UncertainAtoms:
        """Return all atoms, the least certain first, and before all those that cannot be told. There is no plan because
        of some that nobody suspects, so that no limit of questions holds for what follows."""
        if self.judgement is None:
            return UncertainAtoms()
        certain = self.judgement.least_certain(self.task.atoms)
        atoms = sorted(certain, key=lambda atom: atom in self.seen)
        return UncertainAtoms(tuple(atoms), self.unsure(atoms, settings.sure))

    @property
    def spent(self) -> dict[str, float]:
        """What was used so far of the run's budgets, but for replans and time."""
        return {"cycles": self.cycle, "actions": self.actions, "looks": self.looks}

    def unsure_of_goal(self, sure: float) -> tuple[Atom, ...]:
        """Return what the goal hangs on and is not sure; where some of it was given up, that may be anything."""
        if self.given_up != ALWAYS:
            return self.unsure(self.task.atoms, sure)
        unsure = self.unsure(self._asked_for(self.goal), sure)
        unsure = tuple(atom for atom in unsure if atom not in self.hidden)
        # A disjunction that holds by what is sure hangs on nothing else.
        left, plain = self.task.derived.complete(self.seen.without(unsure), self.goal.atoms), self.goal.facts
        hanging = [part for part in self.goal.conjuncts if part.truth(left) is not True]
        kept = frozenset(self._asked_for(Condition.all_of(hanging)))
        return tuple(atom for atom in unsure if atom in plain or atom in kept)

    def claimable(self, claim: float) -> Facts:
        """Return what is seen, without those literals of the goal that hold with a probability of less than `claim`,
        and without whatever else the goal hangs on and is not that sure."""
        if self.judgement is None or self.judgement.thresholded:
            return self.seen
        doubtful, plain = self.unsure(self._asked_for(self.goal), claim), self.goal.facts
        seen = self.seen.without([atom for atom in doubtful if atom not in plain or self.seen.get(atom) is plain[atom]])
        return seen | self.recalled(claim)

    def recalled(self, claim: float) -> Facts:
        """Return the literals of the goal that were seen to hold, are hidden by what the goal itself asks for or by
        having gone to see others after them, and hold with a probability of at least `claim` still."""
        goal, hidden = self.goal.facts, self.hidden
        visible, tried = self.task.visible, self.tried
        kept = [atom for atom in goal if atom in hidden and (atom in tried or visible[atom].given(goal) == NEVER)]
        doubtful = self._unsure(kept, self.known, claim)
        return goal.only(atom for atom in kept if atom not in doubtful and self.known.get(atom) is goal[atom])

    def compared(self, condition: Condition, facts: Facts) -> tuple[Facts, Verdict]:
        """The literals by which a condition is judged where `facts` hold, and what becomes of each."""
        known = self.task.derived.complete(facts, condition.atoms)
        expected = condition.decisive(known)
        return expected, compare(expected, known)

    def _asked_for(self, condition: Condition) -> tuple[Atom, ...]:
        """The atoms that a condition hangs on and that can be asked about, its literals first."""
        atoms = (*condition.facts, *sorted(condition.atoms.difference(condition.facts)))
        return self.task.derived.support(atoms)

    def what_was_given_up(self, plan: Plan | None, reached: Condition) -> GivenUp:
        """Return what was given up; `plan` is for as much of it as is in `reached`, if there is one."""
        back = self.given_up.only(reached.conjuncts)
        return GivenUp(self.given_up if plan is None else back, self.given_up_why, plan)

    def unsure(self, atoms: Iterable[Atom], sure: float) -> tuple[Atom, ...]:
        """Return those of the atoms that cannot be told, or with a probability of less than `sure`."""
        return self._unsure(atoms, self.seen, sure)

    def _unsure(self, atoms: Iterable[Atom], facts: Facts, sure: float) -> tuple[Atom, ...]:
        probability = self.judgement.probability if self.judgement else {}

        def is_sure(atom: Atom) -> bool:
            chance = probability.get(atom, 0.5)
            return atom in facts and (chance if facts[atom] else 1.0 - chance) >= sure

        return tuple(atom for atom in atoms if not is_sure(atom))

    def grounded(self, decision: Decision) -> Decision:
        """The decision with what is believed now of the atoms that spoke for it, and with what the skill said."""
        probability = self.judgement.probability if self.judgement else {}
        known = self.task.derived.complete(self.seen if self.moment.looks else self.known, decision.evidence)

        def ground(atom: Atom) -> Ground:
            expected = self.moment.expected.get(atom, self.goal.facts.get(atom))
            believed = known.get(atom)
            return Ground(atom, expected, believed, probability.get(atom), *self.source.get(atom, (-1, ())))

        return replace(decision, grounds=tuple(map(ground, decision.evidence)), report=self.report)

    # What can happen.

    def resumed(self, since: Resumed) -> RunState:
        """Another process goes on, in a cycle of its own."""
        return replace(
            self,
            since=since,
            cycle=since.cycle + 1,
            actions=since.actions,
            replans=since.plans,
            looks=since.looks,
        )

    def next_cycle(self) -> RunState:
        return replace(self, cycle=self.cycle + 1, report=None)

    def looked(self, memory: Memory, judgement: Judgement, raw: Belief, look: Looked) -> RunState:
        """One more look at the same moment."""
        asked = frozenset((*raw.probability, *raw.unanswered))
        moment = replace(
            self.moment,
            looks=self.moment.looks + 1,
            asked=self.moment.asked | asked,
            observation_id=look.observation_id,
            search=None,
        )
        told = judgement.seen.keys() | judgement.remembered.keys()
        # One thing that is otherwise leaves nothing of the rest: what is sought is somewhere else.
        refuted = any(judgement.seen.get(atom, value) is not value for atom, value in self.supposed.items())
        source = {**self.source, **dict.fromkeys(asked, (look.observation_id, look.cameras))}
        return replace(
            self,
            memory=memory,
            judgement=judgement,
            known=judgement.state.only(told),
            moment=moment,
            source=MappingProxyType(source),
            looks=self.looks + 1,
            supposed=Facts() if refuted else self.supposed.without(judgement.seen),
        )

    def waiting(self, memory: Memory) -> RunState:
        """From here on the world is expected to change: what the next look shows counts, not what earlier ones did."""
        return replace(self, memory=memory, moment=Moment(observation_id=self.moment.observation_id))

    def whole_goal_seen(self) -> RunState:
        """Take what was given up into the goal again, if all of it is seen to hold."""
        return replace(self, goal=self.task.goal) if self.holds(self.task.goal, self.seen) else self

    def holds(self, condition: Condition, facts: Facts) -> bool:
        """Return whether a condition holds where `facts` do; not, where that is unknown."""
        return condition.truth(self.task.derived.complete(facts, condition.atoms)) is True

    @property
    def possible(self) -> tuple[Atom, ...]:
        """The atoms that are believed to be false and may be true, the most probable first."""
        if self.judgement is None:
            return ()
        chance = {atom: self.judgement.probability.get(atom, 0.0) for atom in self.task.atoms}
        may_be = [atom for atom, value in chance.items() if value >= MIN_PROBABILITY and not self.state[atom]]
        # Twice: the action at work at the first time may come to something that undoes the plan.
        open_ = (atom for atom in may_be if self.tried.count(atom) < 2)
        return tuple(sorted(open_, key=lambda atom: (-chance[atom], atom)))

    def assuming(self, state: Facts, doubted: Atom) -> RunState:
        """Plan from `state` from here on, though another one is more probable: carrying the plan out removes the
        doubt."""
        if self.judgement is None:
            raise ValueError("nobody has looked yet")
        judgement = replace(self.judgement, state=state)
        return replace(self, known=state, judgement=judgement, tried=(*self.tried, doubted), supposed=Facts())

    def searching(self, order: SearchOrder) -> RunState:
        """Plan as if what is sought were at the place that is to be looked at first."""
        return replace(self, moment=replace(self.moment, search=order), supposed=order.assumed)

    def first_place(self, steps: Iterable[Step], state: Facts, places: Sequence[Condition]) -> Condition | None:
        """Return which of the places is the first that can be seen when the steps are carried out from a complete
        state; None where none can."""
        for step in steps:
            state = progress(state, step, self.task.derived)
            for place in places:
                if self.holds(place, state):
                    return place
        return None

    def looking_for(self, atom: Atom) -> RunState:
        """A plan is about to be carried out to see it."""
        return replace(self, tried=(*self.tried, atom))

    def giving_up(self, why: tuple[Cause, ...]) -> RunState:
        """Some of the goal is about to be left out of what is planned for."""
        return replace(self, given_up_why=why)

    def planned(self, plan: Plan, goal: Condition) -> RunState:
        """A plan for `goal`, the task's or what is left of it, is taken up."""
        replans, todo = self.replans + (self.plan is not None), tuple(range(len(plan.steps)))
        return replace(self, goal=goal, plan=plan.steps, todo=todo, attempt=1, replans=replans)

    def dispatched(self) -> RunState:
        """The next step is handed to its skill: its effects are expected, and that all else stays."""
        expected = progress(self.known, self.left[0], self.task.derived)
        assumed = self.state.only(self.hidden)
        moment = Moment(expected, self.known, observation_id=self.moment.observation_id, assumed=assumed)
        return replace(self, moment=moment, actions=self.actions + 1)

    def acted(self, result: SkillResult, memory: Memory) -> RunState:
        """The skill is done with it, however that went."""
        return replace(self, report=result, memory=memory, supposed=self.supposed.without(result.step.affects))

    def assumed(self) -> RunState:
        """Nobody looks: what was expected of the step becomes what is known."""
        return replace(self, known=self.moment.expected, todo=self.todo[1:], attempt=1)

    def judged(self, turn: StepOutcome, decision: Decision) -> RunState:
        """The dispatched step came out as `turn` says, and `decision` was taken on it."""
        if turn.is_found_otherwise:
            return replace(self.worked(turn.step), attempt=1)
        if turn.rest is None:
            failed = self.failed(turn.step, self.moment.before, decision, turn.result.blockers)
            return replace(failed, attempt=self.attempt + 1)
        run_state = self.worked(turn.step) if turn.result.done and not turn.verdict.violated else self
        return replace(run_state, todo=tuple(self.todo[1:][position] for position in turn.rest), attempt=1)

    def worked(self, step: Step) -> RunState:
        """The step came out as it was to, so that what it failed by before does not last."""
        failures = {other: counts for other, counts in self.failures.items() if other != step}
        stuck = {other: why for other, why in self.stuck.items() if other != step}
        return replace(self, failures=MappingProxyType(failures), stuck=MappingProxyType(stuck))

    def failed(self, step: Step, known: Facts, decision: Decision, blockers: tuple[str, ...] = ()) -> RunState:
        """The step failed when `known` was known, with these objects in its way."""
        facts = relevant_facts(step, known)
        counts = {**self.failures.get(step, {}), facts: self.failing(step, known).here}
        failures, stuck = {**self.failures, step: MappingProxyType(counts)}, dict(self.stuck)
        if decision.kind is DecisionKind.GIVE_UP_GOAL:
            times = stuck[step].times + 1 if step in stuck else 1
            stuck[step] = Stuck(relevant_facts(step, known, blockers), self.actions, times, blockers)
        return replace(self, failures=MappingProxyType(failures), stuck=MappingProxyType(stuck))

    # What it amounts to.

    def turn(self, result: SkillResult) -> StepOutcome:
        """Return everything that is to be decided upon after the dispatched step was looked at."""
        step, *left = self.left
        moment, judgement = self.moment, self.judgement
        verdict = compare(self.expected, self.seen)
        rules, seen = self.task.derived, self.seen
        view = remaining_plan(step, left, self.state, self.goal, bool(verdict.violated), rules, seen)
        unseen = sorted(view.needed - self.seen.keys() - self.hidden)
        ages = {atom: judgement.age(atom) if judgement else None for atom in unseen}
        assumed = moment.assumed.only(self.seen)
        return StepOutcome(
            step=step,
            result=result,
            expected=self.expected,
            verdict=verdict,
            doubts={atom: age for atom, age in ages.items() if age is None or atom in moment.asked},
            planned=len(left),
            rest=view.rest,
            repeatable=view.repeatable,
            looks=moment.looks,
            attempt=self.attempt,
            failures=self.failing(step, moment.before),
            found_otherwise=tuple(atom for atom, value in assumed.items() if self.seen[atom] is not value),
        )

    def ended(self, decision: Decision) -> Ended:
        """Return how the run ends. The goal was seen if looks at this last moment, with no action after it, show all of
        it."""
        if decision.outcome is None:
            raise ValueError(f"a run does not end with {decision.kind!r}")
        goal, reached = self.task.goal, decision.outcome is OutcomeKind.GOAL_REACHED
        return Ended(
            decision.outcome,
            decision.causes,
            goal_seen=reached and self.moment.looks > 0 and self.holds(goal, self.seen),
            unreached=tuple(str(part) for part in goal.conjuncts if not self.holds(part, self.known)),
            cycles=self.cycle,
            actions=self.actions,
            replans=self.replans,
            looks=self.looks,
        )
