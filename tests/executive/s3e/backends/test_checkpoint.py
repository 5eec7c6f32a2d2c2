"""Checkpoints that are none, or broken: one line each, with the file in it, and nothing half loaded."""

from __future__ import annotations

import json
import math
import platform
import shutil
import struct
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from executive.errors import InputError, MissingError
from executive.s3e.backends import loading, packages
from executive.s3e.backends.checkpoint import check_safetensors, find
from executive.s3e.backends.transformers_backend import TransformersBackend
from tests.executive.s3e.checkpoints import build
from tests.executive.s3e.looking import QUESTIONS, SYSTEM, pictures

ROOT = Path(__file__).resolve().parents[4]


@pytest.fixture
def folder(checkpoint: Callable[[str], Path], tmp_path: Path) -> Path:
    """A checkpoint to break."""
    return Path(shutil.copytree(checkpoint("fastvlm"), tmp_path / "eye"))


def changed(file: Path, change: Callable[[Any], Any]) -> None:
    value = json.loads(file.read_text("utf-8"))
    file.write_text(json.dumps(change(value)), "utf-8")


def shards(folder: Path) -> Path:
    """Split the weights into two files, as large checkpoints are; returns the second."""
    from safetensors.torch import load_file, save_file

    weights = load_file(folder / "model.safetensors")
    (folder / "model.safetensors").unlink()
    names = sorted(weights)
    parts = {"model-1.safetensors": names[::2], "model-2.safetensors": names[1::2]}
    for file, own in parts.items():
        save_file({name: weights[name] for name in own}, folder / file, {"format": "pt"})
    table = {name: file for file, own in parts.items() for name in own}
    (folder / "model.safetensors.index.json").write_text(json.dumps({"metadata": {}, "weight_map": table}), "utf-8")
    return folder / "model-2.safetensors"


def without(*names: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        for name in names:
            (folder / name).unlink()

    return change


def cut_off(folder: Path) -> None:
    file = folder / "model.safetensors"
    file.write_bytes(file.read_bytes()[:-1000])


def cut_off_in_the_header(folder: Path) -> None:
    file = folder / "model.safetensors"
    file.write_bytes(file.read_bytes()[:500])


def another_format(folder: Path) -> None:
    (folder / "model.safetensors").write_bytes(b"PK\x03\x04" + bytes(2000))


def damaged_header(folder: Path) -> None:
    file = folder / "model.safetensors"
    content = bytearray(file.read_bytes())
    content[100:140] = b"?" * 40
    file.write_bytes(content)


def a_shard_is_missing(folder: Path) -> None:
    shards(folder).unlink()


def a_shard_is_cut_off(folder: Path) -> None:
    second = shards(folder)
    second.write_bytes(second.read_bytes()[:-10])


def a_shard_is_outside(folder: Path) -> None:
    shards(folder)
    changed(folder / "model.safetensors.index.json", lambda index: {"weight_map": {"a": "../../model-1.safetensors"}})


def a_shard_is_called(name: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        shards(folder)
        changed(folder / "model.safetensors.index.json", lambda index: {"weight_map": {"a": name}})

    return change


def a_header_says(**tensor: Any) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        said = {"w": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8], **tensor}}
        header = json.dumps(said).replace('"huge"', "9" * 4_000).encode()
        (folder / "model.safetensors").write_bytes(struct.pack("<Q", len(header)) + header + bytes(8))

    return change


def pickled(folder: Path) -> None:
    (folder / "model.safetensors").rename(folder / "pytorch_model.bin")


def some_weights_are_missing(folder: Path) -> None:
    from safetensors.torch import load_file, save_file

    weights = load_file(folder / "model.safetensors")
    kept = {name: weight for name, weight in weights.items() if "multi_modal_projector" not in name}
    save_file(kept, folder / "model.safetensors", {"format": "pt"})


def other_shapes(folder: Path) -> None:
    changed(
        folder / "config.json", lambda config: {**config, "text_config": {**config["text_config"], "hidden_size": 48}}
    )


def config(**entries: Any) -> Callable[[Path], None]:
    return lambda folder: changed(folder / "config.json", lambda value: {**value, **entries})


def written(file: str, text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / file).write_text(text, "utf-8")

    return change


def nonsense_in(file: str) -> Callable[[Path], None]:
    return written(file, '{"half": ')


def template(text: str) -> Callable[[Path], None]:
    return written("chat_template.jinja", text)


