"""The models that come with domains: small, plain weights, and they see."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from executive.app.config import EstimatorConfig
from executive.app.estimators import SHIPPED, open_estimator, shipped, with_default_model
from executive.app.run import Run, RunConfig
from executive.domain.loader import list_domains, load_domain
from executive.lab.training.scene_sampler import SceneSampler
from executive.sim.relighting import Lights, Relighting, Shift
from executive.types import Observation, OutcomeKind

DOMAINS = {name: found for name in list_domains() if (found := shipped(load_domain(name).subject.name))}
"""Those that a model comes with, and its folder."""


@pytest.fixture(scope="module", params=DOMAINS)
def domain(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def folder(domain: str) -> Path:
    return DOMAINS[domain]


def test_all_of_them_are_of_domains_and_together_small() -> None:
    assert "grocery" in DOMAINS
    assert {path for path in SHIPPED.iterdir() if path.is_dir()} == {*DOMAINS.values()}
    assert sum(file.stat().st_size for file in SHIPPED.rglob("*") if file.is_file()) <= 60_000_000


def test_it_is_small_and_holds_no_code(folder: Path) -> None:
    files = [file for file in folder.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) <= 30_000_000
    assert {file.suffix for file in files} <= {".json", ".safetensors", ".jinja", ".md"}
    assert "auto_map" not in json.loads((folder / "config.json").read_text(encoding="utf-8"))


def test_transformers_alone_loads_it(folder: Path) -> None:
    from transformers import AutoModelForImageTextToText, AutoProcessor

    model = AutoModelForImageTextToText.from_pretrained(folder, local_files_only=True, trust_remote_code=False)
    processor = AutoProcessor.from_pretrained(folder, local_files_only=True, trust_remote_code=False)
    assert type(model).__name__ == "FastVlmForConditionalGeneration"
    assert type(processor).__module__.startswith("transformers.")


def test_it_is_what_is_meant_where_no_model_is_named(domain: str, folder: Path) -> None:
    subject = load_domain(domain).subject
    assert with_default_model(EstimatorConfig(), subject).vlm == str(folder)
    assert with_default_model(EstimatorConfig(vlm="elsewhere"), subject).vlm == "elsewhere"


class Moments:
    """Moments that no training saw, so many that one heap that hides everything does not count for much."""

    def __init__(self, domain: str) -> None:
        self.domain = load_domain(domain)
        sampler = SceneSampler(self.domain, [20_261_122])
        self.studio = Relighting(sampler.world.model, sampler.world.spec)
        self.moments = [moment for _ in range(16) for moment in sampler.draw()]
        self.cameras = [camera.name for camera in sampler.world.spec.cameras]
        self._sampler = sampler

    def close(self) -> None:
        self.studio.close()
        self._sampler.close()


@pytest.fixture(scope="module")
def moments(domain: str) -> Iterator[Moments]:
    made = Moments(domain)
    yield made
    made.close()


@pytest.mark.parametrize("harder", [False, True])
def test_it_sees_moments_that_no_training_saw(moments: Moments, harder: bool) -> None:
    """Far below what an evaluation measures, and far above what could be guessed (most atoms are false). One camera
    sees less."""
    eye, rng = open_estimator(EstimatorConfig(), moments.domain.subject), np.random.default_rng(0)
    right, atoms = [], moments.domain.task.atoms
    for number, moment in enumerate(moments.moments):
        lights = Lights.drawn(rng) if harder else None
        shifts = {camera: Shift.drawn(rng) for camera in moments.cameras} if harder else {}
        images = moments.studio.pictures(moment.qpos, lights, shifts)
        belief = eye.estimate(Observation(number, 0.0, images, np.zeros(6)), atoms)
        assert not belief.unanswered
        right += [(belief.probability[atom] > 0.5) == moment.facts[atom] for atom in atoms]
    assert np.mean(right) > (0.96 if len(moments.cameras) > 1 else 0.9)


def test_a_run_sees_with_it_unless_told_otherwise(tmp_path: Path) -> None:
    with Run(RunConfig("grocery", problem="one-item", runs=tmp_path, viewer=False)) as run:
        summary = run.execute()
    assert summary["estimator"] == "s3e:grocery-eye"
    assert summary["outcome"] == OutcomeKind.GOAL_REACHED
    assert summary["goal_true"]
