"""Operators and axioms in the format of Fast Downward's search, and what of them can matter in a state.

A fact is a number: twice that of a variable, and one more where the variable has the value 1. All variables have two
values.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import compress


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator: the facts that it needs, and those that it brings about, whatever else holds or under conditions,
    which are facts again."""

    name: str
    needs: tuple[int, ...]
    gives: tuple[int, ...]
    conditional: tuple[tuple[tuple[int, ...], int], ...]
    cost: int
    text: str

    @classmethod
    def read(cls, text: str, facts: Sequence[int]) -> Operator:
        """Read what the translator wrote. `facts` are all numbers of facts, to be shared between operators."""
        lines = text.split("\n")
        kept = int(lines[2])
        needs, gives, conditional = [], [], []
        for line in lines[3 : 3 + kept]:
            variable, value = line.split()
            needs.append(facts[2 * int(variable) + int(value)])
        for line in lines[4 + kept : -2]:
            count, *parts = map(int, line.split())
            variable_, before, after = parts[-3:]
            if before >= 0 and facts[2 * variable_ + before] not in needs:
                needs.append(facts[2 * variable_ + before])
            if count:
                pairs = zip(parts[: 2 * count : 2], parts[1 : 2 * count : 2], strict=True)
                conditional.append((tuple(facts[2 * v + value_] for v, value_ in pairs), facts[2 * variable_ + after]))
            else:
                gives.append(facts[2 * variable_ + after])
        return cls(lines[1].rstrip(), tuple(needs), tuple(gives), tuple(conditional), int(lines[-2]), text)

    def costing(self, cost: int) -> Operator:
        """The operator with a cost."""
        before = self.text.rsplit("\n", 2)[0]
        text = f"{before}\n{cost}\nend_operator"
        return Operator(self.name, self.needs, self.gives, self.conditional, cost, text)

    def changes(self) -> Iterable[int]:
        """The variables that it changes."""
        yield from (fact >> 1 for fact in self.gives)
        yield from (fact >> 1 for _, fact in self.conditional)

    def simplified(self, reached: bytearray) -> Operator | None:
        """The operator where only these facts are ever so: without conditions that always hold and effects that never
        come about. None where it cannot be carried out or changes nothing."""
        if not all(reached[fact] for fact in self.needs):
            return None
        needs = tuple(fact for fact in self.needs if reached[fact ^ 1])
        gives = tuple(fact for fact in self.gives if reached[fact ^ 1])
        conditional = []
        for conditions, fact in self.conditional:
            if reached[fact ^ 1] and all(reached[each] for each in conditions):
                conditional.append((tuple(each for each in conditions if reached[each ^ 1]), fact))
        if (needs, gives, tuple(conditional)) == (self.needs, self.gives, self.conditional):
            return self
        return self._with(needs, gives, tuple(conditional)) if gives or conditional else None

    def on(self, variables: set[int]) -> Operator:
        """The operator without what it does to other variables than these."""
        gives = tuple(fact for fact in self.gives if fact >> 1 in variables)
        conditional = tuple(each for each in self.conditional if each[1] >> 1 in variables)
        return self._with(self.needs, gives, conditional)

    def _with(
        self, needs: tuple[int, ...], gives: tuple[int, ...], conditional: tuple[tuple[tuple[int, ...], int], ...]
    ) -> Operator:
        before = {fact >> 1: fact & 1 for fact in needs}
        effects = [f"0 {fact >> 1} {before.get(fact >> 1, -1)} {fact & 1}" for fact in gives]
        for conditions, fact in conditional:
            parts = [f"{each >> 1} {each & 1}" for each in conditions]
            change = f"{fact >> 1} {before.get(fact >> 1, -1)} {fact & 1}"
            effects.append(" ".join([str(len(conditions)), *parts, change]))
        changed = {fact >> 1 for fact in gives}.union(fact >> 1 for _, fact in conditional)
        kept = [f"{variable} {value}" for variable, value in before.items() if variable not in changed]
        lines = ["begin_operator", self.name, str(len(kept)), *kept, str(len(effects)), *effects, str(self.cost)]
        return Operator(self.name, needs, gives, conditional, self.cost, "\n".join([*lines, "end_operator"]))


