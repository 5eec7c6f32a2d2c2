"""What a look asks about, through which cameras, and which pictures tell nothing. Pure.

Questions cost time, and with many objects there are more atoms than a look can ask about: their number grows with the
product of the objects. What a step changes, needs and leads to does not, so that is what is asked (issue 5, part 8).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from executive.types import Atom, Image, Step

DOUBTFUL = 0.02
"""An atom whose probability is further than this from 0 and from 1 is worth a question of its own."""

PLAIN = "its picture is all of one colour"
FROZEN = "its picture is the same, bit for bit, as before the last action"
"""Why a picture tells nothing."""

_FLAT = 8
"""Grey levels (of 255) between the darkest and the brightest value of a picture that shows nothing."""


@dataclass(frozen=True, slots=True)
class Attention:
    """What a domain says of looking.

    `closer` maps a predicate or an object to the cameras that show it best; an atom goes by its predicate first, then
    by its arguments, and one that has none is best seen by all. `carried` maps an action to the atom that is true
    while its skill carries something: a predicate, and the positions of its arguments among the step's. `guard` are
    the cameras through which that is watched; none means all.
    """

    closer: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    carried: Mapping[str, tuple[str, tuple[int, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    guard: tuple[str, ...] = ()

    def cameras(self, atom: Atom) -> tuple[str, ...]:
        """Those that show best what the atom is about; none where nobody says."""
        return next((self.closer[name] for name in (atom.predicate, *atom.args) if name in self.closer), ())

    def groups(self, atoms: Iterable[Atom]) -> dict[tuple[str, ...], list[Atom]]:
        """The atoms by the cameras that show them best."""
        groups: dict[tuple[str, ...], list[Atom]] = {}
        for atom in atoms:
            groups.setdefault(self.cameras(atom), []).append(atom)
        return groups

    def held(self, step: Step) -> Atom | None:
        """What is to be true while the step's skill carries something."""
        if step.action not in self.carried:
            return None
        predicate, positions = self.carried[step.action]
        return Atom(predicate, tuple(step.args[position] for position in positions))

    def witnesses(self, step: Step, cameras: Iterable[str]) -> frozenset[str]:
        """The cameras whose picture changes when the step is done: those that show an object of it closely, and those
        that show nothing in particular."""
        special = {camera for names in self.closer.values() for camera in names}
        close = {camera for name in step.args for camera in self.closer.get(name, ())}
        return frozenset(camera for camera in cameras if camera in close or camera not in special)


def questions(
    atoms: Sequence[Atom], matters: Iterable[Iterable[Atom]], probability: Mapping[Atom, float], most: int
) -> tuple[Atom, ...]:
    """What to ask about, at most `most` of the task's `atoms`: all of them if they are no more.

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


def useless(
    images: Mapping[str, Image],
    before: Mapping[str, Image],
    changed: Collection[str],
    moved: bool,
    frozen: Collection[str] = (),
) -> dict[str, str]:
    """The cameras whose pictures tell nothing, each with the reason.

    Args:
        images: what the cameras show now.
        before: what they showed before the last action; {} where there was none.
        changed: the cameras that ought to show something else since.
        moved: whether the arm is elsewhere since.
        frozen: the cameras that were frozen before the last action.
    """
    plain = {camera for camera, image in images.items() if _is_plain(image)}
    still = {camera for camera in images if camera in before and np.array_equal(images[camera], before[camera])}
    # That nothing has changed for all of them may be so; that it did for the others and not for this one may not.
    suspects = set(changed) if moved or (images.keys() & before.keys()) - still - plain else set()
    return {
        camera: PLAIN if camera in plain else FROZEN
        for camera in images
        if camera in plain or camera in still & (suspects | set(frozen))
    }


def _is_plain(image: Image) -> bool:
    return int(image.max(initial=0)) - int(image.min(initial=255)) <= _FLAT
