"""The parts of an item that is put together from several shapes: what a `[[item.part]]` of a `scene.toml` may say."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from executive.sim.fixtures import Colour, Strict, Vec3

Material = Literal["rubber", "metal", "chrome", "wood", "glass"]
Shape = Literal["box", "cylinder", "sphere", "lathe", "torus"]
Radius = Annotated[float, Field(ge=0)]


class PartSpec(Strict):
    """A shape that an item is put together from, fixed to the others. Lengths are in m, in the item's own frame.

    A `box` and a `sphere` have their full extents as `size`, a `cylinder` its diameter twice and its height, and a
    `torus` its outer extents along x and y and the thickness of its tube along z. A `lathe` is what a `profile` of
    (radius, height) sweeps when it is turned about the z axis: from the bottom up, and back down inside where the
    thing is hollow. `position` is where the middle of the shape is (of a lathe: the profile's origin); it is turned
    there by `turn_degrees` about the item's x, y and z axes, in this order. What touches it touches its convex hull.
    """

    shape: Shape
    size: Vec3 | None = None
    profile: Annotated[tuple[tuple[Radius, float], ...], Field(min_length=2, max_length=200)] | None = None
    position: Vec3 = (0.0, 0.0, 0.0)
    turn_degrees: Vec3 = (0.0, 0.0, 0.0)
    rgba: Colour = (0.7, 0.7, 0.7, 1.0)
    material: Material | None = None

    @model_validator(mode="after")
    def _has_its_measures(self) -> Self:
        if self.shape == "lathe":
            if self.profile is None or self.size is not None:
                raise ValueError("a lathe needs 'profile' = [[radius, height], ...], and has no 'size'")
            heights = [height for _, height in self.profile]
            if max(heights) - min(heights) <= 0 or max(radius for radius, _ in self.profile) <= 0:
                raise ValueError("the 'profile' of a lathe encloses nothing: it needs a height and a radius above 0")
            return self
        if self.profile is not None:
            raise ValueError(f"'profile' is for a lathe; a {self.shape} has its 'size'")
        if self.size is None or min(self.size) <= 0:
            raise ValueError(f"a {self.shape} needs 'size' = [x, y, z], each above 0")
        if self.shape == "sphere" and len(set(self.size)) > 1:
            raise ValueError("a sphere's 'size' is its diameter three times")
        if self.shape == "cylinder" and self.size[0] != self.size[1]:
            raise ValueError("a cylinder's 'size' is its diameter twice and its height")
        if self.shape == "torus" and 2 * self.size[2] >= min(self.size[:2]):
            raise ValueError("a torus needs a tube (the third 'size') that leaves a hole")
        return self

    @property
    def is_round_about_z(self) -> bool:
        """Whether it is round about the item's z axis."""
        return (
            self.shape in ("cylinder", "sphere", "lathe")
            and self.position[:2] == (0.0, 0.0)
            and self.turn_degrees[:2] == (0.0, 0.0)
        )
