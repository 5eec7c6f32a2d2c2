"""Train a policy that takes an item, by imitating a skill's demonstrations (behaviour cloning).

python -m examples.learned_pick.train DATA --out pick.safetensors

DATA is a finished collection (executive collect DOMAIN --demonstrations --out DATA). Only demonstrations with a single
grip are used, up to where the item is lifted: how the arm makes room first, or goes home, is not the policy's to learn.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from safetensors.torch import save_file
from scipy.spatial.transform import Rotation

from executive import ExecutiveError, InputError
from executive.export import Demonstration, read_demonstrations
from executive.skills import POLICY_FORMAT, Sensed, turned

HIDDEN = (128, 128)
EPOCHS, BATCH, RATE, DECAY = 60, 512, 2e-3, 1e-4
AHEAD = 3
"""Samples by which the policy closes the fingers sooner than the demonstration: in these, the hand waits already."""
COPIES, ASIDE, TURNED, HOLDING = 10, 0.015, 0.06, 0.2
"""Each moment is shown as it was, and so often with the hand off by a normal error (in m and rad, and less by a factor
while the fingers close or hold) and the motion back to where it was next. How to go on from a mistake of its own is
what a policy that only saw good motions does not know. In these, the item's axes are any of those that its box may
have."""


class Taken(NamedTuple):
    """One moment of a demonstration: what a policy is given, and the motion (6,) and closing that it should want."""

    features: np.ndarray
    motion: np.ndarray
    closes: bool


def moments(demonstration: Demonstration, rng: np.random.Generator) -> Iterator[Taken]:
    """The moments from the opened hand to the lifted item; none where the demonstration is not of one grip."""
    phases = [phase for phase, _ in groupby(demonstration.samples, key=lambda sample: sample.phase)]
    if phases.count("grip") != 1 or "lift" not in phases or not demonstration.located:
        return
    last = max(at for at, sample in enumerate(demonstration.samples) if sample.phase == "lift")
    seen = demonstration.located[0]
    item = transform(seen.pose)
    samples = [each for each in demonstration.samples[: last + 1] if each.time >= seen.time]
    for at, (now, then) in enumerate(pairwise(samples)):
        hand, later = transform(now.hand), transform(then.hand)
        scale = HOLDING if is_closed(now.command) else 1.0
        for copy in range(COPIES + 1):
            off = np.eye(4)
            if copy:
                off[:3, :3] = Rotation.from_rotvec(rng.normal(0, scale * TURNED, 3)).as_matrix()
                off[:3, 3] = rng.normal(0, scale * ASIDE, 3)
            moved = np.linalg.inv(hand @ off) @ later
            motion = np.array([*moved[:3, 3], *Rotation.from_matrix(moved[:3, :3]).as_rotvec()])
            sensed = Sensed(hand @ off, now.gripper, float(now.command[-1]))
            soon = samples[min(at + AHEAD, len(samples) - 1)]
            described = turned(item, seen.centre, rng) if copy else item
            yield Taken(sensed.features(described, seen.half, seen.centre), motion, is_closed(soon.command))


def transform(pose: np.ndarray) -> np.ndarray:
    """The transform (4, 4) of a pose (7,): m, then quaternion w, x, y, z."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(pose[[4, 5, 6, 3]]).as_matrix()
    found[:3, 3] = pose[:3]
    return found


def is_closed(command: np.ndarray) -> bool:
    """Whether the fingers are told to close, or are about to be."""
    return bool(command[-1] > 0.1)


def fit(taken: Sequence[Taken], seed: int) -> dict[str, torch.Tensor]:
    """Train the network, and return what its file has."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # so small a network is slower on more, and other numbers come of it
    features, motions, closes = (
        torch.tensor(np.array([each[at] for each in taken]), dtype=torch.float32) for at in range(3)
    )
    tensors: dict[str, torch.Tensor] = {}
    for name, values, least in (("features", features, 1e-3), ("motion", motions, 1e-4)):
        tensors |= {f"{name}.mean": values.mean(0), f"{name}.deviation": values.std(0).clamp_min(least)}
    features = (features - tensors["features.mean"]) / tensors["features.deviation"]
    motions = (motions - tensors["motion.mean"]) / tensors["motion.deviation"]
    sizes = (features.shape[1], *HIDDEN, motions.shape[1] + 1)
    layers: list[torch.nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [torch.nn.Linear(before, after), torch.nn.ReLU()]
    network = torch.nn.Sequential(*layers[:-1])
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    steps = EPOCHS * -(-len(features) // BATCH)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for epoch in range(EPOCHS):
        total = 0.0
        for some in torch.split(torch.randperm(len(features)), BATCH):
            wanted = network(features[some])
            loss = torch.nn.functional.smooth_l1_loss(wanted[:, :-1], motions[some])
            loss = loss + 0.2 * torch.nn.functional.binary_cross_entropy_with_logits(wanted[:, -1], closes[some])
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()
            total += loss.item() * len(some)
        if epoch % 50 == 49:
            print(f"epoch {epoch + 1}: loss {total / len(features):.4f}", file=sys.stderr)
    with torch.no_grad():
        left = (network(features)[:, :-1] - motions) * tensors["motion.deviation"]
    tensors["motion.noise"] = left.abs().median(0).values / 0.6745  # the deviation, but for a few that are far off
    linear = [layer for layer in network if isinstance(layer, torch.nn.Linear)]
    for number, layer in enumerate(linear):
        tensors |= {f"weight.{number}": layer.weight.detach(), f"bias.{number}": layer.bias.detach()}
    return tensors


def main() -> None:
    parser = argparse.ArgumentParser(description="Train a policy that takes an item from demonstrations.")
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="the file to write")
    parser.add_argument("--action", default="pick")
    parser.add_argument("--most", type=int, help="only so many demonstrations")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    try:
        shown = [each for each in read_demonstrations(arguments.data) if each.name == arguments.action]
        rng = np.random.default_rng(arguments.seed)
        used = [found for each in shown if (found := list(moments(each, rng)))][: arguments.most]
        if not used:
            raise InputError(f"shows no {arguments.action!r} with a single grip", file=arguments.data)
        times = np.concatenate([np.diff([sample.time for sample in each.samples]) for each in shown])
        taken = [moment for each in used for moment in each]
        print(f"{len(used)} demonstrations of {arguments.action}, {len(taken)} moments", file=sys.stderr)
        tensors = fit(taken, arguments.seed)
    except ExecutiveError as error:
        sys.exit(f"error: {error}")
    about = {
        "format": POLICY_FORMAT,
        "action": arguments.action,
        "period": round(float(np.median(times)), 4),
        "demonstrations": len(used),
        "collected": re.sub(r" --out \S+", "", json.loads((arguments.data / "dataset.json").read_text())["command"]),
    }
    save_file(tensors, arguments.out, {"executive": json.dumps(about)})
    print(arguments.out)


if __name__ == "__main__":
    main()
