"""Runs in which some things cannot be seen at first: they are found out, and only what was seen is claimed."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executive.app.config import MonitorConfig
from executive.app.run import Run, RunConfig
from executive.domain import load_domain
from executive.errors import DomainError
from executive.replay import compare_run
from executive.types import Atom, Belief, Decision, Dispatched, OutcomeKind, Reason, SkillResult, SkillStatus
from tests.fakes import Recorder

DRAWERS = Path(__file__).parents[2] / "domains" / "drawers"
DRAWER_NAMES = ("top", "middle", "bottom")


@pytest.fixture
def config(tmp_path: Path) -> RunConfig:
    return RunConfig(str(DRAWERS), world="symbolic", runs=tmp_path / "runs", viewer=False)


def play(config: RunConfig) -> tuple[dict[str, Any], Recorder, Run]:
    seen = Recorder()
    with Run(config, [seen]) as run:
        summary = run.execute()
    return dict(summary), seen, run


def causes(seen: Recorder) -> list[Reason]:
    return [
        cause.code for event in seen.events if isinstance(event.payload, Decision) for cause in event.payload.causes
    ]


@pytest.mark.parametrize("seed", range(4))
def test_drawers_are_opened_until_both_are_found_and_none_twice(config: RunConfig, seed: int) -> None:
    summary, seen, run = play(replace(config, seed=seed))
    assert (summary["outcome"], summary["goal_true"], summary["goal_seen"]) == (OutcomeKind.GOAL_REACHED, True, True)
    pulled = [
        e.payload.step.args for e in seen.events if isinstance(e.payload, Dispatched) and "pull" in str(e.payload)
    ]
    assert len(pulled) == len(set(pulled)) <= len(DRAWER_NAMES)
    assert Reason.HIDDEN in causes(seen)
    assert compare_run(run.folder).agree, "it is decided the same from its record"


def test_what_the_goal_has_hidden_is_claimed_because_it_was_seen_before(config: RunConfig) -> None:
    summary, seen, _ = play(replace(config, problem="put-away", seed=1))
    assert (summary["outcome"], summary["goal_true"], summary["goal_seen"]) == (OutcomeKind.GOAL_REACHED, True, False)
    assert causes(seen)[-2:] == [Reason.GOAL_SEEN, Reason.GOAL_RECALLED]


def test_a_goal_that_hangs_on_what_cannot_be_seen_is_gone_to_see(config: RunConfig, tmp_path: Path) -> None:
    """It holds from the start. It is believed, as it is most probable, but not claimed before it was seen: nobody says
    here that the lemon has to be somewhere, so that to have seen it nowhere else is not enough."""
    folder = tmp_path / "drawers"
    shutil.copytree(DRAWERS, folder)
    file = folder / "domain.toml"
    file.write_text(file.read_text().partition("[invariants]")[0])
    summary, seen, _ = play(replace(config, domain=str(folder), problem="is-it-there"))
    assert (summary["outcome"], summary["goal_seen"], summary["actions"]) == (OutcomeKind.GOAL_REACHED, True, 1)
    assert Reason.TO_BE_SEEN in causes(seen)


HOUSE = """
(define (domain house) (:requirements :strips :typing :negative-preconditions :conditional-effects)
  (:types box thing - object)
  (:predicates (near ?o - object) (open ?b - box) (inside ?t - thing ?b - box) (held ?t - thing))
  (:action go :parameters (?o - object)
    :precondition (and (not (near ?o)) (forall (?b - box) (or (not (inside ?o ?b)) (open ?b))))
    :effect (and (near ?o) (forall (?x - object) (when (not (= ?x ?o)) (not (near ?x))))))
  (:action pull :parameters (?b - box) :precondition (near ?b)
    :effect (and (open ?b) (forall (?t - thing) (when (inside ?t ?b) (near ?t)))))
  (:action push :parameters (?b - box) :precondition (near ?b) :effect (not (open ?b)))
  (:action grasp :parameters (?t - thing) :precondition (near ?t)
    :effect (and (held ?t) (forall (?b - box) (not (inside ?t ?b))))))
