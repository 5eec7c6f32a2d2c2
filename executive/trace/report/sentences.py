"""One sentence or a few for each thing that can happen in a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from executive.trace.record.log import picture_name
from executive.trace.terminal.view import spoken
from executive.types import (
    Blinded,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    Ground,
    Guarded,
    Looked,
    LookKind,
    Moved,
    NoPlan,
    Plan,
    Questions,
    Resumed,
    SkillResult,
)

MOST = 6
"""How many atoms a sentence lists before it counts the rest."""

_DECIDED: Mapping[DecisionKind, str] = {
    DecisionKind.CONTINUE: "It went on",
    DecisionKind.LOOK_AGAIN: "It looked again",
    DecisionKind.RETRY: "It tried once more",
    DecisionKind.REPLAN: "It planned anew",
    DecisionKind.GIVE_UP_GOAL: "It gave up some of the goal",
    DecisionKind.STOP: "It stopped",
}
_HOW: Mapping[LookKind, str] = {
    LookKind.FULL: "asked about all {atoms} atoms",
    LookKind.FOCUSED: "asked about {questions} of {atoms} atoms",
    LookKind.CLOSER: "asked about {questions} of {atoms} atoms, more closely",
    LookKind.MOVED: "asked about {questions} of {atoms} atoms with the arm out of the way",
    LookKind.GUARD: "asked whether what it carried was still there",
}


def looked(look: Looked, cause: str) -> str:
    """What a look was about, and through which cameras it was taken."""
    how = _HOW[look.kind].format(questions=look.questions, atoms=look.atoms)
    through = f" through {listed(look.cameras)}" if look.cameras else ""
    return f"Look {look.observation_id} ({cause}) {how}{through}."


def pictures(observation: int, cameras: Sequence[str]) -> str:
    """Where the pictures of a look lie."""
    return f"Pictures of look {observation}: {', '.join(picture_name(observation, camera) for camera in cameras)}."


def decided(decision: Decision) -> list[str]:
    outcome = f", {decision.outcome}" if decision.outcome else ""
    lines = [f"{_DECIDED[decision.kind]}{outcome}: {decision.reason}."]
    if decision.kind is DecisionKind.CONTINUE and (decision.report is None or decision.report.done):
        return lines
    if decision.report is not None and not decision.report.done:
        lines.append(f"  The skill said: {_said(decision.report)}.")
    lines += [f"  {_ground(ground)}" for ground in decision.grounds[:MOST]]
    if len(decision.grounds) > MOST:
        lines.append(f"  and {len(decision.grounds) - MOST} atoms more")
    looks = dict.fromkeys((ground.observation_id, ground.cameras) for ground in decision.grounds[:MOST])
    lines += [f"  {pictures(look, cameras)}" for look, cameras in looks if cameras]
    return lines


def _ground(ground: Ground) -> str:
    assumed = "assumed to be " if ground.observation_id < 0 and ground.probability is None else ""
    believed = "cannot be told" if ground.believed is None else f"is {assumed}{truth(ground.believed)}"
    expected = "" if ground.expected is None else f" (expected {truth(ground.expected)})"
    probability = "" if ground.probability is None else f", P {ground.probability:.2f}"
    where = f", by look {ground.observation_id}" if ground.observation_id >= 0 else ""
    return f"{ground.atom} {believed}{expected}{probability}{where}"


def _said(result: SkillResult) -> str:
    sense = f", {result.sense}" if result.sense else ""
    reason = f" ({result.reason})" if result.reason else ""
    saved = result.planned_seconds - result.seconds
    early = f", {saved:.1f} s before its planned end" if saved >= 0.05 else ""
    return f"{result.status}{sense}{reason}, after {result.seconds:.1f} s{early}"


def _plan(event: Event) -> str:
    plan = event.payload
    assert isinstance(plan, Plan)
    steps = ", ".join(map(spoken, plan.steps)) or "nothing is left to do"
    count = len(plan.steps)
    return f"The plan: {count} step{'s' * (count != 1)}{f', found by {plan.planner}' if plan.planner else ''}: {steps}."


def _dispatched(event: Event) -> str:
    order = event.payload
    assert isinstance(order, Dispatched)
    again = f", for the {_ordinal(order.attempt)} time" if order.attempt > 1 else ""
    return f"Action {order.action}: {spoken(order.step)}{again}."


def _moved(event: Event) -> str:
    moved = event.payload
    assert isinstance(moved, Moved)
    if moved.seconds <= 0.0:
        return f"The move {moved.move!r} would have shown nothing new."
    reason = f" ({moved.reason})" if moved.reason else ""
    return f"The arm was brought out of the way by {moved.move!r}: {moved.status}{reason}, {moved.seconds:.1f} s."


def _guarded(event: Event) -> str:
    guarded = event.payload
    assert isinstance(guarded, Guarded)
    told = {True: "is still so", False: "is seen no longer", None: "cannot be told"}[guarded.held]
    lost = ": the skill was told" if guarded.lost else ""
    return f"At {event.time:.1f} s, {guarded.atom} {told} (look {guarded.observation_id}){lost}."


def _fault(event: Event) -> str:
    fault = event.payload
    assert isinstance(fault, FaultInjected)
    return f"At {event.time:.1f} s the fault {fault.spec} struck: {fault.detail or fault.kind}."


def _result(event: Event) -> str:
    result = event.payload
    assert isinstance(result, SkillResult)
    return f"The skill said: {_said(result)}."


def _no_plan(event: Event) -> str:
    answer = event.payload
    assert isinstance(answer, NoPlan)
    return f"There was no plan: {answer.reason}{f', {answer.detail}' if answer.detail else ''}."


def _blinded(event: Event) -> str:
    blinded = event.payload
    assert isinstance(blinded, Blinded)
    return f"Camera {blinded.camera} was left out of look {blinded.observation_id}: {blinded.reason}."


def _questions(event: Event) -> str:
    questions = event.payload
    assert isinstance(questions, Questions)
    return f"There was a question for each of {len(questions.text)} atoms, worded by {questions.translator}."


def _ended(event: Event) -> str:
    ended = event.payload
    assert isinstance(ended, Ended)
    seen = "The goal was seen to hold." if ended.goal_seen else "The goal was not seen to hold."
    missing = f" Unreached: {', '.join(ended.unreached)}." if ended.unreached else ""
    counts = ((ended.actions, "action"), (ended.replans, "replan"), (ended.looks, "look"))
    told = ", ".join(f"{count} {noun}{'s' * (count != 1)}" for count, noun in counts)
    return f"The end, {ended.outcome}: {told}. {seen}{missing}"


def _resumed(event: Event) -> str:
    resumed = event.payload
    assert isinstance(resumed, Resumed)
    actions = f"{resumed.actions} action{'s' * (resumed.actions != 1)}"
    return f"The process had ended. Another went on after {actions}, in a world as it was in cycle {resumed.restored}."


SENTENCES: Mapping[type, Callable[[Event], str]] = {
    Plan: _plan,
    Dispatched: _dispatched,
    Moved: _moved,
    Guarded: _guarded,
    FaultInjected: _fault,
    SkillResult: _result,
    NoPlan: _no_plan,
    Blinded: _blinded,
    Questions: _questions,
    Resumed: _resumed,
    Ended: _ended,
}


def truth(value: bool) -> str:
    return "true" if value else "false"


def cycles(count: int) -> str:
    return f"{count} cycle{'s' * (count != 1)}"


def _ordinal(number: int) -> str:
    last = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{last}"


def listed(things: Sequence[object]) -> str:
    names = [str(thing) for thing in things[:MOST]]
    if len(things) > MOST:
        return f"{', '.join(names)} and {len(things) - MOST} more"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else "nothing"
