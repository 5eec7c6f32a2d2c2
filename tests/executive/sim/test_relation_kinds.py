"""What a domain says of its predicates is held against the kinds of things that its relations are about."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import DomainError
from executive.sim import relation_kinds
from executive.sim.relation_kinds import check_kinds, read_relation_kinds
from executive.sim.relations import SimState, takes
from executive.sim.spec import SceneSpec, read_scene
from executive.types import ALWAYS, Atom, Task
from tests.executive.sim.stage import SCENE

FILE = Path("domain.toml")


@pytest.fixture(scope="module")
def spec() -> SceneSpec:
    return read_scene(SCENE)


def task(predicate: str, *pairs: tuple[str, ...], names: tuple[str, ...]) -> Task:
    atoms = tuple(Atom(predicate, args) for args in pairs)
    objects = {name: "object" for args in pairs for name in args}
    return Task("d", "p", objects, atoms, ALWAYS, parameters={predicate: names})


def check(said: str, some: Task, spec: SceneSpec) -> str:
    """What is said of a relation of the task's only predicate; nothing where it is right."""
    (predicate,) = some.parameters
    try:
        check_kinds(read_relation_kinds({predicate: said}, some.parameters, FILE), some, spec, FILE)
    except DomainError as error:
        return f"{error.file}: {error.key}: {error.message}".removeprefix(f"{FILE}: predicates.{predicate}.relation: ")
    return ""


def test_the_wrong_order_is_told_with_the_right_one(spec: SceneSpec) -> None:
    right = task("on-table", ("lemon", "wood-table"), names=("item", "table"))
    swapped = task("on-table", ("wood-table", "lemon"), names=("table", "item"))
    assert check("on", right, spec) == ""
    assert 'write relation = "on(?item, ?table)"' in check("on", swapped, spec)
    assert check("on(?item, ?table)", swapped, spec) == ""
    assert 'write relation = "on(?item, ?table)"' in check("on(?table, ?item)", swapped, spec)


def test_no_order_is_offered_where_none_is_right(spec: SceneSpec) -> None:
    said = check("on", task("near", ("lemon", "soda-can"), names=("a", "b")), spec)
    assert "?b is an item" in said
    assert "write relation" not in said


def test_a_predicate_over_everything_is_right_if_some_things_fit(spec: SceneSpec) -> None:
    pairs = [(one, other) for one in ("lemon", "wood-table") for other in ("lemon", "wood-table")]
    assert check("on", task("on", *pairs, names=("a", "b")), spec) == ""


def test_a_thing_of_the_scene_may_stand_for_itself(spec: SceneSpec) -> None:
    some = task("put-away", ("lemon",), names=("item",))
    assert check("on(?item, wood-table)", some, spec) == ""
    (known,) = read_relation_kinds({"put-away": "on(?item, wood-table)"}, some.parameters, FILE).values()
    assert known.about(Atom("put-away", ("lemon",))) == ("lemon", "wood-table")
    assert "did you mean 'wood-table'?" in check("on(?item, wod-table)", some, spec)
    assert "here are 1" in check("on(?item)", some, spec)


def test_a_relation_that_declares_nothing_is_held_to_its_number_alone(
    spec: SceneSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plain(state: SimState, one: str, other: str) -> bool:
        return False

    @takes("thing", "item")
    def beside(state: SimState, one: str, other: str) -> bool:
        return False

    monkeypatch.setattr(relation_kinds, "relations", lambda: {"plain": plain, "beside": beside})
    swapped = task("near", ("lemon", "wood-table"), names=("a", "b"))
    assert check("plain", swapped, spec) == ""
    assert "needs 2 objects" in check("plain", task("near", ("lemon",), names=("a",)), spec)
    assert 'write relation = "beside(?b, ?a)"' in check("beside", swapped, spec)
