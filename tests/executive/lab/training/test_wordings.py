"""Wordings are drawn from patterns; what is wrong with a file is said with its key."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.domain import scaffold
from executive.domain.loader import load_domain, load_subject
from executive.errors import DomainError
from executive.lab.training.wordings import WORDINGS, Wordings, expand
from executive.s3e import Templates
from executive.sim.spec import read_scene
from tests.executive.sim.stage import ROOT

GROCERY = ROOT / "domains" / "grocery"
SUBJECT = load_subject("grocery")
assert SUBJECT.questions is not None
TEMPLATES = Templates.read(SUBJECT.questions)

words = st.text("abcxyz", min_size=1, max_size=5)


@given(st.lists(st.lists(words, min_size=1, max_size=4), min_size=1, max_size=5), st.integers(0, 2**32))
def test_a_pattern_stands_for_one_part_of_each_group(groups: list[list[str]], seed: int) -> None:
    pattern = " ".join(f"({'|'.join(parts)})" for parts in groups)
    said = expand(pattern, random.Random(seed)).split()
    assert len(said) == len(groups)
    assert all(word in parts for word, parts in zip(said, groups, strict=True))


@given(st.integers(0, 2**32))
def test_groups_nest(seed: int) -> None:
    assert expand("(a (b|c)|d)", random.Random(seed)) in {"a b", "a c", "d"}


@pytest.fixture(scope="module")
def grocery() -> Wordings:
    return Wordings.of(SUBJECT.task, TEMPLATES, GROCERY / WORDINGS)


@given(st.data())
def test_what_is_drawn_names_all_of_the_atoms_arguments(grocery: Wordings, data: st.DataObject) -> None:
    atom = data.draw(st.sampled_from(SUBJECT.task.atoms))
    text, names = grocery.draw(atom, random.Random(data.draw(st.integers(0, 2**32))))
    assert len(names) == len(atom.args)
    for name, argument in zip(names, atom.args, strict=True):
        assert name in grocery.names[argument]
        assert name in text
    assert not set("(|){}") & set(text)


def test_the_words_of_a_run_are_among_those_drawn(grocery: Wordings) -> None:
    atom, rng = SUBJECT.task.atoms[0], random.Random(0)
    drawn = [grocery.draw(atom, rng)[0] for _ in range(500)]
    assert 60 <= drawn.count(grocery.official[atom]) <= 160
    assert len(set(drawn)) > 250


def test_no_two_objects_are_called_the_same(grocery: Wordings) -> None:
    called = [name.casefold() for names in grocery.names.values() for name in names]
    assert len(called) == len(set(called))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[questions", "is not TOML"),
        ("questions = 3", "questions: expected a table"),
        ("[asked]", "asked: unknown key"),
        ("[questions]\non-tabel = ['x']", "questions.on-tabel: unknown key; did you mean 'on-table'"),
        ("[questions]\non-table = 'x'", "questions.on-table: expected a list"),
        ("[questions]\non-table = ['{item} there?']", "does not name {table}"),
        ("[questions]\non-table = ['{item} on {tabel}?']", "names {tabel}"),
        ("[questions]\non-table = ['(a|{item} on {table}?']", "has a bracket"),
        (f"[questions]\non-table = ['{'(a|b)' * 500}']", "questions.on-table: a text has 2,500 characters"),
        ("[objects]\nlemon = ['']", "objects.lemon: expected a list of texts"),
    ],
)
def test_a_mistake_is_named(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / WORDINGS
    file.write_text(text, encoding="utf-8")
    with pytest.raises(DomainError) as told:
        Wordings.of(SUBJECT.task, TEMPLATES, file)
    assert message in str(told.value)
    assert str(file) in str(told.value)


def test_names_of_what_another_task_has_are_passed_over_and_no_others() -> None:
    task = load_domain(GROCERY, "one-item").task
    stage = {*SUBJECT.task.objects}
    assert not stage <= task.objects.keys()
    wordings = Wordings.of(task, TEMPLATES, GROCERY / WORDINGS, stage)
    assert wordings.names.keys() == task.objects.keys()
    with pytest.raises(DomainError, match=r"objects\..*unknown key"):
        Wordings.of(task, TEMPLATES, GROCERY / WORDINGS)


@pytest.mark.parametrize("problem", [None, "one-block"])
def test_those_of_a_new_domain_are_valid_at_once(problem: str | None, tmp_path: Path) -> None:
    folder = scaffold.create("workshop", tmp_path).folder
    domain = load_domain(folder, problem)
    assert domain.subject.questions is not None
    templates = Templates.read(domain.subject.questions)
    stage = read_scene(domain.scene)
    there = {item.name for item in stage.items} | {table.name for table in stage.tables}
    made = Wordings.of(domain.task, templates, folder / WORDINGS, there)
    assert all(len(made.patterns[name]) > 4 for name in ("on", "holding", "hand-empty"))
    names = [name.casefold() for names in made.names.values() for name in names]
    assert len(names) == len(set(names)), "two objects have a name in common"
