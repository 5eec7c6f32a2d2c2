"""The longer pages of docs/, followed word for word: each in a folder of its own, with what the page says is there."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from tests.docs.following import DOCS, FOLLOWED, ROOT, Follower, blocks
from tests.executive.s3e.chat_server import serving
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.on_server import honest

pytestmark = pytest.mark.pages


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder that has of a clone what the pages use of it."""
    folder = tmp_path / "clone"
    folder.mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


@pytest.fixture
def server() -> Iterator[str]:
    """The address of an OpenAI-compatible server."""
    with serving(honest) as there:
        yield there.url


def follow(page: str, clone: Path, **instead: str) -> Follower:
    reader = Follower(clone.parent, instead)
    reader.here = clone
    assert page in FOLLOWED
    for block in blocks(DOCS / page):
        reader.follow(block)
    return reader


@pytest.mark.timeout(1200)
def test_a_domain_of_ones_own(clone: Path) -> None:
    robots = follow("tutorials/domain.md", clone).here
    assert robots == clone.parent / "robots"
    assert (robots / "first.png").stat().st_size > 10_000
    assert (robots / "data" / "README.md").is_file()
    assert len(list((robots / "runs").iterdir())) == 5


@pytest.mark.timeout(1200)
def test_a_model_of_ones_own(clone: Path, server: str) -> None:
    build("fastvlm", clone / "my-model", answering=8.0)
    for name, seed in (("front.png", 0), ("hand.png", 1)):
        pixels = np.random.default_rng(seed).integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Picture.fromarray(pixels).save(clone / name)
    follow("how-to/own-model.md", clone, **{"http://127.0.0.1:8000/v1": server})
    assert (clone / "runs" / "by-sight" / "summary.json").is_file()
    assert list((clone / "report").iterdir())


def test_a_world_of_ones_own(clone: Path) -> None:
    follow("how-to/own-world.md", clone)


def test_a_robot_behind_a_socket(clone: Path) -> None:
    follow("how-to/real-robot.md", clone)


@pytest.mark.timeout(600)
def test_a_domain_before_there_is_a_robot(clone: Path) -> None:
    here = follow("how-to/symbolic-world.md", clone).here
    assert (here / "run.png").stat().st_size > 10_000
    assert len(list((here / "runs").iterdir())) == 2
