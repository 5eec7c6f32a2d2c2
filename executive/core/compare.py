"""Expectations of the world, and their comparison with what is seen. Pure.

A look enters here as the facts that its belief's thresholds derive (`Belief.facts`): what they do not mention is
unknown. A plan is judged by regression, as PLANEX did with its triangle tables (Fikes, Hart and Nilsson 1972): it
still stands when what is believed entails what its remaining steps and the goal ask for, however that came about.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from executive.types import Atom, Facts, Step, Verdict


def compare(expected: Facts, seen: Facts) -> Verdict:
    """Compare an expectation with what was seen: each of its atoms holds, is violated, or is unknown."""
    told = {atom: seen[atom] is value for atom, value in expected.items() if atom in seen}
    holds = frozenset(atom for atom, is_so in told.items() if is_so)
    return Verdict(holds, frozenset(told.keys() - holds), frozenset(expected.keys() - told.keys()))


def bearing(step: Step, known: Facts) -> Facts:
    """What is known that bears on how a step comes out: what it needs and changes, and whatever else is said of the
    objects that it is about, such as what stands on the table that it puts something on."""
    objects = frozenset(step.args)
    own = step.preconditions.keys() | step.effects.keys()
    return known.only(atom for atom in known if atom in own or not objects.isdisjoint(atom.args))


def progress(facts: Facts, step: Step) -> Facts:
    """What is expected after `step`, begun where `facts` hold: its effects, and of everything else that it stays."""
    return facts | step.effects


def regress(steps: Sequence[Step], goal: Facts) -> Facts | None:
    """The least that has to hold for `steps`, carried out in order, to run and to end where `goal` holds.

    None when nothing can: a step undoes what is needed after it, or asks for the opposite of it.
    """
    needed: dict[Atom, bool] = dict(goal)
    for step in reversed(steps):
        for atom, value in step.effects.items():
            if needed.pop(atom, value) is not value:
                return None
        for atom, value in step.preconditions.items():
            if needed.setdefault(atom, value) is not value:
                return None
    return Facts(needed)


def remaining(steps: Sequence[Step], state: Facts, goal: Facts) -> tuple[int, ...] | None:
    """Which of `steps` (positions, in order) are still to be done to get from the complete `state` to `goal`.

    Left out are steps that cannot be done or that nothing needs any more: first those before the earliest position
    from which the plan goes through, then one by one (greedy action elimination, Nakhost and Mueller 2010). None when
    what is left does not reach the goal: then a new plan is called for.
    """
    for start in range(len(steps) + 1):
        kept, reached = _executed(steps, range(start, len(steps)), state, goal)
        if reached:
            break
    else:
        return None
    position = 0
    while position < len(kept):
        fewer, reached = _executed(steps, kept[:position] + kept[position + 1 :], state, goal)
        if reached:
            kept = fewer
        else:
            position += 1
    return kept


class Outlook(NamedTuple):
    """What becomes of the rest of a plan: the positions that are still to be done (None: it does not reach the goal any
    more), the atoms that this hangs on, and whether it would reach the goal after one more try of the step before."""

    rest: tuple[int, ...] | None
    needed: frozenset[Atom]
    repeatable: bool


def outlook(step: Step, left: Sequence[Step], state: Facts, goal: Facts, surprised: bool) -> Outlook:
    """The outlook after `step`, with the steps `left`, from the complete `state`.

    Only a surprise is taken as an occasion to leave out steps; a plan that goes as expected is followed as it is.
    """
    needed, once_more = regress(left, goal), regress((step, *left), goal)
    rest: tuple[int, ...] | None = tuple(range(len(left)))
    if surprised or needed is None or not state.entails(needed):
        rest = remaining(left, state, goal)
        needed = needed if rest is None else regress([left[position] for position in rest], goal)
    return Outlook(rest, frozenset(needed or ()), once_more is not None and state.entails(once_more))


def _executed(
    steps: Sequence[Step], positions: Iterable[int], state: Mapping[Atom, bool], goal: Facts
) -> tuple[tuple[int, ...], bool]:
    """The positions whose steps can be done in turn, and whether the goal holds after them."""
    truth, done = dict(state), []
    for position in positions:
        step = steps[position]
        if all(truth.get(atom) is value for atom, value in step.preconditions.items()):
            truth.update(step.effects)
            done.append(position)
    return tuple(done), all(truth.get(atom) is value for atom, value in goal.items())