def a_processor_that_nobody_knows(folder: Path) -> None:
    (folder / "preprocessor_config.json").unlink()
    written("processor_config.json", '{"processor_class": "NoSuchProcessor"}')(folder)


BROKEN: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "no config": (without("config.json"), "config.json", "no such file"),
    "config is no JSON": (nonsense_in("config.json"), "config.json", "not JSON"),
    "config is a list": (written("config.json", "[]"), "config.json", "not a JSON object"),
    "config without a type": (lambda f: changed(f / "config.json", lambda _: {}), "config.json", "model_type"),
    "a text-only model": (config(model_type="qwen2"), "config.json", "'qwen2'.*no image-text-to-text model"),
    "a type that nobody knows": (config(model_type="fast_vml"), "config.json", "'fast_vml'"),
    "its own code": (config(model_type="mine", auto_map={"AutoModel": "mine.Mine"}), "config.json", "never run"),
    "encoder and decoder": (config(model_type="florence2"), "config.json", "encoder-decoder"),
    "a config of nonsense": (config(text_config=7), "config.json", "config cannot be read"),
    "weights cut off": (cut_off, "model.safetensors", "cut off.*download it again"),
    "weights cut off in the header": (cut_off_in_the_header, "model.safetensors", "cut off"),
    "weights of another format": (another_format, "model.safetensors", "cut off or no safetensors"),
    "weights with a damaged header": (damaged_header, "model.safetensors", "header"),
    "no weights": (without("model.safetensors"), "eye", "no weights in safetensors"),
    "a pickle": (pickled, "eye", "pytorch_model.bin is a pickle"),
    "a missing shard": (a_shard_is_missing, "model-2.safetensors", "is missing"),
    "a shard cut off": (a_shard_is_cut_off, "model-2.safetensors", "cut off"),
    "a shard elsewhere": (a_shard_is_outside, "index.json", "outside"),
    "a shard whose name is too long": (a_shard_is_called("a" * 300), "aaa", "is missing"),
    "a shard with a zero byte in its name": (a_shard_is_called("a\0b"), "b", "is missing"),
    "a shard that is the folder above": (a_shard_is_called(".."), "eye/..", "cannot be read"),
    "tensors without end": (a_header_says(data_offsets=[0, "huge"]), "model.safetensors", "header makes no sense"),
    "tensors of infinite size": (
        a_header_says(data_offsets=[0, math.inf]),
        "model.safetensors",
        "header makes no sense",
    ),
    "tensors of too many dimensions": (a_header_says(shape=[2] * 64), "model.safetensors", "header makes no sense"),
    "tensors of half a value": (a_header_says(shape=[0.5]), "model.safetensors", "header makes no sense"),
    "weights of another model": (some_weights_are_missing, "eye", "lack 4 of the model's.*multi_modal_projector"),
    "weights of other shapes": (other_shapes, "eye", r"another model's: .* is \(.*64.*\) in the weights, \(.*48"),
    "no tokenizer": (without("tokenizer.json", "tokenizer_config.json"), "eye", "no tokenizer"),
    "tokenizer is no JSON": (nonsense_in("tokenizer.json"), "eye/tokenizer.json", "is not JSON"),
    "no processor": (without("processor_config.json", "preprocessor_config.json"), "eye", "no processor for pictures"),
    "processor is no JSON": (nonsense_in("processor_config.json"), "eye/processor_config.json", "is not JSON"),
    "a processor of a class that nobody knows": (
        a_processor_that_nobody_knows,
        "eye",
        "does not take text and pictures together",
    ),
    "no chat template": (without("chat_template.jinja"), "eye", "no chat template"),
    "a template that is none": (template("{% for"), "eye", "chat template cannot be used"),
    "a template without the question": (template("Yes or no?"), "eye", "leaves out"),
}


@pytest.mark.parametrize(("breaks", "where", "why"), BROKEN.values(), ids=BROKEN)
def test_a_broken_checkpoint_is_one_line_that_names_the_file(
    folder: Path, breaks: Callable[[Path], None], where: str, why: str
) -> None:
    breaks(folder)
    with pytest.raises(InputError, match=why) as caught:
        TransformersBackend(folder)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 700
    assert str(caught.value.file).endswith(where)


@pytest.mark.parametrize(
    ("name", "why"),
    [("nowhere", "no such folder"), ("config.json", "is a file"), (".", "no such file; wanted a checkpoint's folder")],
)
def test_a_folder_that_is_none(tmp_path: Path, name: str, why: str) -> None:
    (tmp_path / "config.json").write_text("{}", "utf-8")
    path = tmp_path / name if name != "." else tmp_path.parent
    with pytest.raises(InputError, match=why) as caught:
        TransformersBackend(path)
    assert str(path) in str(caught.value)


