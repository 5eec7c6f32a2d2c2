"""A run's world: the simulated one, built from the domain's scene, or the symbolic one, which needs none. What a run
needs of either is checked and built here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from executive.app.config import DEPTH, MUJOCO, SYMBOLIC_WORLD, RunConfig
from executive.core.attention import Attention
from executive.domain.loader import Domain
from executive.domain.skills import LEARNED
from executive.domain.skills import skills as skills_by_name
from executive.errors import DomainError, OptionError, nearest
from executive.faults import Fault, parse_fault
from executive.faults.catalogue import PHYSICAL, SYMBOLIC
from executive.protocols import Estimator, Skill, SkillContext
from executive.types import Atom, Facts, SkillResult, Step
from executive.util.files import home

if TYPE_CHECKING:
    from executive.belief.sensor_model import SensorModel
    from executive.sim.initial_state import InitialState
    from executive.sim.truth import Truth
    from executive.sim.world import MujocoWorld

_START = 3
"""The stream of random numbers of the symbolic world's initial state, beside those of faults, skills and its sensor."""


class GroundTruth(Protocol):
    """The ground truth of a world, for scores alone."""

    def of(self, atoms: Sequence[Atom]) -> Facts: ...


@dataclass(frozen=True, slots=True)
class Stage:
    """A world with everything of a run that belongs to it.

    `oracle` is the estimator that needs no model; `too_large` are the atoms that cannot be made true, each with the
    reason; `placed` is the table on which the problem says that an item is at first.
    """

    world: Any
    truth: GroundTruth
    oracle: Estimator
    skills: Mapping[str, Skill]
    moves: Mapping[str, Skill]
    attention: Attention
    too_large: Mapping[Atom, str]
    placed: Mapping[str, str] = field(default_factory=dict)


class Setting(Protocol):
    """A world that is checked and not yet built: reading is cheap, and may find a mistake."""

    @property
    def faults(self) -> Sequence[Fault]:
        """What is to be broken."""
        ...

    def open(self, first_observation: int) -> Stage:
        """Build the world in the state of the problem's :init, which the robot is not given."""
        ...


def make_setting(domain: Domain, config: RunConfig) -> Setting:
    """Check what a run needs of its world.

    Raises:
        InputError: a fault is none of this world, or the domain has no scene for the simulator.
    """
    return _Symbolic(domain, config) if config.world == SYMBOLIC_WORLD else _Simulated(domain, config)


def oracle_sensor_model(config: RunConfig) -> SensorModel | None:
    """Return the sensor model of a run's oracle; None where it never errs."""
    from executive.belief.sensor_model import ErrorModel, SensorModel

    flip = config.flip
    return SensorModel(other=ErrorModel(flip, flip), correlation_within=0.0) if flip else None


class _Simulated:
    """The simulator."""

    def __init__(self, domain: Domain, config: RunConfig) -> None:
        self._domain, self._config = domain, config
        self._initial = checked_stage(domain)
        self.faults = parse_faults(domain, config.faults)
        self._policies = load_policies(domain, config.policies)
        if config.eye is not None:
            from executive.sim.spec import read_scene

            config.eye.check_cameras([camera.name for camera in read_scene(domain.scene).cameras])

    def open(self, first_observation: int) -> Stage:
        from executive.sim.truth import Oracle

        domain, config = self._domain, self._config
        skills, moves = {**load_skills(domain), **self._policies}, load_moves(domain)
        drawn = checked_stage(domain, config.seed) if domain.parsed.oneof else self._initial
        world, truth = _simulator(domain, config, self.faults, first_observation, drawn)
        too_large = _too_large(domain, world, truth)
        attention = load_attention(domain, world, () if config.eye is None else config.eye.cameras)
        return Stage(world, truth, Oracle(truth), skills, moves, attention, too_large, self._initial.placed)


