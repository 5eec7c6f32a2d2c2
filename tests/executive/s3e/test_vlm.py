"""The transformers backend on tiny checkpoints of real families: sharing pictures changes no answer."""

from __future__ import annotations

import gc
import logging
import socket
import subprocess
import sys
import weakref
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.errors import InputError
from executive.s3e import prefix
from executive.s3e.backend import TRUE_FALSE, Answer, Backend, Look
from executive.s3e.vlm import TransformersBackend
from executive.types import Image
from tests.executive.s3e.checkpoints import FAMILIES, build

pytestmark = pytest.mark.usefixtures("one_thread")

Pick = Callable[..., TransformersBackend]

SYSTEM = "The assistant answers with one of three responses: YES or NO."
QUESTIONS = (
    *(f"Is the {item} on the {table} table?" for item in ("lemon", "soda can") for table in ("black", "white")),
    "Is the gripper of the robot empty?",
    "Are the cereal box and the water bottle, which were on the wooden table a moment ago, now on the floor?",
    "Empty?",
    "",
    " Is it?",
    "\nIs it?\n",
    "Is the Zitrone \u00fcber dem Tisch? \U0001f34b",
)


@pytest.fixture(scope="session")
def backend(checkpoint: Callable[[str], Path]) -> Pick:
    """A backend of a family, loaded once for each way of asking."""

    @cache
    def loaded(family: str, path: Any = "auto", dtype: str = "auto") -> TransformersBackend:
        return TransformersBackend(checkpoint(family), path=path, dtype=dtype)

    return loaded


def pictures(count: int, seed: int = 0, height: int = 60, width: int = 90) -> list[Image]:
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def apart(some: Sequence[Answer], others: Sequence[Answer]) -> float:
    """How far two sets of answers are apart in yes mass, no mass and P(true), at most."""
    assert [answer.prompt for answer in some] == [answer.prompt for answer in others]
    assert not any(answer.error for answer in (*some, *others))
    return max(float(np.abs(numbers(a) - numbers(b)).max()) for a, b in zip(some, others, strict=True))


def numbers(answer: Answer) -> np.ndarray[Any, Any]:
    return np.array([answer.yes_mass, answer.no_mass, answer.probability()], dtype=float)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("family", FAMILIES)
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


@cache
def asked_alone(model: TransformersBackend) -> list[Answer]:
    """Each question in a look of its own."""
    return [answer for question in QUESTIONS for answer in model.look(pictures(1), SYSTEM).ask([question])]


@pytest.mark.parametrize("family", FAMILIES)
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


@pytest.mark.parametrize("family", FAMILIES)
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
    run = prefix.Prefix._run

    def counted(self: prefix.Prefix, group: Sequence[prefix.Suffix]) -> Any:
        sizes.append(sum(len(suffix.tokens) for suffix in group))
        return run(self, group)

    monkeypatch.setattr(prefix.Prefix, "_run", counted)
    assert apart(look.ask(questions), together) == 0.0, "the same questions twice"
    assert len(sizes) > 1
    assert max(sizes) <= prefix.AT_ONCE


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_again_to_the_last_bit(backend: Pick, family: str) -> None:
    one, another = (backend(family).look(pictures(2), SYSTEM).ask(QUESTIONS) for _ in range(2))
    assert one == another


@pytest.mark.parametrize("family", FAMILIES)
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


# --- what is asked ----------------------------------------------------------------------------------------------------


def test_the_prompt_is_told_as_rendered(backend: Pick) -> None:
    (answer,) = backend("qwen2.5-vl").look(pictures(2), SYSTEM).ask(["Is it dark?"])
    picture = "<|vision_start|><image><|vision_end|>"
    assert answer.prompt == (
        f"<|im_start|>system\n{SYSTEM}<|im_end|>\n<|im_start|>user\n{picture}{picture}Is it dark?<|im_end|>\n"
        "<|im_start|>assistant\n"
    )


def test_no_system_prompt_is_no_system_turn(backend: Pick) -> None:
    (answer,) = backend("smolvlm").look(pictures(1), "").ask(["Is it dark?"])
    assert answer.prompt.startswith("<|im_start|>user\n<image>Is it dark?")


