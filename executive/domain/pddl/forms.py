"""One PDDL file as bracketed forms that know their line: the part of the reader that looks at text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from executive.errors import DomainError, nearest
from executive.util.files import read_text

_DEEPEST = 60
_NAME = re.compile(r"[a-z0-9_][a-z0-9_\-]*")
_TOKEN = re.compile(r";.*|[()]|\?[^\s();?]*|[^\s();?]+")
_RESERVED = frozenset(
    ["and", "or", "not", "imply", "exists", "forall", "when", "either", "define", "domain", "problem"]
)
_REQUIREMENTS = frozenset(
    [
        *(":strips", ":typing", ":equality", ":adl", ":fluents", ":numeric-fluents", ":object-fluents", ":negation"),
        *(":negative-preconditions", ":disjunctive-preconditions", ":existential-preconditions"),
        *(":universal-preconditions", ":quantified-preconditions", ":conditional-effects", ":derived-predicates"),
        *(":durative-actions", ":duration-inequalities", ":continuous-effects", ":timed-initial-literals", ":time"),
        *(":preferences", ":constraints", ":action-costs", ":goal-utilities", ":domain-axioms", ":non-deterministic"),
        *(":probabilistic-effects", ":mdp", ":rewards", ":hierarchy", ":method-preconditions", ":multi-agent"),
        *(":factored-privacy", ":unfactored-privacy", ":timed-initial-fluents", ":safety-constraints", ":open-world"),
        *(":true-negation", ":subgoals-through-axioms", ":action-expansions", ":foreach-expansions", ":dag-expansions"),
        *(
            ":disjunction",
            ":expression-evaluation",
            ":ucpop",
            ":quantified-conditions",
            ":contingent",
            ":supply-demand",
        ),
    ]
)
"""Names that a file may give to what it uses. What it does use is what counts."""

_SECTIONS = {
    "domain": frozenset([":requirements", ":types", ":constants", ":predicates", ":functions", ":action", ":derived"]),
    "problem": frozenset([":domain", ":requirements", ":objects", ":init", ":goal", ":metric"]),
}
DEEDS = frozenset([":action", ":durative-action", ":derived", ":process", ":event"])
"""What says that something may change."""

_EVERY_SECTION = frozenset().union(*_SECTIONS.values())
_REFUSED = {
    ":durative-action": "actions that take time",
    ":process": "processes",
    ":event": "events",
    ":constraints": "trajectory constraints",
    ":task": "hierarchical tasks",
    ":method": "hierarchical tasks",
    ":htn": "hierarchical tasks",
    ":goal-reward": "rewards",
    ":observe": "partial observability",
    ":serial": "hierarchical tasks",
}


@dataclass(frozen=True, slots=True)
class Form:
    """A word, or a bracketed list of forms, and the line on which it begins."""

    line: int
    word: str = ""
    items: tuple[Form, ...] | None = None

    @property
    def head(self) -> str:
        """The first word of a list; empty for a word and for a list that begins with a list."""
        return self.items[0].word if self.items else ""

    @property
    def rest(self) -> tuple[Form, ...]:
        return (self.items or ())[1:]

    def __str__(self) -> str:
        return self.word if self.items is None else f"({' '.join(map(str, self.items))})"


class PddlFile:
    """One PDDL file: its sections, and a way to complain about a line of it.

    With `only`, these sections are read and every other one that PDDL has is passed over, supported or not; `actions`
    are then all that may change something, of whatever kind.
    """

    def __init__(self, path: Path, kind: str, only: frozenset[str] | None = None) -> None:
        self.path = path
        self.definition = definition = self._parse(read_text(path, mistake=DomainError))
        name = definition.rest[0] if definition.rest else None
        if definition.head != "define" or name is None or name.head != kind or len(name.rest) != 1:
            self.fail(definition.line, f"expected (define ({kind} <name>) ...)")
        self.name = self.identifier(name.rest[0], f"the {kind}'s name")
        self.actions: list[Form] = []
        self._sections: dict[str, Form] = {}
        for form in definition.rest[1:]:
            if only is not None and form.head in DEEDS:
                self.actions.append(form)
            elif only is None or form.head in only or form.head not in _SECTIONS[kind] | _REFUSED.keys():
                self._add(form, only or _SECTIONS[kind])

    def fail(self, line: int, message: str) -> NoReturn:
        raise DomainError(message, file=self.path, key=f"line {line}")

    def section(self, name: str) -> Form | None:
        return self._sections.get(name)

    def identifier(self, form: Form, what: str) -> str:
        if form.word in _RESERVED:
            self.fail(form.line, f"{form} cannot be {what}: it is a word of PDDL itself")
        if not _NAME.fullmatch(form.word):
            self.fail(
                form.line, f"{form} cannot be {what}: expected a letter or digit, then letters, digits, '-' or '_'"
            )
        return form.word

    def _parse(self, text: str) -> Form:
        stack: list[tuple[int, list[Form]]] = [(1, [])]
        swallowed: tuple[int, int] | None = None  # where a section begins inside another: which, and where
        for number, line in enumerate(text.lower().split("\n"), start=1):
            for token in _TOKEN.findall(line):
                if token == "(":
                    stack.append((number, []))
                    if len(stack) > _DEEPEST:
                        self.fail(number, f"brackets nested more than {_DEEPEST} deep")
                elif token == ")":
                    start, items = stack.pop()
                    if not stack:
                        self.fail(number, "a ')' without its '('")
                    stack[-1][1].append(Form(start, items=tuple(items)))
                elif not token.startswith(";"):
                    if swallowed is None and len(stack) > 3 and not stack[-1][1] and token in _EVERY_SECTION:
                        swallowed = (stack[2][0], number)
                    stack[-1][1].append(Form(number, token))
        if len(stack) > 1:
            if swallowed is not None:
                self.fail(swallowed[0], f"a '(' that is not closed before the next section, on line {swallowed[1]}")
            self.fail(stack[-1][0], "a '(' that is never closed")
        forms = stack[0][1]
        if not forms:
            self.fail(1, "is empty")
        if len(forms) > 1:
            self.fail(forms[1].line, f"{shorten(forms[1])} after the end of the definition")
        return forms[0]

    def _add(self, form: Form, valid: frozenset[str]) -> None:
        name = form.head
        if name in _REFUSED and name not in valid:
            self.fail(form.line, f"{name} is not supported: {_REFUSED[name]}")
        if name not in valid:
            self.fail(form.line, f"unknown section {shorten(form)}; {nearest(name, valid)}")
        if name in (":action", ":derived"):
            self.actions.append(form)
        elif name in self._sections:
            self.fail(form.line, f"a second {name}; the first is on line {self._sections[name].line}")
        else:
            self._sections[name] = form
        for requirement in form.rest if name == ":requirements" else ():
            if requirement.word not in _REQUIREMENTS:
                hint = nearest(requirement.word, _REQUIREMENTS)
                self.fail(requirement.line, f"unknown requirement {requirement}; {hint}")

    def typed(self, forms: Iterable[Form], what: str, prefix: str = "") -> list[tuple[Form, str, Form | None]]:
        """A PDDL typed list, `a b - t c`, as (form, name with its prefix, form of the type or None)."""
        result: list[tuple[Form, str, Form | None]] = []
        waiting: list[tuple[Form, str]] = []
        queue = iter(forms)
        for form in queue:
            if form.word == "-":
                kind = next(queue, None)
                if kind is None or not waiting:
                    self.fail(form.line, f"a '-' needs {what} before it and a type behind it")
                for each in kind.rest if kind.head == "either" and kind.rest else (kind,):
                    self.identifier(each, "a type")
                result += [(own, name, kind) for own, name in waiting]
                waiting = []
            else:
                if prefix and not form.word.startswith(prefix):
                    self.fail(form.line, f"{shorten(form)} is not {what}, which begins with {prefix!r}")
                bare = Form(form.line, form.word.removeprefix(prefix), form.items)
                waiting.append((form, prefix + self.identifier(bare, what)))
        return result + [(own, name, None) for own, name in waiting]


class Fragment(PddlFile):
    """A formula that another file has as text. `fail` says what is wrong with it, and where it stands there."""

    def __init__(self, text: str, fail: Callable[[str], NoReturn]) -> None:
        self._fail = fail
        self.definition = self._parse(text)

    def fail(self, line: int, message: str) -> NoReturn:
        self._fail(message if line == 1 else f"on its line {line}: {message}")


def shorten(form: Form, limit: int = 60) -> str:
    text = str(form)
    return text if len(text) <= limit else f"{text[: limit - 4]} ..."
