"""The rules by which derived atoms follow from the others: PDDL's axioms, computed as a least fixpoint."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from executive.types.conditions import Condition
from executive.types.facts import Atom


@dataclass(frozen=True)
class DerivedRules:
    """How derived atoms follow from the others (PDDL's axioms). `rules` maps each derived atom to the condition under
    which it is true, which may name derived atoms again; otherwise it is false.

    Raises:
        ValueError: a derived atom depends on its own negation.
    """

    rules: Mapping[Atom, Condition] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        if self.rules:
            _ = self.strata

    def __bool__(self) -> bool:
        return bool(self.rules)

    @cached_property
    def fluents(self) -> frozenset[Atom]:
        """Return the atoms that the rules name and that are not derived."""
        return frozenset[Atom]().union(*(rule.atoms for rule in self.rules.values())) - self.rules.keys()

    @cached_property
    def _users(self) -> Mapping[Atom, tuple[Atom, ...]]:
        """Return the derived atoms whose rules name each derived atom."""
        users: dict[Atom, list[Atom]] = {}
        for atom, rule in self.rules.items():
            for needed in sorted(rule.atoms & self.rules.keys()):
                users.setdefault(needed, []).append(atom)
        return {atom: tuple(found) for atom, found in users.items()}

    @cached_property
    def strata(self) -> tuple[tuple[Atom, ...], ...]:
        """Return the derived atoms in groups, each of which depends on the one before it and on itself, and there on no
        negation."""
        negated = {atom: frozenset(_negated(rule)) for atom, rule in self.rules.items()}
        level, waiting = dict.fromkeys(self.rules, 0), list(self._users)
        while waiting:
            atom = waiting.pop()
            for user in self._users.get(atom, ()):
                if level[user] < (least := level[atom] + (atom in negated[user])):
                    if least >= len(self.rules):
                        raise ValueError(f"{user} depends on its own negation")
                    level[user] = least
                    waiting.append(user)
        groups: dict[int, list[Atom]] = {}
        for atom in sorted(self.rules):
            groups.setdefault(level[atom], []).append(atom)
        return tuple(tuple(groups[number]) for number in sorted(groups))

    def complete(self, state: Mapping[Atom, bool], about: Iterable[Atom] | None = None) -> Mapping[Atom, bool]:
        """The state with the derived atoms that follow from it, true or false; what depends on atoms that the state
        does not mention is left out. With `about`, only those among these, and what they are derived from."""
        if not self.rules:
            return state
        rules = self if about is None else self._part(self.rules.keys() & about)
        if not rules.rules:
            return state
        known = {atom: value for atom in rules.fluents if (value := state.get(atom)) is not None}
        is_whole = len(known) == len(rules.fluents)
        derived: dict[Atom, bool] = {}
        for stratum in rules.strata:
            sure = rules._fixpoint(stratum, known, (True,))
            possible = sure if is_whole else rules._fixpoint(stratum, known, (True, None))
            told = {atom: atom in sure for atom in stratum if atom in sure or atom not in possible}
            known.update(told)
            derived.update(told)
        return {**state, **derived}

    def _part(self, atoms: Set[Atom]) -> DerivedRules:
        """The rules of these derived atoms, and of those that they are derived from."""
        key = frozenset(atoms)
        if key not in self._parts:
            wanted, waiting = set[Atom](), list(key)
            while waiting:
                if (atom := waiting.pop()) not in wanted:
                    wanted.add(atom)
                    waiting += self.rules.keys() & self.rules[atom].atoms
            self._parts[key] = DerivedRules({atom: self.rules[atom] for atom in sorted(wanted)})
        return self._parts[key]

    @cached_property
    def _parts(self) -> dict[frozenset[Atom], DerivedRules]:
        """The parts that were asked for."""
        return {}

    def _fixpoint(
        self, stratum: tuple[Atom, ...], known: Mapping[Atom, bool], wanted: tuple[bool | None, ...]
    ) -> frozenset[Atom]:
        """Return those of a stratum's atoms whose rules come out as `wanted`, from none of them being true on."""
        state = {**known, **dict.fromkeys(stratum, False)}
        found: set[Atom] = set()
        waiting = list(stratum)
        while waiting:
            atom = waiting.pop()
            if atom in state and atom not in found and self.rules[atom].truth(state) in wanted:
                found.add(atom)
                state[atom] = True
                waiting += (user for user in self._users.get(atom, ()) if user in state)
        return frozenset(found)

    def support(self, atoms: Iterable[Atom]) -> tuple[Atom, ...]:
        """These atoms, each once, and in the place of a derived one those that are not derived and that it depends
        on."""
        if not self.rules:
            return tuple(dict.fromkeys(atoms))
        found: dict[Atom, None] = {}
        for atom in atoms:
            below, waiting = dict[Atom, None](), [atom]
            while waiting:
                if (each := waiting.pop()) not in below:
                    below[each] = None
                    waiting += self.rules[each].atoms if each in self.rules else ()
            found.update(dict.fromkeys(sorted(below.keys() - self.rules.keys())))
        return tuple(found)


def _negated(condition: Condition) -> Iterator[Atom]:
    """The atoms that are negated somewhere in a condition."""
    yield from condition.facts.false
    for choice in condition.choices:
        for part in choice:
            yield from _negated(part)
