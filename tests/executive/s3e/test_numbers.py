"""S3E asks for a number once, and what the model's next token puts on the numerals is the fluent's distribution."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from executive.domain.loader import load_domain, load_subject
from executive.errors import DomainError
from executive.s3e import S3E, YES_NO, Answer, AnswerWords, Templates, generic, instruct, observe
from executive.s3e.backends.answer_tokens import numeral_tokens
from executive.s3e.backends.interface import Numerals
from executive.s3e.backends.openai_backend import hear
from executive.types import Atom, Image, Task
from tests.executive.s3e.fakes import FakeBackend
from tests.executive.symbolic import crates

QUESTIONS = {"loose": "Is the {i} loose?", "in": "Is the {i} in the {c}?", "count": "How many items are in the {c}?"}
LOOK = observe({"front": np.zeros((4, 4, 3), np.uint8)})


@dataclass
class Counter:
    """A backend that says yes to every question, and how many there are by `masses`."""

    masses: tuple[float, ...]
    name: str = "counter"
    asked: list[tuple[str, str, int]] = field(default_factory=list)

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> Counting:
        return Counting(self, system, 0)

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> Counting:
        return Counting(self, system, numerals.most)


@dataclass
class Counting:
    counter: Counter
    system: str
    most: int

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        self.counter.asked += [(question, self.system, self.most) for question in questions]
        if not self.most:
            return [Answer(question, 0.9, 0.1) for question in questions]
        masses = self.counter.masses
        return [Answer(question, sum(masses), 0.0, masses=masses) for question in questions]


@pytest.fixture
def task(tmp_path: Path) -> Task:
    domain, problem = crates.write(tmp_path)
    return load_domain(domain, str(problem)).task


def questions() -> Templates:
    return Templates(QUESTIONS)


def test_all_values_of_a_fluent_have_one_question_whose_answer_is_their_distribution(task: Task) -> None:
    masses = (0.0, 0.0, 0.1, 0.6, 0.1, *(0.0,) * 5)
    counter = Counter(masses)
    belief = S3E(counter, questions().translate(task)).estimate(LOOK, task.atoms)
    numbers = [(asked, most) for asked, _, most in counter.asked if most]
    assert numbers == [("How many items are in the k?", 9)]
    (fluent,) = task.fluents
    assert belief.probability[fluent.values[3][1]] == pytest.approx(0.75)
    assert fluent.most_probable(belief.probability) == 3
    assert fluent.mean(belief.probability) == pytest.approx(3.0)
    assert belief.probability[Atom("loose", ("a",))] == pytest.approx(0.9)
    evidence = belief.evidence[fluent.values[3][1]][0]
    assert (evidence.yes_mass, evidence.no_mass) == pytest.approx((0.6, 0.2))


def test_a_number_without_enough_mass_is_unanswered_and_so_is_one_that_nobody_can_be_asked_for(task: Task) -> None:
    values = {atom for _, atom in task.fluents[0].values}
    asked = questions().translate(task)
    unsure = S3E(Counter((0.2, 0.2, *(0.0,) * 8)), asked).estimate(LOOK, task.atoms)
    assert unsure.unanswered == values
    plain = S3E(FakeBackend(lambda question, images: (1.0, 0.0)), asked).estimate(LOOK, task.atoms)
    assert plain.unanswered == values
    assert "numbers" in plain.evidence[min(values)][0].error
    assert len(plain.probability) == len(task.atoms) - len(values)


def test_numbers_have_a_system_prompt_of_their_own_with_the_same_instructions(task: Task) -> None:
    asked = instruct(questions().translate(task), "The crate is blue.")
    counter = Counter((1.0, *(0.0,) * 9))
    S3E(counter, asked).estimate(LOOK, task.atoms)
    systems = {most: system for _, system, most in counter.asked}
    assert systems[0] != systems[9]
    assert all(system.endswith("The crate is blue.") for system in systems.values())


def test_a_template_for_a_number_names_its_objects_and_not_the_number(task: Task) -> None:
    for wrong in ("How many items?", "How many of {number} are in the {c}?"):
        with pytest.raises(DomainError, match=r"questions\.count"):
            replace(questions(), predicates={**questions().predicates, "count": wrong}).translate(task)
    text = generic(task).translate(task).text
    assert len({text[atom] for _, atom in task.fluents[0].values}) == 1


def test_numbers_with_a_question_are_estimated_where_nothing_is_planned(tmp_path: Path) -> None:
    domain, problem = crates.write(tmp_path)
    domain.rename(tmp_path / "domain.pddl")
    problem.rename(tmp_path / "problem.pddl")
    assert load_subject(tmp_path).task.numeric == ("count",)
    lines = [f'{name} = "{text}"' for name, text in questions().predicates.items()]
    (tmp_path / "questions.toml").write_text("\n".join(["[questions]", *lines]))
    task = load_subject(tmp_path).task
    assert (task.numeric, [str(fluent) for fluent in task.fluents]) == ((), ["count(k)"])


class Tokenizer:
    """Has these tokens, and spells everything else letter by letter."""

    def __init__(self, *tokens: str) -> None:
        self._tokens = tokens
        self.all_special_ids: list[int] = []

    def get_vocab(self) -> dict[str, int]:
        return {token: number for number, token in enumerate(self._tokens)}

    def decode(self, ids: Sequence[int], **_: object) -> str:
        return "".join(self._tokens[number] for number in ids)

    def encode(self, text: str, **_: object) -> list[int]:
        if text in self._tokens:
            return [self._tokens.index(text)]
        return [self._tokens.index(letter) for letter in text if letter in self._tokens]


def test_the_beginning_of_a_longer_number_is_no_number() -> None:
    whole = Tokenizer("0", "1", " 1", "2", "one", "12", "x")
    assert numeral_tokens(whole, Numerals(2), 7) == ((0,), (1, 2, 4), (3,))
    digits = Tokenizer(*"0123456789")
    tokens = numeral_tokens(digits, Numerals(12), 10)
    assert tokens[1] == (), "it may go on as 10, 11 or 12"
    assert tokens[2] == (2,)
    assert tokens[12] == ()


def test_a_server_s_listed_tokens_are_summed_by_number() -> None:
    listed = [(" 3", 0.5), ("three", 0.2), ("4", 0.2), ("many", 0.1)]
    top = [{"token": token, "logprob": float(np.log(mass))} for token, mass in listed]
    reply = {"choices": [{"logprobs": {"content": [{**top[0], "top_logprobs": top}]}}]}
    heard = hear(reply, Numerals(9))
    assert heard.masses[3:5] == pytest.approx((0.7, 0.2))
    assert sum(heard.masses) == pytest.approx(0.9)
    assert re.search("3", heard.said)
