"""What to break on purpose, when, and with which chance: `executive faults` lists it all.

grammar.py    how a fault is written, on the command line and in files
kinds.py      the catalogue
injector.py   strikes at the moments that the loop tells of
between.py    cameras, estimators, planners and skills that fail
"""

from executive.faults.catalogue import KINDS, Kind
from executive.faults.grammar import EVER, EXAMPLES, Fault, parse_fault, read_faults
from executive.faults.injector import FaultInjector
from executive.faults.wrappers import faulty_estimator, faulty_planner, faulty_sensing, faulty_skills, faulty_world

__all__ = [
    "EVER",
    "EXAMPLES",
    "KINDS",
    "Fault",
    "FaultInjector",
    "Kind",
    "faulty_estimator",
    "faulty_planner",
    "faulty_sensing",
    "faulty_skills",
    "faulty_world",
    "parse_fault",
    "read_faults",
]
