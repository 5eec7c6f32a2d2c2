"""What is believed before the first look, where something is stated of it: that is where things usually are, and what
the problem leaves open."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from executive.belief.mutex_inference import Group
from executive.types import Atom

LEFT_OUT = 0.001
"""The probability of an atom that the problem does not name among those that may be so: what it says may be wrong."""

_CLOSE = 1e-6


def stated_priors(
    groups: Sequence[Group],
    usual: Mapping[Atom, float],
    unknown: Collection[Atom] = (),
    oneof: Sequence[Sequence[Atom]] = (),
) -> dict[Atom, float]:
    """Return how probable atoms are at first, of which something is stated.

    Args:
        usual: where things usually are.
        unknown: atoms that may be so. The others of their mutex groups are `LEFT_OUT`.
        oneof: sets of atoms of which one is so. They share what is left of the probability evenly, where `usual` does
            not say how.

    Raises:
        ValueError: of a mutex group more than one is so by what is usual; names the atoms and their sum.
    """
    for group in groups:
        if (total := math.fsum(usual.get(atom, 0.0) for atom in group.atoms)) > 1.0 + _CLOSE:
            those = ", ".join(str(atom) for atom in group.atoms if usual.get(atom))
            raise ValueError(f"{those} add up to {total:g}, and one of them at most is so")
    found = dict(usual)
    sets = [frozenset(atoms) for atoms in oneof]
    named = frozenset[Atom](unknown).union(*sets)
    for group in groups:
        if may_be := [atom for atom in group.atoms if atom in named]:
            found.update(dict.fromkeys((atom for atom in group.atoms if atom not in named), LEFT_OUT))
            if any(each.issuperset(may_be) for each in sets) or group.exact:
                found.update(_shared(may_be, usual, 1.0 - LEFT_OUT * (len(group.atoms) - len(may_be))))
    for each in sets:
        if not each <= found.keys():
            found.update(_shared(sorted(each), usual, 1.0))
    return found


def informed(groups: Sequence[Group], even: Mapping[Atom, float], stated: Mapping[Atom, float]) -> dict[Atom, float]:
    """Return each atom's probability where some are stated, from what it is where none is (`even`): the others of a
    mutex group share what is left as they did before."""
    found = dict(even)
    for group in groups:
        own = [atom for atom in group.atoms if atom in stated]
        others = [atom for atom in group.atoms if atom not in stated]
        if not own:
            continue
        left = max(0.0, 1.0 - math.fsum(stated[atom] for atom in own))
        nothing = 0.0 if group.exact else max(0.0, 1.0 - math.fsum(even[atom] for atom in group.atoms))
        before = math.fsum(even[atom] for atom in others) + nothing
        for atom in others:
            found[atom] *= left / before if before > 0.0 else 1.0
    return found | dict(stated)


def _shared(atoms: Sequence[Atom], usual: Mapping[Atom, float], whole: float) -> dict[Atom, float]:
    """Share out a probability, as is usual where that is known and evenly where it is not."""
    known = math.fsum(usual.get(atom, 0.0) for atom in atoms)
    open_ = [atom for atom in atoms if atom not in usual]
    share = max(0.0, 1.0 - known) / len(open_) if open_ else 0.0
    weights = {atom: usual.get(atom, share) for atom in atoms}
    total = math.fsum(weights.values())
    return {atom: whole * (weight / total if total > 0.0 else 1.0 / len(atoms)) for atom, weight in weights.items()}
