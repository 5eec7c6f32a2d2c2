"""A task in the format that Fast Downward's search reads (version 3 of its translator's), and one way to make it.

What costs time in asking a planner is not the search: it is reading PDDL, grounding it and starting interpreters. So a
task is grounded once, and a state and a goal become a few lines of a file: a variable with two values for each atom, so
that every state and every goal can be written down, and an operator for each grounded action that can change something
(the search refuses operators without effects). Which invariants there are need not be known.

`GroundedTask` grounds every action over all objects that fit its types, in this process: for a task of literals
that takes less time than to start another. Others are left to Fast Downward's translator
(`executive.planning.translation`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

from executive.domain.pddl import Schema
from executive.planning.operator_templates import Grounded, OperatorTemplates
from executive.planning.sas_operators import rule_text
from executive.types import Atom, Condition, Facts, Step

Stop: TypeAlias = "Callable[[], bool]"

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
    atoms that axioms compute. `others` are variables that are 0 in every state: of atoms that are true and static.
    """

    def __init__(self) -> None:
        self.number: dict[Atom, int] = {}
        self.derived: frozenset[Atom] = frozenset()
        self.variables: list[str] = []
        self.others: frozenset[int] = frozenset()
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
        for number in self.others:
            state[number] = "0"
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
                for needs in alternatives(part):
                    if all(atom in self.number or not value for atom, value in needs.items()):
                        known = [2 * self.number[a] + (not v) for a, v in needs.items() if a in self.number]
                        rules.append(rule_text(number, known))
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
        self._schema = schema
        self._calls: list[tuple[str, tuple[str, ...]]] = []
        self._operators: list[str] = []
        self._fixed: list[tuple[tuple[int, bool], ...]] = []
        self._changes: list[tuple[int, ...]] = []
        self._makes: dict[int, set[bool]] = {}
        self.number = {atom: number for number, atom in enumerate(schema.task.atoms)}
        self.variables = [_variable(number) for number in self.number.values()]
        self._work = self._grounding(OperatorTemplates(schema, self.number))

    def __len__(self) -> int:
        return len(self._calls)

    def ground(self, stop: Stop) -> bool:
        """Go on with the grounding until it is done or is to `stop`, which is asked after each action; whether it is
        done. Not to be called from two threads at once.

        Raises:
            NoLiteralsError: the task has other conditions than conjunctions of literals.
        """
        return not any(stop() for _ in self._work)

    def _grounding(self, templates: OperatorTemplates) -> Iterator[None]:
        found: list[Grounded] = []
        for name in self._schema.actions:
            for each in templates.grounded(name):
                if each is not None:
                    found.append(each)
                    self._calls.append((name, each.args))
                yield
        self.costs = self._schema.has_costs
        self.scale = scale(each.cost for each in found)
        for number, each in enumerate(found):
            self._operators.append(self._operator(number, each))
            self._changes.append(tuple(each.gives))
            for atom, value in each.gives.items():
                self._makes.setdefault(atom, set()).add(value)
            yield
        for each in found:
            self._fixed.append(tuple(need for need in each.needs.items() if need[0] not in self._makes))
            yield

    def relevant(
        self, true: frozenset[Atom], goal: Condition, avoid: Collection[Step] = frozenset()
    ) -> tuple[list[str], list[str]]:
        # What no action changes is as it is: an action that needs it otherwise can never be carried out, and one that
        # would make it so changes nothing.
        so = {self.number[atom] for atom in true if atom in self.number}
        lasting = {atom for atom, values in self._makes.items() if values == {atom in so}}
        left_out = {(step.action, step.args) for step in avoid}
        operators = [
            text
            for call, text, fixed, changes in zip(self._calls, self._operators, self._fixed, self._changes, strict=True)
            if all((atom in so) is value for atom, value in fixed)
            and not (lasting and lasting.issuperset(changes))
            and not (left_out and call in left_out)
        ]
        return operators, []

    def step(self, name: str) -> Step:
        return self._schema.ground(*self._calls[int(name[1:])])

    def _operator(self, number: int, each: Grounded) -> str:
        needs = {atom: 0 if value else 1 for atom, value in each.needs.items()}
        gives = {atom: 0 if value else 1 for atom, value in each.gives.items()}
        kept = [f"{atom} {value}" for atom, value in needs.items() if gives.get(atom, value) == value]
        changed = [
            f"0 {atom} {needs.get(atom, -1)} {value}" for atom, value in gives.items() if needs.get(atom) != value
        ]
        cost = round(each.cost * self.scale)
        lines = ["begin_operator", f"s{number}", str(len(kept)), *kept, str(len(changed)), *changed, str(cost)]
        return "\n".join([*lines, "end_operator"])


def alternatives(condition: Condition) -> list[Facts]:
    """The conjunctions of literals that a condition is the disjunction of."""
    found: list[Mapping[Atom, bool]] = [condition.facts]
    for choice in condition.choices:
        parts = [inner for part in choice for inner in alternatives(part)]
        found = [
            {**before, **inner}
            for before in found
            for inner in parts
            if all(before.get(atom, value) is value for atom, value in inner.items())
        ]
    return [Facts(facts) for facts in found]


def _variable(number: int, layer: int = -1) -> str:
    return f"begin_variable\nv{number}\n{layer}\n2\nAtom a{number}()\nNegatedAtom a{number}()\nend_variable"
