"""A language model words the questions, and nothing that it writes is taken on trust."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.domain.loader import load_subject
from executive.errors import InputError
from executive.s3e import LanguageModel, Reply, Templates, Translator, Writer
from executive.s3e.questions.checks import Checker
from executive.s3e.questions.prompts import QUESTION_ANSWERING
from executive.types import Atom, Condition, Questions, Task
from tests.executive.s3e.fakes import FakeWriter
from tests.executive.s3e.questions.test_templates import GROCERY, tasks

SUBJECT = load_subject(GROCERY)
DOMAIN = SUBJECT.pddl.read_text()
TEMPLATES = Templates.read(GROCERY / "questions.toml")
TASK = replace(SUBJECT.task, atoms=tuple(atom for atom in SUBJECT.task.atoms if "lemon" in atom.args or not atom.args))
ASKED = TEMPLATES.translate(TASK).text
LEMON, HELD = Atom.parse("on-table(lemon,wood-table)"), Atom.parse("robot-gripping(lemon)")
replies = st.text(max_size=40) | st.sampled_from(
    [
        "Is the lemon on the wood table?",
        "Is the lemon on the black table?",
        "Is the lemon held by the robot?",
        "Is the gripper empty?",
        "on-table(lemon,wood-table) is true.",
    ]
)


def good(prompt: str, attempt: int = 0) -> str:
    """What a language model that knows its trade would say."""
    predicate, _, args = prompt.rstrip(")").partition("(")
    item, _, table = args.replace("-", " ").partition(",")
    return {
        "on-table": f"Is there a {item} on the {table}?",
        "robot-gripping": f"Does the robot grip the {item}?",
        "robot-gripper-empty": "Is the gripper of the robot empty?",
    }[predicate]


def translated(say: Callable[[str, int], str | Reply], **options: object) -> tuple[Questions, FakeWriter]:
    writer = FakeWriter(say)
    return LanguageModel(writer, DOMAIN, TEMPLATES, **options).translate(TASK), writer  # type: ignore[arg-type]


def test_the_model_is_asked_with_the_papers_prompt_and_once_where_it_does_well() -> None:
    questions, writer = translated(good)
    assert questions.text == {atom: good(str(atom)) for atom in TASK.atoms}
    assert (questions.system, questions.translator, questions.warnings) == (QUESTION_ANSWERING, "llm:fake", ())
    ((system, prompts, attempt),) = writer.calls
    assert (sorted(prompts), attempt) == (sorted(map(str, TASK.atoms)), 0)
    assert system.startswith(f"The following is a PDDL domain\n{DOMAIN.strip()}\nHere are the names of all the objects")


def test_parts_are_what_they_claim_to_be() -> None:
    assert isinstance(FakeWriter(good), Writer)
    assert isinstance(LanguageModel(FakeWriter(good), DOMAIN), Translator)


def test_what_is_refused_is_asked_for_again_and_that_alone() -> None:
    questions, writer = translated(lambda p, n: "Yes, it is." if p == str(LEMON) and n < 2 else good(p))
    assert questions.text == {atom: good(str(atom)) for atom in TASK.atoms}
    assert questions.warnings == ()
    assert [call for call in writer.asked if call[1]] == [(str(LEMON), 1), (str(LEMON), 2)]


def test_in_the_end_the_template_is_asked_with_a_warning() -> None:
    questions, writer = translated(lambda p, n: "Yes,\nit is." if p == str(LEMON) else good(p))
    assert questions.text == {**{atom: good(str(atom)) for atom in TASK.atoms}, LEMON: ASKED[LEMON]}
    assert questions.warnings == (
        f"{LEMON}: the model wrote 'Yes, it is.', which is more than one line; asked instead: {ASKED[LEMON]}",
    )
    assert len(writer.asked) == len(TASK.atoms) + 2


def test_without_templates_a_generic_question_is_asked() -> None:
    questions = LanguageModel(FakeWriter(lambda prompt, attempt: "hm"), DOMAIN).translate(TASK)
    assert questions.text[LEMON] == 'Is "on table" true of the lemon and the wood table?'
    assert len(questions.warnings) == len(TASK.atoms)


def test_the_same_question_for_two_atoms_is_taken_for_neither() -> None:
    other = Atom.parse("on-table(lemon,black-table)")
    task = replace(TASK, parameters={}, atoms=(HELD, Atom("robot-smelling", ("lemon",)), LEMON, other))
    twice = {str(HELD): "Has the robot the lemon?", "robot-smelling(lemon)": "has the  robot the lemon?"}
    writer = FakeWriter(lambda prompt, attempt: twice.get(prompt) or good(prompt))
    questions = LanguageModel(writer, DOMAIN).translate(task)
    assert [atom for atom in task.atoms if questions.text[atom].startswith('Is "')] == [HELD, task.atoms[1]]
    assert all("which is asked for another atom, too" in warning for warning in questions.warnings)


def test_a_question_that_a_template_asks_for_another_atom_is_not_taken() -> None:
    """One atom falls back on its template, and what that asks is what the model asked for the other one."""
    task = replace(TASK, parameters={}, atoms=(HELD, Atom("robot-near", ("lemon",))))
    templates = Templates(
        {"robot-gripping": "Does the robot have the {1}?", "robot-near": "Is the robot near the {1}?"}
    )
    say = {str(HELD): "no idea", "robot-near(lemon)": "Does the robot have the lemon?"}
    questions = LanguageModel(FakeWriter(lambda p, n: say[p]), DOMAIN, templates).translate(task)
    assert questions.text == templates.translate(task).text
    assert len(questions.warnings) == 2


@given(task=tasks(), seed=st.integers(0, 99), said=st.lists(replies, min_size=1, max_size=5))
def test_whatever_the_model_says_every_atom_is_asked_about_in_its_own_words(
    task: Task, seed: int, said: list[str]
) -> None:
    """And the order in which the atoms are listed makes no difference."""

    def say(prompt: str, attempt: int) -> str:
        return Random(f"{prompt}{attempt}{seed}").choice(said)

    questions = LanguageModel(FakeWriter(say), DOMAIN).translate(task)
    folded = [" ".join(text.casefold().split()) for text in questions.text.values()]
    assert questions.text.keys() == set(task.atoms)
    assert len(set(folded)) == len(folded)
    assert all(warning.isprintable() for warning in questions.warnings)
    backwards = replace(task, atoms=task.atoms[::-1])
    again = LanguageModel(FakeWriter(say), DOMAIN).translate(backwards)
    assert again.text == questions.text
    assert sorted(again.warnings) == sorted(questions.warnings)


@given(st.dictionaries(st.sampled_from(TASK.atoms), st.lists(replies, min_size=3, max_size=3)))
def test_what_is_taken_from_the_model_has_passed_the_check(said: dict[Atom, list[str]]) -> None:
    checker = Checker(TASK.objects, TEMPLATES.names(TASK))
    questions, _ = translated(lambda p, n: said[Atom.parse(p)][n] if Atom.parse(p) in said else good(p))
    for atom, text in questions.text.items():
        assert text == ASKED[atom] or checker.fault(atom, text) == ""


def test_a_model_that_cannot_be_asked_is_an_error() -> None:
    with pytest.raises(InputError, match="fake: cannot word any question: no server answers"):
        translated(lambda prompt, attempt: Reply(error="no server answers"))


def test_a_reply_that_is_lost_now_and_then_is_made_up_for() -> None:
    def say(prompt: str, attempt: int) -> str | Reply:
        return (
            Reply(error="it broke off")
            if prompt == str(HELD) or (attempt == 0 and prompt == str(LEMON))
            else good(prompt)
        )

    questions, _ = translated(say)
    assert questions.text == {**{atom: good(str(atom)) for atom in TASK.atoms}, HELD: ASKED[HELD]}
    assert questions.warnings == (f"{HELD}: the model wrote nothing: it broke off; asked instead: {ASKED[HELD]}",)


# The cache.


def sloppy(prompt: str, attempt: int) -> str:
    return "Yes." if prompt == str(LEMON) else "hm" if prompt == str(HELD) and attempt == 0 else good(prompt)


def test_the_model_is_asked_once_for_a_domain_and_its_objects(tmp_path: Path) -> None:
    first, writer = translated(sloppy, cache=tmp_path / "kept")
    again, silent = translated(lambda p, n: "nothing of the kind", cache=tmp_path / "kept")
    assert again == first
    assert writer.asked
    assert silent.calls == []
    another_goal = replace(TASK, problem="another", goal=Condition.literal(LEMON))
    questions = LanguageModel(silent, DOMAIN, TEMPLATES, tmp_path / "kept").translate(another_goal)
    assert (questions, silent.calls) == (first, [])


def test_the_file_can_be_read_by_a_person_and_edited(tmp_path: Path) -> None:
    translated(sloppy, cache=tmp_path)
    (file,) = tmp_path.iterdir()
    data = json.loads(file.read_text())
    assert file.name.startswith("grocery-")
    assert (data["domain"], data["model"], data["objects"]) == ("grocery", "fake", dict(TASK.objects))
    assert data["system_prompt"][0] == "The following is a PDDL domain"
    assert data["replies"][str(LEMON)] == ["Yes.", "Yes.", "Yes."]
    data["replies"][str(LEMON)] = ["Is a lemon upon the wooden table?"]
    file.write_text(json.dumps(data))
    edited, silent = translated(sloppy, cache=tmp_path)
    assert edited.text[LEMON] == "Is a lemon upon the wooden table?"
    assert (edited.warnings, silent.calls) == ((), [])


@pytest.mark.parametrize(
    "change",
    [
        lambda model: replace(model, writer=replace(model.writer, name="other")),
        lambda model: replace(model, domain=DOMAIN + "; a comment"),
    ],
)
def test_another_model_or_domain_is_asked_anew(
    tmp_path: Path, change: Callable[[LanguageModel], LanguageModel]
) -> None:
    model = LanguageModel(FakeWriter(good), DOMAIN, TEMPLATES, tmp_path)
    model.translate(TASK)
    changed = change(model)
    changed.translate(TASK)
    assert isinstance(changed.writer, FakeWriter)
    assert changed.writer.asked
    assert len(list(tmp_path.iterdir())) == 2


def test_other_objects_are_asked_about_anew(tmp_path: Path) -> None:
    model = LanguageModel(FakeWriter(good), DOMAIN, TEMPLATES, tmp_path)
    model.translate(TASK)
    fewer = {name: kind for name, kind in TASK.objects.items() if name != "milk-carton"}
    model.translate(replace(TASK, objects=fewer))
    assert len(list(tmp_path.iterdir())) == 2


def test_more_atoms_of_the_same_problem_are_added(tmp_path: Path) -> None:
    some = replace(TASK, atoms=TASK.atoms[:2])
    model = LanguageModel(FakeWriter(good), DOMAIN, TEMPLATES, tmp_path)
    model.translate(some)
    questions, writer = translated(good, cache=tmp_path)
    assert questions.text.keys() == set(TASK.atoms)
    assert {prompt for prompt, _ in writer.asked} == {str(atom) for atom in TASK.atoms[2:]}


@given(st.dictionaries(st.sampled_from(TASK.atoms), st.lists(replies, min_size=3, max_size=3)))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_kept_is_what_was_written(tmp_path: Path, said: dict[Atom, list[str]]) -> None:
    folder = tmp_path / str(len(list(tmp_path.iterdir())))

    def say(prompt: str, attempt: int) -> str:
        return said[Atom.parse(prompt)][attempt] if Atom.parse(prompt) in said else good(prompt)

    first, _ = translated(say, cache=folder)
    again, silent = translated(say, cache=folder)
    assert (again, silent.calls) == (first, [])


DAMAGE = {
    "empty": b"",
    "cut off": b'{"replies": {"on-table(lemon,',
    "not text": b"\xff\xfe\x00",
    "no object": b"[1, 2]",
    "no replies": b"{}",
    "no lists": b'{"replies": {"on-table(lemon,wood-table)": "Is it?"}}',
    "no texts": b'{"replies": {"on-table(lemon,wood-table)": [1]}}',
    "no atoms": b'{"replies": {"on table?": ["Is it?"]}}',
    "too deep": b'{"replies": ' + b"[" * 100_000,
}


@pytest.mark.parametrize("content", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_put_aside_with_a_warning_and_mended(tmp_path: Path, content: bytes) -> None:
    first, _ = translated(good, cache=tmp_path)
    (file,) = tmp_path.iterdir()
    file.write_bytes(content)
    questions, writer = translated(good, cache=tmp_path)
    (warning,) = questions.warnings
    assert warning.startswith(f"{file}: no replies of a model can be read from it (")
    assert warning.isprintable()
    assert (questions.text, len(writer.asked)) == (first.text, len(TASK.atoms))
    assert translated(good, cache=tmp_path)[0] == first


def test_a_domain_may_have_a_long_name(tmp_path: Path) -> None:
    task = replace(TASK, name="a" * 5_000)
    for asked in (True, False):
        writer = FakeWriter(good)
        questions = LanguageModel(writer, DOMAIN, TEMPLATES, cache=tmp_path).translate(task)
        assert (questions.warnings, bool(writer.calls)) == ((), asked)


def test_a_folder_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("a file")
    questions, _ = translated(good, cache=tmp_path / "kept")
    (warning,) = questions.warnings
    assert "the model's replies cannot be kept (" in warning
    assert questions.text == {atom: good(str(atom)) for atom in TASK.atoms}


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    translated(lambda p, n: good(p), cache=tmp_path)
    (file,) = tmp_path.iterdir()
    before = file.read_bytes()
    (tmp_path / file.name).write_bytes(before.replace(b"Does the robot grip the lemon?", b"Does the robot?"))
    damaged = file.read_bytes()

    def full(source: object, target: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    questions, _ = translated(good, cache=tmp_path)
    assert "No space left on device" in questions.warnings[0]
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert file.read_bytes() == damaged


def test_replies_are_kept_where_the_model_breaks_down_in_between(tmp_path: Path) -> None:
    def say(prompt: str, attempt: int) -> str:
        if attempt:
            raise KeyboardInterrupt
        return sloppy(prompt, attempt)

    with pytest.raises(KeyboardInterrupt):
        translated(say, cache=tmp_path)
    _, writer = translated(good, cache=tmp_path)
    assert all(attempt > 0 for _, attempt in writer.asked)
