"""What README and the other pages point to is there. What they tell people to type is carried out in tests/docs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from executive import cli
from executive.errors import MissingError
from executive.faults import parse_fault
from executive.types import OutcomeKind, Payload

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXIT_CODES = (ROOT / "docs" / "reference" / "exit-codes.md").read_text(encoding="utf-8")
FAULTS = (ROOT / "docs" / "how-to" / "faults.md").read_text(encoding="utf-8")
DOCUMENTS = sorted(
    str(path.relative_to(ROOT))
    for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "runs" / "README.md")
)


def shell_lines() -> Iterator[str]:
    """The commands in the README's shell blocks, without their comments."""
    for block in re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL):
        for line in block.splitlines():
            yield line.split("#")[0].strip()


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(document: str) -> None:
    folder = (ROOT / document).parent
    links = re.findall(r"\]\(([^)#:]*)(?:#([^)]*))?\)", (ROOT / document).read_text(encoding="utf-8"))
    targets = [(folder / target if target else ROOT / document, anchor) for target, anchor in links]
    assert [str(target) for target, _ in targets if not target.exists()] == []
    assert [(target.name, anchor) for target, anchor in targets if anchor and anchor not in anchors(target)] == []


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as its readers' sites make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_site_has_every_page() -> None:
    listed = set(re.findall(r"([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    notebooks = {f"tutorials/{notebook.stem}.md" for notebook in (ROOT / "docs" / "tutorials").glob("*.ipynb")}
    assert listed == pages | notebooks | {"reference/command-line.md"}  # made when the site is built


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    pages = "\n".join((ROOT / document).read_text(encoding="utf-8") for document in DOCUMENTS)
    named = set(re.findall(r"`make ([a-z-]+)`", pages))
    named |= {line.split()[1] for line in shell_lines() if line.startswith("make ")}
    assert {"run", "test"} <= named
    assert named <= targets


@pytest.mark.parametrize("spec", re.findall(r"^\| `([^`]+)` \| ", FAULTS, flags=re.MULTILINE))
def test_faults_are_faults(spec: str) -> None:
    parse_fault(spec)


def test_exit_codes_are_those_of_the_command_line() -> None:
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", EXIT_CODES, flags=re.MULTILINE)}
    assert listed == {
        cli.REACHED,
        cli.NOT_REACHED,
        cli.BAD_INPUT,
        MissingError.exit_code,
        cli.INTERRUPTED,
        cli.TERMINATED,
    }
    assert f"{cli.BUG} is a bug" in EXIT_CODES


def test_every_event_and_every_outcome_is_explained() -> None:
    page = (ROOT / "docs" / "reference" / "run-folder.md").read_text(encoding="utf-8")
    assert [kind.__name__ for kind in get_args(Payload) if f"`{kind.__name__}`" not in page] == []
    assert set(re.findall(r"^\| `([a-z-]+)` \|", EXIT_CODES, flags=re.MULTILINE)) == set(OutcomeKind)
