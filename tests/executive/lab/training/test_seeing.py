"""Sampled moments, their pictures, and the labels of the vision encoder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from executive.domain.loader import load_domain
from executive.lab.training import image_shards, vision_encoder
from executive.lab.training.label_space import LabelSpace
from executive.lab.training.network import MEAN, STD
from executive.lab.training.presets import SMALLEST
from executive.lab.training.scene_sampler import SceneSampler
from executive.types import Atom
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"


@pytest.fixture(scope="module")
def sampler() -> Iterator[SceneSampler]:
    made = SceneSampler(load_domain(ROOT / "domains" / "grocery"), [3])
    yield made
    made.close()


def test_moments_are_many_kinds_of_states(sampler: SceneSampler) -> None:
    moments = [moment for _ in range(12) for moment in sampler.draw()]
    held = {
        str(atom) for moment in moments for atom, value in moment.facts.items() if value and "gripping" in str(atom)
    }
    assert len(held) >= 3
    assert any(
        not any(value for atom, value in moment.facts.items() if item in atom.args)
        for moment in moments
        for item in sampler.world.shapes
    ), "nothing ever lies on the floor"
    for moment in moments:
        assert sum(value for atom, value in moment.facts.items() if "gripping" in atom.predicate) <= 1
        for item in sampler.world.shapes:
            assert sum(value for atom, value in moment.facts.items() if atom.args[:1] == (item,)) <= 1


def test_drawers_are_open_and_closed_and_what_a_closed_one_hides_is_labelled_as_not_seen() -> None:
    domain = load_domain(ROOT / "domains" / "kitchen")
    sampler = SceneSampler(domain, [3])
    moments = [moment for _ in range(14) for moment in sampler.draw()]
    sampler.close()
    true = [{atom for atom, value in moment.facts.items() if value} for moment in moments]
    inside = [atom for facts in true for atom in facts if atom.predicate == "in"]
    assert len({atom.args[1] for atom in inside}) == 3
    assert len({atom.args[0] for atom in inside}) >= 3
    assert 0.4 < sum(atom.predicate == "open" for facts in true for atom in facts) / (3 * len(true)) < 0.7
    assert any(Atom("on", (item, "tray")) in facts for facts in true for item in sampler.world.shapes)
    for facts in true:
        assert all(Atom("open", atom.args[1:]) in facts for atom in facts if atom.predicate == "in")
    nowhere = [facts for facts in true if not any("can" in atom.args for atom in facts)]
    assert nowhere, "no closed drawer ever hides anything"


def test_where_items_stand_on_each_other_and_in_regions_they_do_in_samples_too() -> None:
    sampler = SceneSampler(load_domain(ROOT / "domains" / "blocksworld" / "columns", "all-blocks"), [3])
    moments = [moment for _ in range(8) for moment in sampler.draw()]
    sampler.close()
    told = [[atom for atom, value in moment.facts.items() if value] for moment in moments]
    towers = [sum(atom.predicate == "on" for atom in true) for true in told]
    assert max(towers) >= 2
    assert min(towers) <= 1
    assert len({atom.args[1] for true in told for atom in true if atom.predicate == "incolumn"}) >= 4
    for true in told:  # a column has what stands on what is in it
        where = {atom.args[0]: atom.args[1] for atom in true if atom.predicate == "incolumn"}
        for atom in true:
            if atom.predicate == "on" and set(atom.args) <= where.keys():
                assert where[atom.args[0]] == where[atom.args[1]]


def test_the_same_seed_draws_the_same_moments() -> None:
    drawn = []
    for _ in range(2):
        sampler = SceneSampler(load_domain(TRAY), [1, 2])
        drawn.append([moment.qpos for _ in range(2) for moment in sampler.draw()])
        sampler.close()
    assert len(drawn[0]) == len(drawn[1])
    assert all((one == other).all() for one, other in zip(*drawn, strict=True))


def test_a_shard_is_read_as_it_was_drawn(tmp_path: Path) -> None:
    told: list[float] = []
    draw = image_shards.ShardWriter(str(TRAY), None, 5, 64, 6, tmp_path)
    draw(3, told.append)
    assert told == [pytest.approx(done / 6) for done in range(1, 7)]
    assert image_shards.shards(tmp_path) == [3]
    shard = image_shards.read_shard(tmp_path, 3)
    labels = LabelSpace.of(load_domain(TRAY))
    count, cameras = shard.pictures.shape[:2]
    assert count == 6
    assert shard.pictures.shape[2:] == (64, 64, 3)
    assert shard.items.shape == (6, cameras, 48, 48)
    assert shard.facts.shape == (6, len(labels.atoms))
    assert set(np.unique(shard.items)) == {0, *range(1, len(labels.items) + 1)}
    # Somebody else may have drawn it meanwhile; it is the same.
    there = (tmp_path / "shard-0003" / "pictures.npy").stat().st_ino
    image_shards.write_shard(tmp_path, 3, shard._asdict())
    assert [path.name for path in tmp_path.iterdir()] == ["shard-0003"]
    assert (tmp_path / "shard-0003" / "pictures.npy").stat().st_ino == there


def test_a_cell_shows_as_many_pixels_as_it_has() -> None:
    masks = torch.from_numpy(np.random.default_rng(0).integers(0, 3, (2, 48, 48)))
    for grid in (2, 4, 6, 12):
        cells = vision_encoder.shown(masks, 2, grid)
        assert cells.shape == (2, 2, grid, grid)
        for item in range(2):
            assert torch.allclose(cells[:, item].sum((1, 2)), (masks == item + 1).sum((1, 2)).float())


def test_unaugmented_pictures_are_normalised_and_nothing_else() -> None:
    rng = np.random.default_rng(0)
    raw = rng.integers(0, 256, (3, 32, 32, 3), dtype=np.uint8)
    made = vision_encoder.prepared(raw, rng, augment=False)
    plain = (torch.from_numpy(raw).permute(0, 3, 1, 2) / 255.0 - MEAN) / STD
    assert torch.allclose(made, plain, atol=1e-5)


def test_augmented_pictures_stay_pictures() -> None:
    rng = np.random.default_rng(0)
    raw = rng.integers(0, 256, (20, 32, 32, 3), dtype=np.uint8)
    made = vision_encoder.prepared(raw, rng) * STD + MEAN
    assert float(made.min()) >= 0.0 - 1e-5
    assert float(made.max()) <= 1.0 + 1e-5
    plain = torch.from_numpy(raw).permute(0, 3, 1, 2) / 255.0
    changed = [not torch.allclose(one, other, atol=1e-4) for one, other in zip(made, plain, strict=True)]
    assert 5 < sum(changed) < 20


class Says(torch.nn.Module):
    """A head that says the same of everything."""

    def __init__(self, said: torch.Tensor) -> None:
        super().__init__()
        self._said = said

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return self._said


def test_dense_labels_reward_what_is_shown() -> None:
    """Logits that say what the mask and the facts say cost next to nothing; the opposite costs much."""
    labels = LabelSpace.of(load_domain(TRAY))
    dense = vision_encoder.Dense(SMALLEST, labels)
    items, facets = len(labels.items), len(labels.facets)
    masks = torch.zeros(1, 48, 48, dtype=torch.uint8)
    masks[:, :24, :24] = 1
    facts = torch.zeros(1, len(labels.atoms), dtype=torch.bool)
    facts[0, labels.facets[0][1]] = True
    right = torch.full((1, items + facets, 2, 2), -20.0)
    right[0, 0, 0, 0] = right[0, items, 0, 0] = 20.0
    finer = torch.full((1, items, 4, 4), -20.0)
    finer[0, 0, :2, :2] = 20.0

    def loss(sign: float) -> float:
        for name, said in (("cells", right), ("halves", finer)):
            setattr(dense, name, Says(sign * said))
        return float(dense(torch.zeros(1, 16, 2, 2), torch.zeros(1, 16, 4, 4), masks, facts)[0])

    assert loss(1.0) < 1e-3
    assert loss(-1.0) > 10.0
