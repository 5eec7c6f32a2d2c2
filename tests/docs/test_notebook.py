"""The notebook, cell by cell: it runs, and prints what it shows."""

from __future__ import annotations

import ast
import contextlib
import io
import json
from typing import Any

from PIL import Image as Picture

from tests.docs.following import DOCS

NOTEBOOK = json.loads((DOCS / "tutorials" / "library.ipynb").read_text(encoding="utf-8"))


def run(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does; the value of its last line, if that is an expression."""
    *body, last = ast.parse(source).body
    if not isinstance(last, ast.Expr):
        body.append(last)
    exec(compile(ast.Module(body, []), "notebook", "exec"), names)
    return eval(compile(ast.Expression(last.value), "notebook", "eval"), names) if isinstance(last, ast.Expr) else None


def test_it_runs_and_prints_what_it_shows() -> None:
    names: dict[str, Any] = {"__name__": "__main__"}
    pictures = 0
    for number, cell in enumerate(NOTEBOOK["cells"]):
        if cell["cell_type"] != "code":
            continue
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            value = run("".join(cell["source"]), names)
        shown = [output for output in cell["outputs"] if output["output_type"] == "stream"]
        assert printed.getvalue() == "".join("".join(output["text"]) for output in shown), f"cell {number}"
        drawn = [output for output in cell["outputs"] if output["output_type"] != "stream"]
        assert isinstance(value, Picture.Image) == bool(drawn), f"cell {number}"
        pictures += len(drawn)
    assert pictures == 2


def test_it_is_small_and_was_run_in_order() -> None:
    counts = [cell["execution_count"] for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert (DOCS / "tutorials" / "library.ipynb").stat().st_size < 200_000