USER = "{% for part in message['content'] %}{{ part['text'] if part['type'] == 'text' else '<image>' }}{% endfor %}"
TEMPLATES = {
    "refuses the system role": (
        "{% for message in messages %}{% if message['role'] == 'system' %}{{ raise_exception('no system role') }}"
        "{% endif %}USER: " + USER + " ASSISTANT:{% endfor %}",
        "USER: <image>SYS\n\nQ? ASSISTANT:",
    ),
    "leaves the system role out": (
        "{% for message in messages %}{% if message['role'] == 'user' %}USER: " + USER + " ASSISTANT:{% endif %}"
        "{% endfor %}",
        "USER: <image>SYS\n\nQ? ASSISTANT:",
    ),
    "system prompt as a string": (
        "{% for message in messages %}{% if message['role'] == 'system' %}{{ '<<' + message['content'] + '>>' }}"
        "{% else %}" + USER + " ASSISTANT:{% endif %}{% endfor %}",
        "<<SYS>><image>Q? ASSISTANT:",
    ),
    "strings alone": (
        "{% for message in messages %}{{ message['role'] + ': ' + message['content'] + '\n' }}{% endfor %}ASSISTANT:",
        "system: SYS\nuser: <image>Q?\nASSISTANT:",
    ),
    "strings, and no system role": (
        "{% for message in messages %}{% if message['role'] == 'system' %}{{ raise_exception('no') }}{% endif %}"
        "{{ message['content'] + '\n' }}{% endfor %}ASSISTANT:",
        "<image>SYS\n\nQ?\nASSISTANT:",
    ),
}


@pytest.mark.parametrize(("template", "prompt"), TEMPLATES.values(), ids=TEMPLATES)
def test_templates_that_want_other_messages(tmp_path: Path, template: str, prompt: str) -> None:
    folder = build("fastvlm", tmp_path, template=template)
    shared, alone = TransformersBackend(folder), TransformersBackend(folder, path="one by one")
    look = shared.look(pictures(1), "SYS")
    assert look.path == "shared"
    (answer,) = look.ask(["Q?"])
    assert answer.prompt == prompt
    assert apart([answer], alone.look(pictures(1), "SYS").ask(["Q?"])) < 1e-5


@pytest.mark.parametrize("written", [True, False], ids=["by the template, too", "by the tokenizer alone"])
def test_a_text_begins_once(tmp_path: Path, written: bool) -> None:
    template = ("<|endoftext|>" if written else "") + "{% for message in messages %}" + USER + "\n{% endfor %}A:"
    folder = build("fastvlm", tmp_path, template=template, begin=True)
    model = TransformersBackend(folder)
    tokens = model._chat.tokens(model._chat.render(SYSTEM, 1, "Is it?"))
    begin = model._processor.tokenizer.bos_token_id
    assert (tokens[0], tokens.count(begin)) == (begin, 1)
    alone = TransformersBackend(folder, path="one by one")
    look = model.look(pictures(1), SYSTEM)
    assert look.path == "shared"
    assert apart(look.ask(QUESTIONS), alone.look(pictures(1), SYSTEM).ask(QUESTIONS)) < 1e-5


@pytest.mark.parametrize("mark", ["<image>", "<|im_end|>", "<|endoftext|>"])
def test_a_model_s_own_marks_are_no_text(backend: Pick, mark: str) -> None:
    look = backend("fastvlm").look(pictures(1), SYSTEM)
    plain, marked = look.ask(["Is it?", f"Is it{mark}?"])
    assert plain.probability() is not None
    assert mark in marked.error
    assert marked.probability() is None
    with pytest.raises(InputError, match="system prompt"):
        backend("fastvlm").look(pictures(1), f"Answer.{mark}")


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        [np.zeros((0, 8, 3), np.uint8)],
        [np.zeros((8, 8), np.uint8)],
        [np.zeros((8, 8, 4), np.uint8)],
        [np.zeros((8, 8, 3), np.float32)],
        ["a.png"],
        [*pictures(1), None],
    ],
    ids=["none", "empty", "grey", "with alpha", "float", "a name", "the second is missing"],
)
def test_pictures_that_are_none(backend: Pick, wrong: list[Any]) -> None:
    with pytest.raises(InputError, match="picture") as caught:
        backend("fastvlm").look(wrong, SYSTEM)
    assert "\n" not in str(caught.value)


