"""Plans reach their goals; solved, unsolvable, timed out and crashed are four results; no process is left behind."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path
from typing import TypeAlias

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.domain.pddl import Schema, read_task
from executive.errors import MissingError
from executive.planning.fast_downward import SOLVED, UNSOLVABLE, FastDownwardPlanner
from executive.planning.goal_order import State, by_goals, replay
from executive.planning.programs import Answer, SasFile, find_search
from executive.planning.sas_task import GroundedTask
from executive.protocols import Planner
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan
from tests.executive.domain.pddl.test_reader import DATA, PAIRS

Planners: TypeAlias = dict[str, FastDownwardPlanner]
Schemas: TypeAlias = dict[str, Schema]

EXAMPLE_1 = Facts.parse(
    "robot-gripper-empty",
    "on-table(milk-carton,black-table)",
    "on-table(cereal-box,wood-table)",
    "on-table(lemon,white-table)",
)


@pytest.fixture(scope="module")
def planners() -> dict[str, FastDownwardPlanner]:
    return {name: FastDownwardPlanner(read_task(*pair)) for name, pair in PAIRS.items()}


@pytest.fixture(scope="module")
def schemas() -> dict[str, Schema]:
    return {name: read_task(*pair) for name, pair in PAIRS.items()}


@pytest.fixture
def fifteen() -> Schema:
    """Unsolvable, but no search lives to say so."""
    return read_task(DATA / "sliding-tiles.pddl", DATA / "fifteen.pddl")


def declared(schema: Schema) -> Facts:
    return Facts.closed(schema.task.declared, schema.task.atoms)


def drawn(schema: Schema, seed: int) -> tuple[Facts, Condition]:
    """Any state, however inconsistent (two items held, one item on two tables), and any part of the goal."""
    choose, task = random.Random(seed), schema.task
    state = Facts({atom: choose.random() < choose.choice([0.1, 0.3, 0.5]) for atom in task.atoms})
    return state, task.goal.only(choose.sample(task.goal.conjuncts, choose.randint(1, len(task.goal.conjuncts))))


def steps(answer: Plan | NoPlan) -> list[str]:
    assert isinstance(answer, Plan), answer
    return [str(step) for step in answer.steps]


def test_the_papers_example_takes_the_milk_before_the_cereal(planners: Planners, schemas: Schemas) -> None:
    answer = planners["breakfast"].plan(EXAMPLE_1, schemas["breakfast"].task.goal)
    assert steps(answer) == [
        "pick(milk-carton,black-table)",
        "place(milk-carton,white-table)",
        "pick(cereal-box,wood-table)",
        "place(cereal-box,white-table)",
    ]
    assert isinstance(answer, Plan)
    assert answer.cost == 4.0


@given(name=st.sampled_from(["sort-all", "tray", "dishes"]), seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_plan_leads_from_the_state_to_the_goal(planners: Planners, schemas: Schemas, name: str, seed: int) -> None:
    state, goal = drawn(schemas[name], seed)
    answer = planners[name].plan(state, goal)
    if isinstance(answer, NoPlan):
        assert answer.reason is NoPlanReason.UNSOLVABLE
        return
    end = replay(state.true, answer.steps)
    assert end is not None
    assert goal.truth(State(end))
    assert answer.cost == len(answer.steps)
    assert all(step == schemas[name].ground(step.action, step.args) for step in answer.steps)


@given(name=st.sampled_from(["sort-all", "tray", "dishes"]), seed=st.integers(0, 10**6))
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_what_is_grounded_here_is_the_task_that_the_translator_makes_of_it(
    planners: Planners, schemas: Schemas, name: str, seed: int
) -> None:
    """Solvable where that is, in as few steps; goals that something be false included, and steps to do without."""
    choose, task = random.Random(seed), schemas[name].task
    state = Facts({atom: choose.random() < 0.3 for atom in task.atoms})
    kept = task.goal.only(choose.sample(task.goal.conjuncts, choose.randint(1, len(task.goal.conjuncts)))).facts
    untrue = choose.sample(sorted(state.true), min(1, len(state.true)))
    goal = Condition.of({**dict.fromkeys(untrue, False), **kept})
    free = planners[name].plan(state, goal)
    stuck_among = free.steps if isinstance(free, Plan) else ()
    avoid = frozenset(choose.sample(stuck_among, min(len(stuck_among), choose.randint(0, 2))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
        judge = FastDownwardPlanner(schemas[name]).plan(state, goal, avoid)
    answer = planners[name].plan(state, goal, avoid)
    if isinstance(judge, NoPlan):
        assert isinstance(answer, NoPlan)
        assert judge.reason is answer.reason is NoPlanReason.UNSOLVABLE
    else:
        assert isinstance(answer, Plan)
        assert answer.cost == judge.cost
        assert avoid.isdisjoint(answer.steps)
        assert avoid.isdisjoint(judge.steps)


@given(name=st.sampled_from(["sort-all", "tray", "dishes"]), seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_large_tasks_plan_is_as_short_as_a_small_ones(
    planners: Planners, schemas: Schemas, name: str, seed: int
) -> None:
    """However a plan is found first: taken for granted is only one than which none is shorter."""
    state, goal = drawn(schemas[name], seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("executive.planning.fast_downward._FEW", 10**6)
        shortest = planners[name].plan(state, goal)
        patch.setattr("executive.planning.fast_downward._FEW", -1)
        answer = planners[name].plan(state, goal)
    if isinstance(shortest, NoPlan):
        assert isinstance(answer, NoPlan)
        assert answer.reason is shortest.reason
    else:
        assert isinstance(answer, Plan)
        assert answer.cost == shortest.cost


def test_many_items_are_planned_for_without_a_search_for_the_shortest(schemas: Schemas, tmp_path: Path) -> None:
    items = [f"thing-{number}" for number in range(30)]
    problem = tmp_path / "many.pddl"
    problem.write_text(
        f"(define (problem many) (:domain grocery) (:objects {' '.join(items)} - item left right - table)"
        f" (:init (robot-gripper-empty)) (:goal (and {' '.join(f'(on-table {item} right)' for item in items)})))"
    )
    schema = read_task(PAIRS["sort-all"][0], problem)
    state = Facts.parse("robot-gripper-empty", *(f"on-table({item},left)" for item in items))
    answer = FastDownwardPlanner(schema).plan(state, schema.task.goal)
    assert isinstance(answer, Plan)
    assert answer.cost == 2 * len(items)
    assert "lazy_greedy" in answer.planner


def test_what_is_held_is_put_down_first(planners: Planners, schemas: Schemas) -> None:
    held = EXAMPLE_1.without(Facts.parse("robot-gripper-empty", "on-table(cereal-box,wood-table)")) | Facts.parse(
        "robot-gripping(cereal-box)"
    )
    found = steps(planners["breakfast"].plan(held, schemas["breakfast"].task.goal))
    assert found == ["place(cereal-box,white-table)", "pick(milk-carton,black-table)", "place(milk-carton,white-table)"]


def test_a_goal_that_holds_needs_no_steps_and_no_engine(schemas: Schemas, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("executive.planning.fast_downward.find_search", None)
    planner = FastDownwardPlanner(schemas["breakfast"])
    answer = planner.plan(EXAMPLE_1, Condition.parse("on-table(lemon,white-table)", "not robot-gripping(lemon)"))
    assert steps(answer) == []


@pytest.mark.parametrize(
    ("state", "goal"),
    [
        ("on-table(lemon,black-table)", "on-table(lemon,white-table)"),  # nothing held, the gripper not empty
        ("robot-gripper-empty", "on-table(lemon,white-table)"),  # the lemon is nowhere
        ("robot-gripper-empty; on-table(lemon,black-table)", "on-table(lemon,white-table); on-table(lemon,wood-table)"),
        ("robot-gripper-empty; on-table(lemon,black-table)", "robot-gripping(lemon); robot-gripper-empty"),
        ("", "robot-gripper-empty"),
    ],
)
def test_no_way_is_unsolvable_and_says_so(planners: Planners, state: str, goal: str) -> None:
    answer = planners["breakfast"].plan(
        Facts.parse(*filter(None, state.split("; "))), Condition.parse(*goal.split("; "))
    )
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.UNSOLVABLE


ROOMS = """(define (domain rooms)
  (:predicates (in ?room) (lit ?room) (done) (painted ?room))
  (:action move :parameters (?from ?to) :precondition (in ?from) :effect (and (in ?to) (not (in ?from))))
  (:action paint :parameters (?room) :precondition (in ?room) :effect (painted ?room))
  (:action wait :parameters () :precondition () :effect ())
  (:action rest :parameters (?room) :precondition (in ?room) :effect (and))
  (:action work :parameters (?room) :precondition (in ?room) :effect (done)))"""
"""Moving from a room to itself changes nothing, nor does waiting; painting changes nothing where it is done."""


@pytest.mark.parametrize("grounded", [True, False])
def test_29_an_action_that_changes_nothing_is_no_reason_to_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, grounded: bool
) -> None:
    if not grounded:
        monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    (tmp_path / "domain.pddl").write_text(ROOMS)
    (tmp_path / "problem.pddl").write_text(
        "(define (problem go) (:domain rooms) (:objects hall kitchen)"
        " (:init (in hall) (painted hall)) (:goal (and (in kitchen) (done) (painted kitchen))))"
    )
    schema = read_task(tmp_path / "domain.pddl", tmp_path / "problem.pddl")
    found = steps(FastDownwardPlanner(schema).plan(declared(schema), schema.task.goal))
    assert found[0] == "move(hall,kitchen)"
    assert sorted(found[1:]) == ["paint(kitchen)", "work(kitchen)"]


def test_actions_without_effect_are_not_written_down(tmp_path: Path) -> None:
    (tmp_path / "domain.pddl").write_text(ROOMS)
    (tmp_path / "problem.pddl").write_text(
        "(define (problem go) (:domain rooms) (:objects hall kitchen) (:init (in hall)) (:goal (done)))"
    )
    schema = read_task(tmp_path / "domain.pddl", tmp_path / "problem.pddl")
    task = GroundedTask(schema)
    assert task.ground(lambda: False)
    # Two moves between the rooms; in each room, to paint and to work.
    assert len(task) == 6
    painted = frozenset({Atom("in", ("hall",)), Atom("painted", ("hall",))})
    goal = schema.task.goal
    written = [len(task.relevant(true, goal)[0]) for true in (painted - {Atom("painted", ("hall",))}, painted)]
    assert written == [6, 5], "nothing ever takes the paint off, so to paint the hall again changes nothing"
    work = schema.ground("work", ("hall",))
    assert len(task.relevant(painted, goal, frozenset({work}))[0]) == 4


def test_an_engine_that_fails_is_quoted_by_the_line_that_matters() -> None:
    schema = read_task(*PAIRS["tray"])
    task = GroundedTask(schema)
    task.ground(lambda: False)
    text = task.text(frozenset(), schema.task.goal, list(schema.task.goal.facts))
    assert text is not None
    broken = re.sub(r"\nend_operator", "\nend_of_nothing", text, count=1)
    with SasFile(find_search(), broken) as file:
        ended = file.search("astar(blind())", 20.0).ended
    assert ended.code not in (SOLVED, UNSOLVABLE)
    assert "end_operator" in ended.last_words
    assert not re.search("exit ?code|[Mm]emory|Usage", ended.last_words)


def test_grounding_goes_on_where_it_was_told_to_stop(schemas: Schemas) -> None:
    schema = schemas["sort-all"]
    whole, parts = GroundedTask(schema), GroundedTask(schema)
    assert whole.ground(lambda: False)
    calls = 0
    while not parts.ground(lambda: True):
        calls += 1
    assert calls >= len(parts), "it stops after each action"
    question = frozenset[Atom](), schema.task.goal, schema.goals
    assert parts.text(*question) == whole.text(*question)


def test_a_planner_without_time_has_timed_out_and_loses_nothing(schemas: Schemas) -> None:
    schema = schemas["breakfast"]
    planner = FastDownwardPlanner(schema)
    for _ in range(2):
        answer = planner.plan(EXAMPLE_1, schema.task.goal, seconds=0.0)
        assert isinstance(answer, NoPlan)
        assert (answer.reason, "within 0 s" in answer.detail) == (NoPlanReason.TIMED_OUT, True)
    assert isinstance(planner.plan(EXAMPLE_1, schema.task.goal), Plan)


def test_an_order_of_steps_that_takes_too_long_to_find_is_left_as_it_is(planners: Planners, schemas: Schemas) -> None:
    goal = schemas["breakfast"].task.goal
    found = planners["breakfast"].plan(EXAMPLE_1, goal)
    assert isinstance(found, Plan)
    other = (*found.steps[2:], *found.steps[:2])
    order = list(schemas["breakfast"].goals)
    assert by_goals(EXAMPLE_1.true, other, goal, order) == found.steps
    assert by_goals(EXAMPLE_1.true, other, goal, order, stop=lambda: True) == other


@pytest.mark.parametrize(("large", "names"), [(0, ["greedy"]), (10**6, ["greedy", "landmarks"])])
def test_the_first_plan_of_a_large_task_is_taken_as_it_is(
    schemas: Schemas, monkeypatch: pytest.MonkeyPatch, large: int, names: list[str]
) -> None:
    search, asked = SasFile.search, list[str]()

    def counted(file: SasFile, text: str, seconds: float) -> Answer:
        asked.append("landmarks" if "landmark" in text else "greedy")
        return search(file, text, seconds)

    monkeypatch.setattr(SasFile, "search", counted)
    for name, most in (("_FEW", 0), ("_MANY", 0), ("_LARGE", large)):
        monkeypatch.setattr(f"executive.planning.fast_downward.{name}", most)
    schema = schemas["breakfast"]
    assert isinstance(FastDownwardPlanner(schema).plan(EXAMPLE_1, schema.task.goal), Plan)
    assert asked == names


def test_an_atom_of_another_task_is_refused(planners: Planners) -> None:
    with pytest.raises(ValueError, match="holding"):
        planners["breakfast"].plan(Facts.parse("holding(red-cube)"), Condition.parse("robot-gripper-empty"))


def test_it_is_a_planner(planners: Planners, schemas: Schemas) -> None:
    assert isinstance(planners["tray"], Planner)
    with pytest.raises(ValueError, match="timeout"):
        FastDownwardPlanner(schemas["tray"], timeout=0)


@pytest.mark.parametrize("grounded", [True, False])
def test_a_missing_engine_is_named_with_its_command(
    schemas: Schemas, monkeypatch: pytest.MonkeyPatch, grounded: bool
) -> None:
    if grounded:
        monkeypatch.setattr("executive.planning.programs.PACKAGE", "no_such_package")
    else:
        monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
        monkeypatch.setattr("executive.planning.programs.TRANSLATOR", "no_such_package.translate")
    planner = FastDownwardPlanner(schemas["tray"])
    planner.warm_up()  # says nothing; the call that needs it does
    with pytest.raises(MissingError, match="pip install up-fast-downward"):
        planner.plan(Facts(), schemas["tray"].task.goal)


PLAN_DISHES = """
from executive.domain.pddl import read_task
from executive.planning.fast_downward import FastDownwardPlanner
from executive.types import Facts
from tests.executive.domain.pddl.test_reader import PAIRS
for name in ("dishes", "sort-all"):
    schema = read_task(*PAIRS[name])
    held = [f"on-table({atom.args[0]},black-table)" for atom in schema.goals] if name == "sort-all" else []
    state = Facts({atom: True for atom in schema.task.declared}) | Facts.parse(*held)
    planner = FastDownwardPlanner(schema)
    planner.warm_up()
    for _ in range(2):
        print(*planner.plan(state, schema.task.goal).steps)
