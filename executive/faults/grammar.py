"""The notation of faults, on the command line and in files:

    KIND[:ARGUMENT,...][@WHEN]

    drop@4                      in the 4th action (dispatched steps count from 1)
    drop:p=0.3                  in each action with probability 0.3
    drop:p=0.3,item=lemon       ... of those that have to do with the lemon
    drop:release@2-5            in actions 2 to 5, while the item is lowered
    camera:front=black@5-8      from the 5th action on, until the 9th is dispatched; `@5-` goes on to the end
    planner:crash,times=1@0     the first time that it is asked, before the first action

An argument is `key=value`, or a bare word that says how. Either `@WHEN` or `p` says when; `@WHEN` may also follow the
kind (`shove@3:item=lemon`). What each kind takes is in `executive.faults.catalogue`.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from executive.errors import InputError, nearest
from executive.faults.catalogue import KINDS, Kind
from executive.faults.image_noise import SPOILED, most
from executive.util.files import read_toml

EXAMPLES = "drop@4, drop:p=0.3,item=lemon, shove:item=lemon@3 or camera:front=black@5-8"
EVER = 10**9
"""The number of an action that no run reaches."""

_WHEN = re.compile(r"([0-9]{1,9})(?:(-)([0-9]{1,9})?)?")
_CHANCE = re.compile(r"(?:[0-9]{1,3}(?:\.[0-9]{0,25})?|\.[0-9]{1,25})(?:[eE]-?[0-9]{1,3})?")
_NUMBER = re.compile(r"[0-9]{1,4}(?:\.[0-9]{1,6})?")
_TIMES = re.compile(r"[0-9]{1,6}")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_\-]*")


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing to break: in the `action`-th action, or from there to the `until`-th (`EVER`: to the end), or else in
    each action with probability `chance`. The rest is what the kind takes (see `executive.faults.catalogue`); None or
    "" leaves that to it.

    Raises:
        ValueError: both or neither of `action` and `chance`, or an `until` that is not after the action.
    """

    kind: str
    action: int | None = None
    chance: float | None = None
    item: str | None = None
    until: int | None = None
    way: str = ""
    other: str | None = None
    table: str | None = None
    camera: str | None = None
    share: float | None = None
    seconds: float | None = None
    times: int | None = None
    amount: float | None = None
    drawer: str | None = None

    def __post_init__(self) -> None:
        if (self.action is None) is (self.chance is None):
            raise ValueError("either an action or a chance says when")
        if self.until is not None and (self.action is None or self.until <= self.action):
            raise ValueError(f"actions {self.action} to {self.until} are no span")
        if not self.way:
            object.__setattr__(self, "way", KINDS[self.kind].way)

    def covers(self, action: int) -> bool:
        """Whether it names this action; a random fault names none."""
        return self.action is not None and self.action <= action <= (self.until or self.action)

    def __str__(self) -> str:
        given = {
            "p": None if self.chance is None else repr(self.chance),
            self.camera or "": None if self.camera is None else self.way,
            "item": self.item,
            "with": self.other,
            "table": self.table,
            "drawer": self.drawer,
            "share": None if self.share is None else repr(self.share),
            "seconds": None if self.seconds is None else f"{self.seconds:.6f}".rstrip("0").rstrip("."),
            "amount": None if self.amount is None else f"{self.amount:.6f}".rstrip("0").rstrip("."),
            "times": self.times,
        }
        words = [self.way] if self.way != KINDS[self.kind].way and self.camera is None else []
        words += [f"{key}={value}" for key, value in given.items() if value is not None]
        return f"{self.kind}{':' if words else ''}{','.join(words)}{self._when()}"

    def _when(self) -> str:
        if self.action is None:
            return ""
        span = "" if self.until is None else "-" if self.until == EVER else f"-{self.until}"
        return f"@{self.action}{span}"


def parse_fault(
    spec: str,
    items: Collection[str] | None = None,
    tables: Collection[str] | None = None,
    cameras: Collection[str] | None = None,
    drawers: Collection[str] | None = None,
) -> Fault:
    """Parses one fault in the notation of the command line.

    Args:
        items, tables, cameras, drawers: what may be named; None takes any name.

    Raises:
        InputError: it is not such a fault; says what is wrong with it and what would be right.
    """
    return _Reader(spec, items, tables, cameras, drawers).fault()


def read_faults(file: Path) -> tuple[str, ...]:
    """The faults that a TOML file lists, each as it would be written on the command line:

        faults = ["drop:p=0.3", "camera:front=black@5-8"]

    Raises:
        InputError: no such file, or it is not one of faults; file and key are named.
    """
    document = read_toml(file)
    for key in document.keys() - {"faults"}:
        raise InputError(f"unknown key; {nearest(key, ['faults'])}", file=file, key=key)
    listed = document.get("faults")
    if not isinstance(listed, list):
        raise InputError('a list of faults, such as ["drop@4", "shove:p=0.1"]', file=file, key="faults")
    for number, spec in enumerate(listed):
        if not isinstance(spec, str):
            raise InputError(f"a fault in quotes, such as {EXAMPLES}", file=file, key=f"faults[{number}]")
        try:
            parse_fault(spec)
        except InputError as error:
            raise InputError(error.message, file=file, key=f"faults[{number}]") from None
    return tuple(listed)


