"""Expectations of the world, and their comparison with what is seen. Pure.

A look enters here as the facts that its belief's thresholds derive (`Belief.facts`): what they do not mention is
unknown, and so is what follows from it (Kleene's three values). A plan still stands when its remaining steps, carried
forward from what is believed, can all be done and end where the goal holds, however that came about; PLANEX asked the
same of its triangle tables (Fikes, Hart and Nilsson 1972).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from executive.types import Atom, Condition, DerivedRules, Facts, Step, Verdict

NO_RULES = DerivedRules()


def compare(expected: Facts, seen: Mapping[Atom, bool]) -> Verdict:
    """Compare an expectation with what was seen: each of its atoms holds, is violated, or is unknown."""
    told = {atom: seen[atom] is value for atom, value in expected.items() if atom in seen}
    holds = frozenset(atom for atom, is_so in told.items() if is_so)
    return Verdict(holds, frozenset(told.keys() - holds), frozenset(expected.keys() - told.keys()))


def relevant_facts(step: Step, known: Facts, others: Collection[str] = ()) -> Facts:
    """Return the known facts that a step's outcome may depend on: what it needs and changes, and all other atoms of its
    objects, such as what stands on the table that it puts something on, and those of `others` that play a part."""
    objects, own = frozenset((*step.args, *others)), step.atoms
    return known.only(atom for atom in known if atom in own or not objects.isdisjoint(atom.args))


def progress(facts: Facts, step: Step, rules: DerivedRules = NO_RULES) -> Facts:
    """Return what is expected after `step`, begun where `facts` hold: its effects, and of everything else that it
    stays.

    An effect whose condition is unknown makes what it would change unknown. Derived atoms are never among the facts;
    `rules` say how they follow from them, for conditions that name some.
    """
    changes = step.changes(rules.complete(facts, _asked(step)) if rules else facts)
    open_ = [atom for atom, value in changes.items() if value is None]
    changed = facts | {atom: value for atom, value in changes.items() if value is not None}
    return changed.without(open_) if open_ else changed


def reaches(steps: Sequence[Step], state: Facts, goal: Condition, rules: DerivedRules = NO_RULES) -> bool:
    """Return whether all of `steps` can be carried out in order from `state`, and `goal` holds afterwards. What `state`
    does not mention is unknown, and no step begins where it is unknown whether it can."""
    kept, reached = _executed(steps, range(len(steps)), _relevant(steps, state, goal, rules), goal, rules)
    return reached and len(kept) == len(steps)


def remaining(
    steps: Sequence[Step], state: Facts, goal: Condition, rules: DerivedRules = NO_RULES
) -> tuple[int, ...] | None:
    """Return which of `steps` (positions, in order) are still to be done to get from the complete `state` to `goal`.

    Left out are steps that cannot be done or that nothing needs any more: first those before the earliest position
    from which the plan goes through, then one by one (greedy action elimination, Nakhost and Mueller 2010). None when
    what is left does not reach the goal: then a new plan is called for.
    """
    here = _relevant(steps, state, goal, rules)
    for start in range(len(steps) + 1):
        kept, reached = _executed(steps, range(start, len(steps)), here, goal, rules)
        if reached:
            break
    else:
        return None
    position = 0
    while position < len(kept):
        fewer, reached = _executed(steps, kept[position + 1 :], here, goal, rules)
        if reached:
            kept = kept[:position] + fewer
        else:
            _carry_out(steps[kept[position]], here, rules)
            position += 1
    return kept


class RemainingPlan(NamedTuple):
    """The rest of a plan: the positions that are still to be done (None: it no longer reaches the goal), the atoms that
    this depends on, and whether it would reach the goal after one more try of the step before."""

    rest: tuple[int, ...] | None
    needed: frozenset[Atom]
    repeatable: bool


def remaining_plan(
    step: Step,
    left: Sequence[Step],
    state: Facts,
    goal: Condition,
    surprised: bool,
    rules: DerivedRules = NO_RULES,
    seen: Mapping[Atom, bool] = Facts(),
) -> RemainingPlan:
    """Return what is left of the plan after `step`, with the steps `left`, from the complete `state`.

    Only a surprise is taken as an occasion to leave out steps; a plan that goes as expected is followed as it is. Where
    a disjunction leaves open which atoms the rest hangs on, those that are `seen` are taken.
    """
    rest: tuple[int, ...] | None = tuple(range(len(left)))
    if surprised or not reaches(left, state, goal, rules):
        rest = remaining(left, state, goal, rules)
    following = left if rest is None else [left[position] for position in rest]
    needed, open_ = _read(following, goal, rules)
    open_ -= seen.keys()
    if rest is not None:
        open_ = _decisive(following, state, goal, rules, sorted(open_))
    return RemainingPlan(rest, frozenset(needed | open_), reaches((step, *left), state, goal, rules))


_MOST_TRIED = 32
"""Atoms up to which it is tried for each whether a plan hangs on it."""


def _read(steps: Sequence[Step], goal: Condition, rules: DerivedRules) -> tuple[set[Atom], set[Atom]]:
    """Return the atoms whose values from before `steps` matter to them and to the goal after them: those that a literal
    asks for, and those that only a disjunction, a derived atom or an effect's condition does."""
    needed, open_, written = set[Atom](), set[Atom](), set[Atom]()

    def read(condition: Condition, is_effect: bool = False) -> None:
        plain = set() if is_effect else condition.facts.keys() - rules.rules.keys()
        needed.update(plain - written)
        open_.update(set(rules.support(condition.atoms - plain)) - written)

    for step in steps:
        read(step.precondition)
        for effect in step.effects:
            read(effect.condition, is_effect=True)
        written.update(step.unconditional)
    read(goal)
    return needed, open_ - needed


