"""One film of a run that moves one item, for all tests of films."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.lab.film.config import FilmConfig
from executive.lab.film.filming import run_config
from executive.lab.film.record import film_run


@pytest.fixture(scope="session")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five frames a second, and two at each mid-pose."""
    folder = tmp_path_factory.mktemp("films") / "film"
    config = FilmConfig("tabletop", folder, problems=("one-item",), seed=1, fps=5, pause=0.4)
    film_run(run_config(config, "one-item", 1), config, folder)
    return folder
