"""What a depth sensor does to each pixel, compiled."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from executive.types import DepthImage, FloatArray, Image
from executive.util.compiled import compiled

NEAREST, FARTHEST = 0.15, 4.0
"""m from the camera within which anything is measured."""

BEYOND = math.nextafter(FARTHEST, math.inf)
"""m that stands for everything that is out of reach."""

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
    seen: FloatArray,
    log: FloatArray,
    image: Image,
    white: _Noise,
    luck: _Noise,
    between: _Noise,
    noise: float,
    pixel: float,
    found: DepthImage,
) -> None:
    """Fill `found` (H, W) with what is measured, in mm, 0 for nothing.

    Args:
        seen, log: (H, W), the true distances in m, with `BEYOND` for those that are out of reach, and their logarithms
            (which numpy takes many at a time).
        white, luck, between: (H, W), a normal and two uniform random numbers for each pixel.
        noise: standard deviation in m at 1 m.
        pixel: the width of a pixel at 1 m.
    """
    height, width = seen.shape
    # Of the three pixels above each other, so that those around a pixel are told by three of them. Each of the loops
    # over a row is one that the compiler makes instructions for many pixels of.
    lowest, highest, errors = np.empty(width), np.empty(width), np.empty(width)
    low, high, error = np.empty(width), np.empty(width), np.empty(width)
    for row in range(height):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        y = (row + 0.5 - 0.5 * height) * pixel
        for column in range(width):
            one, two, three = seen[above, column], seen[row, column], seen[below, column]
            lowest[column], highest[column] = min(one, two, three), max(one, two, three)
            errors[column] = np.float64(white[above, column]) + white[row, column] + white[below, column]
        for column in range(width):
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            low[column] = min(lowest[left], lowest[column], lowest[right])
            high[column] = max(highest[left], highest[column], highest[right])
            error[column] = errors[left] + errors[column] + errors[right]
        for column in range(width):
            found[row, column] = 0
            away = seen[row, column]
            if away >= BEYOND:
                continue
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            red, green, blue = image[row, column, 0], image[row, column, 1], image[row, column, 2]
            nothing = _ON_DARK * max(0.0, 1.0 - max(red, green, blue) / (255.0 * _DARK))
            if min(red, green, blue) >= _SATURATED:
                nothing = max(nothing, _ON_SATURATED)
            gap = high[column] - low[column]
            if gap > max(_EDGE * away, _STEEP * away * pixel):  # there is no surface to be seen at an angle
                nothing = max(nothing, _AT_EDGES)
                noisy = low[column] + between[row, column] * gap
            else:
                # With u = log z the normal of the surface z(x, y) is along (u_x, u_y, -(1 + x u_x + y u_y)) in the
                # camera's frame, and its product with the line of sight (x, y, 1) is -1 for every surface.
                x = (column + 0.5 - 0.5 * width) * pixel
                across = (log[row, right] - log[row, left]) * (0.5 / pixel if right - left == 2 else 1.0 / pixel)
                down = (log[below, column] - log[above, column]) * (0.5 / pixel if below - above == 2 else 1.0 / pixel)
                along = 1.0 + x * across + y * down
                slant = (across**2 + down**2 + along**2) * (1.0 + x**2 + y**2)
                if slant * _GLANCING**2 > 1.0:  # few surfaces are seen at such an angle, and roots take long
                    nothing = max(nothing, 1.0 - 1.0 / (_GLANCING * math.sqrt(slant)))
                # The sum of a window, over 3, is of variance 1 again, and alike within the window.
                noisy = away + noise * away**2 * error[column] / 3.0
            if luck[row, column] < nothing:
                continue
            noisy = 1.0 / (np.rint(1.0 / max(noisy, NEAREST) / _STEP) * _STEP)
            found[row, column] = np.uint16(np.rint(1000.0 * noisy))
