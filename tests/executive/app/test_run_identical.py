"""Whole runs with three cans that nothing tells apart: what is filmed is followed; of the rest, nothing is claimed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executive import RunConfig, run
from executive.app.config import EstimatorConfig
from executive.app.run import Run
from executive.domain.loader import load_domain
from executive.errors import OptionError
from executive.s3e import S3E, Templates
from executive.types import Image
from tests.executive.s3e.fakes import FakeBackend

SWAP = "swap:item=can-a,with=can-c,seconds=2@2"


def config(folder: Path, *faults: str, film: float = 5.0) -> RunConfig:
    return RunConfig("cans", "one-can", 2, "oracle", faults, poses="depth", film=film, viewer=False, runs=folder)


@pytest.mark.slow
def test_an_exchange_in_view_is_put_right(tmp_path: Path) -> None:
    summary = run(config(tmp_path, SWAP))
    assert summary["goal_seen"]
    assert summary["goal_true"]
    assert summary["replans"] >= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "film"), [((SWAP, "camera:no-depth@2"), 5.0), ((SWAP.replace(",seconds=2", ""),), 0.0)]
)
def test_after_an_exchange_that_nobody_saw_nothing_is_claimed(
    tmp_path: Path, faults: tuple[str, ...], film: float
) -> None:
    summary = run(config(tmp_path, *faults, film=film))
    assert not summary["goal_seen"]
    assert not summary["goal_true"]


class Reader:
    """A model that finds the tags of a picture and knows what is so of the things that they are on: it is told."""

    def __init__(self, config: RunConfig) -> None:
        domain = load_domain(config.domain, config.problem)
        assert domain.subject.questions is not None
        questions = Templates.read(domain.subject.questions).translate(domain.task)
        self._atoms = {text: atom for atom, text in questions.text.items()}
        self.backend = FakeBackend(self._say)
        self.run = Run(config, vlm=S3E(self.backend, questions))

    def _say(self, question: str, pictures: Sequence[Image]) -> tuple[float, float]:
        atom = self._atoms[question]
        is_true = self.run.truth.of([atom])[atom]
        return (0.97, 0.03) if is_true else (0.03, 0.97)


@pytest.mark.slow
def test_a_model_is_asked_about_identical_things_by_their_tags(tmp_path: Path) -> None:
    chosen = replace(config(tmp_path, SWAP), estimator="vlm", eye=EstimatorConfig("a-model"), marks=True)
    reader = Reader(chosen)
    with reader.run as prepared:
        summary = prepared.execute()
    assert summary["goal_seen"]
    assert summary["goal_true"]
    look = reader.backend.looks[0]
    assert all(f"can {tag} has the tag {tag}" in look.system for tag in "ABC")
    assert any("can B" in question for question in reader.backend.asked)
    white = [int((picture == 255).all(axis=2).sum()) for picture in look.images]
    assert np.all(np.array(white) > 200)  # the tags


@pytest.mark.parametrize("options", [{"poses": "oracle"}, {"estimator": "oracle"}])
def test_tags_are_of_estimated_poses_and_for_a_model(options: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        RunConfig("cans", **{"estimator": "vlm", "poses": "depth", "marks": True, "runs": tmp_path, **options})  # type: ignore[arg-type]  # of several types
    assert caught.value.option == "marks"


def test_where_nothing_looks_the_same_there_is_nothing_to_tag(tmp_path: Path) -> None:
    """And a run that ends before it began leaves nothing behind: no folder, no word of what was not freed."""
    command = [
        sys.executable, "-m", "executive", "run", "grocery", "--poses", "depth", "--marks", "--runs", str(tmp_path),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: --marks: ")
    assert not any(tmp_path.iterdir())
