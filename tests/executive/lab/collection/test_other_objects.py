"""A collection with other objects in each episode, and with masks of what each pixel shows."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from executive import cli
from executive.errors import OptionError
from executive.lab.collection import dataset
from executive.lab.config import CollectConfig

COMMAND = ["collect", "blocksworld", "--points", "2", "--objects", "3-4", "--masks", "--seed", "5", "--jobs", "1"]


def test_each_episode_has_objects_atoms_and_masks_of_its_own(tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "data"
    assert cli.exit_code([*COMMAND, "--out", str(out)]) == cli.REACHED
    points = list(dataset.read(out))
    assert len(points) == 2
    (row, _) = dataset.columns(out, 0, "objects", "mask_front", "action")
    names = [each["name"] for each in row["objects"]]
    assert 3 <= len(names) <= 4
    assert all(each["attributes"] == each["name"].split("-") for each in row["objects"])
    about = {name for atom in points[0].facts for name in atom.args}
    assert about == set(names)
    assert sum(
        value for atom, value in points[0].facts.items() if atom.predicate in ("on", "on-table", "holding")
    ) == len(names)
    mask = np.asarray(Picture.open(io.BytesIO(row["mask_front"]["bytes"])))
    assert mask.shape == points[0].images["front"].shape[:2]
    seen, pixels = np.unique(mask[mask > 0], return_counts=True)
    assert set(seen) <= set(range(1, len(names) + 1))
    assert pixels.max() > 200
    manifest = json.loads((out / "dataset.json").read_text(encoding="utf-8"))
    assert manifest["collection"]["objects"] == "3-4"
    assert manifest["atoms"] == []
    assert "each episode has atoms of its own" in (out / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("objects", ["two", "2-", "-3", "2-3-4"])
def test_how_many_objects_is_a_number_or_a_range(objects: str) -> None:
    with pytest.raises(OptionError, match="such as 2-10"):
        CollectConfig("blocksworld", Path("out"), objects=objects)


def test_a_subset_has_blocks_of_it_alone(tmp_path: Path, one_thread: None) -> None:
    out = tmp_path / "data"
    assert cli.exit_code([*COMMAND, "--subset", "metal-only", "--out", str(out)]) == cli.REACHED
    (row, _) = dataset.columns(out, 0, "objects", "action")
    assert {each["attributes"][2] for each in row["objects"]} == {"metal"}
    manifest = json.loads((out / "dataset.json").read_text(encoding="utf-8"))
    assert manifest["collection"]["subset"] == "metal-only"


@pytest.mark.parametrize("options", [{"subset": "metal-only"}, {"combinations": "seen"}])
def test_which_objects_there_are_is_said_of_made_problems_alone(options: dict[str, str]) -> None:
    with pytest.raises(OptionError, match="needs `objects`") as caught:
        CollectConfig("blocksworld", Path("out"), **options)  # type: ignore[arg-type]
    assert [caught.value.option] == list(options)


def test_made_problems_exclude_a_named_one() -> None:
    with pytest.raises(OptionError, match="excludes `problem`"):
        CollectConfig("blocksworld", Path("out"), objects="3", problem="tower-5")
