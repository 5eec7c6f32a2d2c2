"""Which test holds which of the 31 situations that executives get wrong (the project's list of scenarios).

Every one is met with a scripted estimator. Those that are to be met on the real stack, too, are met there with the
oracle and with the eye that comes along: by tests that take an eye as a parameter.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
SCRIPTED, SIMULATED, RESUMED = "core/test_scenarios.py", "core/test_scenarios_simulated.py", "app/test_run_resumed.py"

ON_THE_REAL_STACK = {1, 2, 3, 4, 5, 7, 9, 13, 17, 18, 19, 20, 23, 25, 26, 27}

ELSEWHERE = {
    3: ("core/test_hold_guard.py", "test_a_drop_that_is_seen_ends_the_skill_early_and_says_so"),
    12: ("s3e/backends/test_openai_backend.py", "test_no_reply_whatever_is_more_than_an_error"),
    16: ("planning/test_fast_downward.py", "test_a_search_that_takes_too_long_times_out_and_leaves_no_process"),
    19: ("../skills/test_motion_planning.py", "test_motion_avoids_what_is_in_the_way_and_repeats_by_seed"),
    22: ("domain/pddl/test_mistakes.py", "test_a_mistake_in_the_domain_is_named"),
    23: ("app/test_resume.py", "test_23_a_run_that_is_killed_at_some_dealing_with_the_disk_goes_on"),
    24: ("replay/test_engine.py", "test_24_another_threshold_decides_otherwise_and_says_where_the_record_ends_for_it"),
    29: ("planning/test_fast_downward.py", "test_29_an_action_that_changes_nothing_is_no_reason_to_fail"),
    26: ("core/test_observer.py", "test_a_camera_that_shows_the_same_picture_twice_has_frozen"),
}
"""What is held beside the scripted scenarios, or instead of them, by tests of the part that it is about."""


@cache
def scenarios_of(file: str) -> dict[str, set[int]]:
    """The tests of a file and the scenarios that their names tell: `test_03_and_04_...` tells 3 and 4."""
    tree, found = ast.parse((TESTS / file).read_text(encoding="utf-8")), dict[str, set[int]]()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            words = node.name.split("_")[1:]
            told = words[
                : next((place for place, word in enumerate(words) if not (word.isdigit() or word == "and")), 0)
            ]
            found[node.name] = {int(word) for word in told if word.isdigit()}
    return found


def told(*files: str) -> set[int]:
    return {number for file in files for numbers in scenarios_of(file).values() for number in numbers}


def test_every_scenario_is_met_with_a_scripted_estimator() -> None:
    assert told(SCRIPTED) | ELSEWHERE.keys() >= set(range(1, 32))


@pytest.mark.parametrize("number", ELSEWHERE)
def test_what_is_held_elsewhere_is_there(number: int) -> None:
    file, name = ELSEWHERE[number]
    assert name in scenarios_of(file)


def test_those_for_the_real_stack_are_met_there_with_the_oracle_and_with_the_eye() -> None:
    assert told(SIMULATED, RESUMED) == ON_THE_REAL_STACK
    for file, parameter in ((SIMULATED, "prepared"), (RESUMED, "estimator")):
        for node in ast.parse((TESTS / file).read_text(encoding="utf-8")).body:
            slow = isinstance(node, ast.FunctionDef) and any(
                "slow" in ast.unparse(each) for each in node.decorator_list
            )
            if isinstance(node, ast.FunctionDef) and scenarios_of(file).get(node.name) and not slow:
                assert parameter in {argument.arg for argument in node.args.args}, node.name
