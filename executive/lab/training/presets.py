"""Presets of training: the size of the model, and the number of steps and samples per stage. Torch is not needed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace


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
    def stride(self) -> int:
        """The side of a cell of the vision encoder's grid, in pixels: the stem's 4, doubled by each further stage."""
        return int(2 ** (len(self.widths) + 1))

    @property
    def grid(self) -> int:
        """The number of cells along a picture's side."""
        return self.side // self.stride

    @property
    def cells(self) -> int:
        return self.grid**2

    @property
    def mask(self) -> int:
        """The side of a mask in pixels: some for each cell of a grid that is twice as fine."""
        return 48 if self.grid <= 12 else 96


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

    def scaled(self, share: float) -> Schedule:
        """The same schedule over a share of the steps, at least one if there were any."""
        steps = max(min(self.steps, 1), round(share * self.steps))
        return replace(self, steps=steps, warm=max(1, min(self.warm, steps // 4)))

    def at(self, step: int) -> float:
        """The learning rate at a step."""
        rise = min(1.0, (step + 1) / self.warm)
        return self.rate * rise * (0.5 * (1.0 + math.cos(math.pi * min(step, self.steps) / self.steps)) + 0.01)


@dataclass(frozen=True, slots=True)
class Preset:
    """The settings of all stages. The defaults are those of the model that is shipped.

    `shards` files of `moments` each; per step, `batch` pictures in stage 2, `imagined` scenes in stage 3, `scenes` in
    the later ones, and `questions` about each; in the first `align` steps of stage 4 only the projector learns.
    `further`: the training goes on with a model of the same domain, and keeps its words.
    """

    size: ModelSize = field(default_factory=ModelSize)
    shards: int = 44
    moments: int = 256
    tower: Schedule = Schedule(1200, 2e-3, 100, clip=2.0)
    language: Schedule = Schedule(700, 1.5e-3)
    together: Schedule = Schedule(1400, 7e-4)
    fewer: Schedule = Schedule(600, 4e-4, 30)
    batch: int = 80
    imagined: int = 12
    scenes: int = 12
    questions: int = 16
    align: int = 120
    vocabulary: int = 1200
    further: bool = False

    def scaled(self, share: float) -> Preset:
        """The same training with a share of the pictures and of the steps of each stage."""
        return replace(
            self,
            shards=max(1, round(share * self.shards)),
            align=max(1, round(share * self.align)),
            **{stage: getattr(self, stage).scaled(share) for stage in ("tower", "language", "together", "fewer")},
        )

    def in_parts(self) -> Preset:
        """The training for objects that are described: most steps of its first stage show small parts of pictures,
        take a fraction of the time, and are many times as many."""
        return replace(
            self, tower=replace(self.tower, steps=_SMALL_STEPS * self.tower.steps, rate=0.5 * self.tower.rate)
        )

    def warmed(self, cameras: int, alike: bool = True) -> Preset:
        """The training that starts from a model that was trained before. What is new to that is this domain's
        pictures and words, and not how to see and to look words up. One that is not `alike` knows how to see alone.
        With one camera there is no subset to train on."""
        if not alike:
            return replace(self, tower=self.tower.scaled(_SEEING))
        shorter = {stage: getattr(self, stage).scaled(share) for stage, share in _WARM.items()}
        if cameras == 1:
            shorter["fewer"] = replace(self.fewer, steps=0)
        return replace(self, shards=max(1, round(_WARM["together"] * self.shards)), **shorter)

    def furthered(self, cameras: int) -> Preset:
        """The training that goes on with a model of the same domain: it sees and asks as before, and has no words to
        learn."""
        shorter = {stage: getattr(self, stage).scaled(share) for stage, share in _FURTHER.items()}
        fewer = self.fewer.scaled(_WARM["fewer"]) if cameras > 1 else replace(self.fewer, steps=0)
        shards, language = max(1, round(_WARM["together"] * self.shards)), replace(self.language, steps=0)
        return replace(self, shards=shards, language=language, fewer=fewer, align=0, further=True, **shorter)

    def efforts(self, pace: Pace) -> dict[str, float]:
        """The expected seconds of each stage that has any steps, in order."""
        steps = {name: getattr(self, name).steps for name in ("tower", "language", "together", "fewer")}
        drawn = {"pictures": self.shards * self.moments * pace.moment}
        return drawn | {name: count * getattr(pace, name) for name, count in steps.items() if count}

    def fitted(self, pace: Pace, seconds: float) -> Preset:
        """The same training, shortened until all of it fits into `seconds`.

        Raises:
            ValueError: nothing is left of it then.
        """
        share = min(1.0, seconds / sum(self.efforts(pace).values()))
        if share < _LEAST_SHARE:
            raise ValueError(f"of what it needs, only {share:.1%} would be left")
        return self if share == 1.0 else self.scaled(share)


_SMALL_STEPS = 15
"""How many small steps of the first stage take the place of one."""

_WARM = {"tower": 0.3, "language": 0.4, "together": 0.4, "fewer": 0.4}
"""The share of the steps of each stage that a training takes which does not start from nothing."""

_FURTHER = {"tower": 0.3, "together": 0.6}
"""The same for one that goes on with a model of the same domain."""

_SEEING = 0.6
"""The same for the first stage of one that starts with another model's vision encoder."""

_LEAST_SHARE = 0.05
"""Of a training, below which there is no point in it."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a machine takes, in seconds: to draw a moment (all cameras, all processes at work), and for a step of
    each stage."""

    moment: float
    tower: float
    language: float
    together: float
    fewer: float


PRESETS = {
    "small": Preset(),
    "fine": Preset(
        size=ModelSize(side=256, widths=(32, 64, 160), depths=(1, 2, 2), layers=4),
        shards=48,
        tower=Schedule(3000, 2e-3, 100, clip=2.0),
        language=Schedule(1800, 6e-4, 30),
        together=Schedule(3000, 7e-4),
        fewer=Schedule(0, 4e-4),
        batch=20,
        imagined=5,
        scenes=8,
        questions=24,
        align=150,
    ),
    "smallest": Preset(
        size=SMALLEST,
        shards=2,
        moments=6,
        tower=Schedule(4, 1e-3),
        language=Schedule(4, 1e-3),
        together=Schedule(4, 1e-3),
        fewer=Schedule(3, 1e-3),
        batch=4,
        imagined=2,
        scenes=2,
        questions=4,
        align=2,
    ),
}
"""By name (--recipe): the model that is shipped, one for many small things in a single picture (cells of 16 pixels in
place of 32; it can start from the former), and one for testing that all stages run."""
