"""Samples of scenes for training: what is put right beside another thing is there, and physical."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executive.app.worlds import checked_stage
from executive.domain.loader import load_domain
from executive.lab.training import image_shards
from executive.lab.training.scene_sampler import SceneSampler
from executive.sim import placement

DOMAIN = load_domain("blocksworld")


@pytest.fixture(scope="module")
def sampler() -> Iterator[SceneSampler]:
    made = SceneSampler(DOMAIN, [5], checked_stage(DOMAIN))
    yield made
    made.close()


def test_what_is_put_beside_another_thing_is_as_near_as_the_two_can_be(sampler: SceneSampler) -> None:
    shapes = sampler.world.shapes
    one, other = sorted(shapes)[:2]
    (table,) = sampler.world.places().values()
    standing = placement.upright(shapes[other], np.array(table.centre[:2]), table, 0.3)
    radius, height = (placement.circle(shapes[name]) for name in (one, other)), 2 * float(shapes[other].half[2])
    together, falls, behind = sum(radius), 0, 0
    sight = standing[:2] - np.asarray(sampler.world.spec.cameras[0].position[:2])
    for _ in range(60):
        pose = sampler._beside(one, {other: standing})
        assert pose is not None
        away = float(np.hypot(*(pose[:2] - standing[:2])))
        above = pose[2] - table.centre[2] - shapes[one].half[2] > 0.5 * height
        falls += above
        far = away > 1.15 * together
        cosine = (pose[:2] - standing[:2]) @ sight / away / np.hypot(*sight)
        behind += far
        assert 0.5 * together <= away <= together + 0.25
        assert above or away >= together
        assert not far or cosine > 0.8, "only what a camera sees behind the other is farther away"
    assert 5 < falls < 50
    assert behind > 5


def test_there_is_nothing_to_be_beside_on_the_floor(sampler: SceneSampler) -> None:
    one, other = sorted(sampler.world.shapes)[:2]
    assert sampler._beside(one, {}) is None
    assert sampler._beside(one, {other: np.array([0.5, 0.0, 0.03, 1.0, 0.0, 0.0, 0.0])}) is None


def test_tables_have_other_colours_meanwhile() -> None:
    images = image_shards.ImageSampler(DOMAIN, [5], 64, start=checked_stage(DOMAIN))
    try:
        model, rng = images._relighting.model, np.random.default_rng(0)
        top, before = model.geom("table/top").matid[0], (model.mat_rgba.copy(), model.geom_rgba.copy())
        hues = []
        for _ in range(20):
            with image_shards._recoloured(model, rng, images._tables):
                hues.append(model.mat_rgba[top, :3] / model.mat_rgba[top, :3].max())
        assert np.min(hues) < 0.5
        assert np.array_equal(model.mat_rgba, before[0])
        assert np.array_equal(model.geom_rgba, before[1])
    finally:
        images.close()
