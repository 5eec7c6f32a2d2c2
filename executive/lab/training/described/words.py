"""In what words described objects and what is true of them are asked about."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executive.errors import DomainError, nearest
from executive.lab.training.described.space import BoolArray, DescribedSpace
from executive.lab.training.wordings import check_patterns, expand, read_tables, read_texts, small_placeholders
from executive.s3e.questions.templates import Templates, plain
from executive.types import Task

_SHORT = 0.25
"""The probability that a name leaves out what is not needed to tell its object from the others."""


@dataclass(frozen=True, slots=True)
class Words:
    """Patterns per predicate, the first of which runs use; and words per value, the first of which are in names."""

    patterns: Mapping[str, tuple[str, ...]]
    parameters: Mapping[str, tuple[str, ...]]
    values: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, space: DescribedSpace, task: Task, templates: Templates, file: Path | None = None) -> Words:
        """Reads the words of a domain: its templates, and what `file` (a `wordings.toml`) adds to them.

        Raises:
            DomainError: the file has a mistake, named with its key.
        """
        arity = {name: n for n, names in enumerate((space.nullary, space.unary, space.binary)) for name in names}
        patterns = {name: [small_placeholders(templates.predicates[name])] for name in arity}
        values = {value: [templates.objects.get(value, plain(value))] for value in space.values}
        if file is not None:
            tables = read_tables(file)
            for table, target in (("questions", patterns), ("values", values)):
                for key, entries in tables.get(table, {}).items():
                    if key not in target:
                        raise DomainError(f"unknown key; {nearest(key, target)}", file=file, key=f"{table}.{key}")
                    target[key] += map(small_placeholders, read_texts(entries, file, f"{table}.{key}"))
        parameters = {
            name: tuple(task.parameters.get(name, [str(index + 1) for index in range(count)]))
            for name, count in arity.items()
        }
        for name, each in patterns.items():
            check_patterns(each, parameters[name], file, f"questions.{name}")
        return cls({name: tuple(each) for name, each in patterns.items()}, parameters,
                   {name: tuple(dict.fromkeys(each)) for name, each in values.items()})  # fmt: skip

    def question(self, predicate: str, names: Sequence[str], rng: random.Random) -> str:
        """Samples a question. One in four has the official wording, which runs use."""
        patterns = self.patterns[predicate]
        pattern = patterns[0] if rng.random() < 0.25 else expand(rng.choice(patterns), rng)
        return pattern.format("", *names, **dict(zip(self.parameters[predicate], names, strict=True)))

    def name(self, space: DescribedSpace, own: BoolArray, number: int, rng: random.Random) -> str:
        """Samples a name for an object of a scene, `own` (K, V): its values in order, in other words at times, and at
        times without what no other object needs to be told apart by. The last value, which is a noun, is in each."""
        places = [int(place) for place in np.flatnonzero(own[number])]
        if rng.random() < _SHORT:
            for place in rng.sample(places[:-1], len(places) - 1):
                fewer = [each for each in places if each != place]
                alike = own[: space.most, fewer].all(axis=1)
                if int(alike.sum()) == 1:
                    places = fewer
        named = [self.values[space.values[place]] for place in places]
        official = rng.random() < 0.6
        return " ".join(words[0] if official else rng.choice(words) for words in named)

    def texts(self) -> list[str]:
        """Every text that a tokenizer has to cover."""
        return [
            *(text for each in self.patterns.values() for text in each),
            *(w for v in self.values.values() for w in v),
        ]
