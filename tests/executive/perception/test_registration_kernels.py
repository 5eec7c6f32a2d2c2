"""What is compiled for fitting poses is the same as the formulas in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executive.perception.models import CELL
from executive.perception.registration import LARGEST, _linearised, local, misfit
from executive.perception.registration_kernels import normal_equations
from tests.executive.perception.test_models import BRICK


@pytest.mark.parametrize("seed", range(3))
def test_normal_equations_and_misfits_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(5, random_state=seed).as_matrix()
    translations = rng.normal(0.0, 0.05, (5, 3))
    points = rng.normal(0.0, 0.08, (200, 3))  # some of them far outside of the field
    scale = 0.006
    normal, right = np.empty((5, 6, 6)), np.empty((5, 6))
    normal_equations(BRICK.field, BRICK.low, CELL, rotations, translations, points, scale, normal, right)
    rows, distance, weight = _linearised(BRICK, rotations, translations, points, scale)
    weighted = (rows * weight[..., None]).transpose(0, 2, 1)
    assert normal == pytest.approx(weighted @ rows, abs=1e-9)
    assert right == pytest.approx((weighted @ distance[..., None])[..., 0], abs=1e-9)
    far, _ = BRICK.distances(local(rotations, translations, points))
    expected = np.minimum(np.abs(far), LARGEST).mean(axis=1)
    assert misfit(BRICK, rotations, translations, points) == pytest.approx(expected, abs=1e-9)
