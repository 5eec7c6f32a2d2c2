"""Names that no file can have, wherever a command takes one: bad input, and no bug of Executive's."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from executive import cli

LONG = "a" * 5_000
CAMPAIGN = (
    'title = "One"\nseeds = 1\n[[domains]]\ndomain = "grocery"\nproblems = ["one-item"]\n[estimators]\nnone = {}\n'
)


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "one.toml").write_text(CAMPAIGN)
    Picture.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "a.png")


@pytest.mark.parametrize(
    "command",
    [
        "run NAME",
        "run grocery --problem NAME",
        "run grocery --problem NAME.pddl",
        "run grocery --vlm NAME",
        "run grocery --vlm ~nobody-of-this-name/model",
        "run grocery --vlm x --calibration NAME",
        "run grocery --estimator oracle --calibration NAME",
        "run grocery --estimator oracle --runs NAME",
        "run grocery --estimator oracle --faults NAME",
        "resume NAME",
        "explain NAME",
        "replay NAME",
        "inspect NAME",
        "inspect run --png NAME/x.png",
        "estimate NAME --image a.png",
        "estimate grocery --image NAME",
        "estimate grocery --video NAME",
        "estimate grocery --image a.png --out NAME",
        "estimate grocery --image a.png --vlm NAME",
        "collect NAME --out x",
        "collect grocery --out NAME",
        "eval NAME x --out y",
        "eval grocery NAME --out y",
        "eval grocery x --out NAME",
        "eval grocery x --beside NAME",
        "calibrate NAME x --out y",
        "calibrate grocery NAME --out y",
        "train NAME --out x",
        "train grocery --out NAME",
        "bench NAME",
        "bench one.toml --out NAME",
        "bench --report NAME",
        "bench --compare NAME x",
        "bench --compare NAME:x NAME",
        "new NAME",
        "new x --in NAME",
    ],
)
def test_a_name_that_no_file_can_have_is_bad_input(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(shlex.split(command.replace("NAME", LONG))) == cli.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()[-1:]
    assert line.startswith("error: ")
    assert [path.name for path in Path().iterdir() if LONG in path.name] == []
