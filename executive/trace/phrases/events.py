"""What happens: a phrase for each event, and for what was believed of an atom."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from executive.trace.phrases.reasons import why
from executive.trace.phrases.words import counts, plural, probability, step, truth
from executive.types import (
    COMPILE,
    Blinded,
    Contradiction,
    Decision,
    Dispatched,
    Ended,
    FaultInjected,
    Ground,
    Guarded,
    LookCause,
    LookKind,
    Moved,
    NoPlan,
    Overruled,
    Phase,
    PictureFault,
    Plan,
    Questions,
    Resumed,
    SkillResult,
    Started,
    Step,
)


def started(run: Started) -> str:
    who = "nobody looks" if run.is_blind else f"estimator {run.estimator}"
    return f"{run.domain}: {run.task.problem}, seed {run.seed}, {who}"


def questions(asked: Questions) -> str:
    warnings, more = asked.warnings, len(asked.warnings) - 1
    warned = f": {warnings[0]}{f' (and {more} more)' if more else ''}" if warnings else ""
    return f"questions for {plural(len(asked.text), 'atom')}, worded by {asked.translator}{warned}"


_LOOKS: Mapping[LookKind, str] = {
    LookKind.FULL: "all {atoms} atoms",
    LookKind.FOCUSED: "{questions} of {atoms} atoms",
    LookKind.CLOSER: "{questions} of {atoms} atoms, closer,",
    LookKind.MOVED: "{questions} of {atoms} atoms, with the arm out of the way,",
    LookKind.GUARD: "whether what is carried is still there",
}


_CAUSES: Mapping[str, str] = {
    LookCause.FIRST: "first look",
    LookCause.NO_PLAN: "there is no plan",
    LookCause.BEFORE: "before {about}",
    LookCause.AFTER: "after {about}",
    LookCause.GOAL: "is the goal reached?",
    LookCause.GLANCE: "is {about} so?",
}


def look_cause(cause: str) -> str:
    """Why a look is taken. Records from before there were codes have it in words."""
    code, _, about = cause.partition(" ")
    return _CAUSES[code].format(about=about) if code in _CAUSES else cause


def look(
    number: int,
    cause: str,
    kind: LookKind | None = None,
    questions: int = 0,
    atoms: int = 0,
    cameras: Iterable[str] = (),
) -> str:
    """A look, why it is taken and, once that is known, what it asks about and through which cameras."""
    head = f"look {number} ({look_cause(cause)})" if cause else f"look {number}"
    if kind is None:
        return f"{head}: {plural(questions, 'atom')}" if questions else head
    through = f" through {', '.join(cameras)}" if cameras else ""
    return f"{head}: {_LOOKS[kind].format(questions=questions, atoms=atoms)}{through}".rstrip(",")


def overruled(wrong: Overruled) -> str:
    believed = "cannot be told" if wrong.believed is None else f"is taken for {truth(wrong.believed)}"
    said = f"the look says that {wrong.atom} is {truth(wrong.answered)} (P {wrong.answer:.2f})"
    return f"{said}; with what else is known it {believed} (P {wrong.probability:.2f})"


def contradiction(clash: Contradiction) -> str:
    """Answers that cannot all be so, and what was made of them."""
    said = " and ".join(f"{atom} ({value:.2f})" for atom, value in clash.answers.items())
    held = [f"{atom} is, {value:.2f}" for atom, value in clash.resolved.items() if value >= 0.5]
    wrong = "all be false" if clash.exact else "all be true"
    return f"answers {said} cannot {wrong}: {', '.join(held) or 'none of them is'}"


_USELESS: Mapping[str, str] = {
    PictureFault.PLAIN: "its picture is all of one colour",
    PictureFault.FROZEN: "its picture is the one before, bit for bit",
}


def blinded(camera: str, cause: str) -> str:
    return f"camera {camera} is left out: {_USELESS.get(cause, cause)}"


def depth_left_out(camera: str, why: str) -> str:
    return f"depth of {camera} is not used: {why}"


def guarded(glance: Guarded) -> str:
    told = {True: "is still so", False: "is seen no longer", None: "cannot be told"}[glance.held]
    lost = ", again: the skill is told" if glance.lost else ""
    return f"guard: {glance.atom} {told} (look {glance.observation_id}){lost}"


def moved(move: Moved) -> str:
    if move.seconds <= 0.0 and not move.reason:
        return f"out of the way, {move.move}: it would show nothing new"
    return (
        f"out of the way, {move.move}: {move.status}{f' ({move.reason})' if move.reason else ''}, {move.seconds:.1f} s"
    )


def phase(some: Phase) -> str:
    return f"compiling {some.detail}" if some.name == COMPILE else some.name


def plan(some: Plan, number: int) -> str:
    steps = ", ".join(map(step, some.steps)) or "nothing is left to do"
    return f"{plan_title(number, len(some.steps))}: {steps}"


def plan_title(number: int, steps: int) -> str:
    return f"plan {number}, {plural(steps, 'step')}"


def no_plan(answer: NoPlan) -> str:
    return f"no plan: {answer.reason}{f', {answer.detail}' if answer.detail else ''}"


def action(number: int | None, some: Step, attempt: int = 1) -> str:
    return f"action {number}: {step(some)}{f', attempt {attempt}' if attempt > 1 else ''}"


def skill(result: SkillResult) -> str:
    """Return what a skill reports, and when."""
    sense = f", {result.sense}" if result.sense else ""
    detail = f" ({result.reason})" if result.reason else ""
    early = result.planned_seconds - result.seconds
    saved = f", {early:.1f} s early" if early >= 0.05 else ""
    return f"{step(result.step)} reports {result.status}{sense}{detail}, after {result.seconds:.1f} s{saved}"


def fault(injected: FaultInjected) -> str:
    return f"fault {injected.spec}: {injected.detail or injected.kind}"


def resumed(another: Resumed) -> str:
    done = plural(another.actions, "action")
    return f"resumed after {done}, with the world as it was in cycle {another.restored}, looking first"


def decided(decision: Decision) -> str:
    outcome = f", {decision.outcome}" if decision.outcome else ""
    return f"{decision.kind}{outcome}: {why(decision)}"


def ended(end: Ended) -> str:
    return f"{end.outcome}: {why(end)}"


def account(end: Ended) -> str:
    """Return what a run came to."""
    seen = f"the goal is{' not' * (not end.goal_seen)} seen to hold"
    missing = f"; unreached: {', '.join(end.unreached)}" if end.unreached else ""
    return f"the end, {end.outcome}: {counts(action=end.actions, replan=end.replans, look=end.looks)}; {seen}{missing}"


def ground(atom: Ground) -> str:
    """Return what was believed of an atom that a decision depended on."""
    assumed = "assumed to be " if atom.observation_id < 0 and atom.probability is None else ""
    believed = "cannot be told" if atom.believed is None else f"is {assumed}{truth(atom.believed)}"
    expected = "" if atom.expected is None else f" (expected {truth(atom.expected)})"
    where = f", by look {atom.observation_id}" if atom.observation_id >= 0 else ""
    return f"{atom.atom} {believed}{expected}{probability(atom.probability)}{where}"


EVENTS: Mapping[type, Callable[[Any], str]] = {
    Started: started,
    Resumed: resumed,
    Questions: questions,
    Phase: phase,
    Contradiction: contradiction,
    Overruled: overruled,
    Blinded: lambda event: blinded(event.camera, event.reason),
    Guarded: guarded,
    Moved: moved,
    NoPlan: no_plan,
    Dispatched: lambda order: action(order.action, order.step, order.attempt),
    SkillResult: skill,
    FaultInjected: fault,
    Decision: decided,
    Ended: ended,
}
"""What happens, by its type; of a plan and a look more has to be known (`plan`, `look`)."""


def event(payload: object) -> str:
    """Return the phrase for what happens."""
    return EVENTS[type(payload)](payload)
