"""What is measured of the skills is what was so, wherever a collection lets one know."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from executive.app.sensor_fit import load_outcomes
from executive.belief.action_model import Chances, outcome
from executive.core.compare import progress
from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.collection import dataset
from executive.lab.collection.dataset import Attempt, Ending, Log, Point
from executive.lab.collection.outcomes import document, measure
from executive.types import Atom, Facts, SkillStatus, Step
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"
SCHEMA = load_domain(TRAY).parsed
ATOMS = SCHEMA.task.atoms
CUBES, SUPPORTS = ("green-cube", "red-cube"), ("bench", "tray")
DESCRIBED = {"domain": "tray", "seed": 5}


def facts_of(where: dict[str, str]) -> Facts:
    true = {Atom("holding", (cube,)) for cube, place in where.items() if place == "hand"}
    true |= {Atom("resting-on", (cube, place)) for cube, place in where.items() if place in SUPPORTS}
    return Facts.closed(true | ({Atom("hand-free")} if "hand" not in where.values() else set()), ATOMS)


class Episode:
    """Random actions, some of which fail in every way; and the truth about what came of them."""

    def __init__(self, rng: random.Random) -> None:
        self.where = {cube: rng.choice(SUPPORTS) for cube in CUBES}
        self.attempts: list[Attempt] = []
        self.points: list[tuple[Step, Facts, Facts]] = []
        self.true: list[tuple[str, SkillStatus, Chances]] = []
        while len(self.points) < 20:
            self._act(rng)

    def _act(self, rng: random.Random) -> None:
        held = next((cube for cube in CUBES if self.where[cube] == "hand"), None)
        lying = [cube for cube in CUBES if self.where[cube] in SUPPORTS]
        if held is None and not lying:
            self.where[CUBES[0]] = rng.choice(SUPPORTS)  # somebody helps, before anything is looked at
            self.attempts.append(Attempt("lift(green-cube,bench)", "no path", ""))
            self.true.append(("lift", SkillStatus.NO_PATH, Chances(0, 0, 1)))
            return
        cube = held or rng.choice(lying)
        place = rng.choice(SUPPORTS) if held else self.where[cube]
        step, before = SCHEMA.ground("drop" if held else "lift", (cube, place)), facts_of(self.where)
        status = rng.choice([SkillStatus.DONE, SkillStatus.DONE, SkillStatus.DROPPED, SkillStatus.GRASP_MISSED])
        if status is SkillStatus.DONE or rng.random() < 0.3:
            self.where[cube] = "hand" if step.action == "lift" else place
        elif rng.random() < 0.5:
            self.where[cube] = rng.choice([other for other in (*SUPPORTS, "floor") if other != self.where[cube]])
        after = facts_of(self.where)
        self.attempts.append(Attempt(str(step), str(status), ""))
        self.true.append((step.action, status, outcome(step, before, after)))
        if status is SkillStatus.DONE:
            self.points.append((step, before, after))


def collection(folder: Path, episodes: list[Episode]) -> Path:
    (folder / dataset.SHARDS).mkdir(parents=True)
    for number, episode in enumerate(episodes):
        points = [
            Point(
                seed=5,
                episode=number,
                step=index + 1,
                action=str(step),
                time=float(index),
                joints=np.zeros(6),
                qpos=np.zeros(7),
                images={},
                facts=after,
                surprises=tuple(atom for atom, value in after.items() if progress(before, step)[atom] is not value),
            )
            for index, (step, before, after) in enumerate(episode.points)
        ]
        log = Log(number, len(points), tuple(episode.attempts), Ending.FULL)
        dataset.write_atomically(
            dataset.shard(folder, log.episode), dataset.shard_bytes(dataset.digest(DESCRIBED), log, points, ATOMS, ())
        )
    manifest = {
        "format": dataset.FORMAT,
        "collection": DESCRIBED,
        "command": f"executive collect {TRAY} --points 3 --out {folder} --seed 5",
        "points": 60,
        "finished": True,
        "cameras": {},
        "atoms": [str(atom) for atom in ATOMS],
        "statistics": {"points": 60, "episodes": len(episodes)},
    }
    (folder / dataset.MANIFEST).write_text(json.dumps(manifest))
    return folder


def knowable(episode: Episode) -> list[tuple[str, SkillStatus, Chances]]:
    """What was completed, and what failed alone between two that were."""
    done = [attempt.done for attempt in episode.attempts]
    return [
        each
        for number, each in enumerate(episode.true)
        if done[number] or (0 < number < len(done) - 1 and done[number - 1] and done[number + 1])
    ]


def test_what_is_measured_is_what_was_so(tmp_path: Path) -> None:
    episodes = [Episode(random.Random(seed)) for seed in range(3)]
    expected: dict[tuple[str, SkillStatus], Counter[int]] = {}
    for action, status, chances in (each for episode in episodes for each in knowable(episode)):
        expected.setdefault((action, status), Counter())[chances.index(1)] += 1
    measured = measure(collection(tmp_path / "data", episodes), SCHEMA)
    assert len(measured) >= 6
    assert dict(measured) == {key: Chances(count[0], count[1], count[2]) for key, count in expected.items()}


def test_a_domain_reads_what_was_measured(tmp_path: Path) -> None:
    measured = measure(collection(tmp_path / "data", [Episode(random.Random(1))]), SCHEMA)
    file = tmp_path / "outcomes.toml"
    file.write_text(document(measured, "executive collect tray"))
    assert load_outcomes(file, SCHEMA.actions) == measured
    assert "# Measured on: executive collect tray\n" in file.read_text()


def test_the_program_prints_the_file_without_the_name_of_a_folder(tmp_path: Path) -> None:
    folder = collection(tmp_path / "data", [Episode(random.Random(2))])
    command = [sys.executable, "-m", "executive.lab.collection.outcomes"]
    done = subprocess.run([*command, str(TRAY), str(folder)], capture_output=True, text=True, check=True, cwd=ROOT)
    assert str(tmp_path) not in done.stdout
    (tmp_path / "outcomes.toml").write_text(done.stdout)
    assert load_outcomes(tmp_path / "outcomes.toml", SCHEMA.actions) == measure(folder, SCHEMA)
    wrong = subprocess.run([*command, "grocery", str(folder)], capture_output=True, text=True, check=False, cwd=ROOT)
    assert wrong.returncode == 1
    assert wrong.stderr.startswith("error: was collected in another task: there is no action 'lift'")


def test_a_collection_of_another_task_is_refused(tmp_path: Path) -> None:
    folder = collection(tmp_path / "data", [Episode(random.Random(3))])
    with pytest.raises(InputError, match="was collected in another task"):
        measure(folder, load_domain("grocery").parsed)
