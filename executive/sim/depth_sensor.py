"""What a depth camera measures: the true distances with the errors of a real stereo or time-of-flight sensor.

The error of a measurement grows with the square of the distance, as that of any triangulation does, and neighbours
share a part of it, since both are matched in windows. Much is lost at edges and on what is dark, saturated or seen at a
glancing angle; at edges, what is measured may lie anywhere between near and far.
"""

from __future__ import annotations

import numpy as np

from executive.sim.depth_kernels import BEYOND, FARTHEST, NEAREST, sense
from executive.sim.spec import CameraSpec
from executive.types import DepthImage, FloatArray, Image


def measured(exact: FloatArray, image: Image, camera: CameraSpec, rng: np.random.Generator) -> DepthImage:
    """What the sensor of `camera` measures, (H, W) in mm, 0 for nothing.

    Args:
        exact: true distances along the optical axis, (H, W) in m.
        image: the same view, (H, W, 3).
        rng: the sensor's own stream; as much is drawn whatever there is to see.
    """
    within = (exact >= NEAREST) & (exact <= FARTHEST)
    if camera.depth_noise == 0.0:
        return np.round(1000.0 * np.where(within, exact, 0.0)).astype(np.uint16)
    white = rng.standard_normal(exact.shape, dtype=np.float32)
    luck = rng.random(exact.shape, dtype=np.float32)
    between = rng.random(exact.shape, dtype=np.float32)
    pixel = 2.0 * float(np.tan(0.5 * np.deg2rad(camera.fovy_degrees))) / camera.height
    found = np.empty(exact.shape, np.uint16)
    seen = np.where(within, exact, BEYOND)
    sense(seen, np.log(seen), image, white, luck, between, camera.depth_noise, pixel, found)
    return found
