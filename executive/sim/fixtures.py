"""What a `scene.toml` may say of drawers and of containers, and where their parts are.

A *drawer* slides out of a case that closes it on all sides; it is moved by what pulls at its handle or pushes at its
front, and by nothing else. A *container* is a floor with walls, which stays where it is. Lengths are in m.

The frame of a drawer has its origin in the middle of the lower edge of its closed front, outside, x into the case, y to
the left of whoever looks along x, and z up; with a `yaw` of 0 these are the world's axes, and it opens along -x,
towards a robot that looks along +x.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from executive.types import FloatArray

Vec3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$"), AfterValidator(str.lower)]
"""In small letters: PDDL, which these are the names of, knows no case."""

Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]

_PLAY = 0.001
"""m between a drawer and its case."""


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class Block:
    """A box, in the frame of what it is a part of: its name there, its middle (3,), and half its extent (3,)."""

    name: str
    centre: tuple[float, float, float]
    half: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Floor:
    """A level rectangle that items can lie on, inside of walls.

    Attributes:
        name: whose it is.
        centre: the middle of its top, (3,), in the world frame.
        size: its full extent along its own x and y.
        yaw: how its x is turned about the vertical, in rad.
        height: how high the walls around it are.
        room: how high what is put there may be.
    """

    name: str
    centre: tuple[float, float, float]
    size: tuple[float, float]
    yaw: float
    height: float
    room: float = math.inf


@dataclass(frozen=True, slots=True)
class Rectangle:
    """What something covers of the room seen from above: its middle (2,), how its x is turned about the vertical in
    rad, and half its extent along its own x and y."""

    centre: tuple[float, float]
    yaw: float
    half: tuple[float, float]

    def beside(self, point: FloatArray) -> float:
        """How far a point (2,) is from it, in m; 0 inside."""
        (x, y), cos, sin = point - self.centre, math.cos(self.yaw), math.sin(self.yaw)
        across, along = abs(cos * x + sin * y) - self.half[0], abs(cos * y - sin * x) - self.half[1]
        return math.hypot(max(across, 0.0), max(along, 0.0))


class ContainerSpec(Strict):
    """A floor with walls around it, such as a tray or a bin. `centre` is the middle of the top of its floor, `size` the
    full extent of that along its own x and y, and `height` that of the walls above it."""

    name: Name
    centre: Vec3
    size: tuple[Positive, Positive]
    height: Positive
    wall: Annotated[float, Field(ge=0.002, le=0.05)] = 0.006
    """Thickness of floor and walls."""
    yaw: float = 0.0
    rgba: Colour = (0.8, 0.8, 0.8, 1.0)

    @property
    def floor(self) -> Floor:
        return Floor(self.name, self.centre, self.size, self.yaw, self.height)

    @property
    def covers(self) -> Rectangle:
        """What it covers, walls included."""
        x, y = (0.5 * extent + self.wall for extent in self.size)
        return Rectangle(self.centre[:2], self.yaw, (x, y))

    def blocks(self) -> tuple[Block, ...]:
        """Its parts, around its centre."""
        (x, y), h, t = (0.5 * self.size[0], 0.5 * self.size[1]), 0.5 * (self.height + self.wall), 0.5 * self.wall
        return (
            Block("floor", (0.0, 0.0, -t), (x, y, t)),
            *_around(x, y, t, h - 2.0 * t, h),
        )


class HandleSpec(Strict):
    """A horizontal bar in front of a drawer's front, on two posts."""

    width: Positive = 0.11
    thickness: Annotated[float, Field(ge=0.006, le=0.03)] = 0.012
    gap: Annotated[float, Field(ge=0.02, le=0.15)] = 0.04
    """m between the bar and the front: room for a finger."""
    below: Positive = 0.014
    """m from the upper edge of the front down to the middle of the bar."""


