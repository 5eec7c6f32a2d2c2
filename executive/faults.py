"""What to break on purpose, when, and with which chance.

A fault is written `KIND[@N][:key=value,...]`:

    drop@4                      in the 4th action (dispatched steps count from 1), once
    drop:p=0.3                  in each action with probability 0.3
    drop:p=0.3,item=lemon       ... of those that have to do with the lemon
    shove@3:item=lemon          after the 3rd action, the lemon

Either `@N` or `p` says when. Chance is drawn from the seed, the fault's place in the list and the action's number, and
from nothing else: whoever carries out the n-th action meets the same faults, whatever happened before it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import NoReturn

import numpy as np

from executive.errors import InputError, nearest
from executive.protocols import World
from executive.types import FaultInjected, Phase, Step

EXAMPLES = "drop@4, drop:p=0.3, drop:p=0.3,item=lemon, miss@3 or shove@3:item=lemon"
_NUMBER = re.compile(r"[0-9]{1,9}")
_CHANCE = re.compile(r"(?:[0-9]{1,3}(?:\.[0-9]{0,25})?|\.[0-9]{1,25})(?:[eE]-?[0-9]{1,3})?")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_\-]*")
_STREAM = 1  # beside the skills' chance, which is drawn from the seed and the action alone
_WHETHER, _WHEN, _HOW = range(3)  # what is drawn for a fault in an action

Report = Callable[[FaultInjected], None]


@dataclass(frozen=True, slots=True)
class Kind:
    """A way to break things: what it does, at which moment of an action, and what `item` means to it."""

    description: str
    moment: str
    item: str


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "drop": Kind(
            "the gripper opens while something is carried; physics decides where it lands",
            "somewhere in the middle half of the action's first `transfer` phase",
            "only in actions that name it",
        ),
        "miss": Kind("the next grasp closes beside its item", "before the action", "only in actions that name it"),
        "shove": Kind("someone moves an item to another place", "after the action, before the look", "the one moved"),
    }
)
"""Every kind of fault, by the word that names it."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing to break: in the `action`-th action, or else in each action with probability `chance`."""

    kind: str
    action: int | None = None
    chance: float | None = None
    item: str | None = None

    def __str__(self) -> str:
        at = "" if self.action is None else f"@{self.action}"
        given = {"p": None if self.chance is None else repr(self.chance), "item": self.item}
        arguments = ",".join(f"{key}={value}" for key, value in given.items() if value is not None)
        return f"{self.kind}{at}{':' if arguments else ''}{arguments}"


def parse_fault(spec: str, items: Collection[str] | None = None) -> Fault:
    """Read one fault as it is written on the command line.

    Args:
        items: what may be named by `item`; None takes any name.

    Raises:
        InputError: it is not such a fault; says what is wrong with it and what would be right.
    """

    def refuse(message: str) -> NoReturn:
        raise InputError(f"fault {spec!r}: {message}; write for example {EXAMPLES}")

    head, colon, rest = spec.strip().partition(":")
    kind, sign, at = head.partition("@")
    if kind not in KINDS:
        refuse(f"no kind {kind!r}, {nearest(kind, KINDS)}" if kind else "it names no kind")
    if sign and (not _NUMBER.fullmatch(at) or int(at) == 0):
        refuse(f"after '@' comes the number of an action, counted from 1, not {at!r}")
    arguments: dict[str, str] = {}
    for part in rest.split(",") if colon else []:
        key, equals, value = (text.strip() for text in part.partition("="))
        if key not in ("p", "item"):
            refuse(
                f"no argument {key!r}, {nearest(key, ('item', 'p'))}" if key else "a ':' or ',' with nothing after it"
            )
        if key in arguments:
            refuse(f"{key} is given twice")
        if not equals or not value:
            refuse(f"{key} has no value")
        arguments[key] = value
    chance, item = arguments.get("p"), arguments.get("item")
    if chance is not None and not (_CHANCE.fullmatch(chance) and float(chance) <= 1.0):
        refuse(f"p is a probability from 0 to 1, not {chance!r}")
    if item is not None and not _NAME.fullmatch(item):
        refuse(f"{item!r} is no name of an item")
    if item is not None and items is not None and item not in items:
        refuse(f"no item {item!r}, {nearest(item, items)}")
    if bool(sign) is (chance is not None):
        refuse(f"say when: {kind}@4 for the 4th action or {kind}:p=0.3 for a chance in each, and not both")
    return Fault(kind, int(at) if sign else None, None if chance is None else float(chance), item)


class FaultInjector:
    """Breaks a world as a list of faults demands; see `executive.protocols.FaultSource`."""

    def __init__(self, faults: Sequence[Fault], world: World, seed: int = 0) -> None:
        self._faults, self._world, self._seed = tuple(faults), world, seed
        self._dropping: set[int] = set()  # faults that wait for something to be carried in the action at work
        self._action = 0  # the one at work; 0 between two

    def before_action(self, action: int, step: Step, report: Report) -> None:
        self._action = action
        self._dropping = set(self._due("drop", action, step))
        for place in self._due("miss", action, step):
            self._break(place, action, report)

    def on_phase(self, action: int, step: Step, phase: Phase, report: Report) -> None:
        if phase.name != "transfer":
            return
        for place in sorted(self._dropping):
            delay = phase.seconds * float(self._chance(place, action, _WHEN).uniform(0.25, 0.75))
            self._world.schedule(delay, partial(self._drop, place, action, report))
        self._dropping.clear()

    def after_action(self, action: int, step: Step, report: Report) -> None:
        self._action = 0
        for place in self._due("shove", action, step):
            item = self._faults[place].item
            self._break(place, action, report, **({} if item is None else {"item": item}))

    def _due(self, kind: str, action: int, step: Step) -> list[int]:
        """The places in the list of the faults of this kind that strike in this action."""
        return [
            place
            for place, fault in enumerate(self._faults)
            if fault.kind == kind
            and (kind == "shove" or fault.item is None or fault.item in step.args)
            and (fault.action == action if fault.chance is None else self._strikes(place, action, fault.chance))
        ]

    def _strikes(self, place: int, action: int, chance: float) -> bool:
        return bool(self._chance(place, action, _WHETHER).random() < chance)

    def _drop(self, place: int, action: int, report: Report) -> None:
        if self._action == action:  # the action may have ended before the moment came
            self._break(place, action, report)

    def _break(self, place: int, action: int, report: Report, **arguments: str) -> None:
        fault = self._faults[place]
        detail = self._world.disturb(fault.kind, self._chance(place, action, _HOW), **arguments)
        report(FaultInjected(fault.kind, str(fault), action, detail))

    def _chance(self, place: int, action: int, draw: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(_STREAM, place, action, draw)))
