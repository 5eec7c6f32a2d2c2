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


def test_the_changelog_names_versions_the_latest_first() -> None:
    coming, *versions = re.findall(r"^## (\S+)", text("CHANGELOG.md"), flags=re.MULTILINE)
    assert coming == "Unreleased"
    assert versions[0] == __version__
    numbers = [tuple(map(int, version.split("."))) for version in versions]
    assert numbers == sorted(set(numbers), reverse=True)


def test_hooks_use_what_is_set_up_and_nothing_from_elsewhere() -> None:
    hooks = text(".pre-commit-config.yaml")
    assert re.findall(r"- repo: (\S+)", hooks) == ["local"]
    assert re.findall(r"language: (\S+)", hooks) == ["system"] * hooks.count("- id: ")
    assert all(entry.startswith(".venv/bin/") for entry in re.findall(r"entry: (\S+)", hooks))


def test_readme_names_what_is_under_another_licence() -> None:
    licence = text("README.md").partition("## Licence")[2]
    assert "GPL-3" in licence
    assert "Fast Downward" in licence
    assert "unified-planning" in licence
