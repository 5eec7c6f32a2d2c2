"""The prompts are the paper's, and what is filled in changes nothing else of them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.s3e.questions import prompts
from executive.types import Atom

OBJECTS = {"milk-carton": "item", "wood-table": "table", "lemon": "item"}
names = st.from_regex(r"[a-z][a-z0-9\-]{0,6}", fullmatch=True)


def test_the_prompts_have_the_papers_words() -> None:
    """Appendix E.1, E.2 and B, each with its line breaks."""
    assert prompts.translation("(define ...)", OBJECTS).split("\n") == [
        "The following is a PDDL domain",
        "(define ...)",
        "Here are the names of all the objects in the current problem, sorted by their type:",
        "item type: [milk-carton,lemon], table type: [wood-table]",
        "Given a grounded predicate with concrete variables, write a natural language yes-no query whose answer "
        "determines the truth value of the predicate.",
        "Respond only with this natural language query and nothing else.",
    ]
    assert prompts.QUESTION_ANSWERING.split("\n") == [
        "A curious human is asking an artificial intelligence assistant yes or no questions.",
        "The assistant answers with one of three responses: YES or NO.",
        "The assistant's response should not include any additional text.",
    ]
    assert prompts.no_translation("(define ...)", OBJECTS).split("\n")[-2:] == [
        "Given a grounded predicate with concrete variables, state whether the statement is true or false.",
        'Respond only with a "true" or "false" response and nothing else.',
    ]
    assert prompts.query(Atom("on-table", ("lemon", "black-table"))) == "on-table(lemon,black-table)"
    assert prompts.query(Atom("robot-gripper-empty")) == "robot-gripper-empty()"


@pytest.mark.parametrize("render", [prompts.translation, prompts.no_translation])
@given(domain=st.text(), objects=st.dictionaries(names, names, min_size=1))
def test_whatever_a_domain_says_stays_where_it_is_put(render: object, domain: str, objects: dict[str, str]) -> None:
    """Braces, placeholders and backslashes in a domain are text like any other."""
    assert callable(render)
    for text in (domain, domain + "{OBJECTS_BY_TYPE}{0}{DOMAIN}"):
        rendered = render(text, objects)
        before, after = render("<here>", objects).split("<here>")
        assert rendered == before + text.strip() + after


@given(st.dictionaries(names, names, min_size=1))
def test_every_object_is_listed_once_under_its_type(objects: dict[str, str]) -> None:
    listed: dict[str, str] = {}
    for part in prompts.objects_by_type(objects).split("], "):
        kind, _, members = part.rstrip("]").partition(" type: [")
        for name in members.split(","):
            assert name not in listed
            listed[name] = kind
    assert listed == objects


@pytest.mark.parametrize(
    ("instructions", "tail"), [("", ""), ("  \n ", ""), ("A lemon is yellow.\n", "\nA lemon is yellow.")]
)
def test_instructions_go_to_the_end(instructions: str, tail: str) -> None:
    assert prompts.instructed(prompts.QUESTION_ANSWERING, instructions) == prompts.QUESTION_ANSWERING + tail


def test_the_example_of_instructions_is_the_papers() -> None:
    """Appendix E.3: an introduction, then of each of three items how it looks and how it looks when held."""
    introduction, *items = prompts.GROCERY_INSTRUCTIONS.split("\n")
    assert introduction == (
        "The user will show you images of a simulated robot and ask questions about the state of the environment."
    )
    assert [line.startswith("When the robot is ") for line in items] == [False, True] * 3
    for item, lines in zip(
        ("milk carton", "red can of soda", "loaf of bread"), zip(*[iter(items)] * 2, strict=True), strict=True
    ):
        assert all(item in line for line in lines)
