"""Shell completion: the names of domains, problems and runs that exist.

Each function gives pairs of a word and what it means; the shell keeps those that begin as the typed word does. A TAB
never fails: what cannot be read offers nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from pathlib import Path

Offer = list[tuple[str, str]]


def domains() -> Offer:
    """The domains that come along, and the domain folders that lie here."""
    from executive.domain.loader import list_domains
    from executive.domain.manifest import MANIFEST

    shipped = [(name, "comes with Executive") for name in list_domains()]
    return shipped + _offered(
        lambda: ((str(path.parent), "a folder here") for path in sorted(Path().glob(f"*/{MANIFEST}")))
    )


def problems(domain: object) -> Offer:
    """The problems of a domain, by its folder or its name."""
    from executive.domain.loader import load_domain
    from executive.domain.manifest import MANIFEST

    if not isinstance(domain, str):
        return []

    def found() -> Iterable[tuple[str, str]]:
        folder = Path(domain) if (Path(domain) / MANIFEST).exists() else load_domain(domain).folder
        return ((path.stem, "") for path in sorted((folder / "problems").glob("*.pddl")))

    return _offered(found)


def runs() -> Offer:
    """The runs in `runs`, the latest first."""
    return _offered(lambda: ((path.name, "") for path in latest(Path("runs"))))


def latest(folder: Path) -> list[Path]:
    """The runs in a folder, the latest first."""
    return sorted((path for path in folder.glob("*/")), key=lambda path: path.stat().st_mtime, reverse=True)


def _offered(found: Callable[[], Iterable[tuple[str, str]]]) -> Offer:
    with contextlib.suppress(Exception):
        return list(found())
    return []
