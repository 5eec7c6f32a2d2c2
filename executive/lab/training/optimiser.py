"""The training loop of a stage: AdamW with checkpoints, so that it can be stopped at any moment and resumed."""

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

from executive.lab.training.presets import Schedule
from executive.s3e.backends.loading import native_bfloat16

_SAVE_EVERY, _REPORT_EVERY = 30.0, 1.0
"""Seconds between two checkpoints (at most so much is lost when the process is killed), and between two reports."""

Metrics = Mapping[str, float]


class CancelledError(Exception):
    """Training was cancelled; its state has been saved."""


@dataclass(frozen=True, slots=True)
class Report:
    """The progress of a stage: `new` steps done in this process, their mean `seconds`, and the mean metrics of the
    steps since the last report."""

    stage: str
    step: int
    steps: int
    new: int
    seconds: float
    metrics: Metrics


def train_stage(
    stage: str,
    file: Path,
    parts: Mapping[str, nn.Module],
    schedule: Schedule,
    step_loss: Callable[[int, np.random.Generator], tuple[torch.Tensor, Metrics]],
    seed: int,
    watch: Callable[[Report], None] = lambda report: None,
    stopped: Callable[[], bool] = lambda: False,
    rates: Mapping[str, float] | None = None,
) -> None:
    """Trains the parts in place to the end of a stage, from the checkpoint `file` where that exists.

    Args:
        step_loss: returns the loss of a step and its metrics, given its number and random generator.
        rates: part -> factor of the learning rate, where it is not 1.

    Raises:
        CancelledError: `stopped` said so; the state is saved.
        FloatingPointError: the loss is not a number.
    """
    groups = [
        {"params": list(part.parameters()), "share": (rates or {}).get(name, 1.0)} for name, part in parts.items()
    ]
    optimizer = torch.optim.AdamW(groups, lr=schedule.rate, weight_decay=schedule.decay, betas=(0.9, 0.98))
    begin = _restored(file, parts, optimizer)
    metrics: list[Metrics] = []
    began = since = saved = time.monotonic()
    for step in range(begin, schedule.steps):
        for group in optimizer.param_groups:
            group["lr"] = schedule.at(step) * group["share"]
        sequence = np.random.SeedSequence([seed, step])
        torch.manual_seed(int(sequence.generate_state(1)[0]))
        loss, values = step_loss(step, np.random.default_rng(sequence))
        if not math.isfinite(float(loss.detach())):
            raise FloatingPointError(f"{stage}: the loss of step {step} is not a number")
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        for group in optimizer.param_groups:
            nn.utils.clip_grad_norm_(group["params"], schedule.clip)
        optimizer.step()
        metrics.append(values)
        done, stop, now = step + 1, stopped(), time.monotonic()
        if stop or done == schedule.steps or now - saved > _SAVE_EVERY:
            _save(file, parts, optimizer, done)
            saved = time.monotonic()
        if stop or done == schedule.steps or now - since > _REPORT_EVERY:
            watch(Report(stage, done, schedule.steps, done - begin, (now - began) / (done - begin), _mean(metrics)))
            metrics, since = [], time.monotonic()
        if stop:
            raise CancelledError(stage)


def use_threads(count: int | None) -> None:
    """Sets the number of torch's threads; leaves torch's default if not given."""
    if count is not None:
        torch.set_num_threads(count)


def compute_dtype(device: torch.device) -> torch.dtype:
    """The dtype in which the layers compute: bfloat16, unless the CPU would have to emulate it."""
    return torch.float32 if device.type == "cpu" and not native_bfloat16() else torch.bfloat16


def autocast(device: torch.device) -> torch.autocast:
    """A context in which layers compute in `compute_dtype`."""
    dtype = compute_dtype(device)
    return torch.autocast(device.type, torch.bfloat16, enabled=dtype != torch.float32)


def finished(file: Path, steps: int) -> bool:
    """Whether the checkpoint of a stage is that of its last step."""
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


def _mean(metrics: list[Metrics]) -> dict[str, float]:
    names = dict.fromkeys(name for values in metrics for name in values)
    arrays = {name: np.array([values[name] for values in metrics if name in values]) for name in names}
    return {name: float(np.nanmean(array)) if np.isfinite(array).any() else math.nan for name, array in arrays.items()}
