"""Batches of training questions: many questions per scene in one row, separated by an attention mask.

This is the layout of inference (`executive.s3e.backends.prefix_cache`): the tokens of the scene come first; each
question attends to them and to itself, and its positions count as if it were the only one.

There are three kinds. Yes/no questions, in many wordings, are what the model is for. Open questions ("where is the
lemon?", answered by one word) and probes (a linear head at an item's name predicts the item's facets from an inner
layer) are auxiliary: with yes/no answers alone, a language model takes long to learn to look a name up among the
picture tokens.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from executive.lab.training import tokenizer as words
from executive.lab.training.label_space import LabelSpace
from executive.lab.training.wordings import Wordings

if TYPE_CHECKING:
    import torch

NOTHING = "nothing"
"""The answer to an open question about an item of which no atom is true."""

_OPEN = (
    "where is the {}?",
    "what is true of the {}?",
    "what is the {} on or in?",
    "where do you see the {}?",
    "tell me where the {} is",
)

_UNRELATED = 0.04
"""The probability that unrelated words are put before or after a question."""

_CHATTER = ("please", "tell me", "quick question", "answer yes or no", "thanks", "look closely", "hello", "now", "well")


@dataclass(frozen=True, slots=True)
class QuestionBatch:
    """Questions about B scenes as tensors. The row of a scene is its P tokens, then T tokens of text.

    `ids` (B, T); `positions` (B, P + T); `mask` (B, 1, P + T, P + T) bool, true where a token may look; `questions`
    (B, Q, L), the places of the tokens of each question in its row, -1 after its last one; `last` (N,) are flat indices
    into (B * (P + T)) of the places where answers are read, `answers` (N,) the token each should be, `yes_no` (N,)
    bool, and `agree` (N, A) in which attributes objects agree (`Question`), in which -1 is unknown.
    `probed` (M,) flat indices of item names, `facets` (M, F) the facets to be read there, and `known` (M, F) what is
    true of them, in which -1 is padding.
    """

    ids: torch.Tensor
    positions: torch.Tensor
    mask: torch.Tensor
    questions: torch.Tensor
    last: torch.Tensor
    answers: torch.Tensor
    yes_no: torch.Tensor
    agree: torch.Tensor
    probed: torch.Tensor
    facets: torch.Tensor
    known: torch.Tensor

    def to(self, device: torch.device) -> QuestionBatch:
        """Copies the batch to another device."""
        return QuestionBatch(*(getattr(self, part.name).to(device) for part in fields(self)))


class QuestionSampler:
    """Samples questions and lays them out in batches.

    Args:
        systems: system prompts between pictures and questions, each with its probability; "" is none.
    """

    def __init__(
        self,
        labels: LabelSpace,
        wordings: Wordings,
        tokenizer: Any,
        systems: Sequence[tuple[str, float]],
        untranslated: str,
        seed: int,
    ) -> None:
        self._labels, self._wordings, self._tokenizer = labels, wordings, tokenizer
        self._rng = random.Random(seed)
        self._systems = [[self._id(words.SYSTEM), *self._ids(text)] if text else [] for text, _ in systems]
        self._shares = [share for _, share in systems]
        self._untranslated = [self._id(words.SYSTEM), *self._ids(untranslated)]
        self.yes, self.no = self._id("yes"), self._id("no")
        self._true, self._false = self._id("true"), self._id("false")
        self.affirmative = (self.yes, self._true)
        self._open = [self._first(labels.label(facet)) for facet in range(len(labels.facets))]
        self._nothing = self._first(NOTHING)
        named = {atom for _, atom in labels.facets}
        self._without_item = [index for index in range(len(labels.atoms)) if index not in named]
        self._facets = [labels.of_item(item) for item in range(len(labels.items))]
        self._layout = RowLayout(self._id(words.USER), self._id(words.ASSISTANT), self._facets)

    def reseed(self, seed: int) -> None:
        """Restarts the random generator from a seed."""
        self._rng = random.Random(seed)

    @staticmethod
    def corpus(labels: LabelSpace) -> list[str]:
        """The texts beyond the wordings that the tokenizer has to cover."""
        named = [labels.label(facet) for facet in range(len(labels.facets))]
        return [*_OPEN, *_CHATTER, NOTHING, *named]

    def ask(
        self, facts: np.ndarray[Any, np.dtype[np.bool_]], scene: int, count: int, open_share: float
    ) -> QuestionBatch:
        """Ask `count` questions about each of B scenes, `facts` (B, A) being true of them and `scene` the number of
        tokens that each begins with."""
        rng = self._rng
        raw = rng.random() < 0.06
        system = rng.choices(self._systems, self._shares)[0]
        if raw:
            system = self._untranslated if rng.random() < 0.3 else []
        rows = [[self._question(row, open_share, raw) for _ in range(count)] for row in facts]
        return self._layout.batch(rows, scene, system)

    def official(self, facts: np.ndarray[Any, np.dtype[np.bool_]], scene: int, system: int = -1) -> QuestionBatch:
        """Every atom of each scene once, in the wording that runs use."""
        rows = []
        for row in facts:
            questions = []
            for index, atom in enumerate(self._labels.atoms):
                text = self._ids(self._wordings.official[atom])
                questions.append(Question(text, self.yes if row[index] else self.no, True))
            rows.append(questions)
        return self._layout.batch(rows, scene, self._systems[system])

    def _question(self, facts: np.ndarray[Any, np.dtype[np.bool_]], open_share: float, raw: bool) -> Question:
        rng, labels = self._rng, self._labels
        if raw:
            index = rng.randrange(len(labels.atoms))
            answer = self._true if facts[index] else self._false
            return Question(self._ids(str(labels.atoms[index])), answer, True)
        if rng.random() < open_share:
            item = rng.randrange(len(labels.items))
            true = [facet for facet in self._facets[item] if facts[labels.facets[facet][1]]]
            answer = self._open[rng.choice(true)] if true else self._nothing
            name = rng.choice(self._wordings.names[labels.items[item]])
            return self._probed(rng.choice(_OPEN).format(name), name, item, answer, False, facts)
        index = self._atom(facts)
        atom = labels.atoms[index]
        text, names = self._wordings.draw(atom, rng)
        answer = self.yes if facts[index] else self.no
        if rng.random() < _UNRELATED:
            extra = rng.choice(_CHATTER)
            text = f"{extra}, {text}" if rng.random() < 0.5 else f"{text} {extra}"
        for name, item_name in zip(names, atom.args, strict=True):
            if item_name in labels.items:
                return self._probed(text, name, labels.items.index(item_name), answer, True, facts)
        return Question(self._ids(text), answer, True)

    def _atom(self, facts: np.ndarray[Any, np.dtype[np.bool_]]) -> int:
        """Samples an atom; true ones, and those that name no item, more often than at random. The latter are few, and
        only their own answers teach them."""
        if self._without_item and self._rng.random() < 0.15:
            return self._rng.choice(self._without_item)
        if self._rng.random() < 0.25:
            true = np.flatnonzero(facts)
            if len(true):
                return int(true[self._rng.randrange(len(true))])
        return self._rng.randrange(len(facts))

    def _probed(
        self, text: str, name: str, item: int, answer: int, yes_no: bool, facts: np.ndarray[Any, np.dtype[np.bool_]]
    ) -> Question:
        tokens = self._ids(text)
        end = RowLayout.end_of(self._ids(name), tokens)
        known = [int(facts[self._labels.facets[facet][1]]) for facet in self._facets[item]]
        return Question(tokens, answer, yes_no, [] if end is None else [Probed(end, item, known)])

    def _ids(self, text: str) -> list[int]:
        return list(self._tokenizer(text, add_special_tokens=False)["input_ids"])

    def _id(self, token: str) -> int:
        return int(self._tokenizer.convert_tokens_to_ids(token))

    def _first(self, text: str) -> int:
        return self._ids(text)[0]


class Probed(NamedTuple):
    """The end of an item's name (counted from the token before the question), the item's index, and the truth of each
    of its facets."""

    end: int
    item: int
    known: list[int]


@dataclass(frozen=True, slots=True)
class Question:
    """A question's tokens and answer, and its probes. `agree`, of a question whether one object stands in a relation to
    another: for each attribute, whether what it does stand in that relation to has the value that the other one has;
    -1 where there is no such value."""

    tokens: list[int]
    answer: int
    yes_no: bool
    probes: Sequence[Probed] = ()
    agree: Sequence[int] = ()


class RowLayout:
    """The layout of questions in rows.

    Args:
        user, assistant: the tokens before a question, and before its answer.
        facets: item -> the indices of what a probe at its name is to read.
    """

    def __init__(self, user: int, assistant: int, facets: Sequence[Sequence[int]]) -> None:
        self._user, self._assistant, self._facets = user, assistant, facets

    @staticmethod
    def end_of(name: Sequence[int], tokens: Sequence[int]) -> int | None:
        """Where a name ends for the last time in a question, counted from the token before that; None where it is
        nowhere."""
        ends = [
            begin + len(name) for begin in range(len(tokens) - len(name) + 1)
            if tokens[begin : begin + len(name)] == name
        ]  # fmt: skip
        return ends[-1] if ends else None

    def batch(self, rows: Sequence[Sequence[Question]], scene: int, system: Sequence[int]) -> QuestionBatch:
        """One row of questions for each scene, after the `scene` tokens that show it and those of `system`."""
        import torch

        start = scene + len(system)
        length = len(system) + max(sum(len(question.tokens) + 2 for question in row) for row in rows)
        total, count = scene + length, len(rows)
        most, longest = max(map(len, rows)), max(len(question.tokens) + 2 for row in rows for question in row)
        places = np.full((count, most, longest), -1)
        ids, positions = np.zeros((count, length), np.int64), np.zeros((count, total), np.int64)
        segment = np.full((count, total), -1)
        ids[:, : len(system)], positions[:, :start], segment[:, :start] = system, np.arange(start), 0
        last, answers, yes_no, agree, probed, facets, known = [], [], [], [], [], [], []
        widest = max(len(own) for own in self._facets)
        attributes = max(len(question.agree) for row in rows for question in row)
        for number, row in enumerate(rows):
            at = len(system)
            for order, question in enumerate(row):
                tokens = [self._user, *question.tokens, self._assistant]
                here = scene + at
                ids[number, at : at + len(tokens)] = tokens
                positions[number, here : here + len(tokens)] = start + np.arange(len(tokens))
                segment[number, here : here + len(tokens)] = order + 1
                places[number, order, : len(tokens)] = np.arange(here, here + len(tokens))
                last.append(number * total + here + len(tokens) - 1)
                answers.append(question.answer)
                yes_no.append(question.yes_no)
                agree.append([*question.agree, *([-1] * (attributes - len(question.agree)))])
                for probe in question.probes:
                    own = self._facets[probe.item]
                    missing = widest - len(own)
                    probed.append(number * total + here + probe.end)
                    facets.append([*own, *([0] * missing)])
                    known.append([*probe.known, *([-1] * missing)])
                at += len(tokens)
        same = (segment[:, :, None] == segment[:, None, :]) | (segment[:, None, :] == 0)
        mask = np.tril(np.ones((total, total), bool)) & same | np.eye(total, dtype=bool)
        return QuestionBatch(
            torch.from_numpy(ids),
            torch.from_numpy(positions),
            torch.from_numpy(mask[:, None]),
            torch.from_numpy(places),
            torch.tensor(last),
            torch.tensor(answers),
            torch.tensor(yes_no),
            torch.tensor(agree, dtype=torch.float32).reshape(len(answers), attributes),
            torch.tensor(probed, dtype=torch.long),
            torch.tensor(facets, dtype=torch.long).reshape(-1, widest),
            torch.tensor(known, dtype=torch.float32).reshape(-1, widest),
        )
