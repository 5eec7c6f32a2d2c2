"""A room of boxes for tests of perception: depth by exact intersection of rays, without any simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.spatial.transform import Rotation

from executive.perception import Capture, ItemModel, Localizer
from executive.perception.localizer import matrix
from executive.types import Camera, DepthImage, FloatArray

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = np.array([[q[0], q[i], q[i + 1]] for q in QUADS for i in (1, 2)])
GREY, RED, BLUE = (0.5, 0.5, 0.5), (0.8, 0.2, 0.2), (0.2, 0.3, 0.8)
TABLE, FLOOR = 0.35, 0.3
"""m from the middle of the table to its edges, and from its top to the floor."""
SIZE, FOVY = (320, 240), 0.7


def box(name: str, size: Sequence[float], rgb: Sequence[float] = GREY) -> ItemModel:
    return ItemModel(name, CORNERS * np.array(size) / 2, TRIANGLES, np.array(rgb))


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> FloatArray:
    return np.array([x, y, z, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def camera(name: str, position: Sequence[float], target: Sequence[float] = (0.0, 0.0, 0.05)) -> Camera:
    backward = np.array(position) - target
    backward = backward / np.linalg.norm(backward)
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(backward, right), backward], axis=1)
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    return Camera(name, (*map(float, position), w, x, y, z), FOVY, *SIZE)


CAMERAS = {
    each.name: each
    for each in (
        camera("left", (0.7, -0.5, 0.7)),
        camera("right", (0.7, 0.5, 0.7)),
        camera("far", (-0.8, 0.1, 0.8)),
    )
}


class Room:
    """A table whose top is at z = 0, boxes on it at poses (7,), and a hand that nobody sees.

    `moved` has how far in m cameras stand from where they are taken to stand.
    """

    def __init__(self, shapes: Sequence[ItemModel], where: Mapping[str, FloatArray], noise: float = 0.001) -> None:
        self.shapes = {shape.name: shape for shape in shapes}
        self.where, self.noise = dict(where), noise
        self.cameras: Mapping[str, Camera] = CAMERAS
        self.bounds = np.array([-0.5, -0.5, -0.02]), np.array([0.5, 0.5, 0.5])
        self.time, self.width, self.captures = 0.0, 0.085, 0
        self.moved: dict[str, FloatArray] = {}
        self.blind: set[str] = set()
        self.grip = np.eye(4)
        self.grip[:3, 3] = 0.0, 0.0, 0.4

    def localizer(self, *models: ItemModel) -> Localizer:
        return Localizer(models or tuple(self.shapes.values()), self, self.capture, lambda: self.time)

    def slide(self, openings: Mapping[str, float]) -> None:
        """There are no drawers."""

    def expected(self, joints: FloatArray, fingers: FloatArray, cameras: Sequence[str]) -> dict[str, FloatArray]:
        return {name: self._seen(self.cameras[name], ())[0] for name in cameras}

    def hand(self, joints: FloatArray) -> FloatArray:
        return self.grip

    def capture(self) -> Capture:
        self.captures += 1
        images, depth = {}, {}
        for number, (name, lens) in enumerate(self.cameras.items()):
            by = self.moved.get(name, np.zeros(3))
            stands = Camera(name, (*(np.array(lens.pose[:3]) + by), *lens.pose[3:]), lens.fovy, *SIZE)
            away, images[name] = self._seen(stands, tuple(self.where))
            rng = np.random.default_rng([number, self.captures])
            error = 3.0 * uniform_filter(rng.normal(size=away.shape), 3) * self.noise * away**2
            if name not in self.blind:
                depth[name] = _millimetres(away + error)
        return Capture(self.time, images, depth, np.zeros(6), np.zeros(6), self.width)

    def _seen(self, lens: Camera, names: Sequence[str]) -> tuple[FloatArray, np.ndarray]:
        """Distances along the axis (H, W) in m and the picture."""
        width, height = SIZE
        focal = 0.5 * height / np.tan(0.5 * lens.fovy)
        across, down = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        rays = np.stack([across / focal, -down / focal, -np.ones_like(across)], axis=-1)
        body = matrix(np.array(lens.pose))
        rays, start = rays @ body[:3, :3].T, body[:3, 3]
        away = -start[2] / np.minimum(rays[..., 2], -1e-9)
        over = np.abs(start[:2] + away[..., None] * rays[..., :2]).max(axis=-1) < TABLE
        away = np.where(over, away, (-FLOOR - start[2]) / np.minimum(rays[..., 2], -1e-9))
        image = np.full((height, width, 3), 90, np.uint8)
        for name in names:
            at, shape = matrix(self.where[name]), self.shapes[name]
            origin, direction = (start - at[:3, 3]) @ at[:3, :3], rays @ at[:3, :3]
            with np.errstate(divide="ignore", invalid="ignore"):
                one, other = (-shape.half - origin) / direction, (shape.half - origin) / direction
            enter, leave = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
            hit = (enter < leave) & (enter > 0.0) & (enter < away)
            away = np.where(hit, enter, away)
            image[hit] = np.round(255 * shape.rgb)
        return away, image


def _millimetres(away: FloatArray) -> DepthImage:
    return np.where(away < 4.0, np.round(1000.0 * np.minimum(away, 4.0)), 0.0).astype(np.uint16)