class _Symbolic:
    """The symbolic world. Options that break something are faults like all others."""

    def __init__(self, domain: Domain, config: RunConfig) -> None:
        self._domain, self._config = domain, config
        rates = {"no-effect": config.no_effect, "exogenous": config.exogenous}
        specs = [*config.faults, *(f"{kind}:p={rate!r}" for kind, rate in rates.items() if rate)]
        self.faults = [_only_in(SYMBOLIC_WORLD, parse_fault(spec, domain.task.objects, (), (), ())) for spec in specs]

    def open(self, first_observation: int) -> Stage:
        from executive.planning.initial_state import draw_initial
        from executive.symbolic import SymbolicSkill, SymbolicWorld
        from executive.symbolic.truth import SymbolicTruth
        from executive.symbolic.world import SymbolicEstimator

        domain, config = self._domain, self._config
        world = SymbolicWorld(
            domain.task.atoms,
            draw_initial(
                domain.parsed,
                np.random.default_rng([config.seed, _START]),
                leaves_open=domain.leaves_open,
                timeout=config.patience,
                usual=domain.priors,
            ),
            domain.draw_action,
            config.flip,
            config.seed,
            first_observation,
            domain.task.derived,
            domain.task.fluents,
            domain.task.visibility,
        )
        skills = dict.fromkeys(domain.parsed.actions, SymbolicSkill())
        oracle = SymbolicEstimator(world, config.flip)
        return Stage(world, SymbolicTruth(world), oracle, skills, {}, Attention(), {})


def load_skills(domain: Domain) -> Mapping[str, Skill]:
    """Load each action's skill."""
    points = skills_by_name()
    loaded: dict[str, Skill] = {}
    for action, said in domain.skills.items():
        name, bracket, rest = said.partition("(")
        loaded[action] = points[name].load()
        if bracket:
            own = [variable for variable, _ in domain.parsed.actions[action].parameters]
            words = [word.strip() for word in rest.removesuffix(")").split(",")]
            loaded[action] = SkillCall(loaded[action], [own.index(w) if w in own else w for w in words])
    return loaded


def load_policies(domain: Domain, said: Sequence[str]) -> Mapping[str, Skill]:
    """Load the learned skills that are to carry out some actions, each said as ACTION=FILE.

    Raises:
        InputError: there is no such action, or the file is no policy.
    """
    loaded: dict[str, Skill] = {}
    for each in said:
        action, _, file = each.partition("=")
        if action not in domain.skills:
            raise OptionError(
                f"{each!r}: there is no action {action!r}; {nearest(action, domain.skills)}", option="policies"
            )
        loaded[action] = LEARNED.load()(home(Path(file)))
    return loaded


class SkillCall:
    """A skill that is given other arguments than the action's own: some of these, by their index, and objects of the
    scene, by their names."""

    def __init__(self, skill: Skill, terms: Sequence[int | str]) -> None:
        self._skill, self._terms = skill, tuple(terms)
        if hasattr(skill, "prepare"):
            self.prepare = skill.prepare
        if hasattr(skill, "warm_up"):
            self.warm_up = skill.warm_up

    def __call__(self, step: Step, context: SkillContext) -> SkillResult:
        args = tuple(term if isinstance(term, str) else step.args[term] for term in self._terms)
        return replace(self._skill(replace(step, args=args), context), step=step)


def load_moves(domain: Domain) -> Mapping[str, Skill]:
    """Load the skills that move the arm out of the cameras' view, in order."""
    points = skills_by_name()
    return {name: points[name].load() for name in domain.looking.moves}


def load_attention(domain: Domain, world: MujocoWorld, shown: Sequence[str] = ()) -> Attention:
    """Build the domain's attention: which cameras show which atoms, of those in `shown`, if there are any.

    Raises:
        DomainError: the domain names a camera that the scene does not have.
    """
    looking, cameras = domain.looking, [camera.name for camera in world.spec.cameras]
    for key, names in {"guard": looking.guard, **{f"closer.{name}": of for name, of in looking.closer.items()}}.items():
        for name in names:
            if name not in cameras:
                message = f"the scene has no camera {name!r}; {nearest(name, cameras)}"
                raise DomainError(message, file=domain.files[0], key=f"looking.{key}")
    attention = Attention(looking.closer, looking.carried, looking.guard)
    return attention.only(shown) if shown else attention


def parse_faults(domain: Domain, specs: Sequence[str]) -> list[Fault]:
    """Parse fault specifications, and check their names against the problem and its scene.

    Raises:
        InputError: a specification is malformed, or names something that the scene does not have.
    """
    from executive.sim.spec import read_scene

    scene = read_scene(domain.scene).restricted_to(domain.task.objects, domain.scene)
    items = [item.name for item in scene.items]
    tables = [*(table.name for table in scene.tables), *scene.floors]
    cameras = [camera.name for camera in scene.cameras]
    drawers = [drawer.name for drawer in scene.drawers]
    return [_only_in(MUJOCO, parse_fault(spec, items, tables, cameras, drawers)) for spec in specs]


