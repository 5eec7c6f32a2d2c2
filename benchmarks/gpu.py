"""Looks at the paper's sizes on a GPU: LLaVA-OneVision with Qwen2-0.5B and Qwen2-7B, with random weights.

    python -m benchmarks.gpu                                  # both sizes, float16 and bfloat16, 1 to 500 questions
    python -m benchmarks.gpu --sizes 0.5B --dtypes float16 --json
    python -m benchmarks.gpu --device cpu --sizes tiny --dtypes float32   # the same code, without a GPU

A look takes in pictures of 384 x 384 pixels, of about 1,500 tokens each, and answers questions about them, which share
what the model makes of the pictures. Beside it stands what as many questions take that are asked one at a time, each
with the pictures anew; a few are asked, and counted for all. What a model answers depends on its weights, how long it
takes does not. No checkpoint is downloaded or written: the weights are drawn on the device. Where there is no GPU,
that is said, and nothing is measured.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from executive.types import Image

SYSTEM = "You answer questions about pictures. Answer each with yes or no alone."
ITEMS = ("milk carton", "bread loaf", "lemon", "soda can", "cereal box", "water bottle")
PLACES = ("wooden table", "black table", "white table", "floor", "tray")

ALONE = 3
"""Questions that are asked one at a time; all of them take equally long."""

ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Shape:
    """How large a LLaVA-OneVision is: its language model (Qwen2) and its vision tower (SigLIP)."""

    width: int
    layers: int
    heads: int
    key_value_heads: int
    inner: int
    vocabulary: int
    vision_width: int = 1152
    vision_layers: int = 26
    vision_heads: int = 16
    vision_inner: int = 4304
    picture: int = 384


SHAPES = {
    "0.5B": Shape(width=896, layers=24, heads=14, key_value_heads=2, inner=4864, vocabulary=151_936),
    "7B": Shape(width=3584, layers=28, heads=28, key_value_heads=4, inner=18_944, vocabulary=152_064),
    "tiny": Shape(
        width=64, layers=2, heads=4, key_value_heads=2, inner=96, vocabulary=1_000, vision_width=32, vision_layers=2,
        vision_heads=2, vision_inner=64, picture=56,
    ),
}  # fmt: skip
"""As in the configurations that are published with LLaVA-OneVision; the last one is for a test."""


@dataclass(frozen=True, slots=True)
class Row:
    """What a look takes: seconds of wall time with all questions sharing the pictures, and with each asked alone;
    None where it was not answered, and `note` says why. `gibibytes` is the most that the GPU held."""

    size: str
    dtype: str
    pictures: int
    questions: int
    shared: float | None
    alone: float | None
    gibibytes: float | None
    note: str = ""

    @property
    def ratio(self) -> float | None:
        return None if self.shared is None or self.alone is None else self.alone / self.shared


def missing(device: str) -> str:
    """Return why nothing can be measured there; empty where it can."""
    import torch

    from executive.errors import InputError
    from executive.s3e.backends.loading import choose_device

    try:
        chosen = choose_device(device)
    except InputError as error:
        return error.message
    return f"torch {torch.__version__} finds no GPU on this machine" if device == "auto" and chosen == "cpu" else ""


def measure(
    sizes: Sequence[str], dtypes: Sequence[str], counts: Sequence[int], pictures: int, device: str = "auto"
) -> Iterator[Row]:
    """Yield a row for each size, dtype and number of questions."""
    import torch

    from executive.s3e.backends.loading import choose_device

    place = choose_device(device)
    for size in sizes:
        with tempfile.TemporaryDirectory() as name:
            for dtype in dtypes:
                try:
                    backends = _drawn(size, dtype, place, Path(name))
                except torch.OutOfMemoryError:
                    yield from (Row(size, dtype, pictures, n, None, None, None, "out of memory") for n in counts)
                    continue
                for count in counts:
                    yield _row(backends, size, dtype, pictures, count)
                del backends
                if place.startswith("cuda"):
                    torch.cuda.empty_cache()


def _row(backends: tuple[Any, Any], size: str, dtype: str, pictures: int, count: int) -> Row:
    import torch

    shared, alone = backends
    on_cuda = shared.device.startswith("cuda")
    if on_cuda:
        torch.cuda.reset_peak_memory_stats()
    images, questions = _images(pictures, SHAPES[size].picture), _questions(count)
    together, told = _timed(lambda: shared.look(images, SYSTEM).ask(questions))
    few = questions[:ALONE]
    one, told_alone = _timed(lambda: alone.look(images, SYSTEM).ask(few))
    note = next((answer.error for answer in (*told, *told_alone) if answer.error), "")
    note = note or ("" if shared.look(images, SYSTEM).path == "shared" else "asked one by one")
    used = torch.cuda.max_memory_allocated() / 2**30 if on_cuda else None
    failed = any(answer.error for answer in told), any(answer.error for answer in told_alone)
    return Row(
        size, dtype, pictures, count, None if failed[0] else together,
        None if failed[1] else one / len(few) * count, used, note,
    )  # fmt: skip


def _timed(work: Callable[[], list[Any]]) -> tuple[float, list[Any]]:
    """Return the median of the seconds that it takes, once it is warm, and what it returns. Answers are numbers of
    ours, so that the GPU is done with them."""
    answers, taken = work(), []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        answers = work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken), answers


def _drawn(size: str, dtype: str, device: str, folder: Path) -> tuple[Any, Any]:
    """Return a model with random weights, asked in both ways. What is not a weight (tokenizer, processor and chat
    template) is that of a tiny checkpoint, which is made in `folder`."""
    import torch
    from transformers import LlavaOnevisionConfig, LlavaOnevisionForConditionalGeneration, SiglipVisionConfig

    from executive.s3e.backends.checkpoint import find
    from executive.s3e.backends.loading import Loaded, load_processor
    from executive.s3e.backends.transformers_backend import TransformersBackend
    from tests.executive.s3e.checkpoints import Size, build

    shape, small = SHAPES[size], folder / "parts"
    if not small.exists():
        build("llava-onevision", small, size=Size(picture=shape.picture))
    parts = LlavaOnevisionConfig.from_pretrained(small)
    vision = SiglipVisionConfig(
        hidden_size=shape.vision_width, intermediate_size=shape.vision_inner, num_hidden_layers=shape.vision_layers,
        num_attention_heads=shape.vision_heads, image_size=shape.picture, patch_size=14, vision_use_head=False,
    )  # fmt: skip
    language = {
        **parts.text_config.to_dict(), "vocab_size": shape.vocabulary, "hidden_size": shape.width,
        "intermediate_size": shape.inner, "num_hidden_layers": shape.layers, "num_attention_heads": shape.heads,
        "num_key_value_heads": shape.key_value_heads, "max_position_embeddings": 32_768,
        "layer_types": ["full_attention"] * shape.layers,
    }  # fmt: skip
    config = LlavaOnevisionConfig(
        vision_config=vision.to_dict(), text_config=language, image_token_index=parts.image_token_index,
        video_token_index=parts.video_token_index, image_grid_pinpoints=parts.image_grid_pinpoints,
    )  # fmt: skip
    torch.manual_seed(0)
    before = torch.get_default_dtype()
    torch.set_default_dtype(getattr(torch, dtype))
    try:
        with torch.device(device):
            model = LlavaOnevisionForConditionalGeneration(config).eval().requires_grad_(False)
    finally:
        torch.set_default_dtype(before)
    loaded = Loaded(model, load_processor(find(small)), device, dtype)
    return (
        TransformersBackend.around(loaded, size, small, "shared"),
        TransformersBackend.around(loaded, size, small, "one by one"),
    )


def _images(count: int, side: int) -> list[Image]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (side, side, 3), dtype=np.uint8) for _ in range(count)]


def _questions(count: int) -> list[str]:
    every = [f"Is the {item} on the {place}?" for item in ITEMS for place in PLACES]
    return [every[index % len(every)] for index in range(count)]


def printed(rows: Sequence[Row]) -> str:
    """Return the table in Markdown."""
    lines = [
        "| size | dtype | pictures | questions | look, s | one at a time, s | times | GPU, GiB |",
        "|---" * 8 + "|",
    ]

    def shown(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    for row in rows:
        cells = shown(row.shared, ".3f"), shown(row.alone, ".3f"), shown(row.ratio, ".1f"), shown(row.gibibytes, ".1f")
        lines.append(f"| {row.size} | {row.dtype} | {row.pictures} | {row.questions} | {' | '.join(cells)} |")
    notes = dict.fromkeys(f"- {row.size}, {row.dtype}, {row.questions}: {row.note}" for row in rows if row.note)
    return "\n".join([*lines, *(["", *notes] if notes else [])])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", nargs="+", choices=SHAPES, default=["0.5B", "7B"])
    parser.add_argument(
        "--dtypes", nargs="+", choices=("float16", "bfloat16", "float32"), default=["float16", "bfloat16"]
    )
    parser.add_argument("--questions", nargs="+", type=int, default=[1, 5, 25, 100, 500])
    parser.add_argument("--pictures", type=int, default=2)
    parser.add_argument("--device", default="auto", help="where to compute; by default a GPU, or nowhere")
    parser.add_argument("--json", action="store_true", help="print the rows for programs")
    arguments = parser.parse_args()
    if min(*arguments.questions, arguments.pictures) < 1:
        parser.error("--questions and --pictures: 1 or more")
    why = missing(arguments.device)
    if why:
        print(json.dumps({"skipped": why}) if arguments.json else f"skipped: {why}")
        return
    rows = []
    for row in measure(arguments.sizes, arguments.dtypes, arguments.questions, arguments.pictures, arguments.device):
        print(f"{row.size} {row.dtype} {row.questions} ...", file=sys.stderr, flush=True)
        rows.append(row)
    made = [{**asdict(row), "ratio": row.ratio} for row in rows]
    print(json.dumps({"device": _device_name(arguments.device), "rows": made}, indent=2) if arguments.json
          else f"{printed(rows)}\n\n{_device_name(arguments.device)}")  # fmt: skip


def _device_name(device: str) -> str:
    import torch
    import transformers

    from executive.s3e.backends.loading import choose_device

    place = choose_device(device)
    name = torch.cuda.get_device_name(place) if place.startswith("cuda") else place
    return f"{name}, torch {torch.__version__}, transformers {transformers.__version__}"


if __name__ == "__main__":
    main()
