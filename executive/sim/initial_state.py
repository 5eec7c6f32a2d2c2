"""How a problem's `:init` sets the stage: what stands where, what the hand holds, and that all of it came about.

The scene sets up two things: which table an item is on (the relation `on`), and what the hand holds (`gripping`).
Whatever else `:init` says has to be so once that is done, and is refused otherwise: nothing of it is passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NoReturn

from executive.errors import DomainError, nearest
from executive.sim import footprint
from executive.sim.relation_kinds import Meaning
from executive.sim.scene import ItemShape
from executive.sim.spec import SceneSpec
from executive.types import Atom, Facts

Said = Mapping[Atom, tuple[bool, int]]
"""What `:init` says of atoms: whether they are true, and on which line."""


@dataclass(frozen=True, slots=True)
class Setting:
    """How a run begins: the table of each item in `placed`, the tables on which each in `barred` is not, and the item
    in the hand. The rest is drawn by chance."""

    placed: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    barred: Mapping[str, frozenset[str]] = field(default_factory=lambda: MappingProxyType({}))
    held: str | None = None


def read_setting(said: Said, meanings: Mapping[str, Meaning], spec: SceneSpec, file: Path) -> Setting:
    """What `:init` asks of the scene.

    Args:
        file: the problem's, for error messages.

    Raises:
        DomainError: it contradicts itself, or asks for what no scene can be.
    """
    tables = [table.name for table in spec.tables]
    items = [item.name for item in spec.items]
    placed: dict[str, str] = {}
    barred: dict[str, frozenset[str]] = {}
    since: dict[str, int] = {}
    held: str | None = None
    empty: tuple[bool, int] | None = None

    def fail(line: int, message: str) -> NoReturn:
        raise DomainError(f":init: {message}", file=file, key=f"line {line}")

    for atom, (value, line) in sorted(said.items(), key=lambda entry: entry[1][1]):
        meaning = meanings[atom.predicate]
        things = meaning.about(atom)
        if meaning.name == "on":
            item, table = things
            if item not in items:
                fail(line, f"{item} is declared to be on {table!r}, and is no item; {nearest(item, items)}")
            if table not in tables:
                fail(line, f"{item} is declared to be on {table!r}, which is no table; {nearest(table, tables)}")
            if not value:
                barred[item], since[f"not {item}"] = barred.get(item, frozenset()) | {table}, line
            elif item == held:
                fail(line, f"{item} is in the hand, by line {since[item]}, and not on {table}")
            elif placed.setdefault(item, table) != table:
                fail(line, f"{item} is on {placed[item]} already, by line {since[item]}, and can be on one table only")
            else:
                since[item] = line
        elif meaning.name == "gripping" and value:
            if held is not None:
                fail(line, f"the hand holds {held} already, by line {since[held]}, and can hold one item only")
            if things[0] in placed:
                fail(line, f"{things[0]} is on {placed[things[0]]}, by line {since[things[0]]}, and not in the hand")
            held, since[things[0]] = things[0], line
        elif meaning.name == "gripper-empty":
            empty = value, line
    if empty is not None and empty[0] and held is not None:
        fail(empty[1], f"the hand is not empty: it holds {held}, by line {since[held]}")
    if empty is not None and not empty[0] and held is None:
        fail(empty[1], "the hand is empty unless :init puts an item into it; say which one")
    for item, without in barred.items():
        if placed.get(item) in without or (item not in placed and item != held and without.issuperset(tables)):
            fail(since[f"not {item}"], f"{item} has to be somewhere: on a table, or in the hand")
    return Setting(MappingProxyType(placed), MappingProxyType(barred), held)


def too_large(
    atoms: Iterable[Atom], meanings: Mapping[str, Meaning], shapes: Mapping[str, ItemShape], spec: SceneSpec
) -> dict[Atom, str]:
    """Those of the atoms that would have an item lie on a table which it is too large for however it lies, and why."""
    tables = {table.name: table for table in spec.tables}
    found = {}
    for atom in atoms:
        meaning = meanings[atom.predicate]
        if meaning.name == "on":
            item, name = meaning.about(atom)
            if item in shapes and name in tables and footprint.too_large(shapes[item], tables[name]):
                size = " x ".join(f"{200.0 * half:.1f}" for half in shapes[item].half)
                there = footprint.top(tables[name])
                found[atom] = f"{item}, {size} cm, does not fit on {name}, {there}, whichever way it lies"
    return found


def check_setting(said: Said, truth: Callable[[Sequence[Atom]], Facts], file: Path) -> None:
    """Hold all that `:init` says against what is so before anything has moved.

    Raises:
        DomainError: something of it is not so.
    """
    facts = truth(tuple(said))
    for atom, (value, line) in sorted(said.items(), key=lambda entry: entry[1][1]):
        if facts[atom] is not value:
            raise DomainError(
                f":init: {atom} is {'not ' * value}so once the scene is set up: it sets up what is on which table and "
                "what the hand holds; leave out what does not follow from that",
                file=file,
                key=f"line {line}",
            )
