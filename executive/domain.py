"""A domain folder, read into a `Domain`; every mistake in it is named with its file and key.

A folder is data only and may come from a stranger: nothing in it is run, no path in it leads outside it, and no file
in it is read beyond a size that any honest one keeps. Skills and relations are named by plain words, which installed
packages register under the entry-point groups `executive.skills` and `executive.relations`.
"""

from __future__ import annotations

import hashlib
import re
import reprlib
import stat
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.errors import DomainError, nearest
from executive.pddl import Schema, read_task, read_vocabulary
from executive.types import Task

MANIFEST = "domain.toml"
DOMAIN, PROBLEM, QUESTIONS, INSTRUCTIONS = "domain.pddl", "problem.pddl", "questions.toml", "instructions.md"
"""What the files of a folder without a manifest are called."""
LARGEST = 10_000_000
"""Bytes; no file of a domain is larger."""

_SHIPPED = Path(__file__).resolve().parent.parent / "domains"
"""Beside the package `executive`, in the checkout as in an installed wheel."""

_HEADER = re.compile(r"\s*\[+([^\[\]]+)\]")
_ASSIGNMENT = re.compile(r"""\s*([\w\-."' ]+?)\s*=""")


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What an estimator is asked about: a task's atoms, and the files that say it in words.

    `pddl` is the domain's PDDL file, `questions` the templates of its questions and `instructions` the text on how
    things look, both where there are any; `executive.s3e` reads them.
    """

    name: str
    task: Task
    pddl: Path
    questions: Path | None = None
    instructions: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Domain:
    """A domain and one of its problems, checked.

    `parsed` is what a planner is made from; `skills` maps each action to the name of the skill that carries it out,
    `relations` each predicate to the name of the relation that is its truth in the simulator; `scene` is the file that
    the world is built from, `subject` is what an estimator is asked about, and `files` are all the files that were read
    or located.
    """

    name: str
    folder: Path
    title: str
    description: str
    task: Task
    parsed: Schema
    world: str
    scene: Path
    skills: Mapping[str, str]
    relations: Mapping[str, str]
    subject: Subject
    files: tuple[Path, ...]

    def fingerprint(self) -> str:
        """SHA-256 over the contents of all its files."""
        content = hashlib.sha256()
        for file in self.files:
            content.update(hashlib.sha256(file.read_bytes()).digest())
        return content.hexdigest()


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _World(_Table):
    kind: Literal["mujoco"]
    scene: str


class _Action(_Table):
    skill: str


class _Predicate(_Table):
    relation: str


class _Manifest(_Table):
    title: str = Field(min_length=1)
    description: str = ""
    domain: str
    problem: str
    questions: str | None = None
    instructions: str | None = None
    world: _World
    actions: dict[str, _Action] = {}
    predicates: dict[str, _Predicate] = {}


_TABLES: Mapping[object, type[_Table]] = {"world": _World, "actions": _Action, "predicates": _Predicate}


def list_domains() -> tuple[str, ...]:
    """The names of the domains that are shipped with Executive."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{MANIFEST}")))


def load_domain(
    where: str | Path,
    problem: str | None = None,
    *,
    skills: Collection[str] | None = None,
    relations: Collection[str] | None = None,
) -> Domain:
    """Read and check a domain folder, or a shipped domain by its name.

    `problem` is the name of a file in the folder's `problems/`, or the path of a file inside the folder; without it,
    the problem that the manifest names. `skills` and `relations` are the names that exist; without them, those that
    are registered as entry points.

    Raises:
        DomainError: the first mistake, in one line with its file and key.
    """
    folder = _locate(where)
    source = _Source(folder)
    manifest = source.manifest()
    domain_file = source.file(manifest.domain, "domain")
    default = source.file(manifest.problem, "problem")
    problem_file = default if problem is None else _problem(folder, problem)
    questions, instructions = source.words(manifest)
    scene = source.file(manifest.world.scene, "world.scene")
    parsed = read_task(domain_file, problem_file)
    skill_of = {name: table.skill for name, table in manifest.actions.items()}
    relation_of = {name: table.relation for name, table in manifest.predicates.items()}
    source.check("actions", "skill", parsed.actions, skill_of, skills)
    source.check("predicates", "relation", parsed.predicates, relation_of, relations)
    name = folder.resolve().name
    files = (source.path, domain_file, problem_file, scene, questions, instructions)
    return Domain(
        name=name,
        folder=folder,
        title=manifest.title,
        description=manifest.description,
        task=parsed.task,
        parsed=parsed,
        world=manifest.world.kind,
        scene=scene,
        skills=MappingProxyType(skill_of),
        relations=MappingProxyType(relation_of),
        subject=Subject(name, parsed.task, domain_file, questions, instructions),
        files=tuple(file for file in files if file is not None),
    )


