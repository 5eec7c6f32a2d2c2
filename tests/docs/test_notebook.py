"""The notebooks, cell by cell: they run, and print what they show."""

from __future__ import annotations

import ast
import contextlib
import io
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest
from matplotlib import pyplot
from PIL import Image as Picture

from tests.docs.following import DOCS

NOTEBOOKS = sorted((DOCS / "tutorials").glob("*.ipynb"))
PICTURES = {"failure": 4, "library": 2}


def cells(notebook: Path) -> list[dict[str, Any]]:
    return list(json.loads(notebook.read_text(encoding="utf-8"))["cells"])


def run(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does; the value of its last line, if that is an expression."""
    *body, last = ast.parse(source).body
    if not isinstance(last, ast.Expr):
        body.append(last)
    exec(compile(ast.Module(body, []), "notebook", "exec"), names)
    return eval(compile(ast.Expression(last.value), "notebook", "eval"), names) if isinstance(last, ast.Expr) else None


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_it_runs_and_prints_what_it_shows(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    pictures = 0
    with mpl.rc_context({"backend": "Agg"}):
        for number, cell in enumerate(cells(notebook)):
            if cell["cell_type"] != "code":
                continue
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                value = run("".join(cell["source"]), names)
            shown = [output for output in cell["outputs"] if output["output_type"] == "stream"]
            assert printed.getvalue() == "".join("".join(output["text"]) for output in shown), f"cell {number}"
            drawn = [output for output in cell["outputs"] if output["output_type"] != "stream"]
            made = len(pyplot.get_fignums()) + isinstance(value, Picture.Image)
            pyplot.close("all")
            assert made == len(drawn), f"cell {number}"
            pictures += made
    assert pictures == PICTURES[notebook.stem]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_it_is_small_and_was_run_in_order(notebook: Path) -> None:
    counts = [cell["execution_count"] for cell in cells(notebook) if cell["cell_type"] == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert notebook.stat().st_size < 200_000
