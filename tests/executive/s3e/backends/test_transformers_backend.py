"""The transformers backend on tiny checkpoints of real families: sharing pictures changes no answer."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image as Picture

from executive.s3e.backends import prefix_cache
from executive.s3e.backends.interface import LEAST_MASS, TRUE_FALSE, YES_NO, Answer, Backend, Look, Numerals
from executive.s3e.backends.transformers_backend import TransformersBackend
from tests.executive.s3e.checkpoints import FAMILIES, FORGETTING, OTHERS, build
from tests.executive.s3e.looking import QUESTIONS, SYSTEM, Pick, apart, numbers, pictures

pytestmark = pytest.mark.usefixtures("one_thread")

ALL = (*FAMILIES, *FORGETTING)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("family", ALL)
def test_sharing_changes_no_answer(backend: Pick, family: str, count: int) -> None:
    shown = pictures(count)
    shared = backend(family).look(shown, SYSTEM)
    alone = backend(family, "one by one").look(shown, SYSTEM)
    assert (shared.path, alone.path) == ("shared", "one by one")
    answers = shared.ask(QUESTIONS)
    assert apart(answers, alone.ask(QUESTIONS)) < 1e-5
    # ... and the comparison says something: question, pictures and system prompt all matter to the answer.
    assert np.ptp([answer.probability() for answer in answers]) > 1e-2
    for other in (backend(family).look(pictures(count, seed=1), SYSTEM), backend(family).look(shown, SYSTEM[:-20])):
        moved = [np.abs(numbers(a) - numbers(b)).max() for a, b in zip(answers, other.ask(QUESTIONS), strict=True)]
        assert min(moved) > 1e-4


@pytest.mark.parametrize("family", OTHERS)
def test_other_families_answer_as_a_plain_pass_does(
    backend: Pick, checkpoint: Callable[[str], Path], family: str
) -> None:
    """The processor that transformers would make and a whole forward pass for each question."""
    import torch

    model = backend(family)
    look = model.look(pictures(1), SYSTEM)
    assert look.path == ("shared" if family == "internvl" else "one by one")
    answers = look.ask(QUESTIONS)
    ids = model._tokens[YES_NO]
    for answer in answers:
        assert answer.error == ""
        made = model._processor(text=[answer.prompt], images=[[Picture.fromarray(pictures(1)[0])]], return_tensors="pt")
        with torch.no_grad():
            logits = model._model(**{name: made[name] for name in made if name != "labels"}).logits[0, -1].double()
        told = [logits.softmax(-1)[list(each)].sum().item() for each in ids]
        assert (answer.yes_mass, answer.no_mass) == pytest.approx(told, abs=1e-5)
    assert np.ptp([answer.probability() for answer in answers]) > 1e-2


def test_what_a_model_would_rather_say_is_told(backend: Pick) -> None:
    for answer in backend("fastvlm").look(pictures(1), SYSTEM).ask(QUESTIONS):
        little = answer.yes_mass + answer.no_mass < LEAST_MASS
        assert (re.fullmatch(r"['\"].*['\"] \(\d+%\)", answer.said) is not None) == little


@cache
def asked_alone(model: TransformersBackend) -> list[Answer]:
    """Each question in a look of its own."""
    return [answer for question in QUESTIONS for answer in model.look(pictures(1), SYSTEM).ask([question])]


@pytest.mark.parametrize("family", ALL)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_an_answer_depends_on_no_other_question(backend: Pick, family: str, data: st.DataObject) -> None:
    """Any questions, in any order, repeated, in any batches over one look: each gets the answer that it gets alone."""
    model = backend(family)
    alone = asked_alone(model)
    order = data.draw(st.lists(st.sampled_from(range(len(QUESTIONS))), max_size=20))
    cuts = sorted(data.draw(st.sets(st.integers(0, len(order)), max_size=3)))
    look = model.look(pictures(1), SYSTEM)
    batches = [order[start:end] for start, end in zip([0, *cuts], [*cuts, len(order)], strict=True)]
    answers = [answer for batch in batches for answer in look.ask([QUESTIONS[index] for index in batch])]
    assert len(answers) == len(order)
    assert not order or apart(answers, [alone[index] for index in order]) < 1e-5


@pytest.mark.parametrize("family", ALL)
def test_looks_do_not_disturb_each_other(backend: Pick, family: str) -> None:
    """Some models remember their last pictures' layout (Qwen's `rope_deltas`)."""
    model = backend(family)
    alone = [model.look(pictures(count, count), SYSTEM).ask(QUESTIONS) for count in (1, 2)]
    looks = [model.look(pictures(count, count), SYSTEM) for count in (1, 2)]
    for _ in range(2):
        for look, expected in zip(looks, alone, strict=True):
            assert apart(look.ask(QUESTIONS), expected) < 1e-5


def test_many_questions_go_through_in_groups(backend: Pick, monkeypatch: pytest.MonkeyPatch) -> None:
    questions = [f"Is the lemon on table {number}?" for number in range(100)]
    look = backend("llava-onevision").look(pictures(1), SYSTEM)
    together = look.ask(questions)
    sizes: list[int] = []
    run = prefix_cache.Prefix._row

    def counted(self: prefix_cache.Prefix, group: Sequence[prefix_cache.Suffix]) -> Any:
        sizes.append(sum(len(suffix.tokens) for suffix in group))
        return run(self, group)

    monkeypatch.setattr(prefix_cache.Prefix, "_row", counted)
    assert apart(look.ask(questions), together) == 0.0, "the same questions twice"
    assert len(sizes) > 1
    assert max(sizes) <= prefix_cache.AT_ONCE


@pytest.mark.parametrize("family", ALL)
def test_the_same_again_to_the_last_bit(backend: Pick, family: str) -> None:
    one, another = (backend(family).look(pictures(2), SYSTEM).ask(QUESTIONS) for _ in range(2))
    assert one == another


@pytest.mark.parametrize("family", ALL)
def test_the_order_of_pictures_matters(backend: Pick, family: str) -> None:
    shown = pictures(2)
    one, another = (backend(family).look(order, SYSTEM).ask(QUESTIONS[:3]) for order in (shown, shown[::-1]))
    assert apart(one, another) > 1e-4


def test_pictures_taken_in_parts(tmp_path: Path) -> None:
    """SmolVLM with image splitting: more rows and columns of parts in a picture that is wider."""
    folder = build("smolvlm", tmp_path, splitting=True)
    shown = [*pictures(1, 0, 60, 200), *pictures(1, 1, 90, 60)]
    shared, alone = TransformersBackend(folder), TransformersBackend(folder, path="one by one")
    look = shared.look(shown, SYSTEM)
    assert look.path == "shared"
    assert apart(look.ask(QUESTIONS), alone.look(shown, SYSTEM).ask(QUESTIONS)) < 1e-5


def test_sixteen_bits(backend: Pick) -> None:
    exact = backend("smolvlm").look(pictures(1), SYSTEM).ask(QUESTIONS)
    coarse = backend("smolvlm", "auto", "bfloat16").look(pictures(1), SYSTEM)
    assert coarse.path == "shared"
    assert 1e-6 < apart(coarse.ask(QUESTIONS), exact) < 0.1


def test_other_answers(backend: Pick) -> None:
    """Asked for true and false (Appendix B), the same distribution is summed over other tokens."""
    model = backend("smolvlm")
    yes, true = model.look(pictures(1), SYSTEM), model.look(pictures(1), SYSTEM, TRUE_FALSE)
    pairs = list(zip(yes.ask(QUESTIONS), true.ask(QUESTIONS), strict=True))
    assert all(a.prompt == b.prompt for a, b in pairs)
    assert all(a.yes_mass + a.no_mass + b.yes_mass + b.no_mass <= 1 + 1e-6 for a, b in pairs)
    assert any(abs(a.yes_mass - b.yes_mass) > 1e-3 for a, b in pairs)


def test_it_is_a_backend(backend: Pick) -> None:
    model = backend("fastvlm")
    look = model.look(pictures(1), SYSTEM)
    assert isinstance(model, Backend)
    assert isinstance(look, Look)
    assert model.name == "fastvlm"
    assert look.ask([]) == []


# --- what it loads ----------------------------------------------------------------------------------------------------


def test_nothing_heavy_is_imported_before_a_checkpoint_is_loaded() -> None:
    script = (
        "import sys, executive.s3e.backends.transformers_backend as vlm\n"
        "heavy = {'torch', 'transformers', 'PIL', 'safetensors', 'tokenizers', 'huggingface_hub'}\n"
        "assert heavy.isdisjoint(sys.modules), heavy & sys.modules.keys()\n"
        "try: vlm.TransformersBackend('/nowhere/at/all')\n"
        "except vlm.InputError: pass\n"
        "assert heavy.isdisjoint(sys.modules), heavy & sys.modules.keys()\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


@pytest.mark.parametrize("family", ALL)
def test_neither_network_nor_torchvision(
    checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, family: str
) -> None:
    def refused(*_: Any, **__: Any) -> Any:
        raise AssertionError("a connection was opened")

    folder = checkpoint(family)
    monkeypatch.setattr(socket.socket, "connect", refused)
    monkeypatch.setattr(socket, "getaddrinfo", refused)
    TransformersBackend(folder).look(pictures(1), SYSTEM).ask(QUESTIONS)
    assert "torchvision" not in sys.modules


def test_a_number_has_the_mass_of_its_tokens(backend: Pick) -> None:
    import torch

    model = backend("fastvlm")
    numerals = Numerals(9)
    (answer,) = model.look_for_numbers(pictures(1), SYSTEM, numerals).ask(["How many are there?"])
    made = model._processor(text=[answer.prompt], images=[[Picture.fromarray(pictures(1)[0])]], return_tensors="pt")
    with torch.no_grad():
        logits = model._model(**{name: made[name] for name in made if name != "labels"}).logits[0, -1].double()
    tokens = model._tokens[numerals]
    assert answer.masses == pytest.approx([logits.softmax(-1)[list(each)].sum().item() for each in tokens], abs=1e-5)
    assert answer.yes_mass == pytest.approx(sum(answer.masses))
    decode = model._processor.tokenizer.decode
    for each, forms in zip(tokens, numerals.forms(), strict=True):
        assert {decode([token]) for token in each} <= set(forms)
    assert any(tokens)