"""
NEAR = """
title = "House"
domain = "domain.pddl"
problem = "problem.pddl"
[world]
kind = "symbolic"
[predicates.open]
visible = "(near ?b)"
[predicates.inside]
visible = "(and (open ?b) (near ?b))"
"""


def house(folder: Path, init: str, goal: str) -> RunConfig:
    folder.mkdir()
    (folder / "domain.pddl").write_text(HOUSE)
    (folder / "domain.toml").write_text(NEAR)
    problem = f"(define (problem p) (:domain house) (:objects a b - box t - thing) (:init {init}) (:goal {goal}))"
    (folder / "problem.pddl").write_text(problem)
    return RunConfig(str(folder), world="symbolic", runs=folder / "runs", viewer=False)


def test_what_may_be_why_a_step_fails_is_gone_to_see(tmp_path: Path) -> None:
    """One can go to the thing, unless it is in a closed box: it is, which nobody could see. Who takes for false what
    nobody sees finds that the step fails."""
    config = replace(house(tmp_path / "house", "(inside t a)", "(held t)"), monitor=MonitorConfig(threshold=0.5))
    summary, seen, _ = play(config)
    assert (summary["outcome"], summary["goal_true"], summary["goal_seen"]) == (OutcomeKind.GOAL_REACHED, True, True)
    assert Reason.TO_BE_SEEN in causes(seen)


@pytest.mark.parametrize("search", ["likeliest", "expected"])
def test_what_a_step_hangs_on_is_looked_for_before_it_fails(tmp_path: Path, search: str) -> None:
    summary, seen, _ = play(replace(house(tmp_path / "house", "(inside t a)", "(held t)"), search=search))
    assert (summary["outcome"], summary["goal_true"], summary["goal_seen"]) == (OutcomeKind.GOAL_REACHED, True, True)
    assert summary["actions"] <= 5
    assert (Reason.LOOK_FIRST in causes(seen)) is (search == "expected")


def test_what_cannot_be_seen_at_once_is_seen_in_turn(tmp_path: Path) -> None:
    """To see that one box is closed is to go away from the other."""
    summary, seen, _ = play(house(tmp_path / "house", "(open a)", "(and (not (open a)) (not (open b)))"))
    assert (summary["outcome"], summary["goal_true"]) == (OutcomeKind.GOAL_REACHED, True)
    assert Reason.GOAL_RECALLED in causes(seen)
    assert summary["actions"] <= 5


def test_that_all_other_places_are_empty_is_not_enough_as_a_thing_may_have_fallen(config: RunConfig) -> None:
    """It is stated that the lemon is somewhere, and actions keep it there, but an accident would not."""
    summary, seen, _ = play(replace(config, problem="is-it-there"))
    assert (summary["outcome"], summary["goal_true"], summary["actions"]) == (OutcomeKind.GOAL_REACHED, True, 1)
    assert Reason.TO_BE_SEEN in causes(seen)


def test_a_model_that_speaks_of_what_it_cannot_see_is_not_believed(config: RunConfig) -> None:
    """It says of every drawer, closed as it is, that the lemon is in it."""
    with Run(config) as run:
        monitor, task = run.executive.monitor, run.domain.task
    told = {atom: float(atom == Atom("hand-empty")) for atom in task.atoms if atom not in task.visible}
    visible = {atom: 0.0 for atom in task.atoms if set(atom.args) & {"worktop", "tray"}}
    lies = {Atom("at", ("lemon", drawer)): 0.99 for drawer in DRAWER_NAMES}
    _, honest = monitor.looked(monitor.begin(), Belief(0, {**told, **visible}), 0)
    _, judged = monitor.looked(monitor.begin(), Belief(0, {**told, **visible, **lies}), 0)
    assert judged.probability == honest.probability
    assert not lies.keys() & {atom for atom, value in judged.seen.items() if value}
    assert sum(judged.state[atom] for atom in lies) == 1, "it is planned with as it most probably is: in one of them"


def test_what_is_in_an_open_drawer_is_remembered_when_it_is_closed(config: RunConfig) -> None:
    with Run(config) as run:
        monitor, task = run.executive.monitor, run.domain.task
        lemon = Atom("at", ("lemon", "top"))
        true = {lemon, Atom("at", ("can", "tray")), Atom("hand-empty"), Atom("open", ("top",))}
        all_told = {atom: float(atom in true) for atom in task.atoms}
        memory, judged = monitor.looked(monitor.begin(), Belief(0, all_told), 0)
        assert judged.seen.get(lemon) is True
        push = run.domain.parsed.ground("push", ("top",))
        memory = monitor.acted(memory, push, SkillResult(push, SkillStatus.DONE))
        closed = {**all_told, Atom("open", ("top",)): 0.0, lemon: 0.0}
        _, judged = monitor.looked(memory, Belief(1, closed), 1)
    assert lemon not in judged.seen
    assert judged.age(lemon) == 1
    assert judged.probability[lemon] > 0.98
    assert judged.state[lemon] is True


@pytest.mark.parametrize(
    ("said", "instead", "message"),
    [
        ("(open ?drawer)))", "(opn ?drawer)))", "unknown predicate in .opn .drawer.; did you mean 'open'"),
        ("(= ?place ?drawer)", "(= ?plase ?drawer)", "unknown variable .plase"),
        ("[predicates.at]", "[predicates.att]", "there is no predicate 'att'"),
        ('"(forall (?item', '"(forall (?item - thing) (and))" #', "unknown type"),
        ('somewhere = "', 'somewhere = "(', "never closed"),
        ('kind = "symbolic"', 'kind = "mujoco"', "is missing"),
    ],
)
def test_a_mistake_in_a_formula_is_named_with_its_file_and_line(
    tmp_path: Path, said: str, instead: str, message: str
) -> None:
    folder = tmp_path / "drawers"
    shutil.copytree(DRAWERS, folder)
    file = folder / "domain.toml"
    text = file.read_text()
    assert said in text
    file.write_text(text.replace(said, instead, 1))
    with pytest.raises(DomainError, match=message) as caught:
        load_domain(folder)
    assert caught.value.file == file
    assert (caught.value.key or "").startswith("line ")
