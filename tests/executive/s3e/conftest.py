"""What the tests of models share. No model is loaded unless a test asks for one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from executive.s3e.backends.transformers_backend import TransformersBackend
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.looking import Pick


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a tiny checkpoint of a family, built once."""

    @cache
    def folder(family: str) -> Path:
        return build(family, tmp_path_factory.mktemp("checkpoints") / family)

    return folder


@pytest.fixture(scope="session")
def backend(checkpoint: Callable[[str], Path]) -> Pick:
    """A backend of a family, loaded once for each way of asking."""

    @cache
    def loaded(family: str, path: Any = "auto", dtype: str = "auto") -> TransformersBackend:
        return TransformersBackend(checkpoint(family), path=path, dtype=dtype)

    return loaded
