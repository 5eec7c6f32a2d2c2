"""README, docs, examples and notebooks import what is public and nothing else, and the reference shows all of it."""

from __future__ import annotations

import ast
import importlib
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator

import pytest

import executive
from executive import export, former_names, s3e, skills
from tests.docs.following import DOCS, DOCUMENTS, ROOT, blocks

PUBLIC = {
    "executive": executive.__all__,
    "executive.s3e": s3e.__all__,
    "executive.skills": skills.__all__,
    "executive.export": export.__all__,
}
SHOWN = {
    **{
        str(file.relative_to(ROOT)): file.read_text(encoding="utf-8")
        for file in sorted((ROOT / "examples").rglob("*.py"))
    },
    **{str(block): block.text for page in DOCUMENTS for block in blocks(page) if block.language == "python"},
    **{
        notebook.name: "\n".join(
            "".join(cell["source"])
            for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]
            if cell["cell_type"] == "code"
        )
        for notebook in sorted((DOCS / "tutorials").glob("*.ipynb"))
    },
}


def imported(source: str) -> Iterator[tuple[str, str]]:
    """The module and the name of everything that is imported from this package."""
    try:
        tree = ast.parse(source)
    except SyntaxError:  # a part of a program, which is quoted from one that is looked at as a whole
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "executive":
            yield from ((str(node.module), alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name == "executive":  # what is used of it
                    yield from ((alias.name, name) for name in _used(tree, alias.asname or alias.name))
                elif alias.name.partition(".")[0] == "executive":
                    yield alias.name, ""


def _used(tree: ast.AST, module: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == module:
            yield node.attr


@pytest.mark.parametrize("where", SHOWN)
def test_what_is_imported_is_public(where: str) -> None:
    assert [each for each in imported(SHOWN[where]) if each[1] not in PUBLIC.get(each[0], ())] == []


@pytest.mark.parametrize("page", [str(page.relative_to(ROOT)) for page in DOCUMENTS if page.name != "CHANGELOG.md"])
def test_what_prose_names_is_public(page: str) -> None:
    """A dotted name such as `executive.s3e.Templates` in the text is public, or a word of an entry point's group."""
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    named = re.findall(r"(?<![\w\"./-])(executive(?:\.s3e|\.skills|\.export)?)\.([A-Za-z_]+)(?![\w/])", text)
    groups = {
        ("executive", "skills"),
        ("executive", "relations"),
        ("executive", "s3e"),
        ("executive", "export"),
        ("executive", "__all__"),
    }
    assert {each for each in named if each not in groups and each[1] not in (*PUBLIC[each[0]], "__all__")} == set()


def test_the_reference_has_all_that_is_public() -> None:
    page = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    for module, public in PUBLIC.items():
        shown = re.findall(rf"^::: {module}\.(\w+)$", page, flags=re.MULTILINE)
        assert sorted({*shown} - {"s3e", "export"}) == sorted({*public} - {"__version__"})
        assert len(shown) == len({*shown})


@pytest.mark.parametrize("name", executive.__all__)
def test_what_is_public_is_there(name: str) -> None:
    assert getattr(executive, name) is not None
    assert name in dir(executive)


@pytest.mark.parametrize(("former", "now"), former_names.MOVED.items())
def test_a_former_module_is_found_with_a_warning(former: str, now: str) -> None:
    sys.modules.pop(former, None)
    with pytest.warns(FutureWarning, match=re.escape(now)):
        module = importlib.import_module(former)
    names = [name for name in vars(importlib.import_module(now)) if not name.startswith("_")]
    assert all(getattr(module, name) is getattr(importlib.import_module(now), name) for name in names)


@pytest.mark.parametrize(
    ("module", "former", "now"),
    [("executive.sim.relations", "SimState", "Scene"), ("executive.trace.viewer", "RerunSink", "RerunSink")],
)
def test_a_former_name_is_found_with_a_warning(module: str, former: str, now: str) -> None:
    with pytest.warns(FutureWarning, match=f"executive.{now}"):
        assert getattr(importlib.import_module(module), former) is getattr(executive, now)


def test_the_former_reason_of_a_decision_is_its_causes_in_words() -> None:
    decision = executive.Decision(executive.DecisionKind.REPLAN, (executive.Cause(executive.Reason.PLAN_WITHOUT_STEP),))
    with pytest.warns(FutureWarning, match=r"executive\.why"):
        assert getattr(decision, "reason") == executive.why(decision)  # noqa: B009  (no type knows of it)


def test_the_example_of_the_former_readme_still_imports() -> None:
    program = "from executive.assemble import RunConfig, run\nfrom executive.loop import Executive\n"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stderr.count("FutureWarning") == 2


def test_nothing_public_warns() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", FutureWarning)
        for name in executive.__all__:
            getattr(executive, name)