def _only_in(world: str, fault: Fault) -> Fault:
    """Return the fault, once it is clear that this world has it.

    Raises:
        InputError: it is one of the other world.
    """
    if fault.kind in (SYMBOLIC if world == MUJOCO else PHYSICAL):
        other = SYMBOLIC_WORLD if world == MUJOCO else MUJOCO
        raise OptionError(f"fault {str(fault)!r}: only with `world` {other}", option="faults")
    return fault


def checked_stage(domain: Domain, seed: int | None = None) -> InitialState:
    """Return the problem's initial setting in the domain's scene, after checking that its predicates and :init are
    meaningful there.

    Args:
        seed: draws which atom of each `(oneof ...)` is so, as often as `[priors]` says, and the robot is not told;
            without it, none is set up.

    Raises:
        DomainError: they are not.
    """
    from executive.planning.initial_state import draw_one
    from executive.relations.kinds import check_kinds, read_relation_kinds
    from executive.sim.initial_state import read_initial_state
    from executive.sim.spec import read_scene

    scene, task = read_scene(domain.scene).restricted_to(domain.task.objects, domain.scene), domain.task
    manifest, problem = domain.files[0], domain.files[2]
    kinds = read_relation_kinds(domain.relations, task.parameters, manifest)
    check_kinds(kinds, task, scene.kinds, manifest)
    oneof = domain.parsed.oneof
    declared: dict[Atom, tuple[bool, int]] = dict(domain.parsed.init)
    if seed is not None and oneof:
        rng = np.random.default_rng([seed, _START])
        line = max((line for _, line in declared.values()), default=0)
        declared |= {draw_one(atoms, domain.priors, rng): (True, line) for atoms in oneof}
    return read_initial_state(declared, kinds, scene, problem)


def _too_large(domain: Domain, world: MujocoWorld, truth: Truth) -> Mapping[Atom, str]:
    """Return the atoms that cannot be made true because of an item's size, each with the reason: it is larger than the
    table, or the gripper can take it in no pose.

    Raises:
        DomainError: no atom of the goal can be reached, or an item has to be moved for it that cannot be taken.
    """
    from executive.sim.initial_state import cannot_be_taken, too_large

    task, kinds = domain.task, truth.relation_kinds
    stays = cannot_be_taken(task.atoms, kinds, world.shapes)
    for atom, value in task.goal.facts.items():
        if value and atom in stays and atom not in task.declared:
            world.close()
            raise DomainError(stays[atom], file=domain.scene, key="item")
    why = too_large(task.atoms, kinds, world.shapes, world.spec)
    why |= {atom: reason for atom, reason in stays.items() if kinds[atom.predicate].name == "gripping"}
    goal = task.goal.literals
    if goal is not None and goal.true and why.keys() >= goal.true and not goal.false:
        world.close()
        raise DomainError("; ".join(why[atom] for atom in sorted(goal.true)), file=domain.files[2], key=":goal")
    return why


def _simulator(
    domain: Domain, config: RunConfig, faults: Sequence[Fault], first_observation: int, setting: InitialState
) -> tuple[MujocoWorld, Truth]:
    """Build the world in the state of the problem's :init, which the robot is not given."""
    from executive.sim.initial_state import check_initial_state
    from executive.sim.truth import Truth
    from executive.sim.world import MujocoWorld

    task = domain.task
    world = MujocoWorld(
        domain.scene,
        task.objects,
        seed=config.seed,
        placed=setting.placed,
        grasp_noise=config.grasp_noise,
        home_pose=config.home_pose,
        blockings=sum(fault.kind == "block" for fault in faults),
        keep_trees=config.tree,
        first_observation=first_observation,
        barred=setting.barred,
        held=setting.held,
        depth=config.poses == DEPTH,
        stacked=setting.stacked,
        regions=setting.regions,
        opened=setting.opened,
        renderer=config.renderer,
    )
    truth = Truth(world, domain.relations, task.parameters, domain.files[0])
    try:
        check_initial_state(domain.parsed.init, truth.of, domain.files[2])
    except DomainError:
        world.close()
        raise
    return world, truth
