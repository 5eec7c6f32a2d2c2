"""How reliable the skills are, measured on a collection: what had come of each action, by what its skill reported.

    python -m executive.lab.collection.outcomes grocery FOLDER > domains/grocery/outcomes.toml

A collection keeps the truth after each action that was completed. After one that failed it keeps none; but where
exactly one failed between two that were completed, the state after it is the one that the next action began in, which
follows from the state after that: its effects undone, its preconditions true, all else as it was.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from executive.belief.action_model import Chances, outcome
from executive.domain.loader import load_domain
from executive.domain.pddl import Schema
from executive.errors import ExecutiveError, InputError
from executive.lab.collection import dataset
from executive.lab.collection.dataset import Attempt, Point
from executive.lab.config import read_range
from executive.lab.problems import Combinations, ProblemMaker
from executive.types import Atom, Facts, SkillStatus, Step


def measure(
    folder: Path, schema: Schema, of_episode: Callable[[int], Schema] | None = None
) -> Mapping[tuple[str, SkillStatus], Chances]:
    """How many actions had which outcome, by action and report, in a finished collection of the task.

    Args:
        of_episode: the task of each episode, where they have objects of their own.

    Raises:
        InputError: there is no finished collection, a damaged one, or one of another task.
    """
    manifest = dataset.read_manifest(folder)
    collection = dataset.digest(manifest["collection"])
    points: dict[int, list[Point]] = {}
    for point in dataset.read(folder, cameras=()):
        points.setdefault(point.episode, []).append(point)
    counts: dict[tuple[str, SkillStatus], Counter[int]] = {}
    for episode in range(manifest["statistics"]["episodes"]):
        log = dataset.read_log(folder, collection, episode)
        own = schema if of_episode is None else of_episode(episode)
        for attempt, step, before, after in _transitions(log.attempts, points.get(episode, []), own):
            key = (step.action, SkillStatus(attempt.status))
            counts.setdefault(key, Counter())[outcome(step, before, after).index(1)] += 1
    return {key: Chances(count[0], count[1], count[2]) for key, count in sorted(counts.items())}


def _transitions(
    attempts: tuple[Attempt, ...], points: list[Point], schema: Schema
) -> Iterator[tuple[Attempt, Step, Facts, Facts]]:
    """The actions of an episode whose states before and after are known."""
    steps = [_parsed(attempt.action, schema) for attempt in attempts]
    done = [number for number, attempt in enumerate(attempts) if attempt.done]
    for number, point in zip(done, points, strict=True):
        yield attempts[number], steps[number], _begun(point, steps[number]), point.facts
    for (earlier, was), (later, point) in zip(
        zip(done, points, strict=True), zip(done[1:], points[1:], strict=True), strict=False
    ):
        if later == earlier + 2:
            yield attempts[earlier + 1], steps[earlier + 1], was.facts, _begun(point, steps[later])


def _begun(point: Point, step: Step) -> Facts:
    """The state that a completed action began in. Effects that came about are taken to have been changes, and those
    that did not to have changed nothing."""
    surprising = {atom: not point.facts[atom] for atom in point.surprises if atom not in step.affects}
    undone = {atom: not value for atom, value in step.unconditional.items() if point.facts[atom] is value}
    return point.facts | surprising | undone | step.precondition.facts


def _parsed(action: str, schema: Schema) -> Step:
    named = Atom.parse(action)  # a step is printed as an atom is
    try:
        return schema.ground(named.predicate, named.args)
    except ValueError as error:
        raise InputError(f"was collected in another task: {error}") from None


def _schemas(domain: str, collection: Mapping[str, Any]) -> Callable[[int], Schema] | None:
    """The tasks of a collection's episodes, where they have objects of their own."""
    objects = collection.get("objects")
    if not objects:
        return None
    kind = collection.get("subset"), collection.get("combinations", Combinations.ALL)
    maker = ProblemMaker(domain, *read_range(objects), collection["seed"], *kind)

    def schema(episode: int) -> Schema:
        with maker.domain(episode + 1) as own:
            return own.parsed

    return schema


def document(counts: Mapping[tuple[str, SkillStatus], Chances], command: str) -> str:
    """The text of a domain's `outcomes.toml`; `command` is what collected the data."""
    lines = [
        "# Of the actions whose skill ended with some report: how many had all of their effects, changed nothing, or",
        "# came to something else.",
        f"# Measured on: {command}",
    ]
    for action in dict.fromkeys(action for action, _ in counts):
        lines += ["", f"[{action}]"]
        for status in (status for name, status in counts if name == action):
            lines.append(f'"{status}" = {json.dumps([int(count) for count in counts[action, status]])}')
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="Print a domain's outcomes.toml, as measured on a collection.")
    parser.add_argument("domain")
    parser.add_argument("folder", type=Path, help="the finished collection's")
    parser.add_argument("--problem", help="the problem that it was collected in")
    arguments = parser.parse_args()
    try:
        schema = load_domain(arguments.domain, arguments.problem).parsed
        manifest = dataset.read_manifest(arguments.folder)
        words = shlex.split(manifest["command"])
        where = words.index("--out")
        command = shlex.join([*words[:where], *words[where + 2 :], "--out", "data"])
        of_episode = _schemas(arguments.domain, manifest["collection"])
        print(document(measure(arguments.folder, schema, of_episode), command), end="")
    except ExecutiveError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
