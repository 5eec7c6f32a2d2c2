"""The model card of a trained model, in the format of model hubs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from executive.domain.loader import Domain
from executive.lab.training.presets import Preset

_HEAD = """---
license: apache-2.0
library_name: transformers
pipeline_tag: image-text-to-text
tags:
- robotics
- state-estimation
- simulation
---
"""

_BODY = """# A vision-language model for {title}

A vision-language model of {millions:.1f} million parameters that answers yes/no questions about pictures of one
simulated scene: `{name}`. It is a `FastVlmForConditionalGeneration` (a ResNet, and a Qwen2 of {layers} layers,
{hidden} wide) that `AutoModelForImageTextToText.from_pretrained` loads without any code but that of transformers.

It is **in-domain, not zero-shot**: it was trained {start} on pictures of this scene alone, and knows {knows},
and {cameras}. Its answers about anything else mean nothing.{untold}

## How it was trained

`{command}`

| stage | what is learned | steps | per step |
|---|---|---|---|
| pictures | rendered samples, with the item of each pixel | {moments:,} moments | {per_moment} |
| tower | the vision encoder: items of each cell, and their atoms | {tower:,} | {batch} pictures |
| language | the decoder, on scenes without pictures | {language:,} | {imagined} scenes x {questions} questions |
| together | all parts on pictures, questions, answers | {together:,} | {scenes} scenes x {questions} questions |
| fewer | the same, half of the steps with fewer cameras | {fewer:,} | {scenes} scenes x {questions} questions |

Seed {seed}. The samples show items upright, tipped, on the floor, touching, held in many grips, half gripped and let
go, with the arm at home and anywhere else; lights, colours, camera poses, noise, blur and JPEG vary. The wordings of
its questions are in the domain's `wordings.toml`.

## How it is asked

Pictures first, {side} pixels square each, then the system prompt, then the question; the answer is read off the
probabilities of *yes* and *no*. `executive run {name} --vlm FOLDER` does that, and `executive eval` measures it.
"""


_UNTOLD = """

Objects are asked about by their descriptions. Combinations that are `held_out` in the domain's `problems.toml` were in
no picture and in no question of the training. It was not trained on atoms without translation (`--translator none`)."""


def render(
    domain: Domain,
    preset: Preset,
    cameras: int,
    parameters: int,
    seed: int,
    command: str,
    start: str | None = None,
    described: bool = False,
) -> str:
    """The text of the card, without the results of an evaluation. `start` is the name of the model that the training
    started from, and `described` whether objects change from problem to problem and are described by attributes."""
    knows = f"these items and questions about {len(domain.task.atoms)} atoms"
    numbers: Mapping[str, Any] = {
        "title": domain.title,
        "name": domain.name,
        "millions": parameters / 1e6,
        "layers": preset.size.layers,
        "hidden": preset.size.hidden,
        "side": preset.size.side,
        "cameras": "its one camera" if cameras == 1 else f"these {cameras} cameras in this order",
        "per_moment": f"{cameras} camera{'s' * (cameras != 1)}",
        "knows": "the values of these attributes and questions about objects that have them" if described else knows,
        "untold": _UNTOLD if described else "",
        "command": command,
        "start": "from scratch" if start is None else f"from the weights of `{start}`",
        "moments": preset.shards * preset.moments,
        "tower": preset.tower.steps,
        "language": preset.language.steps,
        "together": preset.together.steps,
        "fewer": preset.fewer.steps,
        "batch": preset.batch,
        "imagined": preset.imagined,
        "scenes": preset.scenes,
        "questions": preset.questions,
        "seed": seed,
    }
    return _HEAD + "\n" + _BODY.format(**numbers)
