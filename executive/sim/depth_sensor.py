"""What a depth camera measures: the true distances with the errors of a real stereo or time-of-flight sensor.

The error of a measurement grows with the square of the distance, as that of any triangulation does, and neighbours
share a part of it, since both are matched in windows. Much is lost at edges and on what is dark, saturated or seen at a
glancing angle; at edges, what is measured may lie anywhere between near and far.
"""

from __future__ import annotations

import numpy as np

from executive.sim.spec import CameraSpec
from executive.types import DepthImage, FloatArray, Image

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

_WINDOW = 3
"""Pixels, across, of the window that a measurement is matched in."""


def measured(exact: FloatArray, image: Image, camera: CameraSpec, rng: np.random.Generator) -> DepthImage:
    """What the sensor of `camera` measures, (H, W) in mm, 0 for nothing.

    Args:
        exact: true distances along the optical axis, (H, W) in m.
        image: the same view, (H, W, 3).
        rng: the sensor's own stream; as much is drawn whatever there is to see.
    """
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    within = (exact >= NEAREST) & (exact <= FARTHEST)
    if camera.depth_noise == 0.0:
        return _millimetres(np.where(within, exact, 0.0))
    white = rng.standard_normal(exact.shape, dtype=np.float32)
    luck = rng.random(exact.shape, dtype=np.float32)
    between = rng.random(exact.shape, dtype=np.float32)
    error = _WINDOW * uniform_filter(white, _WINDOW)  # of variance 1 again, and alike within the window
    seen = np.where(within, exact, FARTHEST)
    noisy = seen + camera.depth_noise * seen**2 * error
    low, high = minimum_filter(seen, 3), maximum_filter(seen, 3)
    edge = high - low > np.maximum(_EDGE * seen, _STEEP * _slope(seen, camera))
    noisy = np.where(edge, low + between * (high - low), noisy)
    noisy = 1.0 / (np.round(1.0 / np.maximum(noisy, NEAREST) / _STEP) * _STEP)
    glancing = np.clip(1.0 - _facing(seen, camera) / _GLANCING, 0.0, 1.0)
    nothing = np.where(edge, _AT_EDGES, glancing)  # across an edge there is no surface to be seen at an angle
    brightness = image.max(axis=2)
    nothing = np.maximum(nothing, _ON_DARK * np.clip(1.0 - brightness / (255.0 * _DARK), 0.0, 1.0))
    nothing = np.maximum(nothing, np.where(image.min(axis=2) >= _SATURATED, _ON_SATURATED, 0.0))
    return _millimetres(np.where(within & (luck >= nothing), noisy, 0.0))


def _millimetres(metres: FloatArray) -> DepthImage:
    return np.round(1000.0 * metres).astype(np.uint16)


def _slope(depth: FloatArray, camera: CameraSpec) -> FloatArray:
    """m between neighbouring pixels at each distance."""
    return np.asarray(depth * (2.0 * np.tan(0.5 * np.deg2rad(camera.fovy_degrees)) / camera.height))


def _facing(depth: FloatArray, camera: CameraSpec) -> FloatArray:
    """The cosine between each line of sight and the surface's normal, (H, W)."""
    height, width = depth.shape
    pixel = 2.0 * np.tan(0.5 * np.deg2rad(camera.fovy_degrees)) / camera.height
    x = (np.arange(width) + 0.5 - 0.5 * width) * pixel
    y = (np.arange(height) + 0.5 - 0.5 * height)[:, None] * pixel
    # With u = log z the normal of the surface z(x, y) is along (u_x, u_y, -(1 + x u_x + y u_y)) in the camera's frame.
    log = np.log(depth)
    down, right = np.gradient(log, pixel)
    along = 1.0 + x * right + y * down
    normal = np.sqrt(right**2 + down**2 + along**2)
    sight = np.sqrt(1.0 + x**2 + y**2)
    # The line of sight (x, y, 1) times the normal is -1 for every surface.
    return np.asarray(1.0 / (normal * sight))
