"""Obstacles of unknown shape as the arm plans around them: boxes of two sizes, as many as it takes to cover them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from executive.sim.scene import ItemShape
from executive.sim.spec import ItemSpec
from executive.types import FloatArray, Lump

COUNT = 24
"""Boxes of each size; what is left when they are used up is not avoided."""

SMALL, LARGE = 0.06, 0.14
"""m along each side of one. What is longer than two small ones is covered with large ones."""

_SIZES = {
    edge: tuple(f"unknown-{name}-{number}" for number in range(1, COUNT + 1))
    for edge, name in ((SMALL, "small"), (LARGE, "large"))
}


def boxes() -> tuple[ItemSpec, ...]:
    """The boxes, for the model to plan in."""
    return tuple(
        ItemSpec(name=name, shape="box", size=(edge, edge, edge)) for edge, names in _SIZES.items() for name in names
    )


def shapes(there: Sequence[ItemSpec]) -> dict[str, ItemShape]:
    """Their shapes by name."""
    return {box.name: ItemShape(box.name, np.zeros(3), 0.5 * np.array(box.size)) for box in there}


def covered(lumps: Sequence[Lump]) -> dict[str, FloatArray]:
    """Poses (7,) of boxes that cover lumps, the largest lump first."""
    poses: dict[str, FloatArray] = {}
    free: dict[float, Iterator[str]] = {edge: iter(names) for edge, names in _SIZES.items()}
    for lump in sorted(lumps, key=lambda lump: -float(np.prod(lump.half))):
        edge = LARGE if float(lump.half.max()) > SMALL else SMALL
        for centre in _centres(lump, edge):
            if (name := next(free[edge], None)) is not None:
                poses[name] = np.array([*centre, 1.0, 0.0, 0.0, 0.0])
    return poses


def _centres(lump: Lump, edge: float) -> list[FloatArray]:
    """Where boxes stand that cover a lump, the highest first and none higher than it is."""
    counts = np.maximum(1, np.ceil(2.0 * lump.half / edge - 1e-6)).astype(int)
    reach = np.maximum(lump.half - 0.5 * edge, 0.0)
    middle = lump.centre - [0.0, 0.0, max(0.0, 0.5 * edge - float(lump.half[2]))]
    lines = [np.linspace(side, -side, count) for side, count in zip(reach, counts, strict=True)]
    return [middle + np.array([x, y, z]) for z, x, y in itertools.product(lines[2], lines[0], lines[1])]
