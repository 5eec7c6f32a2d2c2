"""All that `:init` says is set up, or refused with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import DomainError
from executive.relations.kinds import read_relation_kinds
from executive.sim.initial_state import InitialState, check_initial_state, read_initial_state, too_large
from executive.sim.spec import SceneSpec, TableSpec, read_scene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom, Facts
from tests.executive.sim.stage import ITEMS, MEANING, SCENE, TABLES, grocery

FILE = Path("problem.pddl")
RELATION_KINDS = read_relation_kinds(MEANING, {})


@pytest.fixture(scope="module")
def spec() -> SceneSpec:
    return read_scene(SCENE)


def said(*literals: str) -> dict[Atom, tuple[bool, int]]:
    """An :init with a literal on each line, from the first one on."""
    parsed = [Facts.parse(literal) for literal in literals]
    return {atom: (value, line) for line, facts in enumerate(parsed, 1) for atom, value in facts.items()}


def test_what_is_said_becomes_a_setting(spec: SceneSpec) -> None:
    init = said("on-table(lemon,black-table)", "robot-gripping(bread-loaf)", "not on-table(soda-can,wood-table)")
    assert read_initial_state(init, RELATION_KINDS, spec, FILE) == InitialState(
        {"lemon": "black-table"}, {"soda-can": frozenset({"wood-table"})}, "bread-loaf"
    )
    assert read_initial_state(said("robot-gripper-empty()"), RELATION_KINDS, spec, FILE) == InitialState()


CONTRADICTIONS = [
    (2, ("on-table(lemon,black-table)", "on-table(lemon,wood-table)"), "black-table already, by line 1"),
    (2, ("robot-gripping(lemon)", "robot-gripping(soda-can)"), "lemon already, by line 1"),
    (2, ("on-table(lemon,black-table)", "robot-gripping(lemon)"), "not in the hand"),
    (2, ("robot-gripping(lemon)", "on-table(lemon,black-table)"), "not on black-table"),
    (1, ("robot-gripper-empty()", "robot-gripping(lemon)"), "holds lemon, by line 2"),
    (1, ("not robot-gripper-empty()",), "say which one"),
    (3, tuple(f"not on-table(lemon,{table})" for table in TABLES), "has to be somewhere"),
    (1, ("on-table(lemon,soda-can)",), "is no table"),
    (1, ("on-table(wood-table,black-table)",), "is no item"),
]


@pytest.mark.parametrize(("line", "literals", "words"), CONTRADICTIONS)
def test_a_contradiction_is_refused_with_its_line(
    line: int, literals: tuple[str, ...], words: str, spec: SceneSpec
) -> None:
    with pytest.raises(DomainError) as caught:
        read_initial_state(said(*literals), RELATION_KINDS, spec, FILE)
    assert (caught.value.file, caught.value.key) == (FILE, f"line {line}")
    assert words in caught.value.message


def test_what_does_not_come_about_is_refused_with_its_line() -> None:
    facts = Facts.parse("lid-on(lemon)", "not robot-gripper-empty()")
    check_initial_state(said("lid-on(lemon)"), facts.only, FILE)
    for init in (said("lid-on(lemon)", "robot-gripper-empty()"), said("lid-on(lemon)", "not lid-on(lemon)")):
        with pytest.raises(DomainError) as caught:
            check_initial_state(init, facts.only, FILE)
        assert caught.value.key == "line 2"


@pytest.mark.parametrize("item", ["lemon", "cereal-box"])
def test_a_held_item_is_held_by_the_fingers_alone(item: str) -> None:
    world = grocery(2, held=item)
    truth = Truth(world, MEANING)
    everything = [
        Atom("robot-gripper-empty"),
        *(Atom("robot-gripping", (each,)) for each in ITEMS),
        *(Atom("on-table", (each, table)) for each in ITEMS for table in TABLES),
    ]
    for _ in range(2):
        facts = truth.of(everything)
        assert facts[Atom("robot-gripping", (item,))]
        assert not facts[Atom("robot-gripper-empty")]
        assert len([atom for atom in facts.true if atom.predicate == "on-table"]) == len(ITEMS) - 1
        world.settle(2.0)  # it stays where friction holds it
    world.command_gripper(0.0)
    world.settle(1.0)
    assert not truth.of(everything)[Atom("robot-gripping", (item,))], "nothing but the fingers held it"
    world.close()


def test_what_the_hand_cannot_hold_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.read_text().replace("scale = [0.74, 1.25, 1.05]", "scale = [1.7, 5.0, 1.0]"))
    with pytest.raises(DomainError, match="cereal-box is too wide for the hand"):
        MujocoWorld(file, {"cereal-box": "item", **dict.fromkeys(TABLES, "table")}, held="cereal-box")


def test_items_keep_off_the_tables_that_they_are_barred_from() -> None:
    barred = {"lemon": frozenset({"wood-table", "white-table"})}
    for seed in range(3):
        world = grocery(seed, items=("lemon", "soda-can"), barred=barred)
        assert Truth(world, MEANING).of([Atom.parse("on-table(lemon,black-table)")]).true
        world.close()


def test_an_item_too_large_for_a_table_is_told_with_both_sizes(spec: SceneSpec) -> None:
    tray = TableSpec(name="tray", centre=(0.4, 0.0, 0.8), size=(0.06, 0.06, 0.02))
    wide = spec.model_copy(update={"tables": (*spec.tables, tray)})
    world = grocery(0)
    atoms = [Atom("on-table", (item, table)) for item in ITEMS for table in (*TABLES, "tray")]
    found = too_large([*atoms, Atom("robot-gripper-empty")], RELATION_KINDS, world.shapes, wide)
    assert {atom.args[1] for atom in found} == {"tray"}
    assert Atom("on-table", ("cereal-box", "tray")) in found
    why = found[Atom("on-table", ("cereal-box", "tray"))]
    assert "7.4 x 3.8 x 15.8 cm" in why
    assert "6.0 x 6.0 cm" in why
    world.close()
