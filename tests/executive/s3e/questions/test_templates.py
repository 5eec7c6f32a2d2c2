"""Every atom gets a question of its own, and every mistake in a file of templates is one line with file and key."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.domain.loader import load_subject
from executive.errors import DomainError
from executive.s3e import Templates, Translator, Untranslated, generic, instruct, load_instructions, load_questions
from executive.s3e.questions.prompts import QUESTION_ANSWERING
from executive.s3e.questions.templates import LARGEST
from executive.types import ALWAYS, Atom, Questions, Task

ROOT = Path(__file__).resolve().parents[4]
GROCERY, TRAY = ROOT / "domains" / "grocery", ROOT / "tests" / "domains" / "tray"

names = st.from_regex(r"[a-z][a-z0-9_\-]{0,4}", fullmatch=True)


@st.composite
def tasks(draw: st.DrawFn) -> Task:
    """Tasks with names as awkward as PDDL allows."""
    objects = draw(st.dictionaries(names, st.just("thing"), min_size=1, max_size=4))
    arities = draw(st.dictionaries(names, st.integers(0, 2), min_size=1, max_size=3))
    atoms = [Atom(name, args) for name, arity in arities.items() for args in itertools.product(objects, repeat=arity)]
    parameters = {name: ("first", "second")[:arity] for name, arity in arities.items()}
    return Task("d", "p", objects, tuple(atoms), ALWAYS, parameters=draw(st.sampled_from([parameters, {}])))


@pytest.fixture
def tray() -> Task:
    return load_subject(TRAY).task


def distinct(questions: Questions) -> bool:
    return len({text.casefold() for text in questions.text.values()}) == len(questions.text)


@pytest.mark.parametrize("folder", [GROCERY, TRAY])
def test_the_domains_at_hand_are_asked_about(folder: Path) -> None:
    subject = load_subject(folder)
    assert subject.questions is not None
    assert subject.instructions is not None
    questions = load_questions(subject.questions, subject.task)
    assert questions.text.keys() == set(subject.task.atoms)
    assert distinct(questions)
    assert questions.warnings == ()
    system = instruct(questions, load_instructions(subject.instructions)).system
    assert system.startswith(QUESTION_ANSWERING + "\n")
    assert system.endswith(subject.instructions.read_text().strip())


def test_problems_with_fewer_objects_need_no_other_questions() -> None:
    subject = load_subject(GROCERY, "one-item")
    assert subject.questions is not None
    questions = load_questions(subject.questions, subject.task)
    assert (len(questions.text), questions.warnings) == (5, ())


def test_placeholders_are_names_or_positions(tray: Task) -> None:
    text = {"resting-on": "Is {2} under the {cube}?", "holding": "{{{1}}} held?", "hand-free": "Free?"}
    questions = Templates(text, {"bench": "old {bench}"}).translate(tray).text
    assert questions[Atom.parse("resting-on(red-cube,bench)")] == "Is old {bench} under the red cube?"
    assert questions[Atom.parse("holding(red-cube)")] == "{red cube} held?"
    assert questions[Atom.parse("hand-free")] == "Free?"


@given(tasks())
def test_without_templates_every_atom_still_has_a_question_of_its_own(task: Task) -> None:
    questions = generic(task).translate(task)
    assert questions.text.keys() == set(task.atoms)
    assert distinct(questions)
    assert all(text.endswith("?") for text in questions.text.values())


@given(tasks(), st.text(alphabet="{}12 :!ab", max_size=8))
def test_names_of_objects_are_put_in_as_they_are(task: Task, text: str) -> None:
    """Whatever an object is called, braces included: it is in the question, and nothing in it is a placeholder."""
    called = {name: f"{text}{index}" for index, name in enumerate(task.objects)}
    for atom, question in Templates(generic(task).predicates, called).translate(task).text.items():
        assert all(called[arg].strip() in question for arg in atom.args)


def test_without_translation_the_predicate_is_the_question(tray: Task) -> None:
    questions = Untranslated((TRAY / "domain.pddl").read_text()).translate(tray)
    assert questions.text == {atom: str(atom) for atom in tray.atoms}
    assert questions.answers == ("true", "false")
    assert (TRAY / "domain.pddl").read_text().strip() in questions.system
    assert questions.system.endswith('"true" or "false" response and nothing else.')


@pytest.mark.parametrize("translator", [Templates({}), Untranslated("")])
def test_each_is_a_translator(translator: object) -> None:
    assert isinstance(translator, Translator)


GOOD = (TRAY / "questions.toml").read_text()
MISTAKES = {
    "not TOML": ("[questions]", "[questions", "is not TOML: "),
    "no table": ("[questions]", "[asked]", "asked: unknown key; valid: objects, questions"),
    "misspelt table": ("[questions]", "[question]", "question: unknown key; did you mean 'questions'? valid: "),
    "no questions": (GOOD, "", "questions: is missing: the table with one question per predicate"),
    "a text for a table": (GOOD, 'questions = "all"', "questions: expected a table, got 'all'"),
    "missing predicate": ('hand-free = "Is', '# "Is', 'questions.hand-free: is missing: write hand-free = "Is ...?"'),
    "missing predicate with parameters": (
        'resting-on = "Is',
        '# "Is',
        'questions.resting-on: is missing: write resting-on = "Is ... {cube} ... {support} ...?"',
    ),
    "unknown predicate": (
        "hand-free =",
        "hand-fre =",
        "questions.hand-fre: there is no predicate 'hand-fre' in the PDDL; did you mean 'hand-free'? valid: ",
    ),
    "missing placeholder": (
        "the {cube}?",
        "a cube?",
        "questions.holding: {cube} is missing: every cube would be asked the same",
    ),
    "unknown placeholder": (
        "{cube}",
        "{cub}",
        "questions.holding: unknown placeholder {cub}; did you mean 'cube'? valid: 1, cube",
    ),
    "position from zero": ("{1} resting", "{0} resting", "questions.resting-on: unknown placeholder {0}; valid: 1, 2,"),
    "placeholder of none": ("hand free", "{hand} free", "unknown placeholder {hand}; hand-free has no parameters"),
    "empty placeholder": ("{cube}", "{}", "questions.holding: {} names no parameter: write {1} for the first one"),
    "attribute": ("{cube}", "{cube.__class__}", "unknown placeholder {cube.__class__}; "),
    "format": ("{cube}", "{cube:>9}", "questions.holding: {cube} is a placeholder without ':' and '!'"),
    "conversion": ("{cube}", "{cube!r}", "questions.holding: {cube} is a placeholder without ':' and '!'"),
    "brace": ("{cube}", "{cube", "questions.holding: its braces do not match (expected '}' before end of string)"),
    "no question mark": ("hand free?", "hand free.", "does not end with a question mark"),
    "a number": ('"Is the robot\'s hand free?"', "7", "questions.hand-free: expected a text, got 7"),
    "empty": ('"Is the robot\'s hand free?"', '" "', "questions.hand-free: is empty"),
    "two lines": ("hand free", "hand\\nfree", "questions.hand-free: expected one line of printable text"),
    "endless": ("hand free", "hand free" * 40, "characters, and may have 300"),
    "the same question twice": (
        "robot's hand free",
        "robot's hand holding the red cube",
        'questions.hand-free: "Is the robot\'s hand holding the red cube?" would ask for both holding(red-cube) and '
        "hand-free()",
    ),
    "the same name twice": (
        'hand free?"',
        'hand free?"\n[objects]\nbench = "tray"',
        "objects.bench: tray and bench are both called 'tray'",
    ),
    "a name that is no text": ('hand free?"', 'hand free?"\n[objects]\nbench = 1', "objects.bench: expected a text"),
}


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_with_file_and_key(tray: Task, tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    file = tmp_path / "questions.toml"
    file.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(DomainError) as caught:
        load_questions(file, tray)
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{file}: ")
    assert words in message


def test_what_is_no_file_of_text_is_refused(tray: Task, tmp_path: Path) -> None:
    file = tmp_path / "questions.toml"
    for words, content in [
        ("there is no such file", None),
        ("is not UTF-8 text", b"\xff\xfe"),
        ("has more than 1,000,000 bytes", b"#" * (LARGEST + 1)),
        ("nested too deep", b"a = " + b"[" * 5000),
    ]:
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(DomainError, match=words):
            load_questions(file, tray)
    with pytest.raises(DomainError, match="cannot be read"):
        load_questions(tmp_path, tray)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_damage_is_answered_in_one_line_or_does_no_harm(tray: Task, tmp_path: Path, data: st.DataObject) -> None:
    text = bytearray(GOOD.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 12)))
        text[start:end] = data.draw(st.binary(max_size=4) | st.sampled_from([b"{", b"}", b'"', b"{1}", b"\n", b"[a]"]))
    file = tmp_path / "questions.toml"
    file.write_bytes(bytes(text))
    said, questions = "", None
    try:
        questions = load_questions(file, tray)
    except DomainError as error:
        said = str(error)
    if questions is None:
        assert said.startswith(f"{file}: ")
        assert said.isprintable()
    else:
        assert questions.text.keys() == set(tray.atoms)
        assert distinct(questions)


def test_a_name_for_an_object_that_is_not_there_is_a_warning_where_it_looks_like_a_slip(tray: Task) -> None:
    templates = Templates(generic(tray).predicates, {"red-cubes": "red dice", "spoon": "spoon"})
    (warning,) = templates.translate(tray).warnings
    assert warning == "questions: objects.red-cubes: the problem has no such object; did you mean 'red-cube'?"


@pytest.mark.parametrize(
    ("content", "words"),
    [(b" \n", "is empty"), (b"a\x1b[2Jb", "has control characters"), (b"\xff", "is not UTF-8"), (None, "no such file")],
)
def test_a_mistake_in_instructions_is_named(tmp_path: Path, content: bytes | None, words: str) -> None:
    file = tmp_path / "instructions.md"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(DomainError, match=words):
        load_instructions(file)


@pytest.mark.parametrize("translate", [lambda task: generic(task).translate(task), Untranslated("").translate])
def test_numeric_fluents_are_named_as_not_estimated(tray: Task, translate: Callable[[Task], Questions]) -> None:
    questions = translate(replace(tray, numeric=("weight", "total-cost")))
    assert questions.warnings == (
        "weight: a numeric fluent, which is not estimated",
        "total-cost: a numeric fluent, which is not estimated",
    )
    assert questions.text.keys() == set(tray.atoms)
