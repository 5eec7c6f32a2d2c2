"""Pictures, questions, and how far answers are apart: what the tests of the transformers backend share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from executive.s3e.backends.interface import Answer
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.types import Image

Pick = Callable[..., TransformersBackend]
"""The fixture `backend`: one of a family, loaded once for each way of asking."""

SYSTEM = "The assistant answers with one of three responses: YES or NO."
QUESTIONS = (
    *(f"Is the {item} on the {table} table?" for item in ("lemon", "soda can") for table in ("black", "white")),
    "Is the gripper of the robot empty?",
    "Are the cereal box and the water bottle, which were on the wooden table a moment ago, now on the floor?",
    "Empty?",
    "",
    " Is it?",
    "\nIs it?\n",
    "Is the Zitrone \u00fcber dem Tisch? \U0001f34b",
)


def pictures(count: int, seed: int = 0, height: int = 60, width: int = 90) -> list[Image]:
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def apart(some: Sequence[Answer], others: Sequence[Answer]) -> float:
    """How far two sets of answers are apart in yes mass, no mass and P(true), at most."""
    assert [answer.prompt for answer in some] == [answer.prompt for answer in others]
    assert not any(answer.error for answer in (*some, *others))
    return max(float(np.abs(numbers(a) - numbers(b)).max()) for a, b in zip(some, others, strict=True))


def numbers(answer: Answer) -> np.ndarray[Any, Any]:
    return np.array([answer.yes_mass, answer.no_mass, answer.probability()], dtype=float)
