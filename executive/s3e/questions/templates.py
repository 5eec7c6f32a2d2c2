"""From atoms to questions without a language model: by the templates of a domain, or not at all.

A domain's `questions.toml` has one template per predicate. What it calls `{item}` is the parameter that the PDDL file
calls `?item`; `{1}` is the first parameter. Objects are called by their names with hyphens as spaces, or as `[objects]`
says:

    [questions]
    on-table = "Is the {item} on the {table}?"
    robot-gripper-empty = "Is the robot's gripper empty?"

    [objects]
    soda-can = "red can of soda"

The template of a numeric fluent has its function's name and asks for a number:

    count = "How many items are in the {crate}?"
"""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn, Protocol, runtime_checkable

from executive.errors import DomainError, nearest
from executive.s3e.backends.interface import TRUE_FALSE
from executive.s3e.questions import prompts
from executive.types import Atom, Questions, Task
from executive.util.files import caseless, read_text, read_toml

LARGEST = 1_000_000
"""Bytes; no file of questions or instructions that anyone wrote is larger."""

LONGEST = 300
"""Characters of a question."""


@runtime_checkable
class Translator(Protocol):
    """Words the question of every atom of a task: the paper's translation stage (Section 4)."""

    def translate(self, task: Task) -> Questions: ...


