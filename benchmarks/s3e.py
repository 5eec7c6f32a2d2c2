"""Held against the paper's authors' own package, `s3e` 0.5.0: the same answers, and how much faster.

`python -m benchmarks.s3e` prints both tables (some minutes), `--only same` or `--only faster` one of them, and `--json
FILE` writes the numbers, too. It wants the extra `judge` (pip install 'executive[judge]').

Same answers: random weights in four real architectures, one and two pictures. The judge gets the same checkpoint, the
same pictures, system prompt and questions; that it renders the very same prompts is checked. The masses of yes and no
are compared beside P(true), because the judge says P = 0.5 where a model answers neither. One thing is not its own:
where torchvision is missing, its loading fails at the processors' video part, and it is handed the processor that we
load without that.

Faster: a LLaVA-OneVision of more than 100 M parameters, one picture of about 1,500 tokens, 25 questions of 30 tokens.
Floating-point operations are counted while each side answers, and put beside the time that they would take at the
rate that this machine multiplies matrices with.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from executive.s3e.backends.checkpoint import find
from executive.s3e.backends.interface import Answer
from executive.s3e.backends.loading import load_processor
from executive.s3e.backends.transformers_backend import TransformersBackend, TransformersLook
from executive.types import Image
from tests.executive.s3e.checkpoints import FAMILIES, Size, build

SYSTEM = (
    "A curious human is asking an artificial intelligence assistant yes or no questions. "
    "The assistant answers with one of three responses: YES or NO. "
    "The assistant's response should not include any additional text."
)
ITEMS = ("milk carton", "bread loaf", "lemon", "soda can", "cereal box", "water bottle")
TABLES = ("wooden table", "black table", "white table")
PLAIN = tuple(f"Is the {item} on the {table}?" for item in ITEMS for table in TABLES) + tuple(
    f"Is the robot gripper holding the {item}?" for item in ITEMS
)
QUESTIONS = (*PLAIN, "Is the gripper of the robot empty?")

LARGE = Size(
    width=768,
    layers=12,
    heads=12,
    inner=2048,
    vision_width=512,
    vision_layers=12,
    vision_heads=8,
    picture=378,
    patch=14,
)
"""A picture of 378 pixels is 27 x 27 patches, as in the paper's models; taken once whole and once as its own only part,
and with a newline per row, it becomes 1,485 tokens."""


class Judge:
    """s3e 0.5.0 on a checkpoint, asked as its own engine asks."""

    def __init__(self, folder: Path) -> None:
        from s3e.backends import huggingface
        from transformers.utils import logging as chatter

        chatter.disable_progress_bar()
        theirs = huggingface.AutoProcessor

        class Processors:
            """AutoProcessor, or what we load where that wants torchvision."""

            @staticmethod
            def from_pretrained(name: str) -> Any:
                try:
                    return theirs.from_pretrained(name)
                except ImportError:
                    return load_processor(find(name))

        huggingface.AutoProcessor = Processors
        try:
            self.vlm = huggingface.HuggingFaceVLM(str(folder), device_map=None)  # "auto" would want accelerate
        finally:
            huggingface.AutoProcessor = theirs

    def ask(self, images: Sequence[Image], questions: Sequence[str], system: str = SYSTEM) -> list[Answer]:
        """Its masses as our answers; P(true) is left to `probability`, so that there is no 0.5 in it."""
        from PIL.Image import fromarray
        from s3e.engine import QueryEngine

        engine = QueryEngine(self.vlm, system_prompt=system)
        pictures = [fromarray(image) for image in images]
        predictions = engine.ask(pictures, list(questions))
        prompts = [self.vlm._render_prompt(pictures, question, system) for question in questions]
        return [
            Answer(prompt, predictions[question].masses["yes"], predictions[question].masses["no"])
            for prompt, question in zip(prompts, questions, strict=True)
        ]

    def tokens(self, images: Sequence[Image], prompt: str) -> list[int]:
        """What the model takes for a rendered prompt."""
        from PIL.Image import fromarray

        inputs = self.vlm.processor(text=[prompt], images=[[fromarray(image) for image in images]])
        return list(inputs["input_ids"][0])


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far two sets of answers to the same questions are apart, at most."""

    probability: float
    mass: float

    @classmethod
    def between(cls, ours: Sequence[Answer], theirs: Sequence[Answer]) -> Agreement:
        assert [answer.prompt for answer in ours] == [answer.prompt for answer in theirs], "not the same prompts"
        pairs = list(zip(ours, theirs, strict=True))
        return cls(
            max(abs(p_true(a) - p_true(b)) for a, b in pairs),
            max(max(abs(a.yes_mass - b.yes_mass), abs(a.no_mass - b.no_mass)) for a, b in pairs),
        )


def p_true(answer: Answer) -> float:
    value = answer.probability()
    assert value is not None, answer.error or "no mass at all"
    return value