class _Reader:
    """The parser of one fault."""

    def __init__(
        self,
        spec: str,
        items: Collection[str] | None,
        tables: Collection[str] | None,
        cameras: Collection[str] | None,
        drawers: Collection[str] | None,
    ) -> None:
        self._spec, self._items, self._tables, self._cameras = spec, items, tables, cameras
        self._drawers = drawers
        head, self._colon, rest = spec.strip().partition(":")
        self._name, early, early_when = head.partition("@")
        self._rest, late, late_when = rest.partition("@")
        if self._name not in KINDS:
            self._refuse(f"no kind {self._name!r}, {nearest(self._name, KINDS)}" if self._name else "it names no kind")
        if early and late:
            self._refuse("it says twice when")
        self._kind: Kind = KINDS[self._name]
        self._at = (early_when if early else late_when).strip() if early or late else None
        self._way = ""

    def fault(self) -> Fault:
        first, until = self._when()
        given = self._arguments()
        chance = self._probability("p", given.get("p"))
        if (self._at is None) is (chance is None):
            name = self._name
            self._refuse(f"say when: {name}@4 for the 4th action or {name}:p=0.3 for a chance in each, and not both")
        if not self._way and self._kind.ways and not self._kind.way:
            self._refuse(f"say how: {', '.join(self._kind.ways)}")
        item, other = (_as_written(given.get(key), self._items) for key in ("item", "with"))
        table, camera = _as_written(given.get("table"), self._tables), given.get("camera")
        drawer = _as_written(given.get("drawer"), self._drawers)
        for named, what, valid in (
            (item, "an item", self._items),
            (other, "an item", self._items),
            (table, "a table", self._tables),
            (drawer, "a drawer", self._drawers),
        ):
            if named is not None and not _NAME.fullmatch(named):
                self._refuse(f"{named!r} is no name of {what}")
            if named is not None and valid is not None and named not in valid:
                self._refuse(f"no {what.split()[1]} {named!r}, {nearest(named, valid)}")
        if other is not None and other == item:
            self._refuse("'with' is another item")
        share, seconds, times = given.get("share"), given.get("seconds"), given.get("times")
        for key, value, way in (("share", share, "wrong"), ("seconds", seconds, "slow")):
            if value is not None and self._kind.ways.get(way) and self._way != way:
                self._refuse(f"{key} goes with the way {way!r}")
        if seconds is not None and not (_NUMBER.fullmatch(seconds) and float(seconds) <= 3600.0):
            self._refuse(f"seconds are a number up to 3600, not {seconds!r}")
        amount = self._amount(given.get("amount"))
        if times is not None and not (_TIMES.fullmatch(times) and int(times) > 0):
            self._refuse(f"times is a whole number from 1, not {times!r}")
        return Fault(
            self._name,
            first,
            chance,
            item,
            until,
            self._way,
            other,
            table,
            camera,
            self._probability("share", share),
            None if seconds is None else float(seconds),
            None if times is None else int(times),
            amount,
            drawer,
        )

    def _when(self) -> tuple[int | None, int | None]:
        """The first and the last action; (None, None) for a random fault."""
        if self._at is None:
            return None, None
        match = _WHEN.fullmatch(self._at)
        least = 0 if self._kind.lasting else 1
        counted = "counted from 1" + (" (0: before the first one)" if least == 0 else "")
        if match is None or int(match[1]) < least:
            self._refuse(f"after '@' comes the number of an action, {counted}, or a span such as 5-8, not {self._at!r}")
        first, last = int(match[1]), match[3]
        if match[2] is None:
            return first, None
        if last is None:
            return first, EVER
        if int(last) < first:
            self._refuse(f"actions {first} to {int(last)} are none")
        return first, int(last) if int(last) > first else None

    def _arguments(self) -> dict[str, str]:
        """What is given by key; the camera of a camera fault under `camera`, and the word that says how in `_way`."""
        given: dict[str, str] = {}
        keys = {"p", *self._kind.keys}
        for part in self._rest.split(",") if self._colon else []:
            key, equals, value = (text.strip() for text in part.partition("="))
            if not key:
                self._refuse("a ':' or ',' with nothing after it")
            if key in self._kind.ways and not equals:
                self._take_way(key)
                continue
            if self._name == "camera" and equals and key not in keys:
                key = _as_written(key, self._cameras) or key
                if self._cameras is not None and key not in self._cameras:
                    self._refuse(f"no camera {key!r}, {nearest(key, [*self._cameras, *keys])}")
                if not _NAME.fullmatch(key):
                    self._refuse(f"{key!r} is no name of a camera")
                if value not in self._kind.ways:
                    self._refuse(f"a camera is no {value!r}, {nearest(value, self._kind.ways)}")
                self._take_way(value)
                given["camera"] = key
                continue
            if key not in keys:
                self._refuse(f"no argument {key!r}, {nearest(key, [*keys, *self._kind.ways])}")
            if key in given:
                self._refuse(f"{key} is given twice")
            if not value:
                self._refuse(f"{key} has no value")
            given[key] = value
        return given

    def _take_way(self, way: str) -> None:
        if self._way:
            self._refuse(f"both {self._way!r} and {way!r}")
        self._way = way

    def _amount(self, text: str | None) -> float | None:
        if text is None:
            return None
        if self._way not in SPOILED:
            self._refuse(f"amount goes with {', '.join(SPOILED)}")
        if not (_NUMBER.fullmatch(text) and float(text) <= most(self._way)):
            self._refuse(f"amount is a number up to {most(self._way):g} ({SPOILED[self._way]}), not {text!r}")
        return float(text)

    def _probability(self, key: str, text: str | None) -> float | None:
        if text is None:
            return None
        if not (_CHANCE.fullmatch(text) and float(text) <= 1.0):
            self._refuse(f"{key} is a probability from 0 to 1, not {text!r}")
        return float(text)

    def _refuse(self, message: str) -> NoReturn:
        raise InputError(f"fault {self._spec!r}: {message}; write for example {EXAMPLES}")


def _as_written(name: str | None, valid: Collection[str] | None) -> str | None:
    """The name as those that may be named write it: names know no case."""
    return next((each for each in valid or () if name is not None and each.lower() == name.lower()), name)
