"""Training that starts from a trained model: its vision encoder, projector and decoder, and the words that it knows.

A new domain has its own vocabulary. The embedding of a token that both have is copied; that of a new token stays as it
was drawn, with the length that the copied ones have.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from executive.app.estimators import SHIPPED, shipped
from executive.errors import InputError, OptionError, nearest
from executive.lab.training.presets import ModelSize
from executive.s3e.backends import checkpoint
from executive.s3e.backends.loading import quiet
from executive.s3e.backends.packages import importing
from executive.util.files import home, read_json

ARCHITECTURE = "fast_vlm"


def find(said: str) -> Path:
    """The folder of the model that is meant: a folder, or the domain of one that comes along.

    Raises:
        InputError: there is none, or it is no checkpoint.
    """
    folder = home(said)
    if not os.path.isdir(folder):
        there = shipped(said.removesuffix("-eye")) if "/" not in said else None
        if there is None:
            known = sorted(each.name for each in SHIPPED.iterdir() if each.is_dir())
            message = f"{said!r} is neither the folder of a model nor one that comes along; {nearest(said, known)}"
            raise OptionError(message, option="start")
        folder = there
    checkpoint.inspect(folder, folder.name)
    return folder


def check(folder: Path, size: ModelSize, recipe: str) -> None:
    """Check that a model has the architecture that a recipe makes, and that its vision encoder begins as the recipe's
    does, whatever else it has.

    Raises:
        InputError: it has another one; the first difference is named.
    """
    file = folder / checkpoint.CONFIG
    kind = read_json(file).get("model_type")
    if kind != ARCHITECTURE:
        raise InputError(
            f"is a model of the type {kind!r}, and a training starts from {ARCHITECTURE!r} alone", file=file
        )
    found = _difference(folder, size, stages=len(size.widths))
    if found is not None:
        name, there, here = found
        raise InputError(
            f"is another model than the recipe {recipe!r} makes: {name} is {there} there and {here} here; "
            "choose the recipe that it was trained with",
            file=file,
        )


def is_alike(folder: Path, size: ModelSize) -> bool:
    """Whether all of a model's weights can be the first ones of a model of this size."""
    return _difference(folder, size) is None


def _difference(folder: Path, size: ModelSize, stages: int | None = None) -> tuple[str, Any, Any] | None:
    """The first difference between a model and a size: its name, what is there, and what is wanted. With `stages`, only
    so many stages of the vision encoder count."""
    config = read_json(folder / checkpoint.CONFIG)
    vision, text = (config.get(part) or {} for part in ("vision_config", "text_config"))
    pairs: dict[str, tuple[Any, Any]] = {
        "embedding_size": (vision.get("embedding_size"), size.stem),
        "hidden_sizes": (tuple(vision.get("hidden_sizes") or ())[:stages], size.widths),
        "depths": (tuple(vision.get("depths") or ())[:stages], size.depths),
    }
    if stages is None:
        processor = read_json(folder / "preprocessor_config.json")
        pairs = {
            "picture": ((processor.get("size") or {}).get("height"), size.side),
            **pairs,
            "hidden_size": (text.get("hidden_size"), size.hidden),
            "num_hidden_layers": (text.get("num_hidden_layers"), size.layers),
            "num_attention_heads": (text.get("num_attention_heads"), size.heads),
            "intermediate_size": (text.get("intermediate_size"), size.inner),
        }
    return next(((name, there, here) for name, (there, here) in pairs.items() if there != here), None)


def digest(folder: Path) -> str:
    """SHA-256 of the weights."""
    return hashlib.sha256((folder / checkpoint.WEIGHTS).read_bytes()).hexdigest()


def tokenizer_of(folder: Path) -> Any:
    """The tokenizer of the model in a folder."""
    with importing(), quiet():
        from transformers import AutoTokenizer

        return AutoTokenizer.from_pretrained(folder)


def begin(model: Any, tokenizer: Any, folder: Path, size: ModelSize) -> None:
    """Give a new model of this size the weights of the one in a folder: all of them, or those of its vision encoder."""
    if is_alike(folder, size):
        load(model, tokenizer, folder)
    else:
        load_vision(model, folder)


def load(model: Any, tokenizer: Any, folder: Path) -> None:
    """Give a new model the weights of one that is alike."""
    import torch

    known = tokenizer_of(folder).get_vocab()
    before = _read(folder)
    new = model.model.language_model.embed_tokens.weight
    old = before.model.language_model.embed_tokens.weight
    shared = [(number, known[token]) for token, number in tokenizer.get_vocab().items() if token in known]
    rows, from_rows = torch.tensor(shared).T
    with torch.no_grad():
        new *= old.std() / new.std()
        new[rows] = old[from_rows]
    own = {"embed_tokens", "lm_head"}  # one matrix, a row for each token
    kept = {name: value for name, value in before.state_dict().items() if own.isdisjoint(name.split("."))}
    model.load_state_dict(kept, strict=False)


def load_vision(model: Any, folder: Path) -> None:
    """Give a new model the vision encoder of the one in a folder: as many of its stages as the new one has."""
    encoder = model.model.vision_tower
    wanted, there = encoder.state_dict(), _read(folder).model.vision_tower.state_dict()
    encoder.load_state_dict({name: value for name, value in there.items() if name in wanted}, strict=False)


def _read(folder: Path) -> Any:
    import torch

    with importing():
        from transformers import AutoModelForImageTextToText

    with quiet():
        return AutoModelForImageTextToText.from_pretrained(folder, dtype=torch.float32)
