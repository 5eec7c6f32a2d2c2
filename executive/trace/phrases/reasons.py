"""Why something was decided: a phrase for each code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from executive.trace.phrases.words import listed, plural
from executive.types import Atom, Cause, Decision, Ended, Reason

_MOST = 4
"""How many things a reason lists, as a decision may have several reasons."""

_JOINED = {Reason.UNCERTAIN: ", and ", Reason.GOAL_KEPT: ", ", Reason.DONE_AGAIN: ": "}
"""How a reason is joined to the one before it, where that is not by a semicolon."""


def why(decided: Decision | Ended | Iterable[Cause]) -> str:
    """Return why something was decided, or why a run ended."""
    causes = decided.causes if isinstance(decided, Decision | Ended) else decided
    text = ""
    for cause in causes:
        joined = " " if text.endswith(":") else _JOINED.get(cause.code, "; ")
        text += f"{joined if text else ''}{REASONS[cause.code](cause)}"
    return text


def _atoms(cause: Cause) -> str:
    return listed(cause.atoms, _MOST)


def _literals(cause: Cause) -> str:
    return listed(cause.literals, _MOST)


def _steps(cause: Cause) -> str:
    return listed(cause.steps, _MOST)


def _looks(count: int) -> str:
    return "one look" if count == 1 else f"{count} looks"


def _times(cause: Cause) -> str:
    return "for the first time" if cause.count == 1 else f"{cause.count} times"


def _detail(cause: Cause, before: str = ": ") -> str:
    return f"{before}{cause.detail}" if cause.detail else ""


def _cannot_tell(cause: Cause) -> str:
    def aged(atom: Atom, age: int | None) -> str:
        return f"{atom} (never seen)" if age is None else f"{atom} (last seen {plural(age, 'cycle')} ago)"

    if not cause.ages:
        return f"cannot tell {_atoms(cause)}"
    return f"cannot tell {listed(list(map(aged, cause.atoms, cause.ages)), _MOST)}"


def _nothing_seen(cause: Cause) -> str:
    if not cause.steps:
        return f"nothing can be seen: {_looks(cause.count)} told no atom"
    return f"nothing can be seen any more: {_looks(cause.count)} after {_steps(cause)} told no atom"


def _precondition_unmet(cause: Cause) -> str:
    def unmet(literal: str) -> str:
        atom = literal.removeprefix("not ")
        if atom in never_seen:
            return f"{atom} was never seen"
        return f"{literal} does not hold" if atom == literal else f"{atom} holds"

    never_seen = set(map(str, cause.atoms))
    return f"{_steps(cause)} cannot begin: {listed(list(map(unmet, cause.literals)), _MOST)}"


def _skill_failed(cause: Cause) -> str:
    early = f" ({cause.seconds:.1f} s early)" if cause.seconds >= 0.05 else ""
    return f"{_steps(cause)} reports {cause.status}{_detail(cause)}{early}"


def _no_plan(answer: str) -> Callable[[Cause], str]:
    def phrase(cause: Cause) -> str:
        without = f" without {_steps(cause)}" if cause.steps else ""
        times = f", {cause.count} times" if cause.count > 1 else ""
        return f"the planner answers {answer}{without}{_detail(cause)}{times}"

    return phrase


def _stage_failed(cause: Cause) -> str:
    return f"{cause.what}: {cause.detail}" if cause.what else cause.detail


def _places(cause: Cause) -> str:
    """The first place with what speaks for it, and the others beside it."""

    def told(place: str, chance: float, cost: float) -> str:
        return f"{place} (P {chance:.2f}, {cost:.2f} in vain)"

    first, *rest = list(map(told, cause.literals, cause.probabilities, cause.costs)) or [_literals(cause)]
    return f"{first}, before {listed(rest, _MOST)}" if rest else first


REASONS: Mapping[Reason, Callable[[Cause], str]] = {
    Reason.ALL_KNOWN: lambda _: "every atom is known",
    Reason.INITIAL_STATE_GIVEN: lambda _: "told what holds",
    Reason.CANNOT_TELL: _cannot_tell,
    Reason.UNKNOWN_AS_FALSE: lambda cause: f"cannot tell {_atoms(cause)}: planned from as false",
    Reason.HIDDEN: lambda cause: f"{_atoms(cause)} cannot be seen from here: planned with what is most probable",
    Reason.NOTHING_SEEN: _nothing_seen,
    Reason.PRECONDITION_UNMET: _precondition_unmet,
    Reason.WAITING: lambda cause: f"waiting (look {cause.count})",
    Reason.TRIED_ANYWAY: lambda cause: f"tried all the same, as {_atoms(cause)} is what is most probable",
    Reason.AS_EXPECTED: lambda _: "as expected",
    Reason.SKILL_DONE: lambda cause: f"{_steps(cause)} is done",
    Reason.SKILL_FAILED: _skill_failed,
    Reason.SKILL_FAILED_YET_SEEN: lambda cause: f"{_skill_failed(cause)}, yet what it was for is seen",
    Reason.SKILL_CRASHED: lambda cause: f"the skill for {_steps(cause)} crashed{_detail(cause)}",
    Reason.STEP_FAILED: lambda cause: f"{_steps(cause)} did not come out",
    Reason.EFFECT_MISSING: lambda cause: f"{_atoms(cause)} not seen as expected",
    Reason.SEEN_INSTEAD: lambda cause: f"seen instead: {_atoms(cause)}",
    Reason.UNEXPECTED: lambda cause: f"{_atoms(cause)} seen, which was not expected",
    Reason.EFFECTS_ASSUMED: lambda _: "nobody looks, its effects are assumed",
    Reason.PLAN_VALID: lambda _: "the plan still reaches the goal",
    Reason.PLAN_INVALID: lambda cause: f"{_steps(cause)} is done, yet the plan does not reach the goal from here",
    Reason.FOUND_OTHERWISE: lambda cause: f"now that it can be seen, {_atoms(cause)} is not as the plan took it to be",
    Reason.STEPS_UNNEEDED: lambda cause: f"{cause.count} of {cause.total:g} steps no longer needed",
    Reason.RETRY: lambda cause: f"trying again ({cause.count} of {cause.total:g})",
    Reason.FAILED_WITH_SAME_FACTS: lambda cause: f"it came to this {_times(cause)} from the same known facts",
    Reason.FAILED_TOO_OFTEN: lambda cause: f"it came to this {_times(cause)} by now",
    Reason.LOOK_FIRST: lambda cause: f"what the goal needs is out of view: first {_places(cause)}",
    Reason.LOOK_ELSEWHERE: lambda cause: f"by what was seen now, it is better to look first at {_places(cause)}",
    Reason.PLAN_FOUND: lambda cause: f"{plural(cause.count, 'step')} to go",
    Reason.UNSOLVABLE: _no_plan("unsolvable"),
    Reason.PLANNER_TIMED_OUT: _no_plan("timed out"),
    Reason.PLANNER_CRASHED: _no_plan("crashed"),
    Reason.PLANNER_ASKED_AGAIN: lambda _: "asking once more",
    Reason.BELIEF_DOUBTED: lambda _: "looking again at what is least certain, as what is believed may be wrong",
    Reason.UNCERTAIN: lambda cause: f"{_atoms(cause)} could be surer",
    Reason.OPTIMISTIC_PLAN: lambda cause: f"before any of it is given up, it is tried as if {_atoms(cause)} were so",
    Reason.PLAN_WITHOUT_STEP: lambda _: "there is a plan that does without it",
    Reason.PLAN_CLEARS: lambda cause: f"there is a plan that first ends what is in the way: {_atoms(cause)}",
    Reason.WHOLE_GOAL_REACHABLE: lambda _: "yet there is a plan for the whole goal",
    Reason.NOTHING_REACHABLE: lambda _: "there is no other part of the goal to go for",
    Reason.GOAL_GIVEN_UP: lambda cause: f"giving up {_literals(cause)}",
    Reason.GOAL_KEPT: lambda cause: f"going for {_literals(cause)}",
    Reason.GOAL_SEEN: lambda _: "the goal is seen to hold",
    Reason.GOAL_UNCERTAIN: lambda cause: f"nothing is left to do, but {_atoms(cause)} could be surer",
    Reason.GOAL_NOT_SEEN: lambda cause: f"nothing is left to do, but not seen as the goal has it: {_atoms(cause)}",
    Reason.GOAL_UNKNOWN: lambda cause: f"nothing is left to do, but cannot tell {_atoms(cause)}",
    Reason.GOAL_RECALLED: lambda cause: f"{_atoms(cause)} was seen before it was hidden",
    Reason.TO_BE_SEEN: lambda cause: f"{_atoms(cause)} cannot be seen from here: going to look",
    Reason.GOAL_ONLY_BELIEVED: lambda cause: (
        f"the goal is believed to hold, but cannot tell {_atoms(cause)} in {_looks(cause.count)}"
    ),
    Reason.DONE_AGAIN: lambda cause: f"done once more, as if {_atoms(cause)}",
    Reason.REST_OF_GOAL_SEEN: lambda _: "what was left of the goal is seen to hold",
    Reason.REACHABLE_AGAIN: lambda cause: f"there is a plan for {_literals(cause)} now",
    Reason.GIVEN_UP_BEFORE: lambda cause: f"{_literals(cause)} was given up:",
    Reason.GOAL_NOT_OBSERVED: lambda _: "the plan is carried out; nobody looked whether the goal holds",
    Reason.BUDGET_SPENT: lambda cause: f"the budget of {cause.total:g} {cause.what} is used up",
    Reason.INTERRUPTED: lambda cause: _stage_failed(cause) or "interrupted",
    Reason.STAGE_FAILED: _stage_failed,
    Reason.RECORDED: lambda cause: cause.detail,
}
