"""A task in the format that Fast Downward's search reads (version 3 of its translator's), and one way to make it.

What costs time in asking a planner is not the search: it is reading PDDL, grounding it and starting interpreters. So a
task is grounded once, and a state and a goal become a few lines of a file: a variable with two values for each atom, so
that every state and every goal can be written down, and an operator for each grounded action that can change something
(the search refuses operators without effects). Which invariants there are need not be known.

`GroundedTask` grounds every action over all objects that fit its types, in this process: for a small task that takes
less time than to start another. Larger tasks are left to Fast Downward's translator (`executive.planning.translation`).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

from executive.domain.pddl import Schema
from executive.types import ALWAYS, Atom, Condition, Facts, Step

Stop: TypeAlias = "Callable[[], bool]"

MOST_ALTERNATIVES = 64
"""Conjunctions that a condition may be the disjunction of, to be written down in this process."""

_FRACTION = 1_000


def size(schema: Schema) -> int:
    """How many grounded actions a task may have at most."""
    actions = schema.actions.values()
    return sum(schema.grounding.count(action.parameters, action.precondition) for action in actions)


def scale(costs: Iterable[float]) -> int:
    """What costs are multiplied by for the search, which counts them in whole numbers: in thousandths where one is not
    whole."""
    return 1 if all(cost == int(cost) for cost in costs) else _FRACTION


class SasTask:
    """What is the same in every question about a task: its variables, whether actions have costs, and whether there are
    conditional effects or axioms.

    `number` has the variable of each atom, which is 0 where the atom is true and 1 where it is false; `derived` are the
    atoms that axioms compute.
    """

    def __init__(self) -> None:
        self.number: dict[Atom, int] = {}
        self.derived: frozenset[Atom] = frozenset()
        self.variables: list[str] = []
        self.highest_layer = -1
        self.costs = False
        self.scale = 1
        self.conditional = False
        self.axioms = False

    def __len__(self) -> int:
        """How many grounded actions there are."""
        raise NotImplementedError

    def relevant(
        self, true: frozenset[Atom], goal: Condition, avoid: Collection[Step] = frozenset()
    ) -> tuple[list[str], list[str]]:
        """The operators, without the actions in `avoid`, and the axioms' rules that can matter on the way to a goal
        from a state in which exactly the atoms in `true` are true."""
        raise NotImplementedError

    def step(self, name: str) -> Step:
        """The step of an operator by its name in the file."""
        raise NotImplementedError

    def text(
        self, true: frozenset[Atom], goal: Condition, order: Sequence[Atom], avoid: Collection[Step] = frozenset()
    ) -> str | None:
        """The file for the search from the state in which exactly the atoms in `true` are true, without the actions in
        `avoid`. The goal's literals are in the order of `order`. None where the goal needs an atom that can never be
        true."""
        operators, rules = self.relevant(true, goal, avoid)
        variables = list(self.variables)
        state = ["1"] * len(variables)
        for atom in true:
            if atom in self.number and atom not in self.derived:
                state[self.number[atom]] = "0"
        goals: list[str] = []
        for atom in order:
            if atom in self.number:
                goals.append(f"{self.number[atom]} {0 if goal.facts[atom] else 1}")
            elif goal.facts[atom]:
                return None
        for choice in goal.choices:  # the search takes a conjunction of literals: an axiom says when it holds
            number, possible = len(variables), False
            variables.append(_variable(number, self.highest_layer + 1))
            state.append("1")
            goals.append(f"{number} 0")
            for part in choice:
                for needs in alternatives(part, math.inf):
                    if all(atom in self.number or not value for atom, value in needs.items()):
                        rules.append(_rule(number, [(self.number[a], v) for a, v in needs.items() if a in self.number]))
                        possible = True
            if not possible:
                return None
        return "\n".join(
            [
                f"begin_version\n3\nend_version\nbegin_metric\n{int(self.costs)}\nend_metric",
                str(len(variables)),
                *variables,
                "0",
                "\n".join(["begin_state", *state, "end_state"]),
                "\n".join(["begin_goal", str(len(goals)), *goals, "end_goal"]),
                str(len(operators)),
                *operators,
                str(len(rules)),
                *rules,
                "",
            ]
        )


class GroundedTask(SasTask):
    """All grounded actions of a task that can change something, worked out in this process. They take time: `ground`
    has to be called until it is done with them. The task has no derived atoms."""

    def __init__(self, schema: Schema) -> None:
        super().__init__()
        self._steps: list[Step] = []
        self._written: list[tuple[Step, str]] = []
        self._fixed: list[tuple[tuple[Atom, bool], ...]] = []
        self._makes: dict[Atom, set[bool]] = {}
        self.number = {atom: number for number, atom in enumerate(schema.task.atoms)}
        self.variables = [_variable(number) for number in self.number.values()]
        self._work = self._grounding(schema)

    def __len__(self) -> int:
        return len(self._steps)

    def ground(self, stop: Stop) -> bool:
        """Go on with the grounding until it is done or is to `stop`, which is asked after each action; whether it is
        done. Not to be called from two threads at once.

        Raises:
            TooManyAlternativesError: a condition cannot be written down here.
        """
        return not any(stop() for _ in self._work)

    def _grounding(self, schema: Schema) -> Iterator[None]:
        for name in schema.actions:
            for args in schema.arguments(name):
                with contextlib.suppress(ValueError):  # this one contradicts itself
                    step = schema.ground(name, args)
                    if any(not step.precondition.facts.entails(effect.facts) for effect in step.effects):
                        self._steps.append(step)
                yield
        self.costs = schema.has_costs
        self.conditional = any(effect.condition != ALWAYS for step in self._steps for effect in step.effects)
        self.scale = scale(step.cost for step in self._steps)
        for number, step in enumerate(self._steps):
            for text in self._operators(number, step):
                self._written.append((step, text))
            for effect in step.effects:
                for atom, value in effect.facts.items():
                    self._makes.setdefault(atom, set()).add(value)
            yield
        for step, _ in self._written:
            fixed = ((atom, value) for atom, value in step.precondition.facts.items() if atom not in self._makes)
            self._fixed.append(tuple(fixed))
            yield

    def relevant(
        self, true: frozenset[Atom], goal: Condition, avoid: Collection[Step] = frozenset()
    ) -> tuple[list[str], list[str]]:
        # What no action changes is as it is: an action that needs it otherwise can never be carried out, and one that
        # would make it so changes nothing.
        lasting = {atom for atom, values in self._makes.items() if values == {atom in true}}
        operators = [
            text
            for (step, text), fixed in zip(self._written, self._fixed, strict=True)
            if all((atom in true) is value for atom, value in fixed)
            and not (lasting and lasting.issuperset(step.affects))
            and not (avoid and step in avoid)
        ]
        return operators, []

    def step(self, name: str) -> Step:
        return self._steps[int(name[1:])]

    def _operators(self, number: int, step: Step) -> Iterator[str]:
        """An operator for each way in which the precondition can hold."""
        effects, cost = list(_effects(step)), round(step.cost * self.scale)
        for alternative in alternatives(step.precondition):
            needs = {self.number[atom]: 0 if value else 1 for atom, value in alternative.items()}
            changed = []
            changing = set()
            for condition, atom, value in effects:
                variable, after = self.number[atom], 0 if value else 1
                if needs.get(variable) == after or any(alternative.get(a, v) is not v for a, v in condition.items()):
                    continue
                left = [f"{self.number[a]} {0 if v else 1}" for a, v in condition.items() if a not in alternative]
                changed.append(" ".join([str(len(left)), *left, f"{variable} {needs.get(variable, -1)} {after}"]))
                changing.add(variable)
            if changed:
                kept = [f"{variable} {value}" for variable, value in needs.items() if variable not in changing]
                lines = ["begin_operator", f"s{number}", str(len(kept)), *kept, str(len(changed)), *changed, str(cost)]
                yield "\n".join([*lines, "end_operator"])


class TooManyAlternativesError(Exception):
    """A condition is the disjunction of too many conjunctions to be written out."""


def alternatives(condition: Condition, most: float = MOST_ALTERNATIVES) -> list[Facts]:
    """The conjunctions of literals that a condition is the disjunction of.

    Raises:
        TooManyAlternativesError: there are more than `most`.
    """
    found: list[Mapping[Atom, bool]] = [condition.facts]
    for choice in condition.choices:
        parts = [inner for part in choice for inner in alternatives(part, most)]
        found = [
            {**before, **inner}
            for before in found
            for inner in parts
            if all(before.get(atom, value) is value for atom, value in inner.items())
        ]
        if len(found) > most:
            raise TooManyAlternativesError(str(condition))
    return [facts if isinstance(facts, Facts) else Facts(facts) for facts in found]


def _effects(step: Step) -> Iterator[tuple[Facts, Atom, bool]]:
    """Each effect on an atom with a conjunction of literals under which it comes about: an atom both deleted and added
    is true afterwards."""
    if len(step.effects) == 1 and step.effects[0].condition == ALWAYS:
        for atom, value in step.effects[0].facts.items():
            yield ALWAYS.facts, atom, value
        return
    adding: dict[Atom, list[Condition]] = {}
    for effect in step.effects:
        for atom in effect.facts.true:
            adding.setdefault(atom, []).append(effect.condition)
    for effect in step.effects:
        for atom, value in effect.facts.items():
            others = () if value else (~condition for condition in adding.get(atom, ()))
            for needs in alternatives(Condition.all_of((effect.condition, *others))):
                yield needs, atom, value


def _variable(number: int, layer: int = -1) -> str:
    return f"begin_variable\nv{number}\n{layer}\n2\nAtom a{number}()\nNegatedAtom a{number}()\nend_variable"


def _rule(number: int, needs: Iterable[tuple[int, bool]]) -> str:
    lines = [f"{variable} {0 if value else 1}" for variable, value in needs]
    return "\n".join(["begin_rule", str(len(lines)), *lines, f"{number} 1 0", "end_rule"])