@dataclass(frozen=True, slots=True)
class Templates:
    """One template per predicate, and what to call the objects. `file` is where they were read, for error messages."""

    predicates: Mapping[str, str]
    objects: Mapping[str, str] = field(default_factory=dict)
    file: Path | None = None

    @classmethod
    def read(cls, path: str | Path) -> Templates:
        """Read a `questions.toml`.

        Raises:
            DomainError: the first mistake that can be seen without a task, in one line with file and key.
        """
        file = Path(path)
        tables = read_toml(file, mistake=DomainError)
        valid = ("questions", "objects")
        for name, table in tables.items():
            if name not in valid:
                raise DomainError(f"unknown key; {nearest(name, valid)}", file=file, key=name)
            if not isinstance(table, dict):
                raise DomainError(f"expected a table, got {table!r}", file=file, key=name)
        if "questions" not in tables:
            raise DomainError("is missing: the table with one question per predicate", file=file, key="questions")
        texts = {name: caseless(tables.get(name, {}), file, name, mistake=DomainError) for name in valid}
        return cls(texts["questions"], texts["objects"], file).checked()

    def checked(self) -> Templates:
        """These templates, every text of which is one that can be asked.

        Raises:
            DomainError: the first mistake that can be seen without a task.
        """
        for table, texts in (("questions", self.predicates), ("objects", self.objects)):
            for name, text in texts.items():
                self._check_text(table, name, text)
        for predicate, template in self.predicates.items():
            if not template.rstrip().endswith("?"):
                self._fail("questions", predicate, f"{template!r} does not end with a question mark")
            for place in self._places(predicate):
                if not place:
                    self._fail("questions", predicate, "{} names no parameter: write {1} for the first one")
        return self

    def names(self, task: Task) -> dict[str, str]:
        """What each object of the task is called in a question.

        Raises:
            DomainError: two objects would be called the same.
        """
        names = {name: self.objects.get(name, plain(name)) for name in task.objects}
        called: dict[str, str] = {}
        for name, text in names.items():
            other = called.setdefault(" ".join(text.split()).casefold(), name)
            if other != name:
                key = next((key for key in (name, other) if key in self.objects), name)
                self._fail("objects", key, f"{other} and {name} are both called {text!r}")
        return names

    def translate(self, task: Task) -> Questions:
        """Fill the templates in.

        Raises:
            DomainError: a template is missing, does not fit its predicate, or asks the same as another one.
        """
        parameters = _parameters(task)
        for predicate in self.predicates:
            if predicate not in parameters:
                hint = nearest(predicate, parameters)
                self._fail("questions", predicate, f"there is no predicate {predicate!r} in the PDDL; {hint}")
        for predicate, known in parameters.items():
            if predicate not in self.predicates:
                places = "".join(f" {{{name}}} ..." for name in known)
                self._fail("questions", predicate, f'is missing: write {predicate} = "Is ...{places}?"')
            self._check_placeholders(predicate, known)
        names, text, numerals = self.names(task), {}, _numerals(task)
        asked: dict[str, Atom] = {}
        for atom in task.atoms:
            text[atom] = self._fill(atom, parameters[atom.predicate], names)
            other = asked.setdefault(text[atom].casefold(), atom)
            if other != atom and not (atom in numerals and _of_one_fluent(atom, other)):
                self._fail("questions", atom.predicate, f"{text[atom]!r} would ask for both {other} and {atom}")
        return Questions(
            text,
            prompts.QUESTION_ANSWERING,
            "templates",
            warnings=self._warnings(task),
            numerals=numerals,
            number_system=prompts.COUNTING if numerals else "",
        )

    def _fail(self, table: str, name: str, message: str) -> NoReturn:
        raise DomainError(message, file=self.file, key=f"{table}.{name}")

    def _check_text(self, table: str, name: str, text: object) -> None:
        if not isinstance(text, str):
            self._fail(table, name, f"expected a text, got {text!r}")
        if not text.strip():
            self._fail(table, name, "is empty")
        if not text.isprintable():
            self._fail(table, name, "expected one line of printable text")
        if len(text) > LONGEST:
            self._fail(table, name, f"has {len(text)} characters, and may have {LONGEST}")

    def _places(self, predicate: str) -> list[str]:
        """The placeholders of a template, in order."""
        try:
            parts = list(string.Formatter().parse(self.predicates[predicate]))
        except ValueError as error:
            self._fail("questions", predicate, f"its braces do not match ({error}); a brace itself is written twice")
        for _, place, options, conversion in parts:
            if options or conversion:
                self._fail("questions", predicate, f"{{{place}}} is a placeholder without ':' and '!'")
        return [place.lower() for _, place, _, _ in parts if place is not None]

    def _check_placeholders(self, predicate: str, known: tuple[str, ...]) -> None:
        places = self._places(predicate)
        valid = _positions(known)
        for place in places:
            if place not in valid:
                hint = nearest(place, valid) if valid else f"{predicate} has no parameters"
                self._fail("questions", predicate, f"unknown placeholder {{{place}}}; {hint}")
        used = {valid[place] for place in places}
        for index, name in enumerate(known):
            if index not in used:
                place = name if name.lower() in valid else str(index + 1)
                self._fail("questions", predicate, f"{{{place}}} is missing: every {place} would be asked the same")

    def _fill(self, atom: Atom, known: tuple[str, ...], names: Mapping[str, str]) -> str:
        positions = _positions(known)
        filled = []
        for literal, place, _, _ in string.Formatter().parse(self.predicates[atom.predicate]):
            filled += [literal, "" if place is None else names[atom.args[positions[place.lower()]]]]
        return "".join(filled).strip()

    def _warnings(self, task: Task) -> tuple[str, ...]:
        """What is not asked about, and names of objects that look like slips: those that this problem does not have
        are right in another one of the domain, unless they are nearly those of one that it has."""
        unnamed = [name for name in task.objects if name not in self.objects]
        slips = ((name, get_close_matches(name, unnamed, 1, 0.85)) for name in self.objects if name not in task.objects)
        where = self.file or "questions"
        hints = (
            f"{where}: objects.{name}: the problem has no such object; did you mean {close[0]!r}?"
            for name, close in slips
            if close
        )
        return (*hints, *_passed_over(task))


