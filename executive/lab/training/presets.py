"""Presets of training: the size of the model, and the number of steps and samples per stage. Torch is not needed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

STRIDE = 32
"""The side of a cell of the vision encoder's grid, in pixels."""


@dataclass(frozen=True, slots=True)
class ModelSize:
    """The size of a model: the side of a picture in pixels, widths and depths of the vision encoder's stages, and the
    decoder's dimensions."""

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
        """The number of cells along a picture's side."""
        return self.side // STRIDE

    @property
    def cells(self) -> int:
        return self.grid**2


SMALLEST = ModelSize(
    side=64, stem=8, widths=(8, 8, 16, 16), depths=(1, 1, 1, 1), hidden=32, layers=2, heads=2, inner=32
)
"""For tests: it trains in seconds, and learns little."""


@dataclass(frozen=True, slots=True)
class Schedule:
    """The learning-rate schedule of a stage: linear warm-up to `rate` in `warm` steps, then a cosine to zero over
    `steps`; `decay` is AdamW's weight decay, and `clip` the largest norm of the gradient of a part."""

    steps: int
    rate: float
    warm: int = 50
    decay: float = 0.05
    clip: float = 1.0

    def at(self, step: int) -> float:
        """The learning rate at a step."""
        rise = min(1.0, (step + 1) / self.warm)
        return self.rate * rise * (0.5 * (1.0 + math.cos(math.pi * min(step, self.steps) / self.steps)) + 0.01)


@dataclass(frozen=True, slots=True)
class Preset:
    """The settings of all stages. The defaults are those of the model that is shipped.

    `shards` files of `moments` each; `batch` pictures per step in stage 2, `scenes` per step in the later ones and
    `questions` about each; in the first `align` steps of stage 4 only the projector learns.
    """

    size: ModelSize = field(default_factory=ModelSize)
    shards: int = 44
    moments: int = 256
    tower: Schedule = Schedule(1200, 2e-3, 100, clip=2.0)
    language: Schedule = Schedule(700, 1.5e-3)
    together: Schedule = Schedule(1400, 7e-4)
    fewer: Schedule = Schedule(600, 4e-4, 30)
    batch: int = 80
    scenes: int = 12
    questions: int = 16
    align: int = 120
    vocabulary: int = 1200

    def efforts(self, cameras: int) -> dict[str, float]:
        """The expected core seconds of each stage, in order. Only their ratios matter."""
        seen, read = cameras * self.scenes * _SEEN, self.scenes * self.questions * _READ
        return {
            "pictures": self.shards * self.moments * cameras * _DRAWN,
            "tower": self.tower.steps * self.batch * _SEEN,
            "language": self.language.steps * read,
            "together": self.together.steps * (seen + read),
            "fewer": self.fewer.steps * (0.8 * seen + read),
        }


_DRAWN, _SEEN, _READ = 0.028, 0.019, 0.0029
"""Measured core seconds per picture drawn, per picture of a training step, and per question of a training step."""

PRESETS = {
    "small": Preset(),
    "smallest": Preset(
        size=SMALLEST,
        shards=2,
        moments=6,
        tower=Schedule(4, 1e-3),
        language=Schedule(4, 1e-3),
        together=Schedule(4, 1e-3),
        fewer=Schedule(3, 1e-3),
        batch=4,
        scenes=2,
        questions=4,
        align=2,
    ),
}
"""By name (--recipe): the model that is shipped, and one for testing that all stages run."""
