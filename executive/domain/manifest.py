"""The manifest of a domain folder, `domain.toml`: what it says, and where it says it.

A folder is data only and may come from a stranger: no path in it leads outside it, and no file in it is read beyond a
size that any honest one keeps. Every mistake is one line with its file, line and key.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.domain.pddl import Fragment, Stated, StatedPrior
from executive.domain.skills import skills
from executive.errors import DomainError, nearest, unregistered
from executive.relations import kinds
from executive.util.files import LARGEST, LARGEST_TOML, caseless, parse_toml, read_text, reason
from executive.util.validation import first_mistake

MANIFEST = "domain.toml"

_HEADER = re.compile(r"\s*\[+([^\[\]]+)\]")
_CALL = re.compile(r"([^\s(]+)\s*\(([^()]*)\)")
_ASSIGNMENT = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w\-. ])+?)\s*=""")


@dataclass(frozen=True, slots=True)
class Looking:
    """How to look when something that matters cannot be told, and after what is carried; see
    `executive.core.attention.Attention`, which is made from it. `moves` are skills that bring the arm out of the way,
    the mildest first."""

    moves: tuple[str, ...] = ()
    closer: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    carried: Mapping[str, tuple[str, tuple[int, ...]]] = field(default_factory=lambda: MappingProxyType({}))
    guard: tuple[str, ...] = ()


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _World(_Table):
    kind: Literal["mujoco", "symbolic"]
    scene: str | None = None


class _Action(_Table):
    skill: str
    carrying: str | None = None


class _Predicate(_Table):
    relation: str | None = None
    visible: str | None = None


class _Looking(_Table):
    moves: list[str] = []
    closer: dict[str, list[str]] = {}
    guard: list[str] = []


class Manifest(_Table):
    title: str = Field(min_length=1)
    description: str = ""
    domain: str
    problem: str
    questions: str | None = None
    instructions: str | None = None
    outcomes: str | None = None
    world: _World
    actions: dict[str, _Action] = {}
    predicates: dict[str, _Predicate] = {}
    looking: _Looking = _Looking()
    invariants: dict[str, str] = {}
    priors: dict[str, float] = {}


def inside(folder: Path, path: Path) -> Path:
    """The path, once it is certain that it is an ordinary file of honest size inside the folder, links followed."""
    try:
        real, status = path.resolve(strict=True), path.stat()
    except FileNotFoundError:
        raise DomainError("there is no such file", file=path) from None
    except (OSError, ValueError, RuntimeError) as error:
        raise DomainError(f"cannot be read ({reason(error)})", file=path) from None
    if not real.is_relative_to(folder.resolve()):
        raise DomainError("leads outside the domain folder", file=path)
    if not stat.S_ISREG(status.st_mode):
        raise DomainError("is not a file", file=path)
    if status.st_size > LARGEST:
        raise DomainError(f"has {status.st_size:,} bytes; a domain's files have at most {LARGEST:,}", file=path)
    return path


