"""The shipped model on the looks of a collection: as they are, and with pictures made bad until it is right about the
whole state in half of them. What was answered is kept, and not asked again."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from executive.app.config import EstimatorConfig
from executive.app.estimators import with_default_model
from executive.domain.loader import load_domain
from executive.faults.image_noise import SPOILED, most
from executive.lab.common.process_pool import ProcessPool
from executive.lab.common.progress import Progress, estimate
from executive.lab.config import EvalConfig
from executive.lab.evaluation import store
from executive.lab.evaluation.evaluate import Evaluation, Evaluator
from executive.lab.evaluation.looks import Look, Opened, Said
from executive.s3e import calibration_file

HALF, NEAR = 0.5, 0.05
"""The exact-state rate that is looked for, and what is near enough."""

TRIES, TRIED = 8, 200
"""How many amounts are tried, on how many looks each."""

_LARGEST = {"blurred": 24.0}
"""Where the search begins: with this much, or all there can be, no answer is right."""


class Asked(NamedTuple):
    """What the model said of a collection. `spoiled` is how its pictures were: such as blurred=5, or nothing at all."""

    spoiled: str
    evaluation: Evaluation


def shipped() -> str:
    """Tells the model that comes with the domain, as it answers, from another one."""
    folder = Path(str(with_default_model(EstimatorConfig(), load_domain("grocery").subject).vlm))
    content = hashlib.sha256()
    for file in sorted(path for path in folder.iterdir() if path.name not in (calibration_file.FILE, "README.md")):
        content.update(file.name.encode() + file.read_bytes())
    content.update(repr(calibration_file.read(folder).correction).encode())
    return content.hexdigest()[:12]


def asked(data: Path, looks: int | None, out: Path, jobs: int) -> list[Asked]:
    """The estimator on the first so many `looks` of a collection (all if None), as they are and spoiled in each way.

    Raises:
        InputError: the collection is none, or of another problem.
    """
    names = ["", *SPOILED]
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        return list(pool.map(partial(_asked, data, looks, out / shipped() / data.resolve().name), names))


def exact(evaluation: Evaluation) -> float:
    """The share of looks whose whole state is right at the threshold 0.5; what is not answered is false."""
    said = evaluation.answers
    return float(((said.probability >= 0.5) == said.truth).all(axis=1).mean())


def found(rate: Callable[[float], float], least: float, largest: float) -> float:
    """An amount between the two at which `rate`, which falls with it, is near enough to `HALF`; or the nearest that was
    tried."""
    tried: dict[float, float] = {}
    for _ in range(TRIES):
        amount = float(f"{(least + largest) / 2:.3g}")
        tried[amount] = rate(amount)
        if abs(tried[amount] - HALF) <= NEAR:
            break
        least, largest = (amount, largest) if tried[amount] > HALF else (least, amount)
    return min(tried, key=lambda amount: abs(tried[amount] - HALF))


def _asked(data: Path, looks: int | None, out: Path, way: str) -> Asked:
    if not way:
        return Asked("", _evaluation(data, looks, out, ""))
    tried = TRIED if looks is None else min(TRIED, looks)
    amount = found(
        lambda amount: exact(_evaluation(data, tried, out, f"{way}={amount:g}")), 0.0, _LARGEST.get(way, most(way))
    )
    spoiled = f"{way}={amount:g}"
    return Asked(spoiled, _evaluation(data, looks, out, spoiled))


def _evaluation(data: Path, looks: int | None, out: Path, spoiled: str) -> Evaluation:
    folder = out / f"{spoiled or 'as-they-are'}-{'all' if looks is None else looks}"
    if not (folder / store.RESULTS).is_file():
        folder.mkdir(parents=True, exist_ok=True)
        config = EvalConfig("grocery", data, EstimatorConfig(), looks=looks, disturb=(spoiled,) if spoiled else ())
        with Evaluator(config) as evaluator, ProcessPool[Look, Opened | Said](evaluator.looker, 1) as pool:
            made = evaluator.run(pool, watch=_watch(spoiled or "as they are"))
        assert made is not None  # nobody cancels it
        store.save(folder, made)
        print(f"{spoiled or 'as they are'}: whole state right in {exact(made):.1%} of {len(made.looks)} looks",
              file=sys.stderr, flush=True)  # fmt: skip
    return store.load(folder)


def _watch(name: str) -> Callable[[Progress], None]:
    def tell(now: Progress) -> None:
        if now.new and now.points % 100 == 0 and now.points < now.wanted:
            print(f"{name}: {now.points} of {now.wanted} looks  {estimate(now)}", file=sys.stderr, flush=True)

    return tell
