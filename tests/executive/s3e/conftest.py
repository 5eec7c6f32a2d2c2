"""What the tests of models share. No model is loaded unless a test asks for one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.executive.s3e.checkpoints import build


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a tiny checkpoint of a family, built once."""

    @cache
    def folder(family: str) -> Path:
        return build(family, tmp_path_factory.mktemp("checkpoints") / family)

    return folder


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Tiny models are quicker on one thread than on several that wait for each other."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
