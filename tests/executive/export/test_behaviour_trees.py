"""Behaviour trees of plans, ticked by BehaviorTree.CPP and by py_trees: they do what the plan says where all goes well,
try again what went wrong, believe what is seen, and fail where a new plan is needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from executive import cli
from executive.domain import load_domain
from executive.errors import InputError
from executive.export import btcpp_xml, monitored_tree, py_tree, tree_of_problem, tree_of_run
from executive.export.behaviour_trees import Node, NodeKind
from executive.trace.record.log import read_events
from executive.types import Atom, Condition, Effect, Facts, NoPlan, Plan, Step
from tests.conftest import ROOT

EXAMPLE = ROOT / "runs" / "example"


@dataclass
class Table:
    """A world of atoms, in which steps have their effects but for those that are to fail."""

    state: dict[Atom, bool]
    failing: dict[str, int] = field(default_factory=dict)
    """How often each step still goes wrong, by its name."""
    lying: bool = False
    """Whether skills report the opposite of what they did."""
    hidden: frozenset[Atom] = frozenset()
    done: list[str] = field(default_factory=list)
    seen: dict[Atom, bool] = field(default_factory=dict)
    looks: int = 0

    def look(self) -> bool:
        self.looks += 1
        self.seen = {atom: value for atom, value in self.state.items() if atom not in self.hidden}
        return True

    def holds(self, atom: Atom) -> bool | None:
        return self.seen.get(atom)

    def carry_out(self, step: Step) -> bool:
        self.done.append(str(step))
        works = not self.failing.get(str(step), 0)
        if works:
            self.state |= {atom: value for atom, value in step.changes(self.state).items() if value is not None}
        else:
            self.failing[str(step)] -= 1
        return works is not self.lying


def tick_py_trees(tree: Node, table: Table) -> bool:
    import py_trees

    behaviour = py_tree(tree, dict.fromkeys(("pick", "place"), table.carry_out), table.holds, table.look)
    root = py_trees.trees.BehaviourTree(behaviour)
    for _ in range(1000):
        root.tick()
        if behaviour.status is not py_trees.common.Status.RUNNING:
            return bool(behaviour.status is py_trees.common.Status.SUCCESS)
    raise AssertionError("it does not end")


def tick_btcpp(tree: Node, table: Table, parameters: Mapping[str, tuple[str, ...]] | None = None) -> bool:
    from behaviortreepy import BehaviorTreeFactory, NodeStatus

    steps = {(node.step.action, node.step.args): node.step for node in tree.walk() if node.step}
    names = parameters or {"pick": ("arg1", "arg2"), "place": ("arg1", "arg2")}

    def status(told: bool) -> Any:
        return NodeStatus.SUCCESS if told else NodeStatus.FAILURE

    def skill(action: str) -> Callable[[Any], Any]:
        def tick(node: Any) -> Any:
            board = node.config().blackboard
            return status(table.carry_out(steps[action, tuple(board.get_string(name) for name in names[action])]))

        return tick

    factory = BehaviorTreeFactory()
    factory.register_simple_action("Look", lambda node: status(table.look()))
    factory.register_simple_condition("Holds", lambda node: status(table.holds(Atom.parse(node.name())) is True))
    factory.register_simple_condition("HoldsNot", lambda node: status(table.holds(Atom.parse(node.name())) is False))
    for action in {action for action, _ in steps}:
        factory.register_simple_action(f"Skill_{action}", skill(action))
    loaded = factory.create_tree_from_text(btcpp_xml(tree, parameters))
    return bool(loaded.tick_while_running(0) == NodeStatus.SUCCESS)


TICKED = pytest.mark.parametrize("tick", [tick_py_trees, tick_btcpp])
Tick = Callable[[Node, Table], bool]
CUP, BOX, SHELF = "cup", "box", "shelf"


def on(place: str) -> Atom:
    return Atom("on", (CUP, place))


FREE, HELD = Atom("free"), Atom("held", (CUP,))
PICK = Step.strips("pick", (CUP, BOX), {on(BOX): True, FREE: True}, {on(BOX): False, FREE: False, HELD: True})
PLACE = Step.strips("place", (CUP, SHELF), {HELD: True}, {on(SHELF): True, FREE: True, HELD: False})
GOAL = Condition.of({on(SHELF): True, HELD: False})


def table(**more: Any) -> Table:
    return Table({on(BOX): True, on(SHELF): False, FREE: True, HELD: False}, **more)


@TICKED
def test_a_plan_is_carried_out_and_looked_at(tick: Tick) -> None:
    world = table()
    assert tick(monitored_tree((PICK, PLACE), GOAL), world)
    assert world.done == ["pick(cup,box)", "place(cup,shelf)"]
    assert world.looks == 5  # before and after each, and at the end


@TICKED
def test_what_goes_wrong_is_tried_again(tick: Tick) -> None:
    world = table(failing={"pick(cup,box)": 2})
    assert tick(monitored_tree((PICK, PLACE), GOAL, retries=2), world)
    assert world.done == ["pick(cup,box)"] * 3 + ["place(cup,shelf)"]


@TICKED
def test_what_goes_wrong_too_often_needs_a_new_plan(tick: Tick) -> None:
    world = table(failing={"pick(cup,box)": 3})
    assert not tick(monitored_tree((PICK, PLACE), GOAL, retries=2), world)
    assert world.done == ["pick(cup,box)"] * 3


@TICKED
def test_what_is_seen_counts_and_not_what_a_skill_says(tick: Tick) -> None:
    world = table(lying=True)
    assert tick(monitored_tree((PICK, PLACE), GOAL), world)
    assert world.done == ["pick(cup,box)", "place(cup,shelf)"]
    world = table(lying=True, failing={"pick(cup,box)": 1})
    assert tick(monitored_tree((PICK, PLACE), GOAL), world)
    assert world.done == ["pick(cup,box)"] * 2 + ["place(cup,shelf)"]


@TICKED
def test_a_precondition_that_does_not_hold_keeps_a_step_from_beginning(tick: Tick) -> None:
    world = table()
    world.state[FREE] = False
    assert not tick(monitored_tree((PICK, PLACE), GOAL, retries=0, waits=2), world)
    assert (world.done, world.looks) == ([], 3)


@TICKED
def test_what_cannot_be_seen_is_neither_true_nor_false(tick: Tick) -> None:
    for unseen in (on(SHELF), HELD):
        goal = Condition.literal(unseen, unseen != HELD)
        assert not tick(monitored_tree((), goal, looks_again=1), table(hidden=frozenset({unseen})))


@TICKED
def test_one_of_several_ways_to_meet_a_condition_is_enough(tick: Tick) -> None:
    either = Condition.any_of([Condition.of({HELD: True}), Condition.of({on(BOX): True, FREE: True})])
    world = table()
    assert tick(monitored_tree((), either), world)
    world.state[FREE] = False
    assert not tick(monitored_tree((), either), world)


@TICKED
def test_a_conditional_effect_is_looked_for_where_it_comes_about(tick: Tick) -> None:
    """Picking the cup also lights a lamp, if it is on the box."""
    lamp = Atom("lit")
    pick = Step(
        "pick",
        (CUP, BOX),
        PICK.precondition,
        (*PICK.effects, Effect(Condition.of({on(BOX): True}), Facts({lamp: True}))),
    )
    known = monitored_tree((pick,), Condition(), {on(BOX): True, FREE: True}, retries=0)
    assert lamp in {node.atom for node in known.walk()}
    assert lamp not in {node.atom for node in monitored_tree((pick,), Condition()).walk()}
    world = table()
    world.state[lamp] = False
    assert tick(known, world)


@pytest.mark.parametrize("names", [("item", "item"), ("name", "ID"), ("2nd", "a-b"), ("it em", "_x")])
def test_whatever_parameters_are_called_their_values_arrive(names: tuple[str, str]) -> None:
    tree = monitored_tree((PICK, PLACE), GOAL)
    from executive.export.btcpp import _ports

    ports = tuple(_ports(PICK, {"pick": names}))
    assert len({*ports}) == 2
    world, called = table(), {"pick": ports, "place": tuple(_ports(PLACE, {"place": names}))}
    assert tick_btcpp(tree, world, called)
    assert world.done == ["pick(cup,box)", "place(cup,shelf)"]


def test_the_tree_of_a_recorded_run_has_its_plan_and_its_patience() -> None:
    tree, names = tree_of_run(EXAMPLE)
    plan = next(event.payload for event in read_events(EXAMPLE, images=False) if isinstance(event.payload, Plan))
    assert [node.step for node in tree.walk() if node.step] == list(plan.steps)
    assert {node.attempts for node in tree.walk() if node.name.startswith("try ")} == {3}
    assert names == {}
    with pytest.raises(InputError, match="no plan 99"):
        tree_of_run(EXAMPLE, 99)


def test_the_tree_of_a_problem_reaches_its_goal() -> None:
    """With the real planner, ticked by both in a world that begins as :init says."""
    found = tree_of_problem("grocery", "one-item")
    assert not isinstance(found, NoPlan)
    tree, names = found
    assert names["pick"] == ("item", "table")
    task = load_domain("grocery", "one-item").task
    first = {node.atom for node in tree.walk() if node.kind is NodeKind.HOLDS} - {None}
    for tick in (tick_py_trees, lambda tree, world: tick_btcpp(tree, world, names)):
        world = Table({atom: atom in task.declared for atom in task.atoms})
        assert tick(tree, world)
        assert task.goal.truth(world.state)
        assert first <= {*task.atoms}


def test_the_command_writes_what_loads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.exit_code(["export", "bt", str(EXAMPLE), "--out", "plan.xml"]) == 0
    assert (tmp_path / "plan.xml").read_text() == btcpp_xml(*tree_of_run(EXAMPLE))
    for wrong in (["--plan", "99"], ["--problem", "breakfast"], ["--out", "none/plan.xml"]):
        assert cli.exit_code(["export", "bt", str(EXAMPLE), "--out", "other.xml", *wrong]) == 2
    assert cli.exit_code(["export", "bt", "nowhere", "--out", "other.xml"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["plan.xml"]
    assert "nowhere" in capsys.readouterr().err
