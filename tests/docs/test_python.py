"""Python in README and docs is quoted from programs in examples/, which are type-checked and run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.following import DOCUMENTS, ROOT, Block, blocks

EXAMPLES = [file.read_text(encoding="utf-8") for file in sorted((ROOT / "examples").rglob("*.py"))]
QUOTED = [block for document in DOCUMENTS for block in blocks(document) if block.language == "python"]

pytestmark = pytest.mark.pages


def test_there_is_something_to_check() -> None:
    assert {block.document.name for block in QUOTED} >= {"README.md", "own-model.md", "own-world.md"}


@pytest.mark.parametrize("block", QUOTED, ids=str)
def test_what_is_quoted_is_there(block: Block) -> None:
    assert any(block.text in example for example in EXAMPLES), f"{block} is not in any file of examples/"


@pytest.mark.timeout(900)
def test_the_library_recovers_in_ten_lines(tmp_path: Path) -> None:
    """README's own example, run from another folder."""
    run = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "library.py")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    *told, last = run.stdout.splitlines()
    assert re.fullmatch(r"goal-reached [1-9][0-9]* True", last)
    assert any("dropped" in line for line in told)
