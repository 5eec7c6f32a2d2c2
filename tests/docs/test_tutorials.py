"""The tutorials, followed word for word from an empty folder."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.docs.following import ROOT, Follower, blocks

DOCUMENT = ROOT / "docs" / "tutorial-domain.md"


@pytest.mark.timeout(600)
def test_a_domain_of_ones_own(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    clone.mkdir()
    (clone / ".venv").symlink_to(sys.prefix)
    reader = Follower(tmp_path)
    reader.here = clone
    for block in blocks(DOCUMENT):
        reader.follow(block)
    robots = tmp_path / "robots"
    assert reader.here == robots
    assert (robots / "first.png").stat().st_size > 10_000
    assert (robots / "data" / "README.md").is_file()
    assert len(list((robots / "runs").iterdir())) == 5
