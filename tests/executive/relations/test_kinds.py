"""What a domain says of its predicates is held against the kinds of things that its relations are about."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import DomainError
from executive.relations import Scene, kinds, takes
from executive.relations.kinds import check_kinds, read_relation_kinds
from executive.types import ALWAYS, Atom, Task

FILE = Path("domain.toml")
NAMED = {"lemon": "item", "soda-can": "item", "wood-table": "table"}


def task(predicate: str, *pairs: tuple[str, ...], names: tuple[str, ...]) -> Task:
    atoms = tuple(Atom(predicate, args) for args in pairs)
    objects = {name: "object" for args in pairs for name in args}
    return Task("d", "p", objects, atoms, ALWAYS, parameters={predicate: names})


def check(said: str, some: Task) -> str:
    """What is said of a relation of the task's only predicate; nothing where it is right."""
    (predicate,) = some.parameters
    try:
        check_kinds(read_relation_kinds({predicate: said}, some.parameters, FILE), some, NAMED, FILE)
    except DomainError as error:
        return f"{error.file}: {error.key}: {error.message}".removeprefix(f"{FILE}: predicates.{predicate}.relation: ")
    return ""


def test_the_wrong_order_is_told_with_the_right_one() -> None:
    right = task("on-table", ("lemon", "wood-table"), names=("item", "table"))
    swapped = task("on-table", ("wood-table", "lemon"), names=("table", "item"))
    assert check("on", right) == ""
    assert 'write relation = "on(?item, ?table)"' in check("on", swapped)
    assert check("on(?item, ?table)", swapped) == ""
    assert 'write relation = "on(?item, ?table)"' in check("on(?table, ?item)", swapped)


def test_no_order_is_offered_where_none_is_right() -> None:
    said = check("on", task("near", ("lemon", "soda-can"), names=("a", "b")))
    assert "?b is an item" in said
    assert "write relation" not in said


def test_a_predicate_over_everything_is_right_if_some_things_fit() -> None:
    pairs = [(one, other) for one in ("lemon", "wood-table") for other in ("lemon", "wood-table")]
    assert check("on", task("on", *pairs, names=("a", "b"))) == ""


def test_a_thing_of_the_scene_may_stand_for_itself() -> None:
    some = task("put-away", ("lemon",), names=("item",))
    assert check("on(?item, wood-table)", some) == ""
    (known,) = read_relation_kinds({"put-away": "on(?item, wood-table)"}, some.parameters, FILE).values()
    assert known.about(Atom("put-away", ("lemon",))) == ("lemon", "wood-table")
    assert "did you mean 'wood-table'?" in check("on(?item, wod-table)", some)
    assert "here are 1" in check("on(?item)", some)


def test_a_relation_that_declares_nothing_is_held_to_its_number_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def plain(scene: Scene, one: str, other: str) -> bool:
        return False

    @takes("thing", "item")
    def beside(scene: Scene, one: str, other: str) -> bool:
        return False

    monkeypatch.setattr(kinds, "relations", lambda: {"plain": plain, "beside": beside})
    swapped = task("near", ("lemon", "wood-table"), names=("a", "b"))
    assert check("plain", swapped) == ""
    assert "needs 2 objects" in check("plain", task("near", ("lemon",), names=("a",)))
    assert 'write relation = "beside(?b, ?a)"' in check("beside", swapped)
