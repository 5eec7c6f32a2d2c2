"""What a question has to look like before it is asked: good ones pass whatever their style, and each slip is named."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.domain.loader import load_subject
from executive.s3e import Templates, generic
from executive.s3e.questions.checks import Checker, tidy
from executive.types import Atom, Task
from tests.executive.s3e.questions.test_templates import GROCERY, TRAY, tasks

SUBJECT = load_subject(GROCERY)
TEMPLATES = Templates.read(GROCERY / "questions.toml")
CHECKER = Checker(SUBJECT.task.objects, TEMPLATES.names(SUBJECT.task))


def fault(atom: str, text: str) -> str:
    return CHECKER.fault(Atom.parse(atom), text)


@pytest.mark.parametrize("folder", [GROCERY, TRAY])
def test_the_templates_of_the_domains_at_hand_pass(folder: Path) -> None:
    task, templates = load_subject(folder).task, Templates.read(folder / "questions.toml")
    checker = Checker(task.objects, templates.names(task))
    assert {checker.fault(atom, text) for atom, text in templates.translate(task).text.items()} == {""}


@given(tasks())
def test_generic_questions_name_all_that_they_are_about(task: Task) -> None:
    """They may still name too much: `a` stands for an object, too, and `the a and the the` is hard to take apart."""
    checker = Checker(task.objects, {})
    faults = {checker.fault(atom, text) for atom, text in generic(task).translate(task).text.items()}
    assert not any(fault.startswith("does not") for fault in faults)


@pytest.mark.parametrize(
    ("atom", "text"),
    [
        ("on-table(milk-carton,wood-table)", "In this image, is the milk carton on the wooden table?"),  # Section 4
        ("on-table(milk-carton,wood-table)", "Is the carton of milk on the table made of wood?"),
        ("on-table(milk-carton,wood-table)", "Is milk-carton on wood-table?"),
        ("on-table(milk-carton,wood-table)", "Does the wood table have a white milk carton on it?"),
        ("on-table(soda-can,black-table)", "Can you see the red can of soda on the black table?"),
        ("on-table(water-bottle,white-table)", "Is there a bottle of water on the white table?"),
        ("robot-gripping(lemon)", "Is the lemon held by the robot's gripper?"),
        ("robot-gripper-empty()", "Is the robot gripper empty?"),
    ],
)
def test_good_questions_pass_whatever_their_style(atom: str, text: str) -> None:
    assert fault(atom, text) == ""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "says nothing"),
        ("?!", "says nothing"),
        ("Is the lemon\non the wood table?", "is more than one line"),
        ("Is the lemon on the wood table", "does not end with a question mark"),
        ("True, the lemon is on the wood table.", "does not end with a question mark"),
        ("Is the lemon on the wood table? Or on another?", "is more than one sentence"),
        ("Sure! Is the lemon on the wood table?", "is more than one sentence"),
        ("Query: Is the lemon on the wood table?", "is more than one sentence"),
        ("Where on the wood table is the lemon?", "cannot be answered with yes or no"),
        ("The lemon on the wood table?", "cannot be answered with yes or no"),
        ("Is the lemon not on the wood table?", "may ask for the opposite"),
        ("Isn't the lemon on the wood table?", "may ask for the opposite"),
        ("Isn\N{RIGHT SINGLE QUOTATION MARK}t the lemon on the wood table?", "may ask for the opposite"),
        ("Is there no lemon on the wood table?", "may ask for the opposite"),
        ("Is it on the wood table?", "does not name lemon"),
        ("Is the lemon on the table?", "does not name wood-table"),
        ("Is the lemon on the black table?", "does not name wood-table"),
        ("Is the lemon on the wood table or on the black table?", "names black-table, which the atom has no part in"),
        ("Is the lemon beside the red can of soda on the wood table?", "names soda-can, which the atom has no part in"),
        (f"Is the lemon {'really ' * 50}on the wood table?", "has 381 characters, and may have 300"),
    ],
)
def test_each_slip_is_named(text: str, why: str) -> None:
    assert fault("on-table(lemon,wood-table)", text) == why


def test_an_object_called_like_a_common_word_has_to_be_meant() -> None:
    """A can is not named by a question that begins with "Can"."""
    assert fault("on-table(soda-can,wood-table)", "Can you see it on the wooden table?") == "does not name soda-can"


def test_numbers_tell_objects_apart() -> None:
    checker = Checker(["table1", "table2"], {})
    atom = Atom("clear", ("table1",))
    assert checker.fault(atom, "Is table 1 clear?") == ""
    assert checker.fault(atom, "Is table2 clear?") == "does not name table1"
    assert checker.fault(atom, "Is a table clear?") == "does not name table1"


def test_a_negation_that_the_predicate_asks_for_is_no_slip() -> None:
    assert Checker(["cup"], {}).fault(Atom("not-full", ("cup",)), "Is the cup not full?") == ""


@given(st.text(), st.sampled_from(sorted(SUBJECT.task.atoms)))
def test_whatever_a_model_says_is_judged(text: str, atom: Atom) -> None:
    said = CHECKER.fault(atom, tidy(text))
    assert said == "" or said.isprintable()


def test_what_a_model_thought_aloud_is_no_part_of_its_reply() -> None:
    assert tidy('<think>\nIs it a lemon?\nNo.</think>\n\n"Is it a cup?"') == "Is it a cup?"


@given(st.text(alphabet="ab \"'`?"))
def test_tidying_takes_nothing_but_what_is_around_a_reply(text: str) -> None:
    assert tidy(text) in text
    assert tidy(f'  "{text.strip()}?"\n') in (f"{text.strip()}?", f'"{text.strip()}?"')


@pytest.mark.parametrize(
    "reply",
    ['"Is it?"', " 'Is it?'\n", "`Is it?`", "\u201cIs it?\u201d"],
)
def test_quotation_marks_around_a_reply_are_no_part_of_it(reply: str) -> None:
    assert tidy(reply) == "Is it?"
