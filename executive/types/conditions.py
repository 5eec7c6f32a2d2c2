"""Conditions: formulas over atoms, with three-valued truth."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from executive.types.facts import Atom, Facts

_TOKEN = re.compile(r"\s*(?:([A-Za-z0-9_][\w\-]*\s*\([^()]*\))|([()])|([A-Za-z0-9_][\w\-]*))")
_NOTHING = Facts()


class Condition:
    """A formula over atoms, immutable and in one canonical form: a conjunction of literals and of disjunctions, whose
    alternatives are conditions again. Negation stands before atoms alone; what is quantified has been written out.

    It prints as `on(a,b) and (clear(c) or not held(a))`, and its truth is three-valued (Kleene).

    Attributes:
        facts: the literals among the conjuncts.
        choices: the disjunctions among the conjuncts, each of two alternatives or more; one of none is never true.
    """

    __slots__ = ("_atoms", "_hash", "choices", "facts")
    facts: Facts
    choices: tuple[tuple[Condition, ...], ...]
    _hash: int | None
    _atoms: frozenset[Atom] | None

    def __init__(self) -> None:
        """The condition that always holds; the others are made by `of`, `all_of`, `any_of` and `parse`."""
        self._set(_NOTHING, ())

    def _set(self, facts: Facts, choices: tuple[tuple[Condition, ...], ...]) -> None:
        for name, value in (("facts", facts), ("choices", choices), ("_hash", None), ("_atoms", None)):
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a condition does not change")

    @classmethod
    def _made(cls, facts: Facts, choices: tuple[tuple[Condition, ...], ...] = ()) -> Condition:
        condition = cls.__new__(cls)
        condition._set(facts, choices)
        return condition

    @classmethod
    def of(cls, facts: Mapping[Atom, bool]) -> Condition:
        """Return the conjunction of these literals."""
        return cls._made(facts if isinstance(facts, Facts) else Facts(facts))

    @classmethod
    def literal(cls, atom: Atom, value: bool = True) -> Condition:
        """The condition that one atom is true, or that it is false."""
        return cls._made(Facts({atom: value}))

    @classmethod
    def all_of(cls, conditions: Iterable[Condition]) -> Condition:
        """Return the conjunction of these conditions."""
        literals: dict[Atom, bool] = {}
        waiting, choices = list(conditions), dict[tuple[Condition, ...], None]()
        while waiting:
            for part in waiting:
                for atom, value in part.facts.items():
                    if literals.setdefault(atom, value) is not value:
                        return NEVER
                choices.update(dict.fromkeys(part.choices))
            # What a literal settles in a disjunction may leave another literal.
            settled = [choice for choice in choices if any(not part.atoms.isdisjoint(literals) for part in choice)]
            waiting = [cls.any_of(part.given(literals) for part in choice) for choice in settled]
            for choice in settled:
                del choices[choice]
        return NEVER if () in choices else cls._made(Facts(literals), tuple(sorted(choices, key=_sorting)))

    @classmethod
    def any_of(cls, conditions: Iterable[Condition]) -> Condition:
        """Return the disjunction of these conditions."""
        alternatives: dict[Condition, None] = {}
        for condition in conditions:
            if condition == ALWAYS:
                return ALWAYS
            inner = condition.choices[0] if not condition.facts and len(condition.choices) == 1 else (condition,)
            alternatives.update(dict.fromkeys(inner))
        signs: dict[Atom, bool] = {}
        for part in alternatives:
            for atom, value in part.facts.items() if len(part.facts) == 1 and not part.choices else ():
                if signs.setdefault(atom, value) is not value:
                    return ALWAYS
        if len(alternatives) == 1:
            return next(iter(alternatives))
        return cls._made(_NOTHING, (tuple(sorted(alternatives, key=str)),))

    @classmethod
    def parse(cls, *conjuncts: str) -> Condition:
        """Return the conjunction of conditions as `str` prints them. A name alone is an atom without arguments.

        Raises:
            ValueError: a text is no condition.
        """
        return cls.all_of(map(_parsed, conjuncts))

    def __invert__(self) -> Condition:
        opposites = [Condition.literal(atom, not value) for atom, value in self.facts.items()]
        opposites += [Condition.all_of(~part for part in choice) for choice in self.choices]
        return Condition.any_of(opposites)

    def __and__(self, other: Condition) -> Condition:
        return Condition.all_of((self, other))

    def __or__(self, other: Condition) -> Condition:
        return Condition.any_of((self, other))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Condition):
            return NotImplemented
        return self is other or (self.choices == other.choices and self.facts == other.facts)

    def __hash__(self) -> int:
        found = self._hash
        if found is None:
            object.__setattr__(self, "_hash", found := hash((self.facts, self.choices)))
        return found

    def __repr__(self) -> str:
        return f"Condition({self})"

    def __str__(self) -> str:
        if not self.choices:
            return " and ".join(self.facts.literals()) or "true"
        return " and ".join(self.texts())

    def __reduce__(self) -> tuple[object, ...]:
        return Condition._made, (self.facts, self.choices)

    def texts(self) -> tuple[str, ...]:
        """Return each conjunct as text, which `parse` reads back."""
        alone = not self.facts and len(self.choices) == 1
        shown = [_disjunction(choice) for choice in self.choices]
        return (
            *self.facts.literals(),
            *(text if alone or not choice else f"({text})" for text, choice in zip(shown, self.choices, strict=True)),
        )

    @property
    def atoms(self) -> frozenset[Atom]:
        """All atoms that occur in it."""
        found = self._atoms
        if found is None:
            inner = (part.atoms for choice in self.choices for part in choice)
            object.__setattr__(self, "_atoms", found := frozenset(self.facts).union(*inner))
        return found

    @property
    def conjuncts(self) -> tuple[Condition, ...]:
        """The parts that have to hold, all of them: none where it always holds, itself where it never does."""
        literals = (Condition.literal(atom, value) for atom, value in self.facts.items())
        return (*literals, *(Condition._made(_NOTHING, (choice,)) for choice in self.choices))

    @property
    def literals(self) -> Facts | None:
        """The literals that it is the conjunction of; None where it is more than that."""
        return None if self.choices else self.facts

    def only(self, conjuncts: Iterable[Condition]) -> Condition:
        """The conjunction of those of its conjuncts that are among these."""
        kept = frozenset(conjuncts)
        return Condition.all_of(part for part in self.conjuncts if part in kept)

    def without(self, conjuncts: Iterable[Condition]) -> Condition:
        """Return the conjunction of those of its conjuncts that are not among these."""
        dropped = frozenset(conjuncts)
        return Condition.all_of(part for part in self.conjuncts if part not in dropped)

    def truth(self, state: Mapping[Atom, bool]) -> bool | None:
        """Return whether it holds in a state; None where that depends on atoms which the state does not mention."""
        result: bool | None = True
        for atom, value in self.facts.items():
            known = state.get(atom)
            if known is None:
                result = None
            elif known is not value:
                return False
        for choice in self.choices:
            best: bool | None = False
            for part in choice:
                told = part.truth(state)
                if told:
                    best = True
                    break
                if told is None:
                    best = None
            if best is False:
                return False
            result = result and best
        return result

    def given(self, known: Mapping[Atom, bool]) -> Condition:
        """Return what is left of it where these atoms are known."""
        if self.atoms.isdisjoint(known):
            return self
        if any(known.get(atom, value) is not value for atom, value in self.facts.items()):
            return NEVER
        left = Condition._made(self.facts.without(known))
        choices = (Condition.any_of(part.given(known) for part in choice) for choice in self.choices)
        return Condition.all_of((left, *choices))

    def decisive(self, state: Mapping[Atom, bool]) -> Facts:
        """The literals by which it is judged in a state, as it would have them: they all hold there where it is true,
        one of them does not where it is false, and none is wrong but one is unknown where it is unknown.

        Of a disjunction that is true or unknown these are the literals of one alternative (where it can be, of one that
        holds if all that is unknown is false), of one that is false all that keep an alternative from being true.
        """
        found = dict(self.facts)
        for choice in self.choices:
            told = [(part, part.truth(state)) for part in choice]
            best = [part.decisive(state) for part, truth in told if truth] or sorted(
                (part.decisive(state) for part, truth in told if truth is None),
                key=lambda facts: any(atom not in state for atom in facts.true),
            )
            for atom, value in best[0].items() if best else ():
                found.setdefault(atom, value)
            for part in () if best else choice:
                found.update((a, v) for a, v in part.decisive(state).items() if state.get(a, v) is not v)
        return self.facts if not self.choices else Facts(found)


ALWAYS = Condition()
"""The condition that always holds."""

NEVER = Condition._made(_NOTHING, ((),))
"""The condition that never holds."""


def _sorting(choice: tuple[Condition, ...]) -> str:
    return " or ".join(map(str, choice))


def _disjunction(choice: tuple[Condition, ...]) -> str:
    parts = (f"({part})" if len(part.facts) + len(part.choices) > 1 else str(part) for part in choice)
    return " or ".join(parts) or "false"


def _parsed(text: str) -> Condition:
    tokens: list[str] = []
    position = 0
    stripped = text.rstrip()
    while position < len(stripped):
        match = _TOKEN.match(stripped, position)
        if match is None:
            raise ValueError(f"{text!r} is not a condition such as on(a,b) and (clear(c) or not held(a))")
        tokens.append(match.group().strip())
        position = match.end()
    reading = _Reading(text, tokens)
    condition = reading.disjunction()
    if reading.next is not None:
        raise reading.mistake()
    return condition


class _Reading:
    """Reads a condition's tokens by recursive descent."""

    def __init__(self, text: str, tokens: list[str]) -> None:
        self._text, self._tokens, self._depth = text, tokens[::-1], 0

    @property
    def next(self) -> str | None:
        return self._tokens[-1] if self._tokens else None

    def mistake(self) -> ValueError:
        at = "its end" if self.next is None else repr(self.next)
        return ValueError(f"{self._text[:80]!r} is not a condition: {at} was not expected")

    def disjunction(self) -> Condition:
        parts = [self.conjunction()]
        while self.next == "or":
            self._tokens.pop()
            parts.append(self.conjunction())
        return parts[0] if len(parts) == 1 else Condition.any_of(parts)

    def conjunction(self) -> Condition:
        parts = [self.part()]
        while self.next == "and":
            self._tokens.pop()
            parts.append(self.part())
        return parts[0] if len(parts) == 1 else Condition.all_of(parts)

    def part(self) -> Condition:
        self._depth += 1
        token = self.next
        if token is None or token in (")", "and", "or") or self._depth > 100:
            raise self.mistake()
        self._tokens.pop()
        if token == "not":
            condition = ~self.part()
        elif token == "(":
            condition = self.disjunction()
            if self.next != ")":
                raise self.mistake()
            self._tokens.pop()
        else:
            condition = {"true": ALWAYS, "false": NEVER}.get(token) or Condition.literal(Atom.parse(token))
        self._depth -= 1
        return condition
