"""S3E as a library of its own: the example in its documentation runs, and importing it loads no model."""

from __future__ import annotations

import textwrap
from typing import Any

import pytest

import executive.s3e
from executive.types import Atom, Belief
from tests.executive.s3e.fakes import FakeBackend, picture
from tests.executive.test_imports import HEAVY, loaded_by

LEMON = Atom.parse("on-table(lemon,wood-table)")


def example() -> str:
    """The indented part of the package's documentation."""
    lines = (executive.s3e.__doc__ or "").splitlines()
    return textwrap.dedent("\n".join(line for line in lines if line.startswith("    ") or not line))


def test_the_example_runs_as_it_is_written() -> None:
    backend = FakeBackend(lambda question, images: (0.9, 0.0) if "lemon" in question else (0.0, 0.8))
    names: dict[str, Any] = {"backend": backend, "picture": picture(), "Atom": Atom}
    exec(compile(example(), "executive/s3e/__init__.py", "exec"), names)
    belief = names["belief"]
    assert isinstance(belief, Belief)
    assert belief.truth(LEMON) is True
    assert belief.truth(Atom.parse("robot-gripper-empty")) is False
    assert belief.unanswered == frozenset()
    assert "Is the lemon standing or lying on the wooden table?" in backend.asked


def test_the_example_is_one() -> None:
    assert "load_subject" in example()
    assert "estimator.estimate" in example()


@pytest.mark.parametrize("name", executive.s3e.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(executive.s3e, name) is not None


def test_importing_it_loads_nothing_heavy() -> None:
    assert loaded_by("import executive.s3e").isdisjoint({*HEAVY, "transformers", "httpx2", "sklearn"})
    everything = loaded_by("from executive.s3e import *")  # formats of files among it
    assert everything.isdisjoint({*HEAVY - {"pydantic"}, "transformers", "httpx2", "sklearn"})


def test_templates_are_read_and_a_belief_is_made_without_a_model() -> None:
    statement = (
        "from executive.domain.loader import load_subject\n"
        "from executive.s3e import load_questions, observe\n"
        "subject = load_subject('grocery')\n"
        "load_questions(subject.questions, subject.task)"
    )
    assert loaded_by(statement).isdisjoint({*HEAVY - {"pydantic"}, "transformers", "httpx2", "sklearn"})
