"""Other wordings are read, drawn and filled in; those that measure an eye are none that one is trained on."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from executive.domain.loader import load_subject
from executive.errors import DomainError
from executive.lab.evaluation.paraphrases import Paraphrases
from executive.s3e import Templates
from executive.types import Atom
from tests.executive.sim.stage import ROOT

SUBJECT = load_subject("grocery")
TASK = SUBJECT.task
assert SUBJECT.questions is not None
OWN = Templates.read(SUBJECT.questions)
LEMON = Atom("on-table", ("lemon", "wood-table"))

FILE = """
[questions]
on-table = ["Does the {table} carry the {item}?", "Is the {1} on the {2}?", "Has the {table} the {item} on it?"]
robot-gripping = ["Is the {item} held?"]
robot-gripper-empty = ["Is nothing held?", "Is the hand free?"]
[objects]
lemon = ["yellow fruit", "citrus"]
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "other.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_every_atom_has_every_wording_with_every_name(tmp_path: Path) -> None:
    wordings = Paraphrases.read(written(tmp_path, FILE), TASK, OWN).wordings
    assert set(wordings) == set(TASK.atoms)
    assert set(wordings[LEMON]) == {
        text.format(fruit)
        for fruit in ("yellow fruit", "citrus")
        for text in (
            "Does the wooden table carry the {}?",
            "Is the {} on the wooden table?",
            "Has the wooden table the {} on it?",
        )
    }
    assert set(wordings[Atom("robot-gripping", ("soda-can",))]) == {"Is the red can of soda held?"}
    assert set(wordings[Atom("robot-gripper-empty")]) == {"Is nothing held?", "Is the hand free?"}


def test_objects_keep_their_names_when_they_are_to(tmp_path: Path) -> None:
    wordings = Paraphrases.read(written(tmp_path, FILE), TASK, OWN, rename=False).wordings
    assert len(wordings[LEMON]) == 3
    assert all("lemon" in text for text in wordings[LEMON])


def test_what_is_drawn_is_a_wording_of_the_atom_and_all_are_drawn(tmp_path: Path) -> None:
    paraphrases = Paraphrases.read(written(tmp_path, FILE), TASK, OWN)
    rng = np.random.default_rng(0)
    drawn = [paraphrases.drawn(rng) for _ in range(200)]
    for atom, texts in paraphrases.wordings.items():
        assert {each[atom] for each in drawn} == set(texts)
    assert paraphrases.drawn(np.random.default_rng(5)) == paraphrases.drawn(np.random.default_rng(5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("questions = 3", "questions: expected a table"),
        ("[objects]\nlemon = ['x']", "questions: is missing"),
        ("[question]", "question: unknown key; did you mean 'questions'"),
        ("[questions", "is not TOML"),
        (FILE.replace('["Is the {item} held?"]', '"Is the {item} held?"'), "questions.robot-gripping: expected a list"),
        (FILE.replace('["Is the {item} held?"]', "[]"), "questions.robot-gripping: expected a list of texts"),
        (FILE.replace("{item} held?", "{items} held?"), "unknown placeholder {items}; did you mean 'item'"),
        (FILE.replace("Is nothing held?", "Nothing is held."), "does not end with a question mark"),
        (FILE.replace("robot-gripping", "robot-griping"), "did you mean 'robot-gripping'"),
        (FILE.replace('"citrus"', '"red can of soda"'), "lemon and soda-can are both called"),
    ],
)
def test_a_mistake_is_named_with_file_and_key(text: str, message: str, tmp_path: Path) -> None:
    file = written(tmp_path, text)
    with pytest.raises(DomainError) as told:
        Paraphrases.read(file, TASK, OWN)
    assert message in str(told.value)
    assert str(file) in str(told.value)


DOMAINS = pytest.mark.parametrize("domain", ["grocery", "tabletop"])


@DOMAINS
def test_the_held_out_wordings_are_many_and_not_the_domains_own(domain: str) -> None:
    subject = load_subject(domain)
    assert subject.questions is not None
    templates, task = Templates.read(subject.questions), subject.task
    wordings = Paraphrases.read(ROOT / "domains" / domain / "paraphrases.toml", task, templates).wordings
    own = templates.translate(task).text
    for atom in task.atoms:
        assert len(wordings[atom]) >= 8
        assert own[atom] not in wordings[atom]


@DOMAINS
def test_no_held_out_wording_is_trained_on(domain: str) -> None:
    """A group such as (a|b|) of a training template means the same to a regular expression."""
    held_out, trained = held_out_and_trained(domain, "questions")
    assert held_out.keys() == trained.keys()
    said = [
        (text, template)
        for predicate, texts in held_out.items()
        for text in texts
        for template in trained[predicate]
        if re.fullmatch("".join(c if c in "(|)" else re.escape(c) for c in template), text, re.IGNORECASE)
    ]
    assert said == []


@DOMAINS
def test_no_held_out_name_is_trained_on(domain: str) -> None:
    held_out, trained = held_out_and_trained(domain, "objects")
    subject = load_subject(domain)
    assert subject.questions is not None
    own = set(Templates.read(subject.questions).names(subject.task).values())
    said = {name.casefold() for names in trained.values() for name in names} | own
    assert said.isdisjoint(name.casefold() for names in held_out.values() for name in names)


def held_out_and_trained(domain: str, table: str) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    folder = ROOT / "domains" / domain
    files = (folder / "paraphrases.toml", folder / "wordings.toml")
    held_out, trained = (tomllib.loads(file.read_text(encoding="utf-8"))[table] for file in files)
    return held_out, trained
