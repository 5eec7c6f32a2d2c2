"""A trained model, computed with NumPy: it answers as transformers does, and no other model is computed so."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from executive.app.estimators import shipped
from executive.errors import InputError
from executive.s3e.backends.checkpoint import find
from executive.s3e.backends.interface import Numerals
from executive.s3e.backends.numpy_backend import NumpyBackend, open_checkpoint, supported
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.types import Image

SYSTEM = "Answer yes or no."
QUESTIONS = (
    "Is the lemon on the wood table?",
    "\nIs the milk carton on the black table?",
    " is the robot holding the soda can?",
    "Ist das hier überhaupt eine Frage, und was wird aus ihr?",
    "Is the lemon on the wood table <image>?",
    "?",
)


def eye() -> Path:
    folder = shipped("grocery")
    assert folder is not None
    return folder


def pictures(count: int, side: int = 384) -> list[Image]:
    """Smooth blobs: noise alone would look the same everywhere."""
    rng = np.random.default_rng(count)
    small = rng.integers(0, 255, (count, 6, 6, 3), dtype=np.uint8)
    return [np.kron(each, np.ones((side // 6, side // 6, 1), dtype=np.uint8)) for each in small]


@pytest.fixture(scope="module")
def both() -> tuple[NumpyBackend, TransformersBackend]:
    return NumpyBackend(find(eye())), TransformersBackend(eye())


@pytest.mark.parametrize("count", [1, 5, 9])
def test_it_answers_as_transformers_does(both: tuple[NumpyBackend, TransformersBackend], count: int) -> None:
    seen = pictures(count)
    ours, theirs = (backend.look(seen, SYSTEM).ask(QUESTIONS) for backend in both)
    for mine, other in zip(ours, theirs, strict=True):
        assert (mine.prompt, mine.error) == (other.prompt, other.error)
        assert mine.yes_mass == pytest.approx(other.yes_mass, abs=1e-5)
        assert mine.no_mass == pytest.approx(other.no_mass, abs=1e-5)
        assert mine.said.split(" (")[0] == other.said.split(" (")[0]


def test_it_counts_as_transformers_does(both: tuple[NumpyBackend, TransformersBackend]) -> None:
    seen = pictures(2, side=96)
    ours, theirs = both
    try:
        expected = theirs.look_for_numbers(seen, SYSTEM, Numerals(3)).ask(["How many items are there?"])
    except InputError as error:
        with pytest.raises(InputError, match=str(error.message)):
            ours.look_for_numbers(seen, SYSTEM, Numerals(3))
        return
    (answer,) = ours.look_for_numbers(seen, SYSTEM, Numerals(3)).ask(["How many items are there?"])
    assert answer.masses == pytest.approx(expected[0].masses, abs=1e-5)


def test_no_question_changes_the_answer_to_another(both: tuple[NumpyBackend, TransformersBackend]) -> None:
    many = [f"Is the lemon on table {number}?" for number in range(120)]  # more than go through the model together
    with both[0].look(pictures(3), SYSTEM) as look:
        together = look.ask(many)
        assert look.ask([]) == []
        for index in (0, 57, 119):
            assert look.ask([many[index]])[0].yes_mass == pytest.approx(together[index].yes_mass, abs=1e-5)
    with pytest.raises(ValueError, match="closed"):
        look.ask(["?"])


@pytest.mark.parametrize(
    ("images", "system"),
    [([], SYSTEM), (pictures(1), "An <image> in it."), ([np.zeros((4, 4), dtype=np.uint8)], SYSTEM)],
)
def test_what_is_refused_is_refused_in_the_same_words(
    both: tuple[NumpyBackend, TransformersBackend], images: list[Image], system: str
) -> None:
    said = []
    for backend in both:
        with pytest.raises(InputError) as caught:
            backend.look(images, system)
        said.append(caught.value.message)
    assert said[0] == said[1]


def altered(folder: Path, file: str, changes: dict[str, Any]) -> Path:
    """The shipped model with something else in one of its files; a key such as `text_config.hidden_act` is a path."""
    copied = folder / "model"
    shutil.copytree(eye(), copied)
    whole = json.loads((copied / file).read_text())
    for path, value in changes.items():
        *outer, last = path.split(".")
        inner = whole
        for name in outer:
            inner = inner[name]
        inner[last] = value
    (copied / file).write_text(json.dumps(whole))
    return copied


def test_the_shipped_model_is_computed_so() -> None:
    assert supported(find(eye()))


def test_weights_that_are_stored_in_16_bits_are_computed_in_32(tmp_path: Path) -> None:
    folder = altered(tmp_path, "config.json", {})
    weights = load_file(folder / "model.safetensors")
    halved = {name: value.astype(np.float16) if value.ndim > 1 else value for name, value in weights.items()}
    save_file(halved, folder / "model.safetensors", {"format": "pt"})
    assert supported(find(folder))
    seen = pictures(2)
    ours, theirs = (
        each.look(seen, SYSTEM).ask(QUESTIONS) for each in (NumpyBackend(find(folder)), TransformersBackend(folder))
    )
    for mine, other in zip(ours, theirs, strict=True):
        assert mine.yes_mass == pytest.approx(other.yes_mass, abs=1e-5)


@pytest.mark.parametrize(
    ("file", "key", "value"),
    [
        ("config.json", "text_config.hidden_act", "gelu"),
        ("config.json", "text_config.num_key_value_heads", 2),
        ("config.json", "text_config.rope_parameters.rope_type", "yarn"),
        ("config.json", "vision_config.layer_type", "bottleneck"),
        ("config.json", "quantization_config", {"quant_method": "awq"}),
        ("preprocessor_config.json", "do_center_crop", True),
        ("preprocessor_config.json", "size", {"shortest_edge": 192}),
        ("processor_config.json", "processor_class", "OtherProcessor"),
        ("tokenizer_config.json", "tokenizer_class", "OtherTokenizer"),
    ],
)
def test_one_that_differs_is_left_to_transformers(tmp_path: Path, file: str, key: str, value: object) -> None:
    assert not supported(find(altered(tmp_path, file, {key: value})))


def test_a_damaged_one_is_told_by_transformers(tmp_path: Path) -> None:
    folder = altered(tmp_path, "config.json", {"text_config.num_hidden_layers": 4})
    with pytest.raises(InputError, match="its config cannot be read"):
        open_checkpoint(str(folder))


def test_neither_torch_nor_transformers_is_loaded() -> None:
    program = (
        "import sys\nfrom executive.s3e.backends.numpy_backend import open_checkpoint\nimport numpy as np\n"
        f"look = open_checkpoint({str(eye())!r}).look([np.zeros((64, 64, 3), np.uint8)], '')\nlook.ask(['Is it?'])\n"
        "assert not {'torch', 'transformers', 'scipy'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)
