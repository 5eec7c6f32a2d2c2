"""A data card's numbers add up, and a hub can read it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from huggingface_hub import DatasetCard

from executive.lab.collection import data_card
from tests.executive.lab import samples

WHAT = {
    "domain": "kitchen",
    "problem": "lunch",
    "files": "0123",
    "seed": 3,
    "home_pose": True,
    "grasp_noise": 0.006,
    "slips": 0.05,
    "points_per_episode": 20,
    "failures_in_a_row": 5,
    "jpeg_quality": 92,
    "versions": {"executive": "0.1.0"},
}


def manifest(folder: Path) -> dict[str, Any]:
    return {
        "command": "executive collect kitchen --points 4 --seed 3 --out data",
        "collection": WHAT,
        "cameras": {camera: [32, 24] for camera in samples.CAMERAS},
        "atoms": list(map(str, samples.ATOMS)),
        "statistics": data_card.statistics(samples.write(folder), samples.LOGS),
    }


def test_counts_add_up(tmp_path: Path) -> None:
    counted = data_card.statistics(samples.write(tmp_path), samples.LOGS)
    assert (counted["points"], counted["episodes"], counted["surprising_points"]) == (4, 3, 1)
    assert counted["attempts"] == {"pick": {"done": 4, "dropped": 1, "no path": 5}}
    assert counted["endings"] == {"enough actions done": 2, "too many failures in a row": 1}
    assert counted["predicates"] == {
        "hand-free": {"true": 1, "false": 3},
        "holding": {"true": 3, "false": 1},
        "on": {"true": 1, "false": 3},
    }


def test_the_card_says_what_was_counted(tmp_path: Path) -> None:
    text = data_card.render(manifest(tmp_path))
    assert "| `pick` | 10 | 4 | 40.0 % | dropped 1, no path 5 |" in text
    assert "| `holding` | 3 | 1 | 75.0 % |" in text
    assert "| hand | `image_hand` | 32 | 24 |" in text
    assert "executive collect kitchen --points 4 --seed 3 --out data" in text
    assert "standard deviation of 6 mm" in " ".join(text.split())
    assert not re.search(r"[{}]", text)  # nothing left to be filled in
    assert max(map(len, text.splitlines())) <= 120


def test_a_hub_reads_the_header(tmp_path: Path) -> None:
    data = DatasetCard(data_card.render(manifest(tmp_path))).data.to_dict()
    assert data["pretty_name"] == "Executive: kitchen / lunch"
    assert data["configs"] == [{"config_name": "default", "data_files": "data/*.parquet"}]
    assert data["size_categories"] == ["n<1K"]
