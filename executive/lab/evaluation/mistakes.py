"""The worst mistakes of a model: the pictures, the questions and the answers."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from executive.lab.collection.dataset import Point
from executive.types import Atom, Belief, Image

SHOWN = 24
"""How many looks are kept."""

_HEIGHT = 240
"""Pixels; that of the pictures, side by side."""

_MARGIN, _LINE = 16, 24
"""Pixels, of the sheet."""


class Answered(NamedTuple):
    """One atom of a look: what is true, P(true) or None where unanswered, and what was asked."""

    atom: Atom
    truth: bool
    probability: float | None
    question: str

    @property
    def error(self) -> float:
        """How far from the truth, 0 to 1; no answer is as bad as one that is wrong by a hair."""
        return 0.5 if self.probability is None else abs(self.probability - self.truth)

    @property
    def wrong(self) -> bool:
        """Whether the atom is taken for what it is not, or for nothing."""
        return self.probability is None or (self.probability >= 0.5) is not self.truth


@dataclass(frozen=True, slots=True, eq=False)
class Mistake:
    """A look with its wrong answers, the worst first; without any, with the answer that was nearest to being wrong.
    `picture` has what the cameras saw, side by side."""

    episode: int
    step: int
    action: str
    cameras: tuple[str, ...]
    picture: Image
    answers: tuple[Answered, ...]

    @property
    def error(self) -> float:
        return self.answers[0].error


@dataclass(slots=True)
class Mistakes:
    """Collects the worst look of each episode and atom, so that one long confusion does not fill the whole sheet."""

    most: int = SHOWN
    _worst: dict[tuple[int, Atom], Mistake] = field(default_factory=dict)

    def add(
        self,
        point: Point,
        belief: Belief,
        pictures: Callable[[], Mapping[str, Image]],
        questions: Mapping[Atom, str],
    ) -> None:
        """One look, and what was said of it. `pictures` is asked for what was shown if the look is kept."""
        each = [
            Answered(atom, truth, belief.probability.get(atom), questions.get(atom, ""))
            for atom, truth in point.facts.items()
            if atom in belief.probability or atom in belief.unanswered
        ]
        if not each:
            return
        each.sort(key=lambda answer: (-answer.error, answer.atom))
        key = (point.episode, each[0].atom)
        there = self._worst.get(key)
        if there is not None and there.error >= each[0].error:
            return
        if there is None and len(self._worst) >= self.most:
            least = min(self._worst, key=lambda other: self._worst[other].error)
            if self._worst[least].error >= each[0].error:
                return
            del self._worst[least]
        images = pictures()
        if not images:
            return
        wrong = tuple(answer for answer in each if answer.wrong) or (each[0],)
        picture = side_by_side(images)
        self._worst[key] = Mistake(point.episode, point.step, point.action, tuple(images), picture, wrong)

    def sheet(self) -> tuple[Mistake, ...]:
        """The worst first."""
        return tuple(sorted(self._worst.values(), key=lambda each: (-each.error, each.episode, each.step)))


def side_by_side(images: Mapping[str, Image], height: int = _HEIGHT) -> Image:
    """Pictures in a row, each `height` pixels high."""
    from PIL import Image as Picture

    scaled = [
        np.asarray(Picture.fromarray(image).resize((max(1, round(image.shape[1] * height / image.shape[0])), height)))
        for image in images.values()
    ]
    gap = np.full((height, 4, 3), 255, dtype=np.uint8)
    parts = [part for picture in scaled for part in (picture, gap)][:-1]
    return np.concatenate(parts, axis=1)


def draw(mistakes: Sequence[Mistake], listed: int = 4) -> bytes:
    """All of them on one sheet, a JPEG: pictures, and below them what was asked, what is true, and what was said."""
    from PIL import Image as Picture
    from PIL import ImageDraw, ImageFont

    text, small = ImageFont.load_default(17), ImageFont.load_default(14)
    width = max(mistake.picture.shape[1] for mistake in mistakes) + 2 * _MARGIN
    heights = [mistake.picture.shape[0] + _LINE * (1 + min(listed, len(mistake.answers))) + 28 for mistake in mistakes]
    sheet = Picture.new("RGB", (width, sum(heights) + 2 * _MARGIN), "white")
    pen, top = ImageDraw.Draw(sheet), _MARGIN
    for mistake, height in zip(mistakes, heights, strict=True):
        where = f"episode {mistake.episode}, step {mistake.step}, after {mistake.action}: {', '.join(mistake.cameras)}"
        pen.text((_MARGIN, top), where, "#5d6670", small)
        sheet.paste(Picture.fromarray(mistake.picture), (_MARGIN, top + _LINE))
        line = top + _LINE + mistake.picture.shape[0] + 5
        for answer in mistake.answers[:listed]:
            said = "unanswered" if answer.probability is None else f"P(true) = {answer.probability:.3f}"
            told = f"{answer.atom} is {'true' if answer.truth else 'false'}; {said}; {answer.question}"
            pen.text((_MARGIN, line), told, "#c0341d" if answer.wrong else "#1f2328", text)
            line += _LINE
        top += height
    buffer = io.BytesIO()
    sheet.save(buffer, "JPEG", quality=85)
    return buffer.getvalue()
