"""States are listed where that says more than mutex groups do, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.belief.state_space import StateSpace
from executive.domain.loader import load_domain
from executive.domain.pddl import Schema, read_task
from executive.planning import state_listing
from executive.planning.mutex_groups import Mutexes, find_mutexes
from executive.planning.state_listing import list_states
from executive.types import Atom

DOMAIN = """
(define (domain plates) (:requirements :strips :typing :equality :negative-preconditions) (:types plate)
  (:predicates (on ?a ?b - plate) (alone ?a - plate) (clear ?a - plate))
  (:action stack :parameters (?a ?b - plate)
    :precondition (and (alone ?a) (clear ?a) (clear ?b) (not (= ?a ?b)))
    :effect (and (on ?a ?b) (not (alone ?a)) (not (clear ?b))))
  (:action unstack :parameters (?a ?b - plate)
    :precondition (and (on ?a ?b) (clear ?a))
    :effect (and (alone ?a) (clear ?b) (not (on ?a ?b)))))
"""


def plates(folder: Path, init: str = "(alone a) (alone b) (alone c) (clear a) (clear b) (clear c)") -> Schema:
    """Plates that are stacked on each other, never in a circle."""
    domain, problem = folder / "domain.pddl", folder / "problem.pddl"
    domain.write_text(DOMAIN)
    problem.write_text(
        f"(define (problem p) (:domain plates) (:objects a b c - plate) (:init {init}) (:goal (on a b)))"
    )
    return read_task(domain, problem)


def test_states_are_listed_where_groups_allow_more(tmp_path: Path) -> None:
    schema = plates(tmp_path)
    space = list_states(schema, find_mutexes(schema))
    assert space is not None
    # Apart from clear(.), which follows: all alone, a stack of two (of 6 kinds), a stack of three (of 6).
    assert len(space) == 1 + 6 + 6
    circle = {Atom.parse("on(a,b)"): True, Atom.parse("on(b,a)"): True}
    assert space.common(circle) == {}


def test_groups_that_say_it_all_are_enough() -> None:
    domain = load_domain("grocery")
    assert list_states(domain.parsed, find_mutexes(domain.parsed)) is None


def test_an_initial_state_that_leaves_things_open_lists_nothing(tmp_path: Path) -> None:
    schema = plates(tmp_path, "(alone a) (clear a)")
    found = find_mutexes(schema)
    assert found.state != schema.task.declared
    assert list_states(schema, found) is None
    declared = Mutexes(found.groups, frozenset(schema.task.declared))
    assert isinstance(list_states(schema, declared), StateSpace)


def test_too_many_actions_list_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    schema = plates(tmp_path)
    monkeypatch.setattr(state_listing, "MOST_ACTIONS", 11)
    assert list_states(schema, Mutexes((), frozenset(schema.task.declared))) is None
