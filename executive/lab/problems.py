"""Random problems of a domain: other objects in each, a state that random actions lead to, and another one as the goal.

Which objects there may be, and what a start and a goal consist of, stands in the domain folder's `problems.toml`; the
objects' attributes are those of its scene. A problem depends on the seed and its own number alone.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.domain.loader import Domain, load_domain
from executive.domain.pddl import Schema, read_task
from executive.domain.pddl.random_action import draw_action
from executive.errors import DomainError, InputError, OptionError, nearest
from executive.sim.spec import SceneSpec, read_scene
from executive.types import Atom
from executive.util.atomic_write import write_atomic
from executive.util.files import check_writable, read_toml
from executive.util.validation import first_mistake

FILE = "problems.toml"

_STEPS = 12
"""Random actions for each object on the way to a start or a goal."""

_TRIES = 200
"""How often objects, or a goal that differs from the start, are drawn."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Subset(_Table):
    """Which objects a problem may have: `only` these values of an attribute, and no two that agree in all attributes of
    `distinct`."""

    only: dict[str, list[str]] = {}
    distinct: list[str] = []


HeldOut = dict[str, str]
"""A combination of values that no training sees: attribute -> value."""


class Combinations(StrEnum):
    """Which objects there may be: any; none that has a held-out combination; or in each problem at least one."""

    ALL = "all"
    SEEN = "seen"
    HELD_OUT = "held-out"


class Recipe(_Table):
    """The contents of `problems.toml`."""

    type: str
    each: list[str] = []
    once: list[str] = []
    goal: list[str] = Field(min_length=1)
    chains: dict[str, int] = {}
    subsets: dict[str, Subset] = {}
    held_out: list[Annotated[HeldOut, Field(min_length=2)]] = []

    def is_held_out(self, described: Mapping[str, str]) -> bool:
        """Whether an object's values have a combination that no training sees."""
        return any(pair.items() <= described.items() for pair in self.held_out)

    def allows(self, subset: str, objects: Sequence[Mapping[str, str]]) -> bool:
        """Whether the objects of a problem (attribute -> value) are as a subset says."""
        of = self.subsets[subset]
        if any(each.get(name) not in values for name, values in of.only.items() for each in objects):
            return False
        keys = [tuple(each[name] for name in of.distinct) for each in objects]
        return not of.distinct or len(keys) == len(set(keys))


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem's name, its objects (name -> type), and its PDDL."""

    name: str
    objects: Mapping[str, str]
    text: str