def _decisive(
    steps: Sequence[Step], state: Facts, goal: Condition, rules: DerivedRules, atoms: Sequence[Atom]
) -> set[Atom]:
    """Return those of the atoms without which it would be unknown whether the steps reach the goal."""
    if not atoms or reaches(steps, state.without(atoms), goal, rules):
        return set()
    dropped: list[Atom] = []
    for atom in atoms if len(atoms) <= _MOST_TRIED else ():
        if reaches(steps, state.without([*dropped, atom]), goal, rules):
            dropped.append(atom)
    return set(atoms).difference(dropped)


def _relevant(
    steps: Sequence[Step], state: Mapping[Atom, bool], goal: Condition, rules: DerivedRules
) -> dict[Atom, bool]:
    """What the state says of the atoms that the steps and the goal are about, or that derived ones of them hang on."""
    atoms = rules.support(goal.atoms.union(*(step.atoms for step in steps)))
    return {atom: value for atom in atoms if (value := state.get(atom)) is not None}


def _executed(
    steps: Sequence[Step], positions: Iterable[int], state: Mapping[Atom, bool], goal: Condition, rules: DerivedRules
) -> tuple[tuple[int, ...], bool]:
    """The positions whose steps can be done in turn, and whether the goal holds after them."""
    current = dict(state)
    done = tuple(position for position in positions if _carry_out(steps[position], current, rules))
    return done, goal.truth(rules.complete(current, goal.atoms)) is True


def _carry_out(step: Step, state: dict[Atom, bool], rules: DerivedRules) -> bool:
    """Return whether the step can be done in the state, which becomes the one after it."""
    known = rules.complete(state, _asked(step)) if rules else state
    if not step.precondition.truth(known):
        return False
    for atom, value in step.changes(known).items():
        if value is None:
            state.pop(atom, None)
        else:
            state[atom] = value
    return True


def _asked(step: Step) -> frozenset[Atom]:
    """Return the atoms that the step's precondition and the conditions of its effects name."""
    return step.precondition.atoms.union(*(effect.condition.atoms for effect in step.effects))
