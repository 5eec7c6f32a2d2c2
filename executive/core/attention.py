"""Attention: what a look asks about, through which cameras, and which pictures are uninformative. Pure.

Questions cost time, and with many objects there are more atoms than a look can ask about: their number grows with the
product of the objects. What a step changes, needs and leads to does not, so that is what is asked (issue 5, part 8).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from executive.types import Atom, Image, PictureFault, Step

DOUBTFUL = 0.02
"""An atom whose probability is further than this from 0 and from 1 is worth a question of its own."""

_FLAT = 8
"""Grey levels (of 255) between the darkest and the brightest value of a picture that shows nothing."""

_BLOCK, _MAX_DIFFERENCE = 8, 1.5
"""Two pictures show the same if no square of so many pixels a side differs by more than so many grey levels on
average: noise averages out."""


@dataclass(frozen=True, slots=True)
class Attention:
    """Which cameras a domain uses for what.

    `closer` maps a predicate or an object to the cameras that show it best; an atom goes by its predicate first, then
    by its arguments, and one that has none is best seen by all. `carried` maps an action to the atom that is true
    while its skill carries something: a predicate, and the positions of its arguments among the step's. `guard` are
    the cameras through which that is watched; none means all. `shown` are the cameras whose pictures are taken at
    all; none means all.
    """

    closer: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    carried: Mapping[str, tuple[str, tuple[int, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    guard: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()

    def only(self, shown: Sequence[str]) -> Attention:
        """Return the same with the pictures of these cameras alone: one that is not among them shows nothing best."""
        closer = {name: tuple(each for each in best if each in shown) for name, best in self.closer.items()}
        told = {name: best for name, best in closer.items() if best and len(best) < len(shown)}
        return replace(self, closer=told, guard=tuple(each for each in self.guard if each in shown), shown=tuple(shown))

    def cameras(self, atom: Atom) -> tuple[str, ...]:
        """Return the cameras that show best what the atom is about; none where the domain names none."""
        return next((self.closer[name] for name in (atom.predicate, *atom.args) if name in self.closer), ())

    def groups(self, atoms: Iterable[Atom]) -> dict[tuple[str, ...], list[Atom]]:
        """Return the atoms by the cameras that show them best."""
        groups: dict[tuple[str, ...], list[Atom]] = {}
        for atom in atoms:
            groups.setdefault(self.cameras(atom), []).append(atom)
        return groups

    def held(self, step: Step) -> Atom | None:
        """Return what is to be true while the step's skill carries something."""
        return step.about(self.carried)


def questions(
    atoms: Sequence[Atom], matters: Iterable[Iterable[Atom]], probability: Mapping[Atom, float], most: int
) -> tuple[Atom, ...]:
    """Return what to ask about, at most `most` of the task's `atoms`: all of them if they are no more.

    Else `matters` in the order given (the effects of the step before, the preconditions of the next one, ...), each
    atom once, and between the first two and the rest of them what is in doubt, the most doubtful first.
    """
    if len(atoms) <= most:
        return tuple(atoms)
    effects, needs, *rest = (list(group) for group in matters)
    doubtful = [atom for atom in atoms if DOUBTFUL < probability.get(atom, 0.5) < 1.0 - DOUBTFUL]
    doubtful.sort(key=lambda atom: (abs(probability.get(atom, 0.5) - 0.5), atom))
    wanted = dict.fromkeys(atom for group in (effects, needs, doubtful, *rest) for atom in group)
    return tuple(wanted)[:most]


def uninformative(images: Mapping[str, Image], before: Mapping[str, Image]) -> dict[str, PictureFault]:
    """Return the cameras whose pictures are uninformative, each with the reason.

    Args:
        images: what the cameras show now.
        before: what each showed last; {} where two pictures of one thing may well be the same, bit for bit, as no
            sensor's noise is in them.
    """
    frozen = {name for name in images.keys() & before.keys() if np.array_equal(images[name], before[name])}
    return {
        name: PictureFault.PLAIN if _is_plain(image) else PictureFault.FROZEN
        for name, image in images.items()
        if name in frozen or _is_plain(image)
    }


def same_view(some: Mapping[str, Image], others: Mapping[str, Image]) -> bool:
    """Return whether pictures of the same cameras show the same, up to sensor noise."""
    return some.keys() == others.keys() and all(_same_image(image, others[name]) for name, image in some.items())


def _same_image(image: Image, other: Image) -> bool:
    if image.shape != other.shape:
        return False
    apart = image.astype(np.float32) - other
    for axis in (0, 1):
        starts, length = np.arange(0, apart.shape[axis], _BLOCK), apart.shape[axis]
        sizes = np.diff(starts, append=length)
        apart = np.add.reduceat(apart, starts, axis) / (sizes[:, None, None] if axis == 0 else sizes[:, None])
    return float(np.abs(apart).max(initial=0.0)) <= _MAX_DIFFERENCE


def _is_plain(image: Image) -> bool:
    return int(image.max(initial=0)) - int(image.min(initial=255)) <= _FLAT
