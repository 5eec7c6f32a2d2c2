"""Packages that do not load: what is said of them, and that nothing else suffers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from executive.errors import MissingError
from executive.s3e.backends import packages


@pytest.mark.parametrize(
    ("torch", "fits"),
    [
        ("2.13.0+cpu", "torchvision==0.28.0+cpu --index-url INDEX"),
        ("2.13.0+cu130", "torchvision==0.28.0+cu130 --index-url INDEX"),
        ("2.13.0", "torchvision==0.28.0"),
        ("2.9.1", "torchvision==0.24.1"),
        ("2.14.0a0", "'executive[torchvision]'"),
        ("3.0.0", "'executive[torchvision]'"),
        (None, "'executive[torchvision]'"),
    ],
)
def test_the_torchvision_that_fits_is_of_torchs_release_and_build(
    torch: str | None, fits: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packages, "_version", lambda name: torch)
    requirement, note = packages.fitting_torchvision()
    assert requirement == fits
    assert ("INDEX" in note) == ("INDEX" in fits)


def test_what_is_missing_below_what_transformers_says_is_told() -> None:
    try:
        try:
            raise ModuleNotFoundError("No module named 'timm.layers'", name="timm.layers")
        except ModuleNotFoundError as error:
            raise ImportError("Could not import module 'AutoProcessor'.") from error
    except ImportError as error:
        told = packages.unloadable("a model", error)
    assert "No module named 'timm.layers'" in told.message
    assert told.command == f"{sys.executable} -m pip install timm"
    told = packages.unloadable("a model", ImportError("\nX requires the SentencePiece library but it was not found."))
    assert told.command.endswith(" install sentencepiece")
    assert "\n" not in str(told)


def test_what_does_not_import_is_one_line_and_no_bug() -> None:
    with pytest.raises(MissingError, match="symbol not found"), packages.importing():
        raise RuntimeError("symbol not found\nand more")


def test_a_broken_torchvision_breaks_no_model_that_does_without(tmp_path: Path) -> None:
    """In a process of its own, as this one has loaded everything already: a torchvision of another build than torch."""
    (tmp_path / "torchvision").mkdir()
    (tmp_path / "torchvision" / "__init__.py").write_text("raise RuntimeError('operator nms does not exist')\n")
    script = """
import numpy as np
from executive.app import estimators as eye
from executive.s3e import TransformersBackend
from executive.s3e.backends import packages
backend = TransformersBackend(eye.SHIPPED / "grocery-eye")
with backend.look([np.zeros((64, 64, 3), np.uint8)] * 5, "") as look:
    [answer] = look.ask(["Is the lemon on the floor?"])
assert not answer.error, answer.error
error = packages.needed("torchvision", "a model")
assert "operator nms does not exist" in error.message, error
assert "--force-reinstall" in error.command, error
"""
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        timeout=250,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert run.returncode == 0, run.stderr