def test_a_model_of_the_hub_without_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        TransformersBackend("nobody/nothing-7B")
    line = str(caught.value)
    assert "\n" not in line
    for part in ("nobody/nothing-7B", str(tmp_path / "nobody" / "nothing-7B"), str(tmp_path / "hub"), "hf download"):
        assert part in line


def test_a_model_that_was_downloaded_before(
    checkpoint: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taken from the hub's cache, laid out as the hub's library does, without a network."""
    from huggingface_hub import constants

    commit = "0" * 40
    cached = tmp_path / "models--somebody--eye-7B"
    shutil.copytree(checkpoint("fastvlm"), cached / "snapshots" / commit)
    (cached / "refs").mkdir()
    (cached / "refs" / "main").write_text(commit, "utf-8")
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    found = find("somebody/eye-7B")
    assert (found.name, found.folder) == ("somebody/eye-7B", cached / "snapshots" / commit)


def test_a_checkpoint_in_shards_loads(folder: Path) -> None:
    shards(folder)
    assert TransformersBackend(folder).name == "eye"


def test_a_relative_folder_has_its_own_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert find(".").name == "eye"


def test_safetensors_are_read_as_the_library_reads_them(tmp_path: Path) -> None:
    import torch
    from safetensors.torch import save_file

    file = tmp_path / "a.safetensors"
    save_file({"a": torch.zeros(3, 5), "b": torch.zeros(7, dtype=torch.bfloat16), "c": torch.tensor(1.0)}, file)
    assert check_safetensors(file) == {"F32": 16, "BF16": 7}
    for length in range(file.stat().st_size):
        cut = tmp_path / "cut.safetensors"
        cut.write_bytes(file.read_bytes()[:length])
        with pytest.raises(InputError, match="cut"):
            check_safetensors(cut)


def test_a_family_that_needs_a_package_names_the_extra(
    checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from transformers.models.smolvlm import processing_smolvlm

    monkeypatch.setattr(processing_smolvlm, "num2words", None)
    with pytest.raises(MissingError, match="num2words") as caught:
        TransformersBackend(checkpoint("smolvlm"))
    assert caught.value.command == "pip install 'executive[smolvlm]'"


def test_a_template_that_only_the_tokenizer_has_is_used(folder: Path) -> None:
    """As older checkpoints have it, in tokenizer_config.json."""
    expected = TransformersBackend(folder).look(pictures(1), SYSTEM).ask(QUESTIONS)
    text = (folder / "chat_template.jinja").read_text("utf-8")
    (folder / "chat_template.jinja").unlink()
    changed(folder / "tokenizer_config.json", lambda config: {**config, "chat_template": text})
    assert TransformersBackend(folder).look(pictures(1), SYSTEM).ask(QUESTIONS) == expected


def test_a_model_that_takes_no_question_is_called_what_it_is(checkpoint: Callable[[str], Path]) -> None:
    """GOT-OCR2 reads text off pictures; its processor wants them in another way, whatever their size."""
    folder = checkpoint("got-ocr2")
    with pytest.raises(InputError) as caught:
        TransformersBackend(folder)
    assert str(caught.value).startswith(f"{folder}: GotOcr2Processor takes no question about a picture (ValueError: ")
    assert "pixels" not in str(caught.value)


def test_pictures_that_only_torchvision_prepares(
    checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    import transformers

    def refused(*_: Any, **__: Any) -> Any:
        raise ImportError("\nNewestImageProcessor requires the Torchvision library but it was not found in your env.")

    monkeypatch.setattr(transformers.AutoImageProcessor, "from_pretrained", refused)
    with pytest.raises(MissingError, match="torchvision") as caught:
        TransformersBackend(checkpoint("llava-onevision"))
    assert caught.value.command.endswith(f" -m pip install --no-deps {packages.fitting_torchvision()[0]}")
    assert "\n" not in str(caught.value)


def test_the_extras_that_are_named_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert set(packages.EXTRAS.values()) <= project["optional-dependencies"].keys()


@pytest.mark.parametrize(
    ("device", "dtype", "key"),
    [("tpu", "auto", "device"), ("cuda:9", "auto", "device"), ("cuda:x", "auto", "device"), ("cpu", "int8", "dtype")],
)
def test_no_such_device_or_dtype(checkpoint: Callable[[str], Path], device: str, dtype: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        TransformersBackend(checkpoint("fastvlm"), device=device, dtype=dtype)
    assert caught.value.key == key
    assert "cpu" in str(caught.value) or "float32" in str(caught.value)


@pytest.mark.parametrize(
    ("device", "half", "able", "expected"),
    [
        ("cpu", True, (), "float32"),
        ("cpu", True, ("avx512_f", "avx512_vnni"), "float32"),
        ("cpu", True, ("avx512_bf16",), "bfloat16"),
        ("cpu", True, ("amx_bf16", "avx512_bf16"), "bfloat16"),
        ("cpu", False, ("amx_bf16",), "float32"),
        ("mps", True, (), "float16"),
        ("mps", False, (), "float32"),
    ],
)
def test_sixteen_bits_where_they_are_quick(
    monkeypatch: pytest.MonkeyPatch, device: str, half: bool, able: tuple[str, ...], expected: str
) -> None:
    import torch

    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: dict.fromkeys(able, True))
    assert loading.choose_dtype("auto", device, half) == expected
    assert loading.choose_dtype("float16", device, half) == "float16"


def test_the_device_that_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    assert [loading.choose_device(name) for name in ("auto", "cuda", "cuda:1", "cpu")] == [
        "cuda",
        "cuda",
        "cuda:1",
        "cpu",
    ]
    with pytest.raises(InputError, match="it has cpu, cuda, cuda:1"):
        loading.choose_device("cuda:2")
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    assert loading.choose_device("auto") == "mps"


@pytest.mark.parametrize(("device", "there"), [("cpu", False), ("cuda", True), ("mps", True)])
def test_torch_is_asked_for_a_gpu_where_there_is_a_sign_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str, there: bool
) -> None:
    asked: list[str] = []

    def choose(wanted: str) -> str:
        asked.append(wanted)
        return device

    monkeypatch.setattr(loading, "choose_device", choose)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(loading, "GPUS", (str(tmp_path / "none"),))
    assert (loading.has_gpu(), asked) == (False, [])
    monkeypatch.setattr(loading, "GPUS", (str(tmp_path / "none"), str(tmp_path)))
    assert (loading.has_gpu(), asked) == (there, ["auto"])
    monkeypatch.setattr(loading, "GPUS", ())
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(platform, "machine", lambda: "arm64")
    assert (loading.has_gpu(), asked) == (there, ["auto"] * 2)


def test_half_stored_weights_are_noticed(folder: Path) -> None:
    from safetensors.torch import load_file, save_file

    assert not find(folder).half
    weights = load_file(folder / "model.safetensors")
    save_file({name: weight.half() for name, weight in weights.items()}, folder / "model.safetensors", {"format": "pt"})
    config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    for said, half in (("float32", False), ("float16", True), (None, True)):
        (folder / "config.json").write_text(json.dumps({**config, "dtype": said}), encoding="utf-8")
        assert find(folder).half == half
    assert TransformersBackend(folder, dtype="float32").dtype == "float32"


@pytest.mark.parametrize("shown", [True, False])
def test_loading_leaves_no_trace_on_the_terminal(
    checkpoint: Callable[[str], Path], capfd: pytest.CaptureFixture[str], shown: bool
) -> None:
    from transformers.utils import logging as chatter

    folder = checkpoint("llava-onevision")
    (chatter.enable_progress_bar if shown else chatter.disable_progress_bar)()
    before = chatter.get_verbosity()
    TransformersBackend(folder)
    assert capfd.readouterr() == ("", "")
    assert (chatter.get_verbosity(), chatter.is_progress_bar_enabled()) == (before, shown)


def test_a_package_that_is_missing_is_no_bad_input(
    checkpoint: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package that no extra of ours brings is missing: that is the machine's fault, not the checkpoint's."""
    import transformers

    def broken(*_: Any, **__: Any) -> Any:
        raise ImportError("No module named 'somewhere'")

    monkeypatch.setattr(transformers.AutoProcessor, "from_pretrained", broken)
    with pytest.raises(MissingError, match="somewhere"):
        TransformersBackend(checkpoint("fastvlm"))


def test_a_family_builds_the_same_every_time(checkpoint: Callable[[str], Path], tmp_path: Path) -> None:
    again = build("fastvlm", tmp_path)
    for file in ("model.safetensors", "tokenizer.json", "config.json"):
        assert (again / file).read_bytes() == (checkpoint("fastvlm") / file).read_bytes()
