"""The files that tell what this software is agree with each other."""

from __future__ import annotations

import re
from pathlib import Path

from executive import __version__

ROOT = Path(__file__).parent.parent


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_it_is_cited_by_its_version_and_licence() -> None:
    citation = text("CITATION.cff")
    assert f"\nversion: {__version__}\n" in citation
    assert "\nlicense: Apache-2.0\n" in citation
    assert 'license = "Apache-2.0"' in text("pyproject.toml")
    assert text("LICENSE").lstrip().startswith("Apache License\n")
    for key in ("cff-version", "message", "title", "authors"):
        assert re.search(rf"^{key}:", citation, flags=re.MULTILINE), key


def test_the_changelog_begins_with_this_version() -> None:
    versions = re.findall(r"^## (\S+)", text("CHANGELOG.md"), flags=re.MULTILINE)
    assert next(version for version in versions if version != "Unreleased") == __version__
    assert len(set(versions)) == len(versions)


def test_readme_names_what_is_under_another_licence() -> None:
    licence = text("README.md").partition("## Licence")[2]
    assert "GPL-3" in licence
    assert "Fast Downward" in licence
    assert "unified-planning" in licence