def test_a_picture_that_the_processor_does_not_take(backend: Pick) -> None:
    """Qwen's refuses an aspect ratio of 200 and more."""
    with pytest.raises(InputError, match="900x2 pixels") as caught:
        backend("qwen2.5-vl").look(pictures(1, 0, 2, 900), SYSTEM)
    assert "\n" not in str(caught.value)


# --- where sharing does not work --------------------------------------------------------------------------------------


@pytest.fixture
def fresh(checkpoint: Callable[[str], Path]) -> Callable[[str], TransformersBackend]:
    """A backend that has not looked yet."""
    return lambda family: TransformersBackend(checkpoint(family))


def one_position_off(monkeypatch: pytest.MonkeyPatch) -> None:
    shift = prefix._shift
    monkeypatch.setattr(prefix, "_shift", lambda model: shift(model) + 1)


def questions_that_see_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    fill = torch.Tensor.masked_fill_

    def lenient(self: Any, mask: Any, value: float) -> Any:
        return fill(self, torch.triu(mask, self.shape[1] - self.shape[0] + 1) if self.ndim == 2 else mask, value)

    monkeypatch.setattr(torch.Tensor, "masked_fill_", lenient)


def something_else_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    import transformers

    class Sliding(transformers.DynamicCache):  # type: ignore[misc]
        def __init__(self, config: Any) -> None:
            config = config.get_text_config(decoder=True).__class__.from_dict(
                {
                    **config.get_text_config(decoder=True).to_dict(),
                    "sliding_window": 8,
                    "use_sliding_window": True,
                    "layer_types": ["sliding_attention"] * config.get_text_config(decoder=True).num_hidden_layers,
                }
            )
            super().__init__(config=config)

    monkeypatch.setattr(transformers, "DynamicCache", Sliding)


def the_model_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(self: Any, group: Any) -> Any:
        raise RuntimeError("no such thing here\nand a second line")

    monkeypatch.setattr(prefix.Prefix, "_run", run)


@pytest.mark.parametrize(
    "broken", [one_position_off, questions_that_see_each_other, something_else_is_kept, the_model_raises]
)
@pytest.mark.parametrize("family", ["llava-onevision", "qwen2.5-vl"])
def test_a_model_that_does_not_share_is_asked_one_by_one(
    backend: Pick,
    fresh: Callable[[str], TransformersBackend],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    family: str,
    broken: Callable[[pytest.MonkeyPatch], None],
) -> None:
    expected = backend(family, "one by one").look(pictures(1), SYSTEM).ask(QUESTIONS)
    model = fresh(family)
    broken(monkeypatch)
    look = model.look(pictures(1), SYSTEM)
    assert look.path == "one by one"
    assert apart(look.ask(QUESTIONS), expected) < 1e-5
    (record,) = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert f"{family}: asked one by one" in record.getMessage()
    assert "\n" not in record.getMessage()
    caplog.clear()
    assert model.look(pictures(1), SYSTEM).path == "one by one", "found out once"
    assert not caplog.records


def test_qwen_without_its_shift_would_be_caught(
    fresh: Callable[[str], TransformersBackend], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prefix, "_shift", lambda model: 0)
    assert fresh("qwen2.5-vl").look(pictures(1), SYSTEM).path == "one by one"


def test_each_number_of_pictures_is_checked_for_itself(
    fresh: Callable[[str], TransformersBackend], caplog: pytest.LogCaptureFixture
) -> None:
    model = fresh("llava-onevision")
    with caplog.at_level(logging.INFO, "executive.s3e"):
        for count in (1, 2, 1, 2):
            model.look(pictures(count), SYSTEM)
    assert [record.getMessage().partition(" about ")[2][:9] for record in caplog.records] == ["1 picture", "2 picture"]


