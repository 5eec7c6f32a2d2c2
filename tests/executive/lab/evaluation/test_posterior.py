"""What a run would believe after one look: consistent, and without what no actions lead to."""

from __future__ import annotations

from pathlib import Path

from executive.domain.loader import load_domain
from executive.lab.evaluation.posterior import open_single_look
from executive.types import Atom, Belief

BLOCKS = tuple(
    f"{size}-{colour}-rubber-cube" for size in ("small", "large") for colour in ("red", "blue", "green", "gray")
)
ITSELF = Atom("on", (BLOCKS[0], BLOCKS[0]))


def test_no_block_is_believed_to_be_on_itself_where_states_are_too_many_to_list(tmp_path: Path) -> None:
    everything = " ".join(f"(on-table {name})" for name in BLOCKS)
    problem = tmp_path / "eight.pddl"
    problem.write_text(
        f"(define (problem eight) (:domain blocksworld) (:objects {' '.join(BLOCKS)} - cube)"
        f" (:init (hand-empty) {everything}) (:goal (on {BLOCKS[0]} {BLOCKS[1]})))"
    )
    domain = load_domain("blocksworld", str(problem))
    monitor = open_single_look(domain, None)
    assert monitor.space is None
    assert set(monitor.prior) == {Atom("on", (name, name)) for name in BLOCKS}
    true = {Atom("hand-empty"), *(Atom("on-table", (name,)) for name in BLOCKS)}
    answers = {atom: 0.95 if atom in true else 0.05 for atom in domain.task.atoms} | {ITSELF: 0.9}
    _, judgement = monitor.looked(monitor.begin(), Belief(1, answers, frozenset()), 1)
    assert {atom for atom, value in judgement.probability.items() if value >= 0.5} == true
