"""A task that is written as PDDL is the same task when it is read again."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task
from executive.domain.pddl.text import Writer
from executive.types import Atom
from tests.executive.domain.pddl.test_features import TOWERS, TYPES
from tests.executive.domain.pddl.test_reader import ALL


def house(folder: Path) -> Schema:
    return read_task(*ALL["house"])


def towers(folder: Path) -> Schema:
    return made(folder, TOWERS, "(:objects a b c - block) (:goal (above a c))", "(on b c) (glued c)")


def unions(folder: Path) -> Schema:
    return made(folder, TYPES.replace("(either vehicle floating) - thing ", ""), "(:goal (p))", "")


def made(folder: Path, domain: str, problem: str, init: str) -> Schema:
    (folder / "d.pddl").write_text(f"(define (domain d) {domain})")
    (folder / "p.pddl").write_text(f"(define (problem q) (:domain d) (:init {init}) {problem})")
    return read_task(folder / "d.pddl", folder / "p.pddl")


@pytest.mark.parametrize("make", [house, towers, unions])
def test_a_task_written_and_read_again_has_the_same_atoms_and_steps(
    tmp_path: Path, make: Callable[[Path], Schema]
) -> None:
    schema = make(tmp_path)
    write = Writer(schema)
    actions = [write.action(f"a-{name}", action, action.precondition) for name, action in schema.actions.items()]
    parts = [write.types(), write.constants(), f"(:predicates {' '.join(write.declarations())})"]
    true = sorted(atom for atom in schema.task.static | schema.task.declared if atom.predicate not in schema.derived)
    again = made(
        tmp_path,
        "\n".join([*parts, *write.axioms(), *actions]),
        f"(:goal {write.formula(schema.goal, {})})",
        " ".join([*map(write.atom, true), *write.facts()]),
    )

    def written(atom: Atom) -> Atom:
        return Atom(write.predicates[atom.predicate], tuple(write.objects[name] for name in atom.args))

    assert list(again.task.atoms) == [written(atom) for atom in schema.task.atoms]
    assert again.task.declared == {written(atom) for atom in schema.task.declared}
    choose = random.Random(5)
    states = [{atom: choose.random() < 0.5 for atom in schema.task.atoms} for _ in range(4)]
    steps = 0
    for name in schema.actions:
        for args in schema.arguments(name):
            try:
                step = schema.ground(name, args)
            except ValueError:
                continue
            other = again.ground(f"a-{name}", [write.objects[arg] for arg in args])
            for state in states:
                known = schema.task.derived.complete(state)
                same = again.task.derived.complete({written(atom): value for atom, value in state.items()})
                assert other.precondition.truth(same) is step.precondition.truth(known)
                changes = {written(atom): value for atom, value in step.changes(known).items()}
                assert dict(other.changes(same)) == changes
                assert again.task.goal.truth(same) is schema.task.goal.truth(known)
            steps += 1
    assert steps > 3
