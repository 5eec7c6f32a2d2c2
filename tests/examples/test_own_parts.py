"""A skill and a relation from another package, registered as docs/how-to/own-world.md says, in the simulator."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from executive.app.worlds import load_skills
from executive.domain.loader import Domain, load_domain
from executive.domain.scaffold import create
from executive.protocols import SkillContext
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld
from executive.types import Atom, SkillStatus, Step
from tests.docs.following import ROOT, blocks

UPRIGHT = Atom("upright", ("blue-tin",))
WAIT = Step.strips("wait", ())


@pytest.fixture
def domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Domain:
    """A new domain that names both, with their package installed."""
    (block,) = (block for block in blocks(ROOT / "docs" / "how-to" / "own-world.md") if block.language == "toml")
    installed = tmp_path / "site" / "own_parts-1.0.dist-info"
    installed.mkdir(parents=True)
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: own-parts\nVersion: 1.0\n")
    groups = tomllib.loads(block.text)["project"]["entry-points"]
    lines = [
        line for group, points in groups.items() for line in (f"[{group}]", *(f"{a} = {b}" for a, b in points.items()))
    ]
    (installed / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(installed.parent))

    folder = create("tidy", tmp_path).folder
    pddl = folder / "domain.pddl"
    text = pddl.read_text().replace("(hand-empty))\n\n", "(hand-empty)\n    (upright ?item - item))\n\n", 1)
    waiting = "\n  (:action wait :parameters () :precondition (hand-empty) :effect (hand-empty)))\n"
    pddl.write_text(text.rstrip().removesuffix(")") + waiting)
    with (folder / "domain.toml").open("a") as manifest:
        manifest.write('[predicates.upright]\nrelation = "upright"\n[actions.wait]\nskill = "wait"\n')
    return load_domain(folder)


@pytest.fixture
def world(domain: Domain) -> Iterator[MujocoWorld]:
    world = MujocoWorld(domain.scene, domain.task.objects, seed=0)
    yield world
    world.close()


def test_the_relation_is_the_truth_of_its_predicate(domain: Domain, world: MujocoWorld) -> None:
    truth = Truth(world, domain.relations, domain.task.parameters)
    assert truth.of([UPRIGHT])[UPRIGHT]
    start = world.model.joint("blue-tin/free").qposadr[0]
    world.data.qpos[start + 3 : start + 7] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]  # on its side
    assert not truth.of([UPRIGHT])[UPRIGHT]


def test_the_skill_takes_its_time_and_heeds_a_cancel(domain: Domain, world: MujocoWorld) -> None:
    wait, start = load_skills(domain)["wait"], world.time

    def after(seconds: float) -> SkillContext:
        return SkillContext(world.handle, np.random.default_rng(0), lambda news: None, lambda: world.time >= seconds)

    done = wait(WAIT, after(np.inf))
    assert done.status is SkillStatus.DONE
    assert done.seconds == pytest.approx(2.0, abs=0.1)
    assert world.time == pytest.approx(start + done.seconds)
    cancelled = wait(WAIT, after(world.time + 0.5))
    assert cancelled.status is SkillStatus.CANCELLED
    assert cancelled.seconds == pytest.approx(0.5, abs=0.1)
