"""One word for one thing: names that gave way to the field's terms do not come back (docs/glossary.md)."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

RETIRED = {
    "Eye": "SensorModel, EstimatorConfig or a vision-language model, as the case is",
    "Reading": "ErrorModel, of a sensor",
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
    "Contender": "a configuration of a campaign, an alternative in a benchmark",
    "eyes": "estimators, sensor models or models, as the case is",
    "Turn": "StepOutcome; a turn of the loop is a cycle",
    "Outlook": "RemainingPlan",
    "outlook": "remaining_plan",
    "bearing": "relevant_facts",
    "hung_on": "stuck_among",
    "Leeway": "StuckSteps",
    "leeway": "allowed, of stuck steps",
    "Doubts": "UncertainAtoms",
    "Dropped": "GivenUp",
    "tolerated": "max_failures_with_same_facts",
    "bearable": "max_failures_ever",
    "useless": "uninformative, of pictures",
    "punctual_estimator": "limit_estimator",
    "punctual_planner": "limit_planner",
    "punctual_skills": "limit_skills",
    "punctual_preparing": "limit_preparing",
    "LateError": "TimeLimitError",
    "undisturbed": "uninterrupted",
    "settle_renderer": "choose_renderer",
    "SUMS": "OPENMP_THREADS",
    "DRAWING": "RENDERING_THREADS",
    "COMPILED": "NUMBA_THREADS",
    "spoken": "phrases.step",
    "goal_told": "phrases.goal",
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


RETIRED_WORDS = re.compile(r"\b(eyes?|contenders?|mischief|hunch|hunches|crew|studio|at its word|came of it)\b", re.I)
"""In prose; keys and names of models that have them stand in backquotes."""


def prose(file: Path) -> Iterator[str]:
    """The docstrings of a file and the texts beside its fields, without the names in them."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield re.sub(r"`[^`]*`|^ +\w+: ", "", node.value.value, flags=re.M)


@pytest.mark.parametrize(
    "folder",
    ["executive/lab", "executive/s3e", "executive/util", "executive/app", "executive/cli", "skills", "benchmarks"],
)
def test_docstrings_have_the_fields_words(folder: str) -> None:
    found = {
        (file.relative_to(ROOT).as_posix(), word[0])
        for file in sorted((ROOT / folder).rglob("*.py"))
        for text in prose(file)
        for word in RETIRED_WORDS.finditer(text)
    }
    assert found == set()


@pytest.mark.parametrize("folder", ["executive", "skills", "benchmarks"])
def test_retired_names_do_not_come_back(folder: str) -> None:
    found = {
        (file.relative_to(ROOT).as_posix(), name)
        for file in sorted((ROOT / folder).rglob("*.py"))
        for name in identifiers(file)
        if name in RETIRED
    }
    assert {place: RETIRED[place[1]] for place in found - KEPT} == {}
