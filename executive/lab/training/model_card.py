"""The card that lies beside a grown eye, in the form that model hubs read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from executive.domain.loader import Domain
from executive.lab.training.presets import Recipe

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

_BODY = """# An eye for {title}

A vision-language model of {millions:.1f} million parameters that answers yes/no questions about pictures of one
simulated scene: `{name}`. It is a `FastVlmForConditionalGeneration` (a ResNet, and a Qwen2 of {layers} layers,
{hidden} wide) that `AutoModelForImageTextToText.from_pretrained` loads without any code but that of transformers.

It is **in-domain, not zero-shot**: it was grown from nothing on pictures of this scene alone, knows these items, these
{cameras} cameras in this order, and questions about {atoms} atoms. Of anything else it knows nothing, and says so of
nothing: it answers all the same.

## How it was grown

`{command}`

| stage | what | steps | a step |
|---|---|---|---|
| pictures | moments drawn by the simulator, with what each pixel shows | {moments:,} moments | {cameras} cameras |
| tower | which items each cell shows, and what is true of each | {tower:,} | {batch} pictures |
| language | to look words up, in scenes only imagined | {language:,} | {scenes} scenes x {questions} questions |
| together | pictures, questions, answers | {together:,} | {scenes} scenes x {questions} questions |
| fewer | the same, every other step with some of the pictures | {fewer:,} | {scenes} scenes x {questions} questions |

Seed {seed}. The moments show items upright, tipped, on the floor, touching, held in many grips, half gripped and let
go, with the arm at home and anywhere else; lights, shades, cameras' places, grain, blur and JPEG vary. What it was
asked is in the domain's `wordings.toml`.

## How it is asked

Pictures first, {side} pixels square each, then the system prompt, then the question; the answer is read off the
probabilities of *yes* and *no*. `executive run {name} --vlm FOLDER` does that, and `executive eval` measures it.
"""


def render(domain: Domain, recipe: Recipe, cameras: int, parameters: int, seed: int, command: str) -> str:
    """The card, but for what an evaluation says."""
    numbers: Mapping[str, Any] = {
        "title": domain.title,
        "name": domain.name,
        "millions": parameters / 1e6,
        "layers": recipe.size.layers,
        "hidden": recipe.size.hidden,
        "side": recipe.size.side,
        "cameras": cameras,
        "atoms": len(domain.task.atoms),
        "command": command,
        "moments": recipe.shards * recipe.moments,
        "tower": recipe.tower.steps,
        "language": recipe.language.steps,
        "together": recipe.together.steps,
        "fewer": recipe.fewer.steps,
        "batch": recipe.batch,
        "scenes": recipe.scenes,
        "questions": recipe.questions,
        "seed": seed,
    }
    return _HEAD + "\n" + _BODY.format(**numbers)