def load_subject(where: str | Path, problem: str | None = None) -> Subject:
    """Read what can be estimated in a domain folder, or in a shipped domain by its name. Nothing else of it needs to be
    there or supported: actions of any kind, numbers, no skills, no scene.

    A folder without a manifest has its domain in domain.pddl and, unless `problem` names another one, its problem in
    problem.pddl; questions.toml and instructions.md are taken where they are there.

    Raises:
        DomainError: the first mistake, in one line with its file and key.
    """
    folder = Path(where)
    if (folder / DOMAIN).is_file() and not (folder / MANIFEST).exists():
        domain_file = _inside(folder, folder / DOMAIN)
        problem_file = _inside(folder, folder / PROBLEM) if problem is None else _problem(folder, problem)
        questions, instructions = (
            _inside(folder, folder / name) if (folder / name).exists() else None for name in (QUESTIONS, INSTRUCTIONS)
        )
    else:
        source = _Source(folder := _locate(where))
        manifest = source.manifest()
        domain_file = source.file(manifest.domain, "domain")
        default = source.file(manifest.problem, "problem")
        problem_file = default if problem is None else _problem(folder, problem)
        questions, instructions = source.words(manifest)
    task = read_vocabulary(domain_file, problem_file)
    return Subject(folder.resolve().name, task, domain_file, questions, instructions)


def _locate(where: str | Path) -> Path:
    folder, shipped = Path(where), list_domains()
    if (folder / MANIFEST).exists():
        return folder
    if isinstance(where, str) and where in shipped:
        return _SHIPPED / where
    if folder.is_dir():
        raise DomainError(f"there is no {MANIFEST} in this folder", file=folder)
    if folder.exists():
        raise DomainError(f"is not a folder; a domain is a folder with a {MANIFEST}", file=folder)
    raise DomainError(
        f"no such folder, nor a shipped domain of that name; {nearest(folder.name, shipped)}", file=folder
    )


def _problem(folder: Path, problem: str) -> Path:
    """The problem that the user asks for: a name in `problems/`, or a path inside the folder."""
    names = sorted(path.stem for path in (folder / "problems").glob("*.pddl"))
    if problem in names:
        return _inside(folder, folder / "problems" / f"{problem}.pddl")
    for path in (folder / problem, Path(problem)):
        if path.suffix == ".pddl" and path.is_file():
            return _inside(folder, path)
    raise DomainError(f"there is no problem {problem!r}; {nearest(problem, names)}", file=folder / "problems")


def _inside(folder: Path, path: Path) -> Path:
    """The path, once it is certain that it is an ordinary file of honest size inside the folder, links followed."""
    try:
        real, status = path.resolve(strict=True), path.stat()
    except FileNotFoundError:
        raise DomainError("there is no such file", file=path) from None
    except (OSError, ValueError, RuntimeError) as error:
        raise DomainError(f"cannot be read ({getattr(error, 'strerror', None) or error})", file=path) from None
    if not real.is_relative_to(folder.resolve()):
        raise DomainError("leads outside the domain folder", file=path)
    if not stat.S_ISREG(status.st_mode):
        raise DomainError("is not a file", file=path)
    if status.st_size > LARGEST:
        raise DomainError(f"has {status.st_size:,} bytes; a domain's files have at most {LARGEST:,}", file=path)
    return path