class ProblemMaker:
    """Makes problems of one domain.

    Args:
        least, most: the numbers of objects between which one is drawn.
        subset: the name of one of the recipe's.
        combinations: whether there are objects with a combination of values that is held out.

    Raises:
        DomainError: the domain or its `problems.toml` has a mistake, or there is none.
        OptionError: no such subset, it has too few objects, or nothing is held out.
    """

    def __init__(
        self,
        domain: str | Path,
        least: int,
        most: int,
        seed: int,
        subset: str | None = None,
        combinations: str = Combinations.ALL,
    ) -> None:
        loaded, self._where = load_domain(domain), domain
        self._pddl, self._name, self._seed, self._range = loaded.subject.pddl, loaded.task.name, seed, (least, most)
        self._scene = read_scene(loaded.scene)
        self._file = loaded.folder / FILE
        self._recipe = read_recipe(self._file, self._scene)
        if subset is not None and subset not in self._recipe.subsets:
            raise OptionError(f"no subset {subset!r}; {nearest(subset, self._recipe.subsets)}", option="subset")
        self._subset = Subset() if subset is None else self._recipe.subsets[subset]
        self._stem = f"{subset or 'random'}-{least}" + (f"-{most}" if most > least else "")
        there = [self._subset.only.get(name, list(values)) for name, values in self._scene.attributes.items()]
        self._described = [dict(zip(self._scene.attributes, words, strict=True)) for words in itertools.product(*there)]
        self._held_out = [each for each in self._described if self._recipe.is_held_out(each)]
        self._needs_held_out = combinations == Combinations.HELD_OUT
        if combinations == Combinations.SEEN:
            self._described = [each for each in self._described if each not in self._held_out]
        elif self._needs_held_out and not self._held_out:
            raise OptionError("there is none in problems.toml, or the subset has none", option="combinations")
        kinds = {self._key(each) for each in self._described}
        if not 1 <= least <= most:
            raise OptionError(f"should be two numbers such as 2-10, got {least}-{most}", option="objects")
        if most > len(kinds):
            raise OptionError(f"there are only {len(kinds)} that may be in one problem, got {most}", option="objects")

    def problems(self, count: int) -> Iterator[Problem]:
        """The first `count` problems.

        Raises:
            DomainError: the recipe leads to no problem.
        """
        for number in range(1, count + 1):
            yield self.problem(number)

    def problem(self, number: int) -> Problem:
        """The problem of a number from 1 on.

        Raises:
            DomainError: the recipe leads to none.
        """
        rng = np.random.default_rng([self._seed, number])
        name = f"{self._stem}-{number:04d}"
        for _ in range(_TRIES):
            objects = self._objects(rng)
            schema = self._read(first_problem(self._name, name, objects, self._recipe))
            begin = {atom: atom in schema.task.declared for atom in schema.task.atoms}
            start = self._walk(schema, begin, len(objects), rng)
            goal = self._walk(schema, start, len(objects), rng)
            init = [str_of(atom) for atom, value in start.items() if value]
            wanted = [str_of(a) for a, value in goal.items() if value and a.predicate in self._recipe.goal]
            if not set(wanted) <= set(init):
                return Problem(name, objects, _text(self._name, name, objects, init, wanted))
        raise DomainError(f"after {_TRIES} tries no goal differs from its start", file=self._file, key="goal")

    @contextmanager
    def domain(self, number: int) -> Iterator[Domain]:
        """The domain with the problem of a number; a context manager, as the problem's file is there for its time
        alone.

        Raises:
            DomainError: the recipe leads to no such problem.
        """
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "problem.pddl"
            file.write_text(self.problem(number).text, encoding="utf-8")
            yield load_domain(self._where, str(file))

    def _objects(self, rng: np.random.Generator) -> dict[str, str]:
        count = int(rng.integers(self._range[0], self._range[1] + 1))
        found: dict[str, str] = {}
        taken = set()
        first = [self._held_out[int(rng.integers(len(self._held_out)))]] if self._needs_held_out else []
        for described in (*first, *(self._described[int(index)] for index in rng.permutation(len(self._described)))):
            if len(found) < count and self._key(described) not in taken:
                taken.add(self._key(described))
                found["-".join(described.values())] = described[self._recipe.type]
        return found

    def _key(self, described: Mapping[str, str]) -> tuple[str, ...]:
        """What no two objects of a problem have in common."""
        return tuple(described[name] for name in self._subset.distinct or described)

    def _walk(
        self, schema: Schema, state: Mapping[Atom, bool], objects: int, rng: np.random.Generator
    ) -> dict[Atom, bool]:
        """The state after random actions, where what the recipe says once is true again."""
        once = {Atom.parse(said) for said in map(_plain, self._recipe.once)}
        now, least = dict(state), int(rng.integers(_STEPS * objects, 2 * _STEPS * objects))
        for taken in itertools.count():
            if taken >= least and all(now.get(atom, False) for atom in once):
                return now
            if taken > 100 * least:
                raise DomainError(
                    "random actions never lead back to what is true at first", file=self._file, key="once"
                )
            step = draw_action(schema, now, rng)
            if step is None:
                return now
            then = now | {a: v for a, v in step.changes(schema.task.derived.complete(now)).items() if v is not None}
            if self._chained(then):
                now = then
        raise AssertionError("counting ends")

    def _chained(self, state: Mapping[Atom, bool]) -> bool:
        """Whether no chain of atoms is longer than the recipe allows."""
        for predicate, most in self._recipe.chains.items():
            after = {a.args[0]: a.args[1] for a, value in state.items() if value and a.predicate == predicate}
            for first in after:
                length, at = 0, first
                while at in after and length <= most:
                    length, at = length + 1, after[at]
                if length > most:
                    return False
        return True

    def _read(self, text: str) -> Schema:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "problem.pddl"
            file.write_text(text, encoding="utf-8")
            return read_task(self._pddl, file)


