"""What is asked and how it is written, and what becomes of a look where the model, its template or its memory will not
do what sharing asks of it."""

from __future__ import annotations

import gc
import logging
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.errors import InputError
from executive.s3e.backends import prefix_cache
from executive.s3e.backends.transformers_backend import TransformersBackend
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.looking import QUESTIONS, SYSTEM, Pick, apart, pictures

pytestmark = pytest.mark.usefixtures("one_thread")

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
    "thinks aloud first": (
        "{% for message in messages %}" + USER + "{% endfor %} ASSISTANT:"
        "{{ '' if enable_thinking is defined and not enable_thinking else '<think>' }}",
        "SYS<image>Q? ASSISTANT:",
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


@pytest.mark.parametrize("family", ["qwen2.5-vl", "gemma3"])
def test_a_question_that_joins_with_what_is_before_it(tmp_path: Path, family: str) -> None:
    """Newlines before a question, cut in another way when it begins with one: three are two and one, two are one and
    one. One row shares so much less; rows of their own cannot."""
    picture = "<|vision_start|>" + ("<image><|vision_end|>" if family != "gemma3" else "")
    template = "{% for message in messages %}" + USER.replace("<image>", picture) + "\n{% endfor %}A:"
    template = template.replace("{{ part['text']", "{{ '\n\n' + part['text']")
    folder = build(family, tmp_path, template=template)
    shared, alone = TransformersBackend(folder), TransformersBackend(folder, path="one by one")
    look = shared.look(pictures(1), SYSTEM)
    assert look.path == "shared"
    assert apart(look.ask(QUESTIONS), alone.look(pictures(1), SYSTEM).ask(QUESTIONS)) < 1e-5
    kept = look._prefix
    assert kept is not None
    suffixes = [kept.suffix(shared._chat.tokens(shared._chat.render(SYSTEM, 1, q)), q) for q in ("Is it?", "\nIs it?")]
    length = kept._beginning.length
    assert [suffix and suffix.shared for suffix in suffixes] == [length, length - 2 if family != "gemma3" else None]


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
    shift = prefix_cache._shift
    monkeypatch.setattr(prefix_cache, "_shift", lambda model: shift(model) + 1)


def questions_that_see_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    fill = torch.Tensor.masked_fill_

    def lenient(self: Any, mask: Any, value: float) -> Any:
        return fill(self, torch.triu(mask, self.shape[1] - self.shape[0] + 1) if self.ndim == 2 else mask, value)

    monkeypatch.setattr(torch.Tensor, "masked_fill_", lenient)


def less_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last eight tokens alone, as of a sliding window."""
    import transformers

    class Sliding(transformers.DynamicCache):  # type: ignore[misc]
        def __init__(self, config: Any) -> None:
            text = config.get_text_config(decoder=True)
            window = {"sliding_window": 8, "layer_types": ["sliding_attention"] * text.num_hidden_layers}
            super().__init__(config=type(text)(**{**text.to_dict(), "use_sliding_window": True, **window}))

    monkeypatch.setattr(transformers, "DynamicCache", Sliding)


def nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    import transformers

    monkeypatch.setattr(transformers.DynamicCache, "get_seq_length", lambda self, layer=0: 0)


def the_model_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(self: Any, group: Any) -> Any:
        raise RuntimeError("no such thing here\nand a second line")

    monkeypatch.setattr(prefix_cache.Prefix, "_row", run)


@pytest.mark.parametrize(
    "broken", [one_position_off, questions_that_see_each_other, less_is_kept, nothing_is_kept, the_model_raises]
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
    monkeypatch.setattr(prefix_cache, "_shift", lambda model: 0)
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
    nothing_is_kept(monkeypatch)
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

    monkeypatch.setattr(prefix_cache, "AT_ONCE", 40)
    monkeypatch.setattr(look._prefix._model, "forward", failing)  # type: ignore[union-attr]
    assert apart(look.ask(QUESTIONS), expected) < 1e-5
    assert len(calls) > 3
    assert look.path == "one by one"
    assert "no room" in caplog.text
    assert apart(look.ask(QUESTIONS), expected) < 1e-5


def test_a_look_s_own_trouble_is_its_own(
    fresh: Callable[[str], TransformersBackend], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Sharing has worked; then a look runs out of memory, and the next one does not."""
    model = fresh("fastvlm")
    expected = model.look(pictures(1), SYSTEM).ask(QUESTIONS)
    with monkeypatch.context() as broken:
        nothing_is_kept(broken)
        look = model.look(pictures(1), SYSTEM)
    assert look.path == "one by one"
    assert "sharing failed" in caplog.text
    assert apart(look.ask(QUESTIONS), expected) < 1e-5
    assert model.look(pictures(1), SYSTEM).path == "shared"


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
