"""A backend in a few lines is as good an estimator as any other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from examples.own_model import Colours, judge
from executive.domain.loader import load_subject
from executive.protocols import Estimator
from executive.s3e import S3E, Backend, Templates, observe
from executive.types import Atom, Image, Observation
from tests.contracts import EstimatorContract


def painted(rgb: tuple[int, int, int]) -> Image:
    return np.full((12, 16, 3), rgb, np.uint8)


class TestColours(EstimatorContract):
    def make(self) -> tuple[Estimator, Observation, Sequence[Atom]]:
        subject = load_subject("grocery")
        assert subject.questions is not None
        questions = Templates.read(subject.questions).translate(subject.task)
        return S3E(Colours(), questions), observe({"front": painted((200, 40, 40))}), subject.task.atoms


def test_it_is_a_backend() -> None:
    assert isinstance(Colours(), Backend)


@pytest.mark.parametrize(("rgb", "expected"), [((200, 40, 40), 1.0), ((0, 0, 0), 0.0)])
def test_it_says_yes_where_the_colour_is(rgb: tuple[int, int, int], expected: float, tmp_path: Path) -> None:
    file = tmp_path / "front.png"
    Picture.fromarray(painted(rgb)).save(file)
    belief = judge([str(file)])
    assert belief.probability[Atom.parse("robot-gripping(soda-can)")] == expected  # the red can of soda
    assert Atom.parse("robot-gripping(lemon)") in belief.unanswered
