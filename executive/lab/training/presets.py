"""How large an eye is, and how much of everything it is grown with. Nothing here needs torch."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

STRIDE = 32
"""Pixels to a cell's side."""


@dataclass(frozen=True, slots=True)
class Size:
    """How large an eye is: `side` pixels of a picture, widths and depths of the tower's stages, and the decoder's."""

    side: int = 192
    stem: int = 32
    widths: tuple[int, ...] = (32, 64, 160, 256)
    depths: tuple[int, ...] = (1, 2, 2, 2)
    hidden: int = 192
    layers: int = 3
    heads: int = 4
    inner: int = 384

    @property
    def grid(self) -> int:
        """Cells to a picture's side."""
        return self.side // STRIDE

    @property
    def cells(self) -> int:
        return self.grid**2


SMALLEST = Size(side=64, stem=8, widths=(8, 8, 16, 16), depths=(1, 1, 1, 1), hidden=32, layers=2, heads=2, inner=32)
"""Learns nothing much, in seconds: for tests."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How a stage descends: over `steps`, at a rate that rises to `rate` in `warm` steps and falls to nothing along a
    cosine; `warm` steps are the rise, `decay` is AdamW's and `clip` the largest norm of a part's gradient."""

    steps: int
    rate: float
    warm: int = 50
    decay: float = 0.05
    clip: float = 1.0

    def at(self, step: int) -> float:
        """The rate at a step."""
        rise = min(1.0, (step + 1) / self.warm)
        return self.rate * rise * (0.5 * (1.0 + math.cos(math.pi * min(step, self.steps) / self.steps)) + 0.01)


@dataclass(frozen=True, slots=True)
class Recipe:
    """How much of everything. The numbers are those of the eye that is shipped.

    `shards` files of `moments` each; `batch` pictures a step in stage 2, `scenes` a step in the later ones and
    `questions` about each; `align` are the first steps of stage 4, in which only the projector learns.
    """

    size: Size = field(default_factory=Size)
    shards: int = 44
    moments: int = 256
    tower: Pace = Pace(1200, 2e-3, 100, clip=2.0)
    language: Pace = Pace(700, 1.5e-3)
    together: Pace = Pace(1400, 7e-4)
    fewer: Pace = Pace(600, 4e-4, 30)
    batch: int = 80
    scenes: int = 12
    questions: int = 16
    align: int = 120
    vocabulary: int = 1200

    def efforts(self, cameras: int) -> dict[str, float]:
        """About how many seconds of a core each stage takes, in order. Only how they compare matters."""
        seen, read = cameras * self.scenes * _SEEN, self.scenes * self.questions * _READ
        return {
            "pictures": self.shards * self.moments * cameras * _DRAWN,
            "tower": self.tower.steps * self.batch * _SEEN,
            "language": self.language.steps * read,
            "together": self.together.steps * (seen + read),
            "fewer": self.fewer.steps * (0.8 * seen + read),
        }


_DRAWN, _SEEN, _READ = 0.028, 0.019, 0.0029
"""Seconds of a core that it took to draw a picture, to learn from one, and to learn from a question."""

RECIPES = {
    "small": Recipe(),
    "smallest": Recipe(
        size=SMALLEST,
        shards=2,
        moments=6,
        tower=Pace(4, 1e-3),
        language=Pace(4, 1e-3),
        together=Pace(4, 1e-3),
        fewer=Pace(3, 1e-3),
        batch=4,
        scenes=2,
        questions=4,
        align=2,
    ),
}
"""By name: the eye that is shipped, and one that only shows that all stages run."""