def first_problem(domain: str, name: str, objects: Mapping[str, str], recipe: Recipe) -> str:
    """The problem in which all objects (name -> type) are as a recipe says that they are at first, which is the goal,
    too."""
    first = [*recipe.once, *sorted({said.format(object=each) for each in objects for said in recipe.each})]
    return _text(domain, name, objects, first, first)


def _text(domain: str, name: str, objects: Mapping[str, str], init: Sequence[str], goal: Sequence[str]) -> str:
    by_type: dict[str, list[str]] = {}
    for each, kind in objects.items():
        by_type.setdefault(kind, []).append(each)
    listed = "\n            ".join(f"{' '.join(names)} - {kind}" for kind, names in by_type.items())
    return (
        f"(define (problem {name})\n"
        f"  (:domain {domain})\n"
        f"  (:objects {listed})\n"
        f"  (:init {_indented(init, 9)})\n"
        f"  (:goal (and {_indented(goal, 14)})))\n"
    )


def write(problems: Sequence[Problem], out: Path) -> list[Path]:
    """Write each problem to a file of its name in a folder.

    Raises:
        InputError: one of the files is there already.
    """
    check_writable(out, "out")
    files = [out / f"{problem.name}.pddl" for problem in problems]
    for file in files:
        if file.exists():
            raise InputError("is there already; choose another folder with --out", file=file)
    out.mkdir(parents=True, exist_ok=True)
    for file, problem in zip(files, problems, strict=True):
        write_atomic(file, problem.text.encode())
    return files


def str_of(atom: Atom) -> str:
    """An atom as PDDL writes it."""
    return f"({' '.join((atom.predicate, *atom.args))})"


def _plain(said: str) -> str:
    """An atom of PDDL, (on a b), as it is written elsewhere: on(a,b)."""
    name, *args = said.strip("() \t").split()
    return f"{name}({','.join(args)})"


def _indented(atoms: Sequence[str], by: int) -> str:
    return f"\n{' ' * by}".join(atoms)


def read_recipe(file: Path, scene: SceneSpec) -> Recipe:
    """Read a recipe, and check it against the scene that has the attributes.

    Raises:
        DomainError: it has a mistake.
    """
    document = read_toml(file, mistake=DomainError)
    try:
        recipe = Recipe.model_validate(document)
    except ValidationError as error:
        path, message = first_mistake(error, Recipe)
        raise DomainError(message, file=file, key=".".join(path)) from error
    held_out = {f"held_out[{number}]": pair for number, pair in enumerate(recipe.held_out)}
    named = [("type", recipe.type)]
    named += [(f"subsets.{each}", name) for each, of in recipe.subsets.items() for name in (*of.only, *of.distinct)]
    named += [(key, name) for key, pair in held_out.items() for name in pair]
    for key, name in named:
        if name not in scene.attributes:
            raise DomainError(
                f"the scene has no attribute {name!r}; {nearest(name, scene.attributes)}", file=file, key=key
            )
    said = [(f"subsets.{each}", name, v) for each, of in recipe.subsets.items() for name, v in of.only.items()]
    said += [(key, name, [value]) for key, pair in held_out.items() for name, value in pair.items()]
    for key, name, values in said:
        for value in values:
            if value not in scene.attributes[name]:
                message = f"{name} has no value {value!r}; {nearest(value, scene.attributes[name])}"
                raise DomainError(message, file=file, key=key)
    return recipe
