"""Relations as functions of a scene, held against what touches what in the simulator: `python -m benchmarks.relations`.

Until they were functions of a scene, relations were read from MuJoCo's contacts. Both are asked at moments of random
actions, drops and tips included, and while items tumble that were thrown upon the tables. What differs is printed, with
how far things were apart.

With `--depth` it is what depth tells of the atoms that is held against the truth, once things have come to rest: how
often each relation is wrong on the estimated scene, which is what the belief reckons with.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.kept import Kept, Row
from executive.app.depth_witness import DepthWitness
from executive.app.localizer import item_models, open_localizer
from executive.app.worlds import load_skills
from executive.domain.loader import Domain, load_domain
from executive.faults import FaultInjector, parse_fault
from executive.lab.collection.episode import instances
from executive.perception import EstimatedScenes
from executive.protocols import SkillContext
from executive.relations.convex import distance
from executive.relations.kinds import read_relation_kinds
from executive.sim.known_models import KnownScene
from executive.sim.solids import FINGERS
from executive.sim.spec import read_scene
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom, Facts, News, Phase, Step

FIRST_SEED = 700_000
ACTIONS, THROWN = 3, 3.0
"""Of each scene: random actions, and seconds for which things tumble."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", default="grocery", help="with --depth: whose relations")
    parser.add_argument("--moments", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first scene")
    parser.add_argument("--depth", type=int, default=0, help="so many scenes, of the relations on the estimated scene")
    parser.add_argument("--out", type=Path, help="a file that results are kept in, to go on with later")
    arguments = parser.parse_args()
    domain = load_domain("grocery")
    if arguments.depth:
        measure_depth(load_domain(arguments.domain), arguments.seed, arguments.depth)
        return
    moments, seed = 0, arguments.seed
    with Kept(arguments.out) as kept:
        while moments < arguments.moments:
            moments += kept.of(f"seed {seed}", partial(compare, domain, seed))["moments"]
            seed += 1
    report(list(kept.rows.values()), len(domain.task.atoms))
    seconds = sum(row["seconds"] for row in kept.rows.values())
    print(f"seeds {arguments.seed} to {seed - 1}, {seconds:.0f} s of processor time")


def compare(domain: Domain, seed: int) -> Row:
    """Return what the moments of a scene came to."""
    began, tally = time.process_time(), Tally(domain)
    world = play(domain, seed, tally.compare)
    row = {
        "moments": tally.moments,
        "true": tally.true,
        "atoms": tally.atoms,
        "differing": [f"seed {seed} at {line}" for line in tally.differing],
        "seconds": time.process_time() - began,
    }
    world.close()
    return row


def report(rows: list[Row], atoms_of_each: int) -> None:
    """Print what all scenes came to."""
    moments = sum(row["moments"] for row in rows)
    true, wrong = (sum((Counter(row[name]) for row in rows), Counter[str]()) for name in ("true", "atoms"))
    differing = [line for row in rows for line in row["differing"]]
    atoms = moments * atoms_of_each
    for line in differing:
        print(line)
    print(f"{moments} moments, {1.0 - len(differing) / moments:.3%} the same in all of {atoms_of_each} atoms")
    print(f"{atoms} atoms, {1.0 - wrong.total() / atoms:.4%} the same")
    print(f"true: {dict(true)}; differing: {dict(wrong)}")


def play(
    domain: Domain,
    seed: int,
    moment: Callable[[MujocoWorld], None] | None = None,
    rest: Callable[[MujocoWorld], None] | None = None,
) -> MujocoWorld:
    """A scene in which random actions are carried out, and then everything is thrown upon the tables. `moment` is
    called ten times a second, `rest` after each action and in the end."""
    world = MujocoWorld(domain.scene, domain.task.objects, seed, grasp_noise=0.003, depth=rest is not None)
    rng, skills = np.random.default_rng([seed, 2]), load_skills(domain)
    items, tables = world.items, [table.name for table in world.spec.tables]
    specs = ("drop:p=0.3", "shove:p=0.2", "tip:p=0.2")
    faults = FaultInjector([parse_fault(spec, items, tables, []) for spec in specs], world, seed)
    truth, steps = Truth(world, domain.relations, domain.task.parameters), instances(domain.parsed)
    if moment is not None:
        world.watch(lambda frame: moment(world))
    for count in range(1, ACTIONS + 1):
        known = domain.task.derived.complete(truth.of(domain.task.atoms))
        applicable = [step for step in steps if step.precondition.truth(known)]
        if not applicable:
            break
        step = applicable[int(rng.integers(len(applicable)))]
        faults.before_action(count, step)
        follow = partial(_follow, faults, count, step)
        skills[step.action](
            step, SkillContext(world.handle, np.random.default_rng([seed, count]), follow, lambda: False)
        )
        faults.after_action(count, step)
        if rest is not None:
            rest(world)
    for item in items:
        table = world.spec.tables[int(rng.integers(len(tables)))]
        beside = np.array(table.size[:2]) * rng.uniform(-0.5, 0.5, 2)
        x, y, z, w = Rotation.random(rng=rng).as_quat()
        world.put(
            item,
            np.array([*(np.array(table.centre[:2]) + beside), table.centre[2] + rng.uniform(0.1, 0.4), w, x, y, z]),
        )
    world.settle(THROWN)
    if rest is not None:
        rest(world)
    return world


def measure_depth(domain: Domain, first: int, scenes: int) -> None:
    """How often relations are wrong on the estimated scene."""
    spec = read_scene(domain.scene)
    models, known, kinds = item_models(spec), KnownScene(spec), read_relation_kinds(domain.relations, {})
    counts: Counter[tuple[str, str, bool, int]] = Counter()
    for seed in range(first, first + scenes):

        def rest(world: MujocoWorld, seed: int = seed) -> None:
            world.localizer = world.localizer or open_localizer(world, models=models, known=known)
            facts = Truth(world, domain.relations, domain.task.parameters).of(domain.task.atoms)
            told = DepthWitness(world, EstimatedScenes(models, known), kinds).told(domain.task.atoms)
            missing = set(world.localizer.now().missing)
            hidden = domain.task.visibility.hidden(facts)  # a run asks nobody about these
            for atom in (atom for atom in domain.task.atoms if atom not in hidden):
                how = "missing" if missing & set(atom.args) else "seen"
                value = told.get(atom, -1.0)
                kind = -1 if value < 0.0 else 0 if value < 0.1 or how == "missing" else 2 if value > 0.9 else 1
                counts[atom.predicate, how, facts[atom], kind] += 1
                if kind >= 0 and abs(value - facts[atom]) > 0.5:
                    print(
                        f"seed {seed} at {world.time:.1f} s: {atom} {value:.2f}, in truth {facts[atom]} ({how})",
                        flush=True,
                    )

        play(domain, seed, rest=rest).close()
    print(f"{'predicate':<22}{'item':<9}{'truth':<7}{'no answer':>10}{'below 0.1':>10}{'between':>9}{'above 0.9':>10}")
    for predicate, how, truth in sorted({key[:3] for key in counts}):
        row = [counts[predicate, how, truth, kind] for kind in (-1, 0, 1, 2)]
        print(f"{predicate:<22}{how:<9}{truth!s:<7}{row[0]:>10}{row[1]:>10}{row[2]:>9}{row[3]:>10}")
    print(f"{scenes} scenes")


def _follow(faults: FaultInjector, count: int, step: Step, news: News) -> None:
    if isinstance(news, Phase):
        faults.on_phase(count, step, news)


class Contacts:
    """The relations by what MuJoCo has touch each other, after `mj_forward`."""

    def __init__(self, world: MujocoWorld) -> None:
        self.world = world
        self.touching: dict[str, set[str]] = {item: set() for item in world.shapes}
        model, data = world.model, world.data
        for contact in data.contact[: data.ncon]:
            first, second = (int(model.geom_bodyid[geom]) for geom in contact.geom)
            for one, other in ((first, second), (second, first)):
                item, root = model.body(model.body_rootid[one]).name, model.body(model.body_rootid[other]).name
                if item in self.touching and root != item:
                    self.touching[item].add(root if root in self.touching else model.body(other).name)

    def gripping(self, item: str) -> bool:
        return all(not self.touching[item].isdisjoint(finger) for finger in FINGERS)

    def on(self, item: str, table: str) -> bool:
        if self.gripping(item):
            return False
        seen, frontier, tables = {item}, [item], set()
        while frontier:
            for body in self.touching[frontier.pop()]:
                if body in self.world.handle.tables:
                    tables.add(body)
                elif body in self.touching and body not in seen:
                    seen.add(body)
                    frontier.append(body)
        centre = self.world.data.subtree_com[self.world.model.body(item).id]
        return bool(tables) and table == min(sorted(tables), key=lambda name: self._outside(centre, name))

    def _outside(self, point: np.ndarray[tuple[int], np.dtype[np.float64]], name: str) -> float:
        table = self.world.handle.tables[name]
        x, y = point[:2] - np.asarray(table.centre[:2])
        cos, sin = np.cos(table.yaw), np.sin(table.yaw)
        local = np.abs([cos * x + sin * y, -sin * x + cos * y]) - 0.5 * np.asarray(table.size[:2])
        return float(np.linalg.norm(np.maximum(local, 0.0)))

    def of(self, atoms: tuple[Atom, ...]) -> Facts:
        empty = not any(self.gripping(item) for item in self.world.shapes)
        told: dict[str, Callable[..., bool]] = {
            "on-table": self.on,
            "robot-gripping": self.gripping,
            "robot-gripper-empty": lambda: empty,
        }
        return Facts({atom: told[atom.predicate](*atom.args) for atom in atoms})


class Tally:
    """The moments, and where the two differ."""

    def __init__(self, domain: Domain) -> None:
        self.domain, self.moments, self.true = domain, 0, Counter[str]()
        self.differing: list[str] = []
        self.atoms: Counter[str] = Counter()
        self._truth: tuple[MujocoWorld, Truth] | None = None

    def compare(self, world: MujocoWorld) -> None:
        if self._truth is None or self._truth[0] is not world:
            self._truth = world, Truth(world, self.domain.relations, self.domain.task.parameters)
        facts = self._truth[1].of(self.domain.task.atoms)
        other = Contacts(world).of(self.domain.task.atoms)
        self.moments += 1
        self.true.update(atom.predicate for atom in facts.true)
        wrong = [atom for atom in self.domain.task.atoms if facts[atom] is not other[atom]]
        if wrong:
            self.atoms.update(atom.predicate for atom in wrong)
            said = ", ".join(f"{atom} {facts[atom]}, by contacts {other[atom]}" for atom in wrong)
            self.differing.append(f"{world.time:.2f} s: {said}{self._apart(self._truth[1], world, wrong)}")

    def _apart(self, truth: Truth, world: MujocoWorld, wrong: list[Atom]) -> str:
        scene, item = truth.scene(), next((atom.args[0] for atom in wrong if atom.args), None)
        if item is None:
            return ""
        mine = scene.items[item].parts[0].corners
        others = {**scene.items, **scene.tables, "left finger": scene.fingers[0], "right finger": scene.fingers[1]}
        away = {
            name: min(distance(mine, part.corners) for part in solid.parts)
            for name, solid in others.items()
            if name != item
        }
        speed = float(np.linalg.norm(world.data.joint(f"{item}/free").qvel[:3]))
        near = ", ".join(
            f"{name} {1e3 * gap:.2f} mm" for name, gap in sorted(away.items(), key=lambda each: each[1])[:3]
        )
        return f"; {item} moves at {speed:.2f} m/s, next to {near}"


if __name__ == "__main__":
    main()
