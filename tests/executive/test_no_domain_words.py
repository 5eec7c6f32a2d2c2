"""Nothing of a domain that comes along stands in the package or in the skills: they work with any."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from executive.domain.loader import list_domains, load_domain

ROOT = Path(__file__).parents[2]
FILES = [
    file
    for folder in (ROOT / "executive", ROOT / "skills")
    for file in sorted(folder.rglob("*.py"))
    if not {"domains", "models", "templates"} & set(file.relative_to(ROOT).parts)
]


@pytest.mark.parametrize("name", list_domains())
def test_names_of_a_domain_stand_in_its_own_folder_alone(name: str) -> None:
    """Its compound names, which are words of no other language, as code that knew the domain would write them: as whole
    strings."""
    domain = load_domain(name)
    words = {*domain.task.objects, *domain.parsed.predicates, *domain.parsed.actions}
    compound = sorted(word for word in words if "-" in word)
    pattern = re.compile(rf"""["']({"|".join(map(re.escape, compound)) or "(?!)"})["']""")
    found = [(file.name, word) for file in FILES for word in pattern.findall(file.read_text(encoding="utf-8"))]
    assert FILES
    assert found == []