class DrawerSpec(Strict):
    """A drawer in its case. `front` is the middle of the lower edge of its closed front, outside; `size` the depth, the
    width and the height of the room in it, of which the walls enclose the share `walls`."""

    name: Name
    front: Vec3
    size: tuple[Positive, Positive, Positive]
    travel: Positive | None = None
    """How far it slides until it meets its stop; as far as it is deep where nothing is said."""
    walls: Annotated[float, Field(gt=0.05, le=1.0)] = 0.6
    wall: Annotated[float, Field(ge=0.003, le=0.05)] = 0.006
    """Thickness of floor, walls, front and case."""
    yaw: float = 0.0
    handle: HandleSpec = HandleSpec()
    friction: Annotated[float, Field(ge=0, le=50)] = 2.0
    """The force in N that it takes to move it."""
    damping: Annotated[float, Field(ge=0, le=500)] = 15.0
    """N s/m by which what moves it is slowed down."""
    mass: Positive = 0.8
    open: Share = 0.0
    """How far it is open at first, as a share of its travel."""
    rgba: Colour = (0.78, 0.70, 0.58, 1.0)

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        depth, width, _ = self.size
        if self.travel is not None and self.travel > depth:
            raise ValueError(
                f"'travel', {self.travel:g}, is more than the drawer is deep, {depth:g}: it would fall out"
            )
        if self.handle.width > width + 4.0 * self.wall:
            raise ValueError(f"'handle.width', {self.handle.width:g}, is more than the front is wide")
        if self.handle.below + 0.5 * self.handle.thickness > self.rise:
            raise ValueError(f"'handle.below', {self.handle.below:g}, is more than the front is high, {self.rise:.3g}")
        return self

    @property
    def stroke(self) -> float:
        """How far it slides from closed to open."""
        return self.size[0] if self.travel is None else self.travel

    @property
    def rise(self) -> float:
        """How high front and case are."""
        return self.size[2] + 3.0 * self.wall + _PLAY

    @property
    def breadth(self) -> float:
        """How wide front and case are."""
        return self.size[1] + 4.0 * self.wall + 2.0 * _PLAY

    @property
    def depth(self) -> float:
        """How deep the case is, with the closed front."""
        return self.size[0] + 3.0 * self.wall + 2.0 * _PLAY

    @property
    def axis(self) -> FloatArray:
        """The unit vector (3,) along which it opens, world frame."""
        return np.array([-math.cos(self.yaw), -math.sin(self.yaw), 0.0])

    @property
    def protrusion(self) -> float:
        """How far its handle stands out from its front."""
        return self.handle.gap + self.handle.thickness

    @property
    def covers(self) -> Rectangle:
        """What it and its case cover, wherever it slides."""
        return self._covered(-(self.stroke + self.protrusion), self.depth)

    def before(self, opening: float) -> Rectangle:
        """What front and handle are going to cover on the way from being open by `opening` m to fully open."""
        return self._covered(-(self.stroke + self.protrusion), -opening)

    def _covered(self, start: float, end: float) -> Rectangle:
        x, y, _ = self.at((0.5 * (start + end), 0.0, 0.0), 0.0)
        return Rectangle((x, y), self.yaw, (0.5 * (end - start), 0.5 * self.breadth))

    def floor(self, opening: float) -> Floor:
        """Its floor when it is open by `opening` m."""
        depth, width, height = self.size
        middle = self.at((self.wall + 0.5 * depth, 0.0, 2.0 * self.wall + _PLAY), opening)
        return Floor(self.name, middle, (depth, width), self.yaw, self.walls * height, height)

    def bar(self, opening: float) -> FloatArray:
        """The middle (3,) of its handle's bar in the world frame when it is open by `opening` m."""
        handle = self.handle
        out = -(handle.gap + 0.5 * handle.thickness)
        return np.array(self.at((out, 0.0, self.rise - handle.below), opening))

    def at(self, point: Vec3, opening: float) -> Vec3:
        """A point of the drawer's frame in the world frame, once it is open by `opening` m."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y = point[0] - opening, point[1]
        return self.front[0] + cos * x - sin * y, self.front[1] + sin * x + cos * y, self.front[2] + point[2]

    def blocks(self) -> tuple[Block, ...]:
        """The parts that slide, in its frame when it is closed."""
        (depth, width, height), t, half = self.size, self.wall, 0.5 * self.wall
        floor, high = t + _PLAY, 0.5 * (self.walls * height + t)
        bar = self.handle
        out, up = -(bar.gap + 0.5 * bar.thickness), self.rise - bar.below
        post = 0.5 * bar.thickness
        return (
            Block("front", (half, 0.0, 0.5 * self.rise), (half, 0.5 * self.breadth, 0.5 * self.rise)),
            Block("floor", (t + 0.5 * depth, 0.0, floor + half), (0.5 * depth, 0.5 * width + t, half)),
            *(
                Block(f"side-{n}", (t + 0.5 * depth, s * (0.5 * width + half), floor + high), (0.5 * depth, half, high))
                for n, s in ((1, -1.0), (2, 1.0))
            ),
            Block("back", (t + depth + half, 0.0, floor + high), (half, 0.5 * width + t, high)),
            Block("handle", (out, 0.0, up), (post, 0.5 * bar.width, post)),
            *(
                Block(f"post-{n}", (-0.5 * bar.gap, s * (0.5 * bar.width - post), up), (0.5 * bar.gap, post, post))
                for n, s in ((1, -1.0), (2, 1.0))
            ),
        )

    def case(self) -> tuple[Block, ...]:
        """The parts around it, which stay where they are, in its frame when it is closed."""
        (t, half), rise, breadth = (self.wall, 0.5 * self.wall), self.rise, self.breadth
        start, end = t + _PLAY, self.depth
        middle, long = 0.5 * (start + end), 0.5 * (end - start)
        return (
            Block("bottom", (middle, 0.0, half), (long, 0.5 * breadth, half)),
            Block("top", (middle, 0.0, rise - half), (long, 0.5 * breadth, half)),
            *(
                Block(f"side-{n}", (middle, s * (0.5 * breadth - half), 0.5 * rise), (long, half, 0.5 * rise - t))
                for n, s in ((1, -1.0), (2, 1.0))
            ),
            Block("back", (end - half, 0.0, 0.5 * rise), (half, 0.5 * breadth - t, 0.5 * rise - t)),
        )


def _around(x: float, y: float, t: float, up: float, h: float) -> Iterator[Block]:
    """Four walls around a floor of half extents x and y: `t` and `h` are half their thickness and height, and `up` is
    where their middle is above the floor."""
    for number, side in ((1, -1.0), (2, 1.0)):
        yield Block(f"end-{number}", (side * (x + t), 0.0, up), (t, y + 2.0 * t, h))
        yield Block(f"side-{number}", (0.0, side * (y + t), up), (x, t, h))
