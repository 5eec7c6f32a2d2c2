"""One word for one thing: names that gave way to the field's terms do not come back (docs/glossary.md)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

RETIRED = {
    "Eye": "SensorModel, EstimatorConfig or a vision-language model, as the case is",
    "Reading": "ErrorModel, of a sensor",
    "Track": "BeliefState",
    "Course": "RunState",
    "Trust": "SensorFit",
    "unrest": "process_noise, of an action model",
    "heeds": "agrees_with, of evidence",
    "anew": "increment, of evidence",
    "HARDLY": "LEAST_EVIDENCE",
    "NOWHERE": "EMPTY_GROUP",
    "BAND": "DEFAULT_THRESHOLDS",
    "WIDEST": "MAX_FRONTIER",
    "FELT": "GRIP_EVIDENCE; as a sense, the record's word",
    "mate": "partner, in a mutex group",
    "mates": "partners, in a mutex group",
    "at_word": "thresholded",
    "deaf": "block_signals",
    "write_whole": "write_atomic",
    "crew": "a worker pool",
    "Crew": "WorkerPool",
    "hire": "submit",
    "eye_config": "estimator_config",
}
"""Each with the name that took its place."""

KEPT = {
    ("executive/trace/record/monitor_file.py", "unrest"),  # the key in monitor.json
    ("executive/types/actions.py", "FELT"),  # `Sense`, which records hold
}
"""Where a retired name stays, because files on disk have it."""


def identifiers(file: Path) -> Iterator[str]:
    """The names that a file defines: classes, functions, parameters, variables and fields."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
            case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name


@pytest.mark.parametrize("folder", ["executive", "skills"])
def test_retired_names_do_not_come_back(folder: str) -> None:
    found = {
        (file.relative_to(ROOT).as_posix(), name)
        for file in sorted((ROOT / folder).rglob("*.py"))
        for name in identifiers(file)
        if name in RETIRED
    }
    assert {place: RETIRED[place[1]] for place in found - KEPT} == {}