def pictures(count: int, seed: int = 0, height: int = 72, width: int = 96) -> list[Image]:
    """Pictures with something in them: blocks of colour, not noise that every model averages away."""
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 256, (count, 6, 8, 3), dtype=np.uint8)
    return [np.kron(image, np.ones((height // 6, width // 8, 1), np.uint8)) for image in small]


def same(folder: Path, families: Sequence[str]) -> list[dict[str, Any]]:
    """The first table's rows."""
    rows = []
    for family in families:
        checkpoint = build(family, folder / family)
        ours, judge = TransformersBackend(checkpoint), Judge(checkpoint)
        for count in (1, 2):
            shown = pictures(count)
            look = ours.look(shown, SYSTEM)
            answers = look.ask(QUESTIONS)
            apart = Agreement.between(answers, judge.ask(shown, QUESTIONS))
            rows.append(
                {
                    "family": family,
                    "pictures": count,
                    "path": look.path,
                    "P(true)": apart.probability,
                    "mass": apart.mass,
                    "permuted": _reordered(look, answers, list(np.random.default_rng(1).permutation(len(QUESTIONS)))),
                    "subset": _reordered(look, answers, list(range(0, len(QUESTIONS), 3))),
                    "spread": float(np.ptp([p_true(answer) for answer in answers])),
                }
            )
    return rows


def _reordered(look: TransformersLook, answers: Sequence[Answer], order: Sequence[int]) -> float:
    again = look.ask([QUESTIONS[index] for index in order])
    return Agreement.between(again, [answers[index] for index in order]).probability


def long_questions(tokenizer: Any, count: int, tokens: int = 30) -> list[str]:
    """Questions of that many tokens each, every one different."""
    words = " ".join((*ITEMS, *TABLES)).split()
    rng = np.random.default_rng(0)
    made: dict[str, None] = {}
    while len(made) < count:
        drawn = ["Is", *rng.choice(words, tokens)]
        while len(tokenizer.encode(" ".join(drawn) + "?", add_special_tokens=False)) > tokens:
            drawn.pop()
        made[" ".join(drawn) + "?"] = None
    return list(made)


def faster(folder: Path, most: int) -> dict[str, Any]:
    """The second table's numbers."""
    import torch

    build("llava-onevision", folder, size=LARGE)
    ours, judge = TransformersBackend(folder), Judge(folder)
    shown = [pictures(1, seed, 378, 384) for seed in range(3)]

    def look_and_ask(images: Sequence[Image], questions: Sequence[str]) -> list[Answer]:
        with ours.look(images, SYSTEM) as look:
            return look.ask(questions)

    questions = long_questions(judge.vlm.processor.tokenizer, 500)
    first = _timed(lambda: look_and_ask(shown[0], []))
    judge.ask(shown[0], questions[:1])
    rate, asked = [matrix_rate()], questions[:25]
    mine = [_timed(lambda: look_and_ask(shown[1], asked))]
    theirs = _timed(lambda: judge.ask(shown[1], asked))
    mine += [_timed(lambda: look_and_ask(shown[1], asked)) for _ in range(2)]
    rate.append(matrix_rate())
    tokens = judge.tokens(shown[1], mine[0].answers[0].prompt)
    operations = {
        "ours": _counted(lambda: look_and_ask(shown[1], asked)),
        "s3e": _counted(lambda: judge.ask(shown[1], asked[:1])) * len(asked),
    }
    return {
        "parameters": sum(weight.numel() for weight in judge.vlm.model.parameters()),
        "picture tokens": tokens.count(judge.vlm.model.config.image_token_id),
        "prompt tokens": len(tokens),
        "threads": torch.get_num_threads(),
        "GFLOP/s": median(rate) / 1e9,
        "P(true) apart": Agreement.between(mine[0].answers, theirs.answers).probability,
        "first look, seconds": first.seconds,
        "25 questions": {
            "ours": _row(*mine) | {"TFLOP": operations["ours"] / 1e12},
            "s3e": _row(theirs) | {"TFLOP": operations["s3e"] / 1e12},
        },
        "more questions": {
            count: {"ours": _row(_timed(partial(look_and_ask, shown[2], questions[:count])))}
            | ({"s3e": _row(_timed(partial(judge.ask, shown[2], questions[:count])))} if count <= most else {})
            for count in (10, 100, 500)
        },
    }


def _row(*runs: Timed) -> dict[str, float]:
    return {
        "seconds": median(run.seconds for run in runs),
        "processor seconds": median(run.processor for run in runs),
        "peak MB": runs[0].peak / 1e6,
    }


@dataclass(frozen=True, slots=True)
class Timed:
    """Answers, the seconds that they took (on the wall, and of all processors together), and the most memory in use
    meanwhile (bytes, the whole process)."""

    answers: list[Answer]
    seconds: float
    processor: float
    peak: float


def _timed(ask: Callable[[], list[Answer]]) -> Timed:
    with peak_memory() as peak:
        wall, processor = time.perf_counter(), time.process_time()
        answers = ask()
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return Timed(answers, wall, processor, max(peak))


@contextmanager
def peak_memory() -> Iterator[list[float]]:
    """The resident memory of this process in bytes, looked at every 10 ms (Linux; NaN elsewhere)."""
    import resource

    samples, done = [float("nan")], threading.Event()
    page = resource.getpagesize()

    def watch() -> None:
        while True:
            samples.append(int(Path("/proc/self/statm").read_text().split()[1]) * page)
            if done.wait(0.01):
                return

    watcher = threading.Thread(target=watch, daemon=True)
    if sys.platform == "linux":
        samples.clear()
        watcher.start()
    try:
        yield samples
    finally:
        done.set()
        if watcher.ident is not None:
            watcher.join()


def matrix_rate(size: int = 1536) -> float:
    """Floating-point operations a second when multiplying square matrices in float32: the best of some."""
    import torch

    one, another = torch.randn(size, size), torch.randn(size, size)
    best = float("inf")
    for _ in range(8):
        began = time.perf_counter()
        torch.mm(one, another)
        best = min(best, time.perf_counter() - began)
    return 2.0 * size**3 / best


def _counted(ask: Callable[[], Any]) -> int:
    """The floating-point operations of the matrix products in it."""
    import torch
    from torch.utils import flop_counter

    def attention(query: Any, key: Any, value: Any, *_: Any, **__: Any) -> int:
        return int(sdpa(query, key, value))

    sdpa: Any = flop_counter.sdpa_flop_count
    on_cpu = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu  # not among those that torch counts
    with flop_counter.FlopCounterMode(display=False, custom_mapping={on_cpu: attention}) as counter:
        ask()
    return int(counter.get_total_flops())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("same", "faster"))
    parser.add_argument("--families", nargs="*", default=FAMILIES, choices=FAMILIES, metavar="FAMILY")
    parser.add_argument(
        "--most", type=int, default=10, help="let s3e answer up to so many questions of 10, 100 and 500"
    )
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    numbers: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        if arguments.only != "faster":
            numbers["same"] = same(Path(folder), arguments.families)
            print_same(numbers["same"])
        if arguments.only != "same":
            numbers["faster"] = faster(Path(folder) / "large", arguments.most)
            print_faster(numbers["faster"])
    if arguments.json:
        arguments.json.write_text(json.dumps(numbers, indent=2) + "\n", "utf-8")


def print_same(rows: Sequence[dict[str, Any]]) -> None:
    print(
        f"Same answers: largest difference from s3e 0.5.0 in {len(QUESTIONS)} questions, and of ours among themselves"
    )
    print(f"{'':<18}{'pictures':>9}{'path':>9}{'P(true)':>10}{'mass':>10}{'permuted':>10}{'subset':>10}  P spans")
    for row in rows:
        numbers = "".join(f"{row[key]:>10.1e}" for key in ("P(true)", "mass", "permuted", "subset"))
        print(f"{row['family']:<18}{row['pictures']:>9}{row['path']:>9}{numbers}{row['spread']:>9.2f}")


def print_faster(numbers: dict[str, Any]) -> None:
    rate, sides = numbers["GFLOP/s"], numbers["25 questions"]
    print(
        f"\nFaster: {numbers['parameters'] / 1e6:.0f} M parameters, {numbers['picture tokens']} picture tokens, "
        f"{numbers['prompt tokens']} in all; {numbers['threads']} threads, {rate:.0f} GFLOP/s in a matrix product"
    )
    print(f"{'25 questions':<14}{'seconds':>10}{'processor s':>13}{'TFLOP':>8}{'s at that rate':>16}{'peak MB':>9}")
    for name in ("s3e", "ours"):
        side = sides[name]
        print(
            f"{name:<14}{side['seconds']:>10.2f}{side['processor seconds']:>13.2f}{side['TFLOP']:>8.2f}"
            f"{side['TFLOP'] * 1e3 / rate:>16.2f}{side['peak MB']:>9.0f}"
        )
    ratio = {key: sides["s3e"][key] / sides["ours"][key] for key in ("seconds", "processor seconds", "TFLOP")}
    print(
        f"{'ratio':<14}{ratio['seconds']:>10.1f}{ratio['processor seconds']:>13.1f}{ratio['TFLOP']:>8.1f}"
        f"   P(true) apart by {numbers['P(true) apart']:.1e}"
    )
    print(f"the first look of a model compares both ways of asking, and takes {numbers['first look, seconds']:.1f} s")
    print(f"\n{'questions':<14}{'':<6}{'seconds':>10}{'processor s':>13}{'peak MB':>9}")
    for count, sides in numbers["more questions"].items():
        for name, side in sides.items():
            print(
                f"{count:<14}{name:<6}{side['seconds']:>10.2f}{side['processor seconds']:>13.2f}{side['peak MB']:>9.0f}"
            )


if __name__ == "__main__":
    main()