"""


def test_the_same_plan_in_every_process() -> None:
    """Neither the hash seed nor a second call changes the plan."""
    outputs = {
        subprocess.run(
            [sys.executable, "-c", PLAN_DISHES],
            env={**os.environ, "PYTHONHASHSEED": seed},
            cwd=Path(__file__).resolve().parents[3],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    (output,) = outputs
    dishes, again, groceries, groceries_again = output.splitlines()
    assert (dishes, groceries) == (again, groceries_again)
    assert "serve()" in dishes
    assert groceries.count("place") == 5  # the cereal stands on the black table already


@pytest.fixture
def mark(monkeypatch: pytest.MonkeyPatch) -> str:
    """An environment variable that the engine's processes inherit, to know them by."""
    monkeypatch.setenv("EXECUTIVE_TEST_MARK", value := uuid.uuid4().hex)
    return value


def marked(mark: str) -> dict[int, str]:
    """The living processes that carry the mark, with their command lines, this one left out."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if (
                int(folder.name) != os.getpid()
                and f"EXECUTIVE_TEST_MARK={mark}".encode() in (folder / "environ").read_bytes()
            ):
                found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:  # it ended while we looked, or belongs to somebody else
            continue
    return found


def wait_for(mark: str, wanted: str) -> int:
    """The process with `wanted` in its command line, once it is there."""
    while True:
        for pid, command in marked(mark).items():
            if wanted in command:
                return pid
        time.sleep(0.01)


def gone(mark: str) -> bool:
    """Whether all marked processes end (killed ones take a moment)."""
    for _ in range(500):
        if not marked(mark):
            return True
        time.sleep(0.01)
    return False


SEARCH = "--internal-plan-file"


def test_a_search_that_takes_too_long_times_out_and_leaves_no_process(
    fifteen: Schema, mark: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    answer = FastDownwardPlanner(fifteen, timeout=3.0).plan(declared(fifteen), fifteen.task.goal)
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.TIMED_OUT
    assert "3 s" in answer.detail
    assert gone(mark)
    assert not list(tmp_path.iterdir())  # Fast Downward's intermediate file did not land in the current directory


@pytest.mark.parametrize("grounded", [True, False])
def test_killed_processes_are_a_crash_and_take_the_others_with_them(
    fifteen: Schema, mark: str, monkeypatch: pytest.MonkeyPatch, grounded: bool
) -> None:
    """In each of the searches."""
    if not grounded:
        monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    killed: list[int] = []

    def kill() -> None:
        for _ in range(2):
            killed.append(wait_for(mark, SEARCH))
            os.kill(killed[-1], signal.SIGKILL)
            while killed[-1] in marked(mark):
                time.sleep(0.01)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    answer = FastDownwardPlanner(fifteen, timeout=200.0).plan(declared(fifteen), fifteen.task.goal)
    thread.join()
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.CRASHED
    assert answer.detail.isprintable()
    assert len(set(killed)) == 2
    assert gone(mark)


@pytest.mark.parametrize("grounded", [True, False])
def test_an_engine_that_does_not_start_is_a_crash(
    schemas: Schemas, monkeypatch: pytest.MonkeyPatch, grounded: bool
) -> None:
    if grounded:
        monkeypatch.setattr("executive.planning.fast_downward.find_search", lambda: Path("/no/such/engine"))
    else:
        monkeypatch.setattr("executive.planning.fast_downward.MOST_GROUNDED", -1)
    planner = FastDownwardPlanner(schemas["breakfast"])
    planner.warm_up()
    if not grounded:
        monkeypatch.setattr(sys, "executable", "/no/such/python")
    answer = planner.plan(EXAMPLE_1, schemas["breakfast"].task.goal)
    assert isinstance(answer, NoPlan)
    assert answer.reason is NoPlanReason.CRASHED
    assert "/no/such" in answer.detail


def test_an_interrupt_ends_the_engine(fifteen: Schema, mark: str) -> None:
    """Ctrl-C while the search runs: the exception comes through, and nothing runs on."""

    def interrupt() -> None:
        wait_for(mark, SEARCH)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt, daemon=True)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        FastDownwardPlanner(fifteen, timeout=200.0).plan(declared(fifteen), fifteen.task.goal)
    thread.join()
    assert gone(mark)


def test_two_planners_in_one_directory_do_not_read_each_other(schemas: Schemas) -> None:
    answers: dict[str, list[list[str]]] = {"lemon": [], "soda-can": []}
    states = {item: Facts.parse("robot-gripper-empty", f"on-table({item},black-table)") for item in answers}

    def work(item: str) -> None:
        planner = FastDownwardPlanner(schemas["sort-all"])
        for _ in range(4):
            answers[item].append(steps(planner.plan(states[item], Condition.parse(f"on-table({item},white-table)"))))

    threads = [threading.Thread(target=work, args=(item,)) for item in answers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for item, found in answers.items():
        assert found == [[f"pick({item},black-table)", f"place({item},white-table)"]] * 4