class Source:
    """The manifest as text: what it says, and where it says it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, inside(folder, folder / MANIFEST)
        self.text = read_text(self.path, largest=LARGEST_TOML, mistake=DomainError)

    def fail(self, key: Sequence[str], message: str) -> NoReturn:
        line = self._line(key)
        dotted = ".".join(key)
        raise DomainError(message, file=self.path, key=dotted if line is None else f"line {line}: {dotted}")

    def manifest(self) -> Manifest:
        said = parse_toml(self.text, self.path, mistake=DomainError)
        for name in ("actions", "predicates"):
            if isinstance(said.get(name), dict):
                said[name] = caseless(said[name], self.path, name, mistake=DomainError)
        try:
            return Manifest.model_validate(said)
        except ValidationError as error:
            key, message = first_mistake(error, Manifest)
            self.fail(key, message)

    def file(self, name: str, key: str) -> Path:
        """A file that the manifest names, which must lie in the folder."""
        pure = PurePosixPath(name), PureWindowsPath(name)
        if any(path.is_absolute() or path.anchor or ".." in path.parts for path in pure):
            self.fail(key.split("."), f"{name!r} is not a path inside the domain folder")
        try:
            return inside(self.folder, self.folder / name)
        except DomainError as error:
            self.fail(key.split("."), f"{name!r}: {error.message}")

    def scene(self, manifest: Manifest) -> Path | None:
        """The file that the simulated world is built from; None where there is no more than atoms."""
        world = manifest.world
        if (world.scene is None) is (world.kind == "mujoco"):
            self.fail(("world", "scene"), "is missing" if world.scene is None else "goes with kind = 'mujoco' alone")
        return None if world.scene is None else self.file(world.scene, "world.scene")

    def stated(self, manifest: Manifest) -> Stated:
        """The formulas that the manifest states."""

        def fragment(text: str, *key: str) -> Fragment:
            return Fragment(text, partial(self.fail, key))

        visible = {
            name: fragment(table.visible, "predicates", name, "visible")
            for name, table in manifest.predicates.items()
            if table.visible is not None
        }
        kept = {name: fragment(text, "invariants", name) for name, text in manifest.invariants.items()}
        return Stated(MappingProxyType(visible), MappingProxyType(kept))

    def priors(self, manifest: Manifest) -> Sequence[StatedPrior]:
        """Where things usually are, as the manifest states it."""
        return [
            StatedPrior(Fragment(text, partial(self.fail, ("priors", text))), probability)
            for text, probability in manifest.priors.items()
        ]

    def words(self, manifest: Manifest) -> tuple[Path | None, Path | None]:
        """The files of questions and instructions, where the manifest names them."""
        questions = None if manifest.questions is None else self.file(manifest.questions, "questions")
        instructions = None if manifest.instructions is None else self.file(manifest.instructions, "instructions")
        return questions, instructions

    def looking(
        self,
        manifest: Manifest,
        predicates: Mapping[str, Sequence[str]],
        actions: Mapping[str, Sequence[str]],
        objects: Collection[str],
        skills: Collection[str] | None,
    ) -> Looking:
        """What the manifest says of looking. `predicates` and `actions` are given with their parameters."""
        said, skills = manifest.looking, _registered("skill") if skills is None else skills
        nearer = caseless(said.closer, self.path, "looking.closer", mistake=DomainError)
        for name in said.moves:
            if name not in skills:
                self.fail(("looking", "moves"), unregistered("skill", name, skills))
        for name in nearer:
            if name not in (known := {*predicates, *objects}):
                message = f"there is no predicate and no object {name!r}; {nearest(name, known)}"
                self.fail(("looking", "closer", name), message)
        carried = {
            name: self._carried(name, table.carrying, actions[name], predicates)
            for name, table in manifest.actions.items()
            if table.carrying is not None
        }
        closer = {name: tuple(map(str.lower, cameras)) for name, cameras in nearer.items()}
        guard = tuple(map(str.lower, said.guard))
        return Looking(tuple(said.moves), MappingProxyType(closer), MappingProxyType(carried), guard)

    def _carried(
        self, action: str, carrying: str, names: Sequence[str], predicates: Mapping[str, Sequence[str]]
    ) -> tuple[str, tuple[int, ...]]:
        """A predicate, and the positions of its arguments among the action's parameters, which are called `names`."""
        key = ("actions", action, "carrying")
        match = _CALL.fullmatch(carrying.lower())
        if match is None:
            self.fail(key, f"{carrying!r} is not a predicate of the action's parameters, such as holding(?item)")
        predicate, terms = match[1], [term.strip() for term in match[2].split(",") if term.strip()]
        if predicate not in predicates:
            self.fail(key, f"there is no predicate {predicate!r}; {nearest(predicate, predicates)}")
        if (takes := len(predicates[predicate])) != len(terms):
            self.fail(key, f"{predicate} has {takes} parameter{'s' * (takes != 1)}, not {len(terms)}")
        for term in terms:
            if term not in names:
                self.fail(key, f"{action} has no parameter {term}; {nearest(term, names)}")
        return predicate, tuple(names.index(term) for term in terms)

    def call(self, key: Sequence[str], said: str, names: Sequence[str]) -> str:
        """What is said of a predicate or an action, whose parameters are called `names`: the word of a relation or a
        skill and, where they are not its own in their order, its arguments, such as on(?tool, tray)."""
        match = _CALL.fullmatch(said)
        if match is None:
            return said
        terms = [term.strip().lower() for term in match[2].split(",") if term.strip()]
        for term in terms:
            if term.startswith("?") and term not in names:
                self.fail(key, f"{key[1]} has no parameter {term}; {nearest(term, names)}")
        for name in names:
            if name not in terms:
                self.fail(key, f"{name} is missing: {key[1]} would be the same for each")
        return f"{match[1]}({', '.join(terms)})"

    def check(
        self,
        table: str,
        key: str,
        declared: Collection[str],
        given: Mapping[str, str],
        known: Collection[str] | None,
        needless: Collection[str] = (),
    ) -> None:
        """Everything that is declared in PDDL is assigned a word that is registered, and nothing else is; `needless`
        names what may go without."""
        known = _registered(key) if known is None else known
        what = table.removesuffix("s")
        for name, word in given.items():
            if name not in declared:
                self.fail((table, name), f"there is no {what} {name!r} in the PDDL; {nearest(name, declared)}")
            word = word.partition("(")[0].strip()
            if word not in known:
                self.fail((table, name, key), unregistered(key, word, known))
        for name in declared:
            if name not in given and name not in needless:
                self.fail((table, name), f"is missing: name the {key} of this {what}; {nearest(name, known)}")

    def _line(self, key: Sequence[str]) -> int | None:
        """The line where the key is set, else where the innermost table around it begins."""
        table: tuple[str, ...] = ()
        found: tuple[int, int] | None = None
        for number, line in enumerate(self.text.lower().splitlines(), start=1):
            if header := _HEADER.match(line):
                here = table = _parts(header[1])
            elif assignment := _ASSIGNMENT.match(line):
                here = (*table, *_parts(assignment[1]))
            else:
                continue
            if here == tuple(map(str.lower, key[: len(here)])) and (found is None or len(here) > found[0]):
                found = (len(here), number)
        return None if found is None else found[1]


def _registered(what: str) -> set[str]:
    """The skills or relations that there are."""
    return kinds.names() if what == "relation" else set(skills())


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip(" \"'") for part in dotted.split("."))
