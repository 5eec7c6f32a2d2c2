"""Pictures that are worse than they were: out of focus, noisy, dark."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from executive.types import Image

SPOILED: Mapping[str, str] = MappingProxyType(
    {
        "blurred": "standard deviation of the blur, in pixels (2 % of the width)",
        "noisy": "standard deviation of noise on every value, in grey levels (40)",
        "dark": "share of the light that is gone, from 0 to 1 (0.7)",
    }
)
"""How a picture can be spoiled, each with what an amount of it means and, in brackets, how much it is by default."""

_BLUR = 0.02
"""As a share of a picture's width: a lemon is a yellow cloud."""

_DEFAULTS = {"noisy": 40.0, "dark": 0.7}
_MOST = {"blurred": 1000.0, "noisy": 255.0, "dark": 1.0}


def most(way: str) -> float:
    """The largest amount of it that means anything."""
    return _MOST[way]


def spoiled(image: Image, way: str, amount: float | None, chance: np.random.Generator) -> Image:
    """The picture (H, W, 3), spoiled in one of the ways of `SPOILED`. Only noise is a matter of chance."""
    if way == "blurred":
        from scipy.ndimage import gaussian_filter

        sigma = max(1.0, _BLUR * image.shape[1]) if amount is None else amount
        return np.asarray(gaussian_filter(image, (sigma, sigma, 0.0)), dtype=np.uint8)
    strength = _DEFAULTS[way] if amount is None else amount
    if way == "dark":
        return (image * (1.0 - strength)).round().astype(np.uint8)
    return np.clip(image + chance.normal(0.0, strength, image.shape), 0, 255).round().astype(np.uint8)
