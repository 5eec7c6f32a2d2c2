"""Training questions about described objects, laid out as all others (`executive.lab.training.question_batches`)."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

import numpy as np

from executive.lab.training import tokenizer as words
from executive.lab.training.described.space import NO_ATOM, DescribedSpace, Scenes
from executive.lab.training.described.words import Words
from executive.lab.training.question_batches import NOTHING, Probed, Question, QuestionBatch, RowLayout
from executive.s3e.questions.templates import plain

_TRUE, _NEAR, _NULLARY = 0.3, 0.25, 0.1
"""The probabilities that a question is about a true atom, one that differs from a true one in an object, and one that
names no object. The others are about any atom."""

_ALIKE = 0.6
"""The probability that of those that differ from a true atom in an object, one is taken in which the other object is as
much like it as any in the scene: a large brown cube for a large red one."""

_OPEN = "which {attribute} has what the {name} is {predicate}?"


class DescribedQuestions:
    """Samples questions about scenes of described objects.

    Args:
        systems: system prompts between pictures and questions, each with its probability; "" is none.
    """

    def __init__(
        self, space: DescribedSpace, said: Words, tokenizer: Any, systems: Sequence[tuple[str, float]], seed: int
    ) -> None:
        self._space, self._words, self._tokenizer = space, said, tokenizer
        self._rng = random.Random(seed)
        self._systems = [[self._id(words.SYSTEM), *self._ids(text)] if text else [] for text, _ in systems]
        self._shares = [share for _, share in systems]
        self.yes, self.no = self._id("yes"), self._id("no")
        self.affirmative = (self.yes, self._id("true"))
        self._answers = [self._ids(said.values[value][0])[0] for value in space.values]
        self._nothing = self._ids(NOTHING)[0]
        probed = list(range(space.size - len(space.values)))
        self._layout = RowLayout(self._id(words.USER), self._id(words.ASSISTANT), [probed] * space.objects)
        first = 0
        self._of_attribute: dict[str, range] = {}
        for attribute, values in space.attributes.items():
            self._of_attribute[attribute] = range(first, first := first + len(values))

    def reseed(self, seed: int) -> None:
        """Restarts the random generator from a seed."""
        self._rng = random.Random(seed)

    @staticmethod
    def corpus(space: DescribedSpace) -> list[str]:
        """The texts beyond patterns and values that the tokenizer has to cover."""
        open_ones = [
            _OPEN.format(attribute=plain(attribute), name="", predicate=plain(predicate))
            for attribute in space.attributes
            for predicate in space.binary
        ]
        return [*open_ones, NOTHING]

    def ask(self, scenes: Scenes, scene: int, count: int, open_share: float) -> QuestionBatch:
        """Ask `count` questions about each of B scenes, `scene` being the number of tokens that each begins with."""
        system = self._rng.choices(self._systems, self._shares)[0]
        read_off = scenes.channels()[:, :, len(self._space.values) :]
        rows = []
        for row in range(len(scenes.own)):
            one = Scenes(*(part[row] for part in scenes))
            atoms = self._atoms(one)
            rows.append([self._question(one, atoms, read_off[row], open_share) for _ in range(count)])
        return self._layout.batch(rows, scene, system)

    @staticmethod
    def _atoms(one: Scenes) -> dict[str, np.ndarray[Any, Any]]:
        """The places of a scene's atoms in its arrays, (N, 1 + arity)."""
        named = {"nullary": one.nullary, "unary": one.unary, "binary": one.binary}
        return {name: np.argwhere(array != NO_ATOM) for name, array in named.items()}

    def _question(
        self, one: Scenes, atoms: dict[str, np.ndarray[Any, Any]], read_off: np.ndarray[Any, Any], open_share: float
    ) -> Question:
        rng, space = self._rng, self._space
        if space.binary and len(atoms["binary"]) and rng.random() < open_share:
            return self._open(one, read_off)
        kind, place = self._drawn(one, atoms)
        names = {"nullary": space.nullary, "unary": space.unary, "binary": space.binary}[kind]
        arguments = [int(each) for each in place[1:]]
        called = [self._words.name(space, one.own, number, rng) for number in arguments]
        text = self._words.question(names[int(place[0])], called, rng)
        answer = self.yes if getattr(one, kind)[tuple(place)] == 1 else self.no
        agree = self._agree(one, int(place[0]), arguments) if kind == "binary" else []
        named = list(zip(called, arguments, strict=True))
        return self._probed(text, named, answer, True, read_off, agree)

    def _agree(self, one: Scenes, predicate: int, arguments: Sequence[int]) -> list[int]:
        first, second = arguments
        partners = one.own[one.binary[predicate, first] == 1].any(axis=0)
        values = [np.flatnonzero(one.own[second, of.start : of.stop]) + of.start for of in self._of_attribute.values()]
        return [int(partners[found[0]]) if len(found) else -1 for found in values]

    def _drawn(self, one: Scenes, atoms: dict[str, np.ndarray[Any, Any]]) -> tuple[str, np.ndarray[Any, Any]]:
        rng, of_objects = self._rng, [kind for kind in ("unary", "binary") if len(atoms[kind])]
        luck = rng.random()
        if len(atoms["nullary"]) and (luck < _NULLARY or not of_objects):
            return "nullary", self._one_of(atoms["nullary"])
        luck -= _NULLARY
        true = {kind: np.argwhere(getattr(one, kind) == 1) for kind in of_objects}
        if luck < _TRUE:
            for kind in rng.sample(of_objects, len(of_objects)):
                if len(true[kind]):
                    return kind, self._one_of(true[kind])
        elif luck < _TRUE + _NEAR and len(true.get("binary", ())):
            predicate, first, second = self._one_of(true["binary"])
            legal = atoms["binary"][atoms["binary"][:, 0] == predicate]
            near = legal[(legal[:, 1:] == (first, second)).sum(axis=1) == 1]
            turned = legal[(legal[:, 1:] == (second, first)).all(axis=1)]
            near = turned if len(turned) and rng.random() < 0.25 else near
            if len(near) and rng.random() < _ALIKE:
                own = one.own.astype(np.int32)
                alike = (own[near[:, 1]] * own[first]).sum(axis=1) + (own[near[:, 2]] * own[second]).sum(axis=1)
                near = near[alike == alike.max()]
            if len(near):
                return "binary", self._one_of(near)
        kind = rng.choices(of_objects, [len(atoms[each]) for each in of_objects])[0]
        return kind, self._one_of(atoms[kind])

    def _open(self, one: Scenes, read_off: np.ndarray[Any, Any]) -> Question:
        rng, space = self._rng, self._space
        number = rng.choice(np.flatnonzero(one.own[: space.most].any(axis=1)).tolist())
        predicate, attribute = rng.randrange(len(space.binary)), rng.choice(list(space.attributes))
        second = np.flatnonzero(one.binary[predicate, number] == 1)
        true = [place for place in self._of_attribute[attribute] if len(second) and one.own[second[0], place]]
        name = self._words.name(space, one.own, number, rng)
        text = _OPEN.format(attribute=plain(attribute), name=name, predicate=plain(space.binary[predicate]))
        answer = self._answers[true[0]] if true else self._nothing
        return self._probed(text, [(name, number)], answer, False, read_off)

    def _probed(
        self,
        text: str,
        named: Sequence[tuple[str, int]],
        answer: int,
        yes_no: bool,
        read_off: np.ndarray[Any, Any],
        agree: Sequence[int] = (),
    ) -> Question:
        tokens = self._ids(text)
        ends = [(RowLayout.end_of(self._ids(name), tokens), number) for name, number in named]
        probes = [Probed(end, number, read_off[number].tolist()) for end, number in ends if end is not None]
        return Question(tokens, answer, yes_no, probes, agree)

    def _one_of(self, places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        chosen: np.ndarray[Any, Any] = places[self._rng.randrange(len(places))]
        return chosen

    def _ids(self, text: str) -> list[int]:
        return list(self._tokenizer(text, add_special_tokens=False)["input_ids"])

    def _id(self, token: str) -> int:
        return int(self._tokenizer.convert_tokens_to_ids(token))
