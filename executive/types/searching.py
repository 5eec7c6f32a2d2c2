"""Where to look first for what is not known: the places, in order, and why."""

from __future__ import annotations

from dataclasses import dataclass, field

from executive.types.conditions import Condition
from executive.types.facts import Facts


@dataclass(frozen=True, slots=True)
class PlaceToLook:
    """A place where something can be found out.

    Attributes:
        condition: what has to hold for it to be seen, such as open(drawer).
        probability: how probable it is that the goal needs something that is there.
        cost: what it costs to look there in vain, and to undo what the goal does not want.
        expected: what is spent in vain, in expectation, where one looks there first and goes on in the best order.
    """

    condition: Condition
    probability: float
    cost: float
    expected: float


@dataclass(frozen=True, slots=True)
class SearchOrder:
    """Where to look first: the places from the cheapest in expectation on; none where there is no choice.

    `assumed` is what is planned with of the atoms that cannot be seen: what is most probable, if what is sought is at
    the first place. `hypotheses` is how many states were weighed.
    """

    places: tuple[PlaceToLook, ...] = ()
    assumed: Facts = field(default_factory=Facts)
    hypotheses: int = 0