def test_sharing_on_request_or_not_at_all(checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    model = TransformersBackend(checkpoint("fastvlm"), path="shared")
    assert model.look(pictures(1), SYSTEM).path == "shared"
    something_else_is_kept(monkeypatch)
    with pytest.raises(InputError, match="cannot share"):
        model.look(pictures(1), SYSTEM)


def test_when_sharing_fails_on_the_way_the_rest_is_asked_one_by_one(
    backend: Pick, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As when memory runs out for the second group of many questions."""
    expected = backend("smolvlm").look(pictures(1), SYSTEM).ask(QUESTIONS)
    look = backend("smolvlm").look(pictures(1), SYSTEM)
    forward, calls = look._prefix._model.forward, []  # type: ignore[union-attr]

    def failing(**arguments: Any) -> Any:
        calls.append(arguments)
        if len(calls) == 2:
            raise MemoryError("no room")
        return forward(**arguments)

    monkeypatch.setattr(prefix, "AT_ONCE", 40)
    monkeypatch.setattr(prefix.groups, "__defaults__", (40,))
    monkeypatch.setattr(look._prefix._model, "forward", failing)  # type: ignore[union-attr]
    assert apart(look.ask(QUESTIONS), expected) < 1e-5
    assert len(calls) > 3
    assert look.path == "one by one"
    assert "no room" in caplog.text
    assert apart(look.ask(QUESTIONS), expected) < 1e-5


def test_an_output_that_is_no_number_is_no_answer(
    checkpoint: Callable[[str], Path], caplog: pytest.LogCaptureFixture
) -> None:
    model = TransformersBackend(checkpoint("fastvlm"))
    model._model.get_output_embeddings().weight[5, 0] = float("nan")
    answers = model.look(pictures(1), SYSTEM).ask(QUESTIONS[:2])
    assert [answer.probability() for answer in answers] == [None, None]
    assert all("not a number" in answer.error for answer in answers)


def test_a_model_that_fails_altogether_gives_no_answer(
    checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = TransformersBackend(checkpoint("fastvlm"), path="one by one")
    look = model.look(pictures(1), SYSTEM)

    def failing(**arguments: Any) -> Any:
        raise MemoryError("no room")

    monkeypatch.setattr(model._model, "forward", failing)
    (answer,) = look.ask(["Is it?"])
    assert "no room" in answer.error
    assert answer.probability() is None


def test_what_is_kept_is_freed(backend: Pick) -> None:
    with backend("llava-onevision").look(pictures(1), SYSTEM) as look:
        look.ask(QUESTIONS)
        kept = [weakref.ref(layer.keys) for layer in look._prefix._cache.layers]  # type: ignore[union-attr]
        assert all(keys() is not None for keys in kept)
    gc.collect()
    assert all(keys() is None for keys in kept)
    with pytest.raises(ValueError, match="closed"):
        look.ask(QUESTIONS)


def test_asking_keeps_no_more_than_the_beginning(backend: Pick) -> None:
    look = backend("llava-onevision").look(pictures(1), SYSTEM)
    lengths = []
    for _ in range(3):
        look.ask(QUESTIONS)
        lengths.append(look._prefix._cache.get_seq_length())  # type: ignore[union-attr]
    assert lengths == [look._prefix._beginning.length] * 3  # type: ignore[union-attr]


# --- what it loads ----------------------------------------------------------------------------------------------------


def test_nothing_heavy_is_imported_before_a_checkpoint_is_loaded() -> None:
    script = (
        "import sys, executive.s3e.vlm as vlm\n"
        "heavy = {'torch', 'transformers', 'PIL', 'safetensors', 'tokenizers', 'huggingface_hub'}\n"
        "assert heavy.isdisjoint(sys.modules), heavy & sys.modules.keys()\n"
        "try: vlm.TransformersBackend('/nowhere/at/all')\n"
        "except vlm.InputError: pass\n"
        "assert heavy.isdisjoint(sys.modules), heavy & sys.modules.keys()\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


@pytest.mark.parametrize("family", FAMILIES)
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
