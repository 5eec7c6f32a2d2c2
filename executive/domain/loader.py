"""A domain folder, read into a `Domain`; every mistake in it is named with its file and key.

A folder is data only and may come from a stranger: nothing in it is run, no path in it leads outside it, and no file
in it is read beyond a size that any honest one keeps. Skills and relations are named by plain words, which installed
packages register under the entry-point groups `executive.skills` and `executive.relations`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from executive.domain.manifest import MANIFEST, Looking, Manifest, Source, inside
from executive.domain.pddl import Schema, ground_priors, read_task, read_vocabulary
from executive.domain.pddl.random_action import draw_action
from executive.errors import DomainError, nearest
from executive.types import Atom, Step, Task
from executive.types.visibility import Visibility
from executive.util.files import read_toml

DOMAIN, PROBLEM, QUESTIONS, INSTRUCTIONS = "domain.pddl", "problem.pddl", "questions.toml", "instructions.md"
"""What the files of a folder without a manifest are called."""

_SHIPPED = (Path(__file__).parents[1] / "domains").resolve()
"""In an installed wheel a folder of the package; in a checkout a link to the one beside it."""


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

    `parsed` is what a planner is made from; `skills` maps each action to the skill that carries it out: its name, with
    its arguments where they are not the action's own (`pick(?x, table)`); `relations` maps each predicate that is
    neither static nor derived to what is its truth in the simulator, in the same way; `scene` is the file that the
    world is built from, `subject` is what an estimator is asked about, `outcomes` is the file that says how reliable
    the skills are (`executive.app.sensor_fit` reads it), if there is one, `looking` is how it is to look, and `files`
    are all the files that were read or located. A pair of PDDL files has neither skills nor relations nor a scene
    (`scene_file` is None), nor has a folder of the kind `symbolic`: only the symbolic world can play it. `leaves_open`
    is whether the problem's :init may leave open where things are, for the robot to see; that of a pair of PDDL files
    says everything, what it does not name is false, but for what it calls unknown. `priors` is how probable atoms are
    at first, of which something is stated."""

    name: str
    folder: Path
    title: str
    description: str
    task: Task
    parsed: Schema
    world: str
    scene_file: Path | None
    skills: Mapping[str, str]
    relations: Mapping[str, str]
    subject: Subject
    outcomes: Path | None
    looking: Looking
    files: tuple[Path, ...]
    leaves_open: bool = False
    priors: Mapping[Atom, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def scene(self) -> Path:
        """The file that the simulated world is built from.

        Raises:
            DomainError: there is none.
        """
        if self.scene_file is None:
            raise DomainError("has no scene for the simulator; play it with --world symbolic", file=self.files[0])
        return self.scene_file

    def draw_action(
        self, state: Mapping[Atom, bool], rng: np.random.Generator, about: Collection[str] = ()
    ) -> Step | None:
        """Draw an action that can be carried out in a state (see `executive.domain.pddl.random_action`)."""
        return draw_action(self.parsed, state, rng, about)

    def fingerprint(self) -> str:
        """SHA-256 over the contents of all its files."""
        content = hashlib.sha256()
        for file in self.files:
            content.update(hashlib.sha256(file.read_bytes()).digest())
        return content.hexdigest()


def list_domains() -> tuple[str, ...]:
    """The names of the domains that are shipped with Executive."""
    return tuple(sorted(path.parent.relative_to(_SHIPPED).as_posix() for path in _SHIPPED.rglob(MANIFEST)))


def load_domain(
    where: str | Path,
    problem: str | None = None,
    *,
    skills: Collection[str] | None = None,
    relations: Collection[str] | None = None,
) -> Domain:
    """Read and check a domain folder, or a shipped domain by its name.

    `problem` is the name of a file in the folder's `problems/`, the path of a file inside the folder, or that of a PDDL
    file anywhere else, for other tasks of the same scene; without it, the problem that the manifest names. Where
    `where` is a PDDL file itself, `problem` is another one, wherever it is. `skills` and `relations` are the names that
    exist; without them, those that are registered as entry points.

    Raises:
        DomainError: the first mistake, in one line with its file and key.
    """
    if is_pddl(where):
        return _load_pair(Path(where), problem)
    folder = _locate(where)
    source = Source(folder)
    manifest = source.manifest()
    domain_file = source.file(manifest.domain, "domain")
    default = source.file(manifest.problem, "problem")
    problem_file = default if problem is None else _problem(folder, problem)
    questions, instructions = source.words(manifest)
    scene = source.scene(manifest)
    outcomes = None if manifest.outcomes is None else source.file(manifest.outcomes, "outcomes")
    parsed = read_task(domain_file, problem_file, _looked_at(manifest, questions), source.stated(manifest))
    if parsed.unreachable:  # in a folder that is made for a robot this is a slip of the pen
        line, reason = parsed.unreachable
        raise DomainError(reason, file=problem_file, key=f"line {line}")
    skill_of = {name: table.skill for name, table in manifest.actions.items()}
    relation_of = {name: each.relation for name, each in manifest.predicates.items() if each.relation is not None}
    if scene is None:  # a world of atoms needs no words for what they do in the simulator
        needless = frozenset(parsed.predicates)
        source.check("actions", "skill", parsed.actions, skill_of, skills, parsed.actions)
    else:
        needless = parsed.static | parsed.derived
        source.check("actions", "skill", parsed.actions, skill_of, skills)
    for name in relation_of:
        if name in parsed.derived:
            source.fail(("predicates", name), "is derived by axioms: it is computed, and needs no relation")
    source.check("predicates", "relation", parsed.predicates, relation_of, relations, needless)
    for name, said in relation_of.items():
        names = [f"?{each}" for each in parsed.task.parameters[name]]
        relation_of[name] = source.call(("predicates", name, "relation"), said, names)
    for name, said in skill_of.items():
        names = [variable for variable, _ in parsed.actions[name].parameters]
        skill_of[name] = source.call(("actions", name, "skill"), said, names)
    # Those of the manifest's own problem, too: others may do with fewer.
    objects = {*parsed.task.objects, *read_vocabulary(domain_file, default).objects}
    name = folder.resolve().name
    files = (source.path, domain_file, problem_file, scene, questions, instructions, outcomes)
    return Domain(
        name=name,
        folder=folder,
        title=manifest.title,
        description=manifest.description,
        task=parsed.task,
        parsed=parsed,
        world=manifest.world.kind,
        scene_file=scene,
        skills=MappingProxyType(skill_of),
        relations=MappingProxyType(relation_of),
        subject=Subject(name, parsed.task, domain_file, questions, instructions),
        outcomes=outcomes,
        leaves_open=True,
        looking=source.looking(
            manifest,
            parsed.predicates,
            {name: [variable for variable, _ in action.parameters] for name, action in parsed.actions.items()},
            objects,
            skills,
        ),
        priors=ground_priors(source.priors(manifest), parsed, objects),
        files=tuple(file for file in files if file is not None),
    )


def is_pddl(where: str | Path) -> bool:
    """Whether a user means a PDDL file, and not a folder or the name of a shipped domain."""
    return Path(where).suffix.lower() == ".pddl" and not os.path.isdir(where)


def _load_pair(domain: Path, problem: str | None) -> Domain:
    """Read two PDDL files that are all there is of a domain."""
    if problem is None:
        raise DomainError("needs a problem: name its PDDL file, too", file=domain)
    files = inside(Path("/"), domain), inside(Path("/"), Path(problem))
    parsed = read_task(*files)
    name = parsed.task.name
    return Domain(
        name=name,
        folder=domain.parent,
        title=name,
        description="",
        task=parsed.task,
        parsed=parsed,
        world="symbolic",
        scene_file=None,
        skills=MappingProxyType({}),
        relations=MappingProxyType({}),
        subject=Subject(name, parsed.task, domain),
        outcomes=None,
        looking=Looking(),
        files=files,
    )


def load_subject(where: str | Path, problem: str | None = None) -> Subject:
    """Read what can be estimated in a domain folder, or in a shipped domain by its name. Nothing else of it needs to be
    there or supported: actions of any kind, numbers, no skills, no scene.

    What no action of the domain changes is not estimated, unless questions.toml or domain.toml speaks of it.

    A folder without a manifest has its domain in domain.pddl and, unless `problem` names another one, its problem in
    problem.pddl; questions.toml and instructions.md are taken where they are there.

    Raises:
        DomainError: the first mistake, in one line with its file and key.
    """
    folder = Path(where)
    if os.path.isfile(folder / DOMAIN) and not (folder / MANIFEST).exists():
        domain_file = inside(folder, folder / DOMAIN)
        problem_file = inside(folder, folder / PROBLEM) if problem is None else _problem(folder, problem)
        questions, instructions = (
            inside(folder, folder / name) if (folder / name).exists() else None for name in (QUESTIONS, INSTRUCTIONS)
        )
        seen = _asked(questions)
    else:
        source = Source(folder := _locate(where))
        manifest = source.manifest()
        domain_file = source.file(manifest.domain, "domain")
        default = source.file(manifest.problem, "problem")
        problem_file = default if problem is None else _problem(folder, problem)
        questions, instructions = source.words(manifest)
        seen = _looked_at(manifest, questions)
    task = read_vocabulary(domain_file, problem_file, seen)
    return Subject(folder.resolve().name, task, domain_file, questions, instructions)


def load_visibility(where: str | Path, problem: str | None = None) -> Visibility:
    """Read under which conditions a domain's atoms can be seen; a folder without a manifest states none.

    Raises:
        DomainError: the first mistake, in one line with its file and key.
    """
    if os.path.isfile(Path(where) / DOMAIN) and not (Path(where) / MANIFEST).exists():
        return Visibility()
    manifest = Source(_locate(where)).manifest()
    stated = any(table.visible is not None for table in manifest.predicates.values())
    return load_domain(where, problem).task.visibility if stated else Visibility()


def _looked_at(manifest: Manifest, questions: Path | None) -> frozenset[str]:
    """The predicates that somebody is to look at, whether an action changes them or not."""
    return frozenset({*manifest.predicates, *_asked(questions)})


def _asked(questions: Path | None) -> frozenset[str]:
    """The predicates that there is a question for. What is wrong with the file is said when it is needed."""
    if questions is None:
        return frozenset()
    try:
        asked = read_toml(questions, mistake=DomainError).get("questions")
    except DomainError:
        return frozenset()
    return frozenset(name.lower() for name in asked) if isinstance(asked, dict) else frozenset()


def _locate(where: str | Path) -> Path:
    folder, shipped = Path(where), list_domains()
    if os.path.exists(folder / MANIFEST):  # not so for names that no file can have
        return folder
    if isinstance(where, str) and where in shipped:
        return _SHIPPED / where
    if os.path.isdir(folder):
        raise DomainError(f"there is no {MANIFEST} in this folder", file=folder)
    if os.path.exists(folder):
        raise DomainError(f"is not a folder; a domain is a folder with a {MANIFEST}", file=folder)
    raise DomainError(
        f"no such folder, nor a shipped domain of that name; {nearest(folder.name, shipped)}", file=folder
    )


def _problem(folder: Path, problem: str) -> Path:
    """The problem that the user asks for: a name in `problems/`, a path inside the folder, or that of a PDDL file
    anywhere else, which is another task for the same scene."""
    names = sorted(path.stem for path in (folder / "problems").glob("*.pddl"))
    if problem in names:
        return inside(folder, folder / "problems" / f"{problem}.pddl")
    if Path(problem).suffix.lower() == ".pddl":
        if os.path.isfile(problem):
            return inside(Path(problem).resolve().parent, Path(problem))
        if os.path.isfile(folder / problem):
            return inside(folder, folder / problem)
    raise DomainError(f"there is no problem {problem!r}; {nearest(problem, names)}", file=folder / "problems")