class _Source:
    """The manifest as text: what it says, and where it says it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, _inside(folder, folder / MANIFEST)
        try:
            self.text = self.path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise DomainError(f"is not UTF-8 text ({error.reason} at byte {error.start})", file=self.path) from None
        except OSError as error:
            raise DomainError(f"cannot be read ({error.strerror})", file=self.path) from None

    def fail(self, key: Sequence[str], message: str) -> NoReturn:
        line = self._line(key)
        dotted = ".".join(key)
        raise DomainError(message, file=self.path, key=dotted if line is None else f"line {line}: {dotted}")

    def manifest(self) -> _Manifest:
        try:
            return _Manifest.model_validate(tomllib.loads(self.text))
        except tomllib.TOMLDecodeError as error:
            raise DomainError(f"is not TOML: {error}", file=self.path) from None
        except RecursionError:
            raise DomainError("is not TOML that anyone would write: nested too deep", file=self.path) from None
        except ValidationError as error:
            # A misspelt key is also a missing one: the first is what to say.
            first = min(error.errors(), key=lambda entry: entry["type"] != "extra_forbidden")
            key, kind = tuple(map(str, first["loc"])), first["type"]
            if kind == "extra_forbidden":
                table = _Manifest if len(key) == 1 else _TABLES[key[0]]
                self.fail(key, f"unknown key; {nearest(key[-1], table.model_fields)}")
            if kind == "missing":
                self.fail(key, "is missing")
            should = "be a table" if kind in ("model_type", "dict_type") else first["msg"].partition(" should ")[2]
            self.fail(key, f"should {should}, got {reprlib.repr(first['input'])}")

    def file(self, name: str, key: str) -> Path:
        """A file that the manifest names, which must lie in the folder."""
        pure = PurePosixPath(name), PureWindowsPath(name)
        if any(path.is_absolute() or path.anchor or ".." in path.parts for path in pure):
            self.fail(key.split("."), f"{name!r} is not a path inside the domain folder")
        try:
            return _inside(self.folder, self.folder / name)
        except DomainError as error:
            self.fail(key.split("."), f"{name!r}: {error.message}")

    def words(self, manifest: _Manifest) -> tuple[Path | None, Path | None]:
        """The files of questions and instructions, where the manifest names them."""
        questions = None if manifest.questions is None else self.file(manifest.questions, "questions")
        instructions = None if manifest.instructions is None else self.file(manifest.instructions, "instructions")
        return questions, instructions

    def check(
        self, table: str, key: str, declared: Collection[str], given: Mapping[str, str], known: Collection[str] | None
    ) -> None:
        """Everything that is declared in PDDL is assigned a word that is registered, and nothing else is."""
        if known is None:
            known = {entry.name for entry in entry_points(group=f"executive.{key}s")}
        what = table.removesuffix("s")
        for name, word in given.items():
            if name not in declared:
                self.fail((table, name), f"there is no {what} {name!r} in the PDDL; {nearest(name, declared)}")
            if word not in known:
                self.fail((table, name, key), f"no {key} {word!r} is registered; {nearest(word, known)}")
        for name in declared:
            if name not in given:
                self.fail((table, name), f"is missing: name the {key} of this {what}; {nearest(name, known)}")

    def _line(self, key: Sequence[str]) -> int | None:
        """The line where the key is set, else where the innermost table around it begins."""
        table: tuple[str, ...] = ()
        found: tuple[int, int] | None = None
        for number, line in enumerate(self.text.splitlines(), start=1):
            if header := _HEADER.match(line):
                here = table = _parts(header[1])
            elif assignment := _ASSIGNMENT.match(line):
                here = (*table, *_parts(assignment[1]))
            else:
                continue
            if here == tuple(key[: len(here)]) and (found is None or len(here) > found[0]):
                found = (len(here), number)
        return None if found is None else found[1]


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip(" \"'") for part in dotted.split("."))
