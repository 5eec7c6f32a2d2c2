"""The symbolic world does what the domain says, or nothing; its sensor is wrong as often as it says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.protocols import Estimator, Simulator, SkillContext, World
from executive.symbolic import SymbolicSkill, SymbolicWorld
from executive.symbolic.truth import SymbolicTruth
from executive.symbolic.world import SymbolicEstimator
from executive.types import Atom, Observation, SkillResult, SkillStatus
from tests.contracts import EstimatorContract, SimulatorContract
from tests.executive.symbolic import crates
from tests.executive.symbolic.couriers import write

X_AT_A, X_HELD, HERE_A = Atom("at", ("x", "a")), Atom("held", ("x",)), Atom("here", ("a",))


@pytest.fixture(scope="module")
def couriers(tmp_path_factory: pytest.TempPathFactory) -> Any:
    domain, problem = write(tmp_path_factory.mktemp("couriers"))
    return load_domain(domain, str(problem))


def made(couriers: Any, flip: float = 0.0, seed: int = 0) -> SymbolicWorld:
    return SymbolicWorld(couriers.task.atoms, couriers.task.declared, couriers.draw_action, flip, seed)


def do(world: SymbolicWorld, couriers: Any, name: str, *args: str) -> SkillResult:
    context = SkillContext(world.handle, np.random.default_rng(0), lambda news: None, lambda: False)
    return SymbolicSkill()(couriers.parsed.ground(name, args), context)


def true(world: SymbolicWorld) -> frozenset[Atom]:
    return SymbolicTruth(world).of(tuple(world.state)).true


class TestSymbolicWorld(SimulatorContract):
    @pytest.fixture(autouse=True)
    def _load(self, couriers: Any) -> None:
        self.couriers = couriers

    def make(self) -> Simulator:
        return made(self.couriers)

    def pass_time(self, world: World, seconds: float) -> None:
        assert isinstance(world, SymbolicWorld)
        world.advance(seconds)

    def test_a_listener_sees_frames_until_nobody_watches(self) -> None:
        world, frames = self.make(), list[object]()
        world.watch(frames.append)
        self.pass_time(world, 1.0)
        assert frames == [], "nothing has a pose"

    def test_a_disturbance_says_what_it_did_and_an_unknown_one_is_bad_input(self) -> None:
        world = self.make()
        for kind in ("no-effect", "exogenous"):
            assert world.disturb(kind, np.random.default_rng(1))
        with pytest.raises(InputError, match="'drop'"):
            world.disturb("drop", np.random.default_rng(1))


class TestSymbolicEstimator(EstimatorContract):
    @pytest.fixture(autouse=True)
    def _load(self, couriers: Any) -> None:
        self.couriers = couriers

    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        world = made(self.couriers, 0.2, 3)
        return SymbolicEstimator(world, 0.2), world.observe(), self.couriers.task.atoms


def test_an_action_has_its_effects_where_its_precondition_holds(couriers: Any) -> None:
    world = made(couriers)
    assert do(world, couriers, "pick", "x", "a").done
    assert X_HELD in true(world)
    assert X_AT_A not in true(world)
    assert world.time == 1.0


def test_where_the_precondition_does_not_hold_nothing_is_done_and_the_skill_says_so(couriers: Any) -> None:
    world = made(couriers)
    before = true(world)
    assert do(world, couriers, "pick", "y", "b").status is SkillStatus.NOT_APPLICABLE
    assert true(world) == before


def test_an_action_without_effect_is_reported_as_done_once(couriers: Any) -> None:
    world = made(couriers)
    before = true(world)
    world.disturb("no-effect", np.random.default_rng(0))
    assert do(world, couriers, "pick", "x", "a").done
    assert true(world) == before
    assert do(world, couriers, "pick", "x", "a").done
    assert X_HELD in true(world)


def test_another_agent_does_what_is_possible_and_about_what_is_named(couriers: Any) -> None:
    world = made(couriers)
    assert world.disturb("exogenous", np.random.default_rng(0), item="x") == "another agent does pick(x,a)"
    assert X_HELD in true(world)
    assert "nothing to do" in world.disturb("exogenous", np.random.default_rng(0), item="y")
    reached = {true(world)}
    for seed in range(30):
        world.disturb("exogenous", np.random.default_rng(seed))
        reached.add(true(world))
    for state in reached:  # legal ones alone
        assert sum(atom.predicate == "here" for atom in state) == 1
        assert sum(atom.predicate in ("held", "free") for atom in state) == 1
    assert len(reached) > 5


def test_answers_are_wrong_as_often_as_they_say_each_look_anew(couriers: Any) -> None:
    world, looks = made(couriers, 0.1, 7), 2000
    wrong = Counter[Atom]()
    for _ in range(looks):
        answers = world.sense(world.observe(), world.state)
        assert set(answers.values()) <= {0.9, 0.1}
        wrong.update(atom for atom, value in answers.items() if (value > 0.5) is not world.state[atom])
    for atom in world.state:
        assert 0.07 * looks < wrong[atom] < 0.13 * looks


def test_one_moment_gives_one_answer_and_another_seed_gives_others(couriers: Any) -> None:
    world, other = made(couriers, 0.4, 1), made(couriers, 0.4, 2)
    look = world.observe()
    answers = world.sense(look, couriers.task.atoms)
    assert world.sense(look, [X_AT_A]) == {X_AT_A: answers[X_AT_A]}
    do(world, couriers, "pick", "x", "a")
    assert world.sense(look, couriers.task.atoms) == answers, "what was seen, and not what has become of it"
    assert other.sense(other.observe(), couriers.task.atoms) != answers
    world.observe()
    with pytest.raises(ValueError, match="past"):
        world.sense(look, [X_AT_A])


def test_a_restored_world_is_what_it_was_and_other_snapshots_are_refused(couriers: Any) -> None:
    world = made(couriers)
    do(world, couriers, "go", "a", "b")
    world.disturb("no-effect", np.random.default_rng(0))
    kept, state = world.snapshot(), true(world)
    do(world, couriers, "go", "b", "c")
    do(world, couriers, "go", "b", "c")
    assert true(world) != state
    world.restore(kept)
    assert (true(world), world.time) == (state, 1.0)
    do(world, couriers, "go", "b", "c")
    assert true(world) == state, "it still has no effect"
    for bad in (b"", b"{}", b"[]", b'{"time": 0, "ineffective": false, "true": ["other(x)"]}'):
        with pytest.raises(InputError):
            world.restore(bad)
    assert true(world) == state


def test_a_pair_of_pddl_files_needs_both_and_has_no_scene(tmp_path: Path) -> None:
    domain, problem = write(tmp_path)
    assert load_domain(domain, str(problem)).task.problem == "two"
    with pytest.raises(InputError, match="needs a problem"):
        load_domain(domain)
    with pytest.raises(InputError, match="no such file"):
        load_domain(domain, str(tmp_path / "none.pddl"))
    with pytest.raises(InputError, match="has no scene"):
        _ = load_domain(domain, str(problem)).scene


def test_a_number_is_read_at_once_and_wrong_as_often_as_it_says(tmp_path: Path) -> None:
    domain, problem = crates.write(tmp_path)
    task = load_domain(domain, str(problem)).task
    (fluent,), looks, wrong = task.fluents, 2000, 0
    world = SymbolicWorld(task.atoms, task.declared, lambda *_: None, 0.2, fluents=task.fluents)
    for _ in range(looks):
        answers = world.sense(world.observe(), [atom for _, atom in fluent.values])
        shares = fluent.distribution(answers)
        assert shares is not None
        assert sum(answers.values()) == pytest.approx(1.0)
        assert sorted(set(shares.values())) == pytest.approx([0.2 / 9, 0.8])
        wrong += fluent.most_probable(answers) != 0
    assert 0.16 * looks < wrong < 0.24 * looks
