"""The labels of scenes whose objects are described: by the values of attributes, and by what is true of the objects.

An object's CHANNELS are what can be read off it: its own values, the unary predicates that are true of it, and for each
binary predicate the values of what it stands in that relation to (what a block is on), and of what stands in it to the
object (what is on the block).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from executive.domain.loader import Domain
from executive.errors import DomainError
from executive.lab.problems import FILE, HeldOut, read_recipe
from executive.sim.spec import read_scene
from executive.types import Atom

NO_ATOM = -1
"""In place of the truth of what is no atom of the task."""

BoolArray = np.ndarray[Any, np.dtype[np.bool_]]

Described = Mapping[str, Mapping[str, str]]
"""Objects in the order that masks number them in: name -> attribute -> value."""


class Scenes(NamedTuple):
    """B scenes of at most K objects, of which the last ones are the same in all: constants, as tables and regions.

    `own` (B, K, V) bool, the values of each object, none for one that is not there; `nullary` (B, N), `unary`
    (B, U, K), `binary` (B, R, K, K) int8: the truth of each atom, `NO_ATOM` where there is none.
    """

    own: BoolArray
    nullary: np.ndarray[Any, np.dtype[np.int8]]
    unary: np.ndarray[Any, np.dtype[np.int8]]
    binary: np.ndarray[Any, np.dtype[np.int8]]

    def channels(self) -> BoolArray:
        """What can be read off each object, (B, K, H)."""
        own, true = self.own.astype(np.int32), (self.binary == 1).astype(np.int32)
        to = np.einsum("brkj,bjv->bkrv", true, own) > 0
        by = np.einsum("brjk,bjv->bkrv", true, own) > 0
        count, objects = self.own.shape[:2]
        unary = (self.unary == 1).transpose(0, 2, 1)
        parts = [self.own, unary, to.reshape(count, objects, -1), by.reshape(count, objects, -1)]
        return np.concatenate(parts, axis=2)


@dataclass(frozen=True)
class DescribedSpace:
    """The vocabulary of a domain's scenes.

    Attributes:
        attributes: attribute -> its values, in the scene's order.
        type: the attribute that decides an object's PDDL type.
        constants: the objects that are in every problem.
        nullary, unary, binary: the predicates that are asked about.
        most: the largest number of described objects.
        held_out: the combinations of values that training does not see.
        hues: the attributes whose values are colours and nothing else.
    """

    attributes: Mapping[str, tuple[str, ...]]
    type: str
    constants: tuple[str, ...]
    nullary: tuple[str, ...]
    unary: tuple[str, ...]
    binary: tuple[str, ...]
    most: int
    held_out: tuple[HeldOut, ...] = ()
    hues: tuple[str, ...] = ()

    @classmethod
    def of(cls, domain: Domain, most: int) -> DescribedSpace:
        """The vocabulary of a domain.

        Raises:
            DomainError: the domain has no attributes or no `problems.toml`, or a predicate has three parameters.
        """
        scene = read_scene(domain.scene)
        recipe = read_recipe(domain.folder / FILE, scene)
        arity = {atom.predicate: len(atom.args) for atom in domain.task.atoms}
        for name, count in arity.items():
            if count > 2:
                message = f"has {count} parameters, and objects that are described are asked about in pairs at most"
                raise DomainError(message, file=domain.subject.pddl, key=name)
        items = {item.name for item in scene.restricted_to(domain.task.objects, domain.scene).items}
        of = {n: tuple(sorted(name for name, count in arity.items() if count == n)) for n in range(3)}
        return cls(
            {name: tuple(values) for name, values in scene.attributes.items()},
            recipe.type,
            tuple(name for name in domain.task.objects if name not in items),
            of[0],
            of[1],
            of[2],
            most,
            tuple(recipe.held_out),
            tuple(
                name
                for name, values in scene.attributes.items()
                if all(part.keys_said().keys() == {"rgba"} for part in values.values())
            ),
        )

    @cached_property
    def values(self) -> tuple[str, ...]:
        """The values of all attributes, and the constants, each of which has itself as its only value."""
        return (*(value for values in self.attributes.values() for value in values), *self.constants)

    @property
    def objects(self) -> int:
        """K, with the constants."""
        return self.most + len(self.constants)

    @property
    def size(self) -> int:
        """H, the number of channels."""
        return len(self.values) * (1 + 2 * len(self.binary)) + len(self.unary)

    def channels_of(self, values: Collection[str]) -> list[int]:
        """The channels that say one of some values, of the object or of what it stands in a relation to."""
        places, count, relations = [self.values.index(value) for value in values], len(self.values), len(self.binary)
        first = [0, *(count + len(self.unary) + number * count for number in range(2 * relations))]
        return [start + place for start in first for place in places]

    @cached_property
    def descriptions(self) -> list[dict[str, str]]:
        """All descriptions of an object that training may see."""
        all_of = [dict(zip(self.attributes, words, strict=True)) for words in product(*self.attributes.values())]
        return [each for each in all_of if not self.is_held_out(each)]

    def is_held_out(self, described: Mapping[str, str]) -> bool:
        """Whether a description has a combination of values that training does not see."""
        return any(pair.items() <= described.items() for pair in self.held_out)

    def painted_anew(self, objects: Described, painted: Collection[str], rng: np.random.Generator) -> Described:
        """The same objects with other values of the attributes `painted`, such that training may see them and no two
        are alike."""
        found: dict[str, Mapping[str, str]] = {}
        for name in rng.permutation(sorted(objects)).tolist():
            kept = {key: value for key, value in objects[name].items() if key not in painted}.items()
            open_ = [each for each in self.descriptions if kept <= each.items() and each not in found.values()]
            found[name] = open_[int(rng.integers(len(open_)))]
        return {name: found[name] for name in objects}

    def encode(self, objects: Described, facts: Mapping[Atom, bool], file: Path | None = None) -> Scenes:
        """One scene.

        Raises:
            DomainError: it has too many objects, or one that no space of this vocabulary has.
        """
        if len(objects) > self.most:
            raise DomainError(f"has {len(objects)} objects, and {self.most} are the most here", file=file)
        place = {value: number for number, value in enumerate(self.values)}
        index = {name: number for number, name in enumerate(objects)}
        index |= {name: self.most + number for number, name in enumerate(self.constants)}
        made = self.empty(1)
        for name, described in objects.items():
            made.own[0, index[name], [place[value] for value in described.values()]] = True
        for name in self.constants:
            made.own[0, index[name], place[name]] = True
        for atom, value in facts.items():
            at = [index[name] for name in atom.args]
            for names, array in ((self.nullary, made.nullary), (self.unary, made.unary), (self.binary, made.binary)):
                if atom.predicate in names:
                    array[(0, names.index(atom.predicate), *at)] = int(bool(value))
        return made

    def empty(self, count: int) -> Scenes:
        """Scenes without objects and atoms."""
        shapes = ((len(self.nullary),), (len(self.unary), self.objects), (len(self.binary), self.objects, self.objects))
        atoms = (np.full((count, *shape), NO_ATOM, np.int8) for shape in shapes)
        return Scenes(np.zeros((count, self.objects, len(self.values)), np.bool_), *atoms)

    def described_anew(self, scenes: Scenes, rng: np.random.Generator) -> Scenes:
        """The same scenes with other objects: each gets another description that training may see, of the same type,
        so that the same atoms are about it. No two objects of a scene are alike."""
        place = {value: number for number, value in enumerate(self.values)}
        types = self.attributes[self.type]
        by_type: dict[str, list[list[int]]] = {value: [] for value in types}
        for each in self.descriptions:
            by_type[each[self.type]].append([place[value] for value in each.values()])
        own = scenes.own.copy()
        for row in own:
            groups: dict[str, list[int]] = {}
            for number in np.flatnonzero(row[: self.most].any(axis=1)).tolist():
                groups.setdefault(next(v for v in types if row[number, place[v]]), []).append(number)
            for kind, numbers in groups.items():
                chosen = rng.choice(len(by_type[kind]), len(numbers), replace=False)
                row[numbers] = False
                for number, one in zip(numbers, chosen.tolist(), strict=True):
                    row[number, by_type[kind][one]] = True
        return scenes._replace(own=own)


def is_described(domain: Domain, problem: str | None) -> bool:
    """Whether a domain's training is about described objects: it has a `problems.toml`, and no problem is named."""
    return problem is None and (domain.folder / FILE).is_file()


def gathered(scenes: Sequence[Scenes]) -> Scenes:
    """Several scenes as one batch."""
    return Scenes(*(np.concatenate(parts) for parts in zip(*scenes, strict=True)))
