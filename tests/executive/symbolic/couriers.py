"""A small domain of one courier that fetches things along roads, as PDDL files."""

from __future__ import annotations

from pathlib import Path

DOMAIN = """
(define (domain couriers)
  (:requirements :typing)
  (:types place thing)
  (:predicates (at ?t - thing ?p - place) (held ?t - thing) (free) (here ?p - place) (road ?a ?b - place))
  (:action go :parameters (?a ?b - place)
    :precondition (and (here ?a) (road ?a ?b)) :effect (and (not (here ?a)) (here ?b)))
  (:action pick :parameters (?t - thing ?p - place)
    :precondition (and (here ?p) (at ?t ?p) (free)) :effect (and (held ?t) (not (at ?t ?p)) (not (free))))
  (:action put :parameters (?t - thing ?p - place)
    :precondition (and (here ?p) (held ?t)) :effect (and (not (held ?t)) (at ?t ?p) (free))))
"""

PROBLEM = """
(define (problem two) (:domain couriers)
  (:objects a b c - place x y - thing)
  (:init (here a) (free) (at x a) (at y b) (road a b) (road b a) (road b c) (road c b))
  (:goal (and (at x c) (at y a))))
"""


def write(folder: Path, problem: str = PROBLEM) -> tuple[Path, Path]:
    """Write both files into a folder."""
    files = folder / "couriers.pddl", folder / "two.pddl"
    for file, text in zip(files, (DOMAIN, problem), strict=True):
        file.write_text(text)
    return files
