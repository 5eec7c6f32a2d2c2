"""The initial state of a scene from a problem's `:init`: what each item stands on or is in, which drawers are open, and
the item in the gripper.

What is set up are the table of an item (`on`), the table or item that it stands on (`directly-on`), the region that it
is in (`in-region`), the drawer or container (`inside`), whether a drawer is open (`open`), and the item in the gripper
(`gripping`). Every other literal of `:init` is checked afterwards, and
refused if it does not hold: none is ignored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NoReturn

from executive.errors import DomainError, nearest
from executive.relations.kinds import RelationKind
from executive.sim import footprint, graspable
from executive.sim.placement import places
from executive.sim.scene import ItemShape
from executive.sim.spec import SceneSpec
from executive.types import Atom, Facts

Declared = Mapping[Atom, tuple[bool, int]]
"""The literals of `:init`: atom -> (value, line)."""


@dataclass(frozen=True, slots=True)
class InitialState:
    """The initial state of a run: the table, drawer or container of each item in `placed`, the excluded ones of each in
    `barred`, the item that each stands on in `stacked` (none of these is in `placed`), the region of each in `regions`,
    the drawers that are open or closed in `opened`, and the item in the gripper. The rest is sampled."""

    placed: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    barred: Mapping[str, frozenset[str]] = field(default_factory=lambda: MappingProxyType({}))
    held: str | None = None
    stacked: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    regions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    opened: Mapping[str, bool] = field(default_factory=lambda: MappingProxyType({}))


def read_initial_state(
    declared: Declared, kinds: Mapping[str, RelationKind], spec: SceneSpec, file: Path
) -> InitialState:
    """Reads the initial state that `:init` declares.

    Args:
        file: the problem's, for error messages.

    Raises:
        DomainError: it contradicts itself, or asks for what no scene can be.
    """
    surfaces = [name for name, kind in spec.kinds.items() if kind in ("table", "container")]
    receptacles = [*spec.floors]
    homes = [*(table.name for table in spec.tables), *(drawer.name for drawer in spec.drawers)]
    items = [item.name for item in spec.items]
    placed: dict[str, str] = {}
    barred: dict[str, frozenset[str]] = {}
    stacked: dict[str, str] = {}
    regions: dict[str, str] = {}
    opened: dict[str, bool] = {}
    since: dict[str, int] = {}
    held: str | None = None
    empty: tuple[bool, int] | None = None

    def fail(line: int, message: str) -> NoReturn:
        raise DomainError(f":init: {message}", file=file, key=f"line {line}")

    for atom, (value, line) in sorted(declared.items(), key=lambda entry: entry[1][1]):
        kind = kinds[atom.predicate]
        things = kind.about(atom)
        if kind.name == "directly-on" and value and things[0] in items and things[1] in items:
            item, base = things
            if item == held:
                fail(line, f"{item} is in the hand, by line {since[item]}, and not on {base}")
            if stacked.setdefault(item, base) != base or item in placed:
                fail(line, f"{item} is on {placed.get(item, stacked[item])} already, by line {since[item]}")
            since.setdefault(item, line)
        elif kind.name == "in-region" and value and things[0] in items and things[1] in spec.kinds:
            item, region = things
            if regions.setdefault(item, region) != region:
                fail(
                    line, f"{item} is in {regions[item]} already, by line {since[f'{item} in']}, and in one region only"
                )
            since.setdefault(f"{item} in", line)
        elif kind.name == "open":
            opened[things[0]] = value
        elif kind.name in ("on", "inside") or (kind.name == "directly-on" and value):
            item, table = things
            where, what = ("in", "drawer or container") if kind.name == "inside" else ("on", "table or container")
            if item not in items:
                fail(line, f"{item} is declared to be {where} {table!r}, and is no item; {nearest(item, items)}")
            if table not in (known := receptacles if kind.name == "inside" else surfaces):
                fail(line, f"{item} is declared to be {where} {table!r}, which is no {what}; {nearest(table, known)}")
            if not value:
                barred[item], since[f"not {item}"] = barred.get(item, frozenset()) | {table}, line
            elif item == held:
                fail(line, f"{item} is in the hand, by line {since[item]}, and not on {table}")
            elif item in stacked and kind.name == "directly-on":
                fail(line, f"{item} is on {stacked[item]} already, by line {since[item]}")
            elif placed.setdefault(item, table) != table:
                fail(line, f"{item} is on {placed[item]} already, by line {since[item]}, and can be in one place only")
            else:
                since[item] = line
        elif kind.name == "gripping" and value:
            if held is not None:
                fail(line, f"the hand holds {held} already, by line {since[held]}, and can hold one item only")
            below = placed | stacked
            if things[0] in below:
                fail(line, f"{things[0]} is on {below[things[0]]}, by line {since[things[0]]}, and not in the hand")
            held, since[things[0]] = things[0], line
        elif kind.name == "gripper-empty":
            empty = value, line
    if empty is not None and empty[0] and held is not None:
        fail(empty[1], f"the hand is not empty: it holds {held}, by line {since[held]}")
    if empty is not None and not empty[0] and held is None:
        fail(empty[1], "the hand is empty unless :init puts an item into it; say which one")
    for item, without in barred.items():
        if placed.get(item) in without or (item not in placed and item != held and without.issuperset(homes)):
            fail(since[f"not {item}"], f"{item} has to be somewhere: on a table, in a drawer, or in the hand")
    for item in stacked:
        tower = [item]
        while (under := stacked.get(tower[-1])) is not None:
            if under in tower:
                fail(since[item], f"{item} is on {stacked[item]}, and under it as well")
            tower.append(under)
        if tower[-1] == held:
            fail(since[item], f"{item} is on {stacked[item]}, and {held} is in the hand, by line {since[held]}")
        placed.pop(item, None)  # it is where what it stands on is; whether that is there is checked afterwards
    return InitialState(
        MappingProxyType(placed),
        MappingProxyType(barred),
        held,
        MappingProxyType(stacked),
        MappingProxyType(regions),
        MappingProxyType(opened),
    )


def too_large(
    atoms: Iterable[Atom], kinds: Mapping[str, RelationKind], shapes: Mapping[str, ItemShape], spec: SceneSpec
) -> dict[Atom, str]:
    """The atoms that put an item on a table for which it is too large in every pose, each with the reason."""
    tables = places(spec)
    found = {}
    for atom in atoms:
        kind = kinds[atom.predicate]
        if kind.name in ("on", "inside"):
            item, name = kind.about(atom)
            if item in shapes and name in tables and footprint.too_large(shapes[item], tables[name]):
                size = " x ".join(f"{200.0 * half:.1f}" for half in shapes[item].half)
                there, into = footprint.top(tables[name]), "on" if kind.name == "on" else "into"
                found[atom] = f"{item}, {size} cm, does not fit {into} {name}, {there}, whichever way it lies"
    return found


def cannot_be_taken(
    atoms: Iterable[Atom], kinds: Mapping[str, RelationKind], shapes: Mapping[str, ItemShape]
) -> dict[Atom, str]:
    """The atoms that are about an item that the gripper can take in no pose, as held or as put somewhere, each with the
    reason."""
    why = {item: reason for item, shape in shapes.items() if (reason := graspable.why_not(shape)) is not None}
    moved = {atom: kinds[atom.predicate].about(atom)[0] for atom in atoms if kinds[atom.predicate].name in _MOVED}
    return {atom: why[item] for atom, item in moved.items() if item in why}


_MOVED = frozenset({"on", "directly-on", "in-region", "inside", "gripping"})
"""The relations whose first argument is an item that is taken to where they hold."""


def check_initial_state(declared: Declared, truth: Callable[[Sequence[Atom]], Facts], file: Path) -> None:
    """Checks every literal of `:init` against the ground truth before anything has moved.

    Raises:
        DomainError: a literal does not hold.
    """
    facts = truth(tuple(declared))
    for atom, (value, line) in sorted(declared.items(), key=lambda entry: entry[1][1]):
        if facts[atom] is not value:
            raise DomainError(
                f":init: {atom} is {'not ' * value}so once the scene is set up: it sets up what is on or in what, "
                "which drawers are open and what the hand holds; leave out what does not follow from that",
                file=file,
                key=f"line {line}",
            )
