"""What a depth sensor does to each pixel, compiled."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from executive.types import DepthImage, FloatArray, Image
from executive.util.compiled import compiled

NEAREST, FARTHEST = 0.15, 4.0
"""m from the camera within which anything is measured."""

_STEP = 0.0005
"""1/m: measurements are multiples of it in inverse distance (disparity), 0.5 mm at 1 m."""

_EDGE = 0.02
"""A jump of the distance between neighbours, as a share of it, that is an edge."""

_STEEP = 12.0
"""Widths of a pixel that a surface seen at 80 degrees recedes by from one pixel to the next but one: no edge."""

_AT_EDGES = 0.7
"""The chance that nothing is measured there; the rest lies between near and far."""

_DARK = 0.12
"""The share of white below which what is seen reflects too little: the chance of nothing rises to `_ON_DARK` at 0."""

_ON_DARK = 0.6

_SATURATED, _ON_SATURATED = 252, 0.5
"""A grey level from which on a highlight blinds the sensor, and the chance that nothing is measured there."""

_GLANCING = 0.3
"""Cosine of the angle of view to the surface's normal below which the chance of nothing rises, to 1 at 0."""

_Noise = npt.NDArray[np.float32]


@compiled
def sense(
    exact: FloatArray,
    image: Image,
    white: _Noise,
    luck: _Noise,
    between: _Noise,
    noise: float,
    pixel: float,
    found: DepthImage,
) -> None:
    """Fill `found` (H, W) with what is measured of `exact` (H, W) in m, in mm, 0 for nothing.

    Args:
        white, luck, between: (H, W), a normal and two uniform random numbers for each pixel.
        noise: standard deviation in m at 1 m.
        pixel: the width of a pixel at 1 m.
    """
    height, width = exact.shape
    seen = np.empty((height, width))
    for row in range(height):
        for column in range(width):
            away = exact[row, column]
            seen[row, column] = away if NEAREST <= away <= FARTHEST else FARTHEST
    log = np.log(seen)
    for row in range(height):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        y = (row + 0.5 - 0.5 * height) * pixel
        for column in range(width):
            found[row, column] = 0
            if not NEAREST <= exact[row, column] <= FARTHEST:
                continue
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            away = seen[row, column]
            low, high, error = away, away, 0.0
            for at in (above, row, below):
                for beside in (left, column, right):
                    low, high = min(low, seen[at, beside]), max(high, seen[at, beside])
                    error += white[at, beside]
            brightest, darkest = 0, 255
            for colour in range(3):
                brightest = max(brightest, image[row, column, colour])
                darkest = min(darkest, image[row, column, colour])
            nothing = _ON_DARK * max(0.0, 1.0 - brightest / (255.0 * _DARK))
            if darkest >= _SATURATED:
                nothing = max(nothing, _ON_SATURATED)
            if high - low > max(_EDGE * away, _STEEP * away * pixel):  # there is no surface to be seen at an angle
                nothing = max(nothing, _AT_EDGES)
                noisy = low + between[row, column] * (high - low)
            else:
                # With u = log z the normal of the surface z(x, y) is along (u_x, u_y, -(1 + x u_x + y u_y)) in the
                # camera's frame, and its product with the line of sight (x, y, 1) is -1 for every surface.
                x = (column + 0.5 - 0.5 * width) * pixel
                across = (log[row, right] - log[row, left]) / ((right - left) * pixel)
                down = (log[below, column] - log[above, column]) / ((below - above) * pixel)
                along = 1.0 + x * across + y * down
                facing = 1.0 / math.sqrt((across**2 + down**2 + along**2) * (1.0 + x**2 + y**2))
                nothing = max(nothing, min(1.0, max(0.0, 1.0 - facing / _GLANCING)))
                # The sum of a window, over 3, is of variance 1 again, and alike within the window.
                noisy = away + noise * away**2 * error / 3.0
            if luck[row, column] < nothing:
                continue
            noisy = 1.0 / (np.rint(1.0 / max(noisy, NEAREST) / _STEP) * _STEP)
            found[row, column] = np.uint16(np.rint(1000.0 * noisy))
