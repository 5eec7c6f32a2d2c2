"""The settings: where things really are, what the robot is told of that, and what goes wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from executive.domain.loader import Domain
from executive.types import Atom

DRAWERS = ("left", "middle", "right")
OPEN_PLACES = ("worktop",)
WANTED = ("lemon", "can")
OTHERS = ("salt", "cup")

Distribution = Mapping[str, float]
"""How probable each place is."""

EVEN: Distribution = MappingProxyType(dict.fromkeys((*DRAWERS, *OPEN_PLACES), 0.25))


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting of the benchmark.

    Attributes:
        truth: where each wanted thing is, how probably; others are anywhere.
        told: whether the robot is told that.
        problem: of the domain; None for its own.
        faults: what is broken, as specifications.
    """

    name: str
    truth: Mapping[str, Distribution]
    told: bool
    problem: str | None = None
    faults: tuple[str, ...] = field(default=())

    def draw(self, seed: int) -> Mapping[str, str]:
        """Return where each thing is."""
        rng = np.random.default_rng(seed)
        found = {}
        for item in (*WANTED, *OTHERS):
            shares = self.truth.get(item, EVEN)
            found[item] = str(rng.choice(list(shares), p=list(shares.values())))
        return found

    def prior(self) -> Mapping[Atom, float]:
        """Return what the robot is told."""
        if not self.told:
            return {}
        return {
            Atom("at", (item, place)): share for item, shares in self.truth.items() for place, share in shares.items()
        } | {Atom("at", (item, "tray")): 0.0 for item in self.truth}

    def true_atoms(self, domain: Domain, seed: int) -> frozenset[Atom]:
        return domain.task.declared | {Atom("at", each) for each in self.draw(seed).items()}


def _shares(left: float, middle: float, right: float, worktop: float) -> Distribution:
    return MappingProxyType({"left": left, "middle": middle, "right": right, "worktop": worktop})


_USUAL = MappingProxyType({"lemon": _shares(0.7, 0.15, 0.05, 0.1), "can": _shares(0.1, 0.1, 0.7, 0.1)})
_HEAVY = MappingProxyType({"lemon": _shares(0.3, 0.2, 0.4, 0.1), "can": _shares(0.2, 0.3, 0.4, 0.1)})
_WRONG = ("no-effect:p=0.1", "relocate:p=0.1")

SETTINGS = (
    Setting("anywhere", MappingProxyType(dict.fromkeys(WANTED, EVEN)), told=False),
    Setting("usual places, not told", _USUAL, told=False),
    Setting("usual places, told", _USUAL, told=True),
    Setting("a heavy drawer, told", _HEAVY, told=True, problem="heavy-drawer"),
    Setting("usual places, told, with faults", _USUAL, told=True, faults=_WRONG),
)
