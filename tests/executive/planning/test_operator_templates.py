"""Operators straight from lifted actions are those that come of writing every action out."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.domain.pddl import Schema, read_task
from executive.planning.operator_templates import NoLiteralsError, OperatorTemplates, is_literal
from executive.types import Atom

DOMAINS = Path(__file__).parents[3] / "domains"
WITHOUT_AXIOMS = sorted(
    file.parent.name for file in DOMAINS.glob("*/domain.pddl") if "(:derived" not in file.read_text()
)

ODD = """(define (domain odd) (:requirements :adl :action-costs) (:types thing place) (:constants home - place)
  (:predicates (at ?t - thing ?p - place) (road ?a ?b - place) (clean) (seen ?t - thing))
  (:functions (total-cost) (toll ?a ?b - place))
  (:action go :parameters (?t - thing ?a ?b - place)
    :precondition (and (at ?t ?a) (not (= ?a ?b)) (and (road ?a ?b) (not (at ?t ?b))))
    :effect (and (not (at ?t ?a)) (at ?t ?b) (increase (total-cost) (toll ?a ?b))))
  (:action return :parameters (?t - thing) :precondition (clean) :effect (and (at ?t home) (not (at ?t home))))
  (:action never :parameters (?t - thing) :precondition (and (clean) (not (clean))) :effect (seen ?t))
  (:action clean :parameters () :precondition () :effect (clean))
  (:action idle :parameters (?t - thing) :precondition (seen ?t) :effect (seen ?t))
  (:action any :parameters (?t - thing) :precondition (or (seen ?t) (clean)) :effect (not (seen ?t))))"""

FEW = """(define (problem few) (:domain odd) (:objects b a - thing y x - place)
  (:init (at a x) (road x y) (road y home) (road home x) (= (total-cost) 0) (= (toll x y) 2) (= (toll y home) 0.5))
  (:goal (at a home)) (:metric minimize (total-cost)))"""


def odd(folder: Path) -> Schema:
    (folder / "domain.pddl").write_text(ODD)
    (folder / "problem.pddl").write_text(FEW)
    return read_task(folder / "domain.pddl", folder / "problem.pddl")


Facts = list[tuple[Atom, bool]]


def written_out(schema: Schema, name: str) -> dict[tuple[str, ...], tuple[Facts, Facts, float]]:
    """What each action that can change something needs, gives and costs, by its arguments."""
    found = {}
    for args in schema.arguments(name):
        try:
            step = schema.ground(name, args)
        except ValueError:
            continue
        needs, gives = step.precondition.facts, step.unconditional
        if not needs.entails(gives):
            found[args] = list(needs.items()), list(gives.items()), step.cost
    return found


def by_templates(schema: Schema, name: str) -> dict[tuple[str, ...], tuple[Facts, Facts, float]]:
    atoms = schema.task.atoms
    templates = OperatorTemplates(schema, {atom: number for number, atom in enumerate(atoms)})
    return {
        each.args: ([(atoms[n], v) for n, v in each.needs.items()], [(atoms[n], v) for n, v in each.gives.items()],
                    each.cost)
        for each in templates.grounded(name)
        if each is not None
    }  # fmt: skip


@pytest.mark.parametrize("domain", WITHOUT_AXIOMS)
def test_they_are_the_actions_written_out(domain: str) -> None:
    schema = read_task(DOMAINS / domain / "domain.pddl", DOMAINS / domain / "problem.pddl")
    assert any(is_literal(schema, name) for name in schema.actions)
    for name in schema.actions:
        if is_literal(schema, name):
            assert list(by_templates(schema, name).items()) == list(written_out(schema, name).items()) != []


def test_static_atoms_equalities_costs_and_what_is_deleted_and_added(tmp_path: Path) -> None:
    schema = odd(tmp_path)
    for name in set(schema.actions) - {"any"}:
        assert is_literal(schema, name)
        assert list(by_templates(schema, name).items()) == list(written_out(schema, name).items())
    costs = {args[1:]: cost for args, (_, _, cost) in by_templates(schema, "go").items()}
    assert costs == {("x", "y"): 2.0, ("y", "home"): 0.5}, "the third road has no toll"
    there = {"b": [(Atom("at", ("b", "home")), True)], "a": [(Atom("at", ("a", "home")), True)]}
    assert {args[0]: gives for args, (_, gives, _) in by_templates(schema, "return").items()} == there
    assert not by_templates(schema, "never")
    assert not by_templates(schema, "idle")


def test_what_is_more_than_literals_is_said(tmp_path: Path) -> None:
    schema = odd(tmp_path)
    assert not is_literal(schema, "any")
    with pytest.raises(NoLiteralsError):
        by_templates(schema, "any")
