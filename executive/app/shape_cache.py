"""Distance fields of known shapes in the user's cache: they follow from the shape alone, and take long to compute."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from executive.perception import ItemModel
from executive.perception.models import CELL, MARGIN
from executive.util.arrays import kept

_FORMAT = 1
"""Of the fields: to be raised with every change of how they are computed."""


def with_field(model: ItemModel, folder: Path | None = None) -> ItemModel:
    """Return the model with its distance field: from the cache, or computed and kept there. What cannot be read or kept
    is computed anew, and nothing else changes.

    Args:
        folder: in place of the user's cache.
    """
    kept("shapes", _digest(model), lambda: {"field": model.field}, lambda its: model.use_field(its["field"]), folder)
    return model


def _digest(model: ItemModel) -> str:
    """A name for all that the field follows from."""
    digest = hashlib.sha256(repr((_FORMAT, CELL, MARGIN, model.vertices.shape, model.faces.shape)).encode())
    digest.update(np.ascontiguousarray(model.vertices).tobytes())
    digest.update(np.ascontiguousarray(model.faces).tobytes())
    return digest.hexdigest()