@dataclass(frozen=True, slots=True)
class Rule:
    """An axiom: the facts under which it makes a derived variable true."""

    needs: tuple[int, ...]
    variable: int
    text: str

    @classmethod
    def read(cls, text: str) -> Rule:
        """Read what the translator wrote."""
        *conditions, head = (line.split() for line in text.split("\n")[2:-1])
        return cls(tuple(2 * int(variable) + int(value) for variable, value in conditions), int(head[0]), text)

    def simplified(self, reached: bytearray) -> Rule | None:
        """The rule without conditions that always hold; None where it never comes about."""
        if not all(reached[fact] for fact in self.needs):
            return None
        needs = tuple(fact for fact in self.needs if reached[fact ^ 1])
        return self if needs == self.needs else Rule(needs, self.variable, rule_text(self.variable, needs))


def rule_text(variable: int, needs: Iterable[int]) -> str:
    """A rule that makes a derived variable true where these facts hold."""
    lines = [f"{fact >> 1} {fact & 1}" for fact in needs]
    return "\n".join(["begin_rule", str(len(lines)), *lines, f"{variable} 1 0", "end_rule"])


class Reachability:
    """Which facts can be brought about from a state, if what was so once stays so."""

    def __init__(self, count: int, operators: Sequence[Operator], rules: Sequence[Rule]) -> None:
        """`count` is the number of variables."""
        self._count = count
        self._bodies: list[tuple[int, ...]] = []
        self._heads: list[tuple[int, ...]] = []
        for operator in operators:
            if operator.gives:
                self._add(operator.needs, operator.gives)
            for conditions, fact in operator.conditional:
                self._add((*operator.needs, *conditions), (fact,))
        for rule in rules:
            self._add(rule.needs, (2 * rule.variable,))
        given = {fact for heads in self._heads for fact in heads}
        self._lasting = bytearray(fact ^ 1 not in given for fact in range(2 * count))
        self._users: list[list[int]] | None = None

    def _add(self, body: tuple[int, ...], heads: tuple[int, ...]) -> None:
        self._bodies.append(body)
        self._heads.append(heads)

    def open(self, state: Sequence[int]) -> bool:
        """Whether every variable can change from a state, at least at first sight."""
        return not any(compress(self._lasting, self._facts(state)))

    def reached(self, state: Sequence[int]) -> bytearray:
        """Whether each fact can be brought about from a state, the values of all variables."""
        if self._users is None:
            self._users = [[] for _ in range(2 * self._count)]
            for number, body in enumerate(self._bodies):
                for fact in set(body):
                    self._users[fact].append(number)
        missing = [len(set(body)) for body in self._bodies]
        reached = self._facts(state)
        waiting = list(compress(range(2 * self._count), reached))
        for number, count in enumerate(missing):
            for fact in self._heads[number] if not count else ():
                if not reached[fact]:
                    reached[fact] = True
                    waiting.append(fact)
        while waiting:
            for number in self._users[waiting.pop()]:
                missing[number] -= 1
                if not missing[number]:
                    for fact in self._heads[number]:
                        if not reached[fact]:
                            reached[fact] = True
                            waiting.append(fact)
        return reached

    def _facts(self, state: Sequence[int]) -> bytearray:
        facts = bytearray(2 * self._count)
        for variable, value in enumerate(state):
            facts[2 * variable + value] = True
        return facts


def relevant(
    goal: Iterable[int], operators: Sequence[Operator], rules: Sequence[Rule]
) -> tuple[list[Operator], list[Rule]]:
    """What of operators and rules can matter for variables of a goal: what changes one of them, or one that must be so
    for that, and so on."""
    needs: dict[int, set[int]] = {}
    for operator in operators:
        own = {fact >> 1 for fact in operator.needs}
        for fact in operator.gives:
            needs.setdefault(fact >> 1, set()).update(own)
        for conditions, fact in operator.conditional:
            needs.setdefault(fact >> 1, set()).update(own, (each >> 1 for each in conditions))
    for rule in rules:
        needs.setdefault(rule.variable, set()).update(fact >> 1 for fact in rule.needs)
    matter = set(goal)
    waiting = list(matter)
    while waiting:
        found = needs.get(waiting.pop(), set()) - matter
        matter |= found
        waiting += found
    if needs.keys() <= matter:
        return list(operators), list(rules)
    kept = []
    for operator in operators:
        changed = set(operator.changes())
        if not changed.isdisjoint(matter):
            kept.append(operator if changed <= matter else operator.on(matter))
    return kept, [rule for rule in rules if rule.variable in matter]