@dataclass(frozen=True, slots=True)
class Untranslated:
    """The paper's ablation (Appendix B): the model is shown `on-table(lemon,black-table)` itself, with the whole domain
    in its system prompt, and answers with true or false.

    `domain` is the text of the PDDL domain file.
    """

    domain: str

    def translate(self, task: Task) -> Questions:
        system = prompts.no_translation(self.domain, task.objects)
        words = (TRUE_FALSE.affirmative, TRUE_FALSE.negative)
        text = {atom: prompts.query(atom) for atom in task.atoms}
        return Questions(text, system, "none", words, _passed_over(task))


def generic(task: Task) -> Templates:
    """Templates made from the names alone, where the domain has none: stiff, but every atom gets a question
    of its own."""
    predicates, objects = _distinct(_parameters(task)), _distinct(task.objects)
    texts = {}
    functions = {fluent.function for fluent in task.fluents}
    for predicate, known in _parameters(task).items():
        named = " and ".join(f"the {{{index + 1}}}" for index in range(len(known)))
        if predicate in functions:
            texts[predicate] = f'What number is "{predicates[predicate]}"{f" of {named}" if named else ""}?'
            continue
        texts[predicate] = f'Is "{predicates[predicate]}" true{f" of {named}" if named else ""}?'
    return Templates(texts, objects)


def load_questions(path: str | Path, task: Task) -> Questions:
    """The questions of a task from the templates of its domain.

    Raises:
        DomainError: the first mistake in the file, in one line with its key.
    """
    return Templates.read(path).translate(task)


def load_instructions(path: str | Path) -> str:
    """What a domain's `instructions.md` says of how things look (Appendix E.3).

    Raises:
        DomainError: it cannot be read, or says nothing.
    """
    file = Path(path)
    text = read_text(file, largest=LARGEST, mistake=DomainError).strip()
    if not text:
        raise DomainError("is empty: it says how things look, or is not there at all", file=file)
    if any(not (character.isprintable() or character in "\n\t") for character in text):
        raise DomainError("has control characters in it", file=file)
    return text


def instruct(questions: Questions, instructions: str) -> Questions:
    """The same questions with instructions appended to their system prompt (Appendix E.3)."""
    number = prompts.instructed(questions.number_system, instructions) if questions.number_system else ""
    return replace(questions, system=prompts.instructed(questions.system, instructions), number_system=number)


def plain(name: str) -> str:
    """A PDDL name in plain words: `soda-can` is a soda can."""
    return " ".join(name.replace("-", " ").replace("_", " ").split())


def _passed_over(task: Task) -> tuple[str, ...]:
    """What a domain has that is not estimated."""
    return tuple(f"{name}: a numeric fluent, which is not estimated" for name in task.numeric)


def _distinct(names: Iterable[str]) -> dict[str, str]:
    """Names in plain words, but for those that would then be the same."""
    words = {name: plain(name) for name in names}
    folded = [text.casefold() for text in words.values()]
    return {name: text if folded.count(text.casefold()) == 1 else name for name, text in words.items()}


def _parameters(task: Task) -> dict[str, tuple[str, ...]]:
    """Each predicate with the names of its parameters; positions where a task does not say them."""
    known = {atom.predicate: tuple(str(index + 1) for index in range(len(atom.args))) for atom in task.atoms}
    known |= task.parameters
    functions = {fluent.function for fluent in task.fluents}  # a question for a number does not name it
    return {name: names[:-1] if name in functions else names for name, names in known.items()}


def _numerals(task: Task) -> dict[Atom, int]:
    """The atoms that stand for values of numeric fluents, with the values."""
    return {atom: value for fluent in task.fluents for value, atom in fluent.values}


def _of_one_fluent(atom: Atom, other: Atom) -> bool:
    return (atom.predicate, atom.args[:-1]) == (other.predicate, other.args[:-1])


def _positions(known: Iterable[str]) -> dict[str, int]:
    """Every valid placeholder, and which argument it stands for. A name that two parameters share stands for none."""
    names = tuple(name.lower() for name in known)
    positions = {name: index for index, name in enumerate(names) if names.count(name) == 1}
    return {**positions, **{str(index + 1): index for index in range(len(names))}}
