"""Evaluation of collections whose objects change from episode to episode: what is asked about a point, and the looks
that the paper's Tables 5 and 6 are about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from executive.domain.loader import Domain, Subject, load_domain
from executive.lab.collection.dataset import Point
from executive.lab.problems import FILE, Recipe, first_problem, read_recipe
from executive.sim.spec import read_scene
from executive.types import ALWAYS, Atom

LIMITS = (3, 5, 7, 10)
"""The numbers of objects up to which looks are scored apart (Table 5)."""

BoolArray = np.ndarray[Any, np.dtype[np.bool_]]


@dataclass(frozen=True, slots=True)
class Varying:
    """What is known of the objects of a domain whose problems differ in them.

    Attributes:
        attributes: the scene's attributes, in order.
        recipe: of its `problems.toml`.
    """

    attributes: tuple[str, ...]
    recipe: Recipe

    @classmethod
    def of(cls, domain: str) -> Varying:
        """Read what a domain's folder says of its objects.

        Raises:
            DomainError: the domain or its `problems.toml` has a mistake.
        """
        loaded: Domain = load_domain(domain)
        scene = read_scene(loaded.scene)
        return cls(tuple(scene.attributes), read_recipe(loaded.folder / FILE, scene))

    def described(self, point: Point) -> dict[str, dict[str, str]]:
        """A point's objects: name -> attribute -> value."""
        return {name: dict(zip(self.attributes, words, strict=True)) for name, words in point.objects.items()}

    def problem(self, domain: str, point: Point) -> str:
        """A problem with a point's objects, as PDDL."""
        return first_problem(domain, "looks", self._typed(point), self.recipe)

    def _typed(self, point: Point) -> dict[str, str]:
        return {name: values[self.recipe.type] for name, values in self.described(point).items()}

    def subject(self, subject: Subject, point: Point) -> Subject:
        """What is asked about a point: its own atoms, about its own objects and those that all problems have."""
        own = self._typed(point)
        named = {name for atom in point.facts for name in atom.args}
        shared = {name: kind for name, kind in subject.task.objects.items() if name in named and name not in own}
        task = replace(
            subject.task,
            objects={**own, **shared},
            atoms=tuple(point.facts),
            goal=ALWAYS,
            declared=frozenset(),
            visible={},
        )
        return replace(subject, task=task)

    def groups(self, points: Sequence[Point]) -> dict[str, BoolArray]:
        """The looks (looks,) at so many objects at most, and those whose objects are as each subset says."""
        described = [list(self.described(point).values()) for point in points]
        limits = {f"at most {most}": [len(each) <= most for each in described] for most in LIMITS}
        subsets = {name: [self.recipe.allows(name, each) for each in described] for name in self.recipe.subsets}
        return {name: np.array(chosen, dtype=np.bool_) for name, chosen in {**limits, **subsets}.items()}

    def held_out(self, point: Point) -> list[bool]:
        """Whether each of a point's atoms is about an object with a combination that training did not see."""
        described = self.described(point)
        odd = {name for name, values in described.items() if self.recipe.is_held_out(values)}
        return [not odd.isdisjoint(atom.args) for atom in point.facts]


def columns(
    points: Sequence[Point], told: Mapping[int, Sequence[float | None]]
) -> tuple[tuple[Atom, ...], np.ndarray[Any, Any], np.ndarray[Any, Any], BoolArray]:
    """All atoms of all points, and for each look (looks, most atoms of a look) which of these each column is (-1 for
    none), P(true) and the truth.

    Args:
        told: the number of a look from 1 -> P(true) of each of its atoms, None where unanswered.
    """
    atoms = tuple(dict.fromkeys(atom for point in points for atom in point.facts))
    place = {atom: number for number, atom in enumerate(atoms)}
    shape = (len(points), max((len(point.facts) for point in points), default=0))
    which, probability, truth = np.full(shape, -1), np.full(shape, np.nan), np.zeros(shape, np.bool_)
    for row, point in enumerate(points):
        count = len(point.facts)
        which[row, :count] = [place[atom] for atom in point.facts]
        probability[row, :count] = [np.nan if p is None else p for p in told[row + 1]]
        truth[row, :count] = list(point.facts.values())
    return atoms, which, probability, truth
