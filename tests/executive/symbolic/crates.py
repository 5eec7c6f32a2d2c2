"""A small domain with numbers: things are put into a crate until there are enough, as PDDL files."""

from __future__ import annotations

from pathlib import Path

DOMAIN = """
(define (domain crates) (:requirements :typing :numeric-fluents)
  (:types item crate)
  (:predicates (loose ?i - item) (in ?i - item ?c - crate))
  (:functions (count ?c - crate))
  (:action put :parameters (?i - item ?c - crate) :precondition (loose ?i)
    :effect (and (not (loose ?i)) (in ?i ?c) (increase (count ?c) 1)))
  (:action take :parameters (?i - item ?c - crate) :precondition (and (in ?i ?c) (> (count ?c) 0))
    :effect (and (loose ?i) (not (in ?i ?c)) (decrease (count ?c) 1))))
"""

PROBLEM = """
(define (problem three) (:domain crates)
  (:objects a b c d - item k - crate)
  (:init (loose a) (loose b) (loose c) (loose d) (= (count k) 0))
  (:goal (>= (count k) 3)))
"""


def write(folder: Path) -> tuple[Path, Path]:
    """Write both files into a folder."""
    files = folder / "crates.pddl", folder / "three.pddl"
    for file, text in zip(files, (DOMAIN, PROBLEM), strict=True):
        file.write_text(text)
    return files
