"""Modules that README or docs of version 0.1 showed, importable for one release by the names that they had then."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "executive.assemble": "executive.app.run",
    "executive.compare": "executive.core.compare",
    "executive.loop": "executive.core.loop",
    "executive.pddl": "executive.domain.pddl",
    "executive.sim.handle": "executive.sim.robot_api",
    "executive.sim.relations": "executive.relations",
    "executive.trace.events": "executive.trace.record.log",
}
"""By the former name, the module's name now."""


class _Former(ModuleType):
    """`executive.compare` is a former module and a public function: importing one hides the other, so it is both."""

    def __call__(self, *arguments: object) -> object:
        return getattr(self, self.__name__.rpartition(".")[2])(*arguments)


class _Finder(MetaPathFinder, Loader):
    """Makes a module of the former name that has the contents of the one that took its place."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Former(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        now = MOVED[module.__name__]
        warnings.warn(
            f"{module.__name__} is called {now} now; the former name works until version 0.3",
            FutureWarning,
            stacklevel=2,
        )
        moved = import_module(now)
        module.__dict__["__getattr__"] = lambda name: getattr(moved, name)


def renamed(module: str, former: str, now: str, value: object) -> object:
    """A name within a module that is called otherwise now, with a warning."""
    warnings.warn(
        f"{module}.{former} is called {now} now; the former name works until version 0.3", FutureWarning, stacklevel=3
    )
    return value


def _reason(decided: object) -> str:
    """`Decision.reason` and `Ended.reason`, which were texts."""
    warnings.warn(
        "causes have taken the place of reason, which works until version 0.3: executive.why has the text",
        FutureWarning,
        stacklevel=2,
    )
    text: str = import_module("executive.trace.phrases").why(decided)
    return text


def give_reason(*kinds: type) -> None:
    """Have what was decided know its reason in words."""
    for kind in kinds:
        setattr(kind, "reason", property(_reason))  # noqa: B010  (a type checker is not to know of it)


def install() -> None:
    """Have former names be found from now on, after everything that exists."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
