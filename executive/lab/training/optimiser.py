"""Gradient descent that can be stopped at any moment and gone on with: what every stage of training is run by."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from executive.lab.training.presets import Pace

_SAVED, _TOLD = 30.0, 1.0
"""Seconds between two saves, which is all that a kill costs, and between two reports."""

Told = Mapping[str, float]


class CancelledError(Exception):
    """Training was asked to stop; it has been saved."""


@dataclass(frozen=True, slots=True)
class Report:
    """How far a stage is, for those who watch: how many steps it has done in this process, how many seconds each of
    these took, and what the last ones came to on average."""

    stage: str
    step: int
    steps: int
    new: int
    seconds: float
    told: Told


def descend(
    stage: str,
    file: Path,
    parts: Mapping[str, nn.Module],
    pace: Pace,
    one: Callable[[int, np.random.Generator], tuple[torch.Tensor, Told]],
    seed: int,
    watch: Callable[[Report], None] = lambda report: None,
    stopped: Callable[[], bool] = lambda: False,
    rates: Mapping[str, float] | None = None,
) -> None:
    """Run a stage to its end, going on from `file` where that exists; the parts then are what the stage made of them.

    Args:
        one: makes the loss of a step, given its number and the chance that belongs to it, and tells how good it was.
        rates: part -> share of the pace's rate, where it is not 1.

    Raises:
        CancelledError: `stopped` said so; the state is saved.
        FloatingPointError: the loss is not a number.
    """
    groups = [
        {"params": list(part.parameters()), "share": (rates or {}).get(name, 1.0)} for name, part in parts.items()
    ]
    optimizer = torch.optim.AdamW(groups, lr=pace.rate, weight_decay=pace.decay, betas=(0.9, 0.98))
    begin = _restored(file, parts, optimizer)
    told: list[Told] = []
    began = since = saved = time.monotonic()
    for step in range(begin, pace.steps):
        for group in optimizer.param_groups:
            group["lr"] = pace.at(step) * group["share"]
        sequence = np.random.SeedSequence([seed, step])
        torch.manual_seed(int(sequence.generate_state(1)[0]))
        loss, news = one(step, np.random.default_rng(sequence))
        if not math.isfinite(float(loss.detach())):
            raise FloatingPointError(f"{stage}: the loss of step {step} is not a number")
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        for group in optimizer.param_groups:
            nn.utils.clip_grad_norm_(group["params"], pace.clip)
        optimizer.step()
        told.append(news)
        done, stop, now = step + 1, stopped(), time.monotonic()
        if stop or done == pace.steps or now - saved > _SAVED:
            _save(file, parts, optimizer, done)
            saved = time.monotonic()
        if stop or done == pace.steps or now - since > _TOLD:
            watch(Report(stage, done, pace.steps, done - begin, (now - began) / (done - begin), _mean(told)))
            told, since = [], time.monotonic()
        if stop:
            raise CancelledError(stage)


def use_threads(count: int | None) -> None:
    """Compute with so many threads; as torch has it when not given."""
    if count is not None:
        torch.set_num_threads(count)


def finished(file: Path, steps: int) -> bool:
    """Whether a stage has been run to its end."""
    return file.exists() and int(torch.load(file, weights_only=True, map_location="cpu")["step"]) >= steps


def _restored(file: Path, parts: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer) -> int:
    if not file.exists():
        return 0
    saved = torch.load(file, weights_only=True, map_location="cpu")
    for name, part in parts.items():
        part.load_state_dict(saved["parts"][name])
    optimizer.load_state_dict(saved["optimizer"])
    return int(saved["step"])


def _save(file: Path, parts: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer, step: int) -> None:
    state: dict[str, Any] = {
        "step": step,
        "parts": {name: part.state_dict() for name, part in parts.items()},
        "optimizer": optimizer.state_dict(),
    }
    passing = file.with_name(f".{file.name}.{os.getpid()}")
    torch.save(state, passing)
    passing.replace(file)


def _mean(told: list[Told]) -> dict[str, float]:
    names = dict.fromkeys(name for news in told for name in news)
    values = {name: np.array([news[name] for news in told if name in news]) for name in names}
    return {name: float(np.nanmean(value)) if np.isfinite(value).any() else math.nan for name, value in values.items()}
