"""The benchmark of poses counts what it says it counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import poses
from executive.app.localizer import item_models
from executive.sim.spec import read_scene


def test_an_error_is_how_far_the_middle_is_off_and_how_far_it_is_turned() -> None:
    models = {model.name: model for model in item_models(read_scene(poses.SCENE))}
    here = np.array([0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0])
    quarter = np.array([0.1, 0.2, 0.304, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    away, angle = poses.error(models["cereal-box"], here, quarter)
    assert away == pytest.approx(0.004, abs=1e-4)
    assert angle == pytest.approx(90.0)
    assert poses.error(models["soda-can"], here, quarter)[1] == pytest.approx(0.0, abs=1e-6)


def test_it_prints_errors_and_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["poses", "--scenes", "1", "--absent", "--moved", "2"])
    poses.main()
    printed = capsys.readouterr().out
    assert "1 scenes: 0 items not found, 0 reported that are not there" in printed
    assert "1 cameras left out" in printed
    row = next(line.split() for line in printed.splitlines() if line.startswith("all "))
    assert int(row[1]) in (4, 5)
    assert float(row[2]) < 2.0
