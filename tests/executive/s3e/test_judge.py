"""The paper's authors' own package, s3e 0.5.0, gives the same answers on the same checkpoints."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("s3e", reason="the judge is not installed: pip install 'executive[judge]'")

from benchmarks.s3e import PLAIN, Judge, pictures, same
from tests.executive.s3e.checkpoints import FAMILIES, build


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_answers(tmp_path: Path, family: str) -> None:
    rows = same(tmp_path, [family])
    assert [row["pictures"] for row in rows] == [1, 2]
    for row in rows:
        assert row["path"] == "shared"
        assert row["P(true)"] < 1e-4
        assert row["mass"] < 1e-4
        assert max(row["permuted"], row["subset"]) < 1e-5
        assert row["spread"] > 1e-2, "the questions have to matter for the comparison to say anything"


@pytest.mark.usefixtures("one_thread")
def test_the_judge_judges(tmp_path: Path) -> None:
    """It tells other pictures, another system prompt and other weights apart."""
    folder = build("smolvlm", tmp_path / "one")
    judge, other = Judge(folder), Judge(build("smolvlm", tmp_path / "another", seed=1))
    (base,) = judge.ask(pictures(1), PLAIN[:1])
    changed = [
        *judge.ask(pictures(1, seed=1), PLAIN[:1]),
        *judge.ask(pictures(1), PLAIN[:1], "Answer."),
        *other.ask(pictures(1), PLAIN[:1]),
    ]
    assert all(abs(answer.yes_mass - base.yes_mass) > 1e-4 for answer in changed)
