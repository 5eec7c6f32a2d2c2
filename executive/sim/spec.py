"""What a `scene.toml` may say: tables, items, cameras, the robot's place and home pose. Data only, checked at birth.

Lengths are in m, angles in rad unless a key says degrees, positions in the world frame (z up, the floor at z = 0,
+x from the robot towards the tables).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from executive.errors import DomainError, nearest
from executive.util.files import read_toml
from executive.util.validation import first_mistake

Vec3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$"), AfterValidator(str.lower)]
"""In small letters: PDDL, which these are the names of, knows no case."""

Positive = Annotated[float, Field(gt=0)]

ASSETS = ("milk", "bread", "lemon", "can", "cereal", "bottle")
"""robosuite's objects that an item may be made from."""

TEXTURES = {"wood": "light-wood.png", "dark-wood": "dark-wood.png", "ceramic": "ceramic.png"}
"""robosuite's textures that a table may wear."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RobotSpec(_Strict):
    """Where the arm stands and how it waits."""

    position: Vec3
    yaw: float = 0.0
    home: Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
    reach: tuple[Positive, Positive] = (0.25, 0.76)
    """Horizontal distance from the base's axis, nearest and farthest, within which items are placed."""
    speed: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of the arm's rated joint velocities and accelerations that is used."""

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.reach[0] >= self.reach[1]:
            raise ValueError("'reach' is [nearest, farthest], the first below the second")
        return self


class TableSpec(_Strict):
    """A box whose top face, at `centre`, carries items. `size` is the full extent along its own x, y and z."""

    name: Name
    centre: Vec3
    size: tuple[Positive, Positive, Positive]
    yaw: float = 0.0
    rgba: Colour = (1.0, 1.0, 1.0, 1.0)
    texture: Literal["wood", "dark-wood", "ceramic"] | None = None


class ItemSpec(_Strict):
    """A thing to be moved: a robosuite asset, scaled (along its own x, y and z), or a primitive shape."""

    name: Name
    asset: str | None = None
    scale: Positive | tuple[Positive, Positive, Positive] = 1.0
    shape: Literal["box", "cylinder"] | None = None
    size: Vec3 | None = None
    """Full extents of a primitive: (x, y, z); a cylinder's diameter is x."""
    rgba: Colour | None = None
    mass: Positive = 0.1
    friction: Positive = 0.95

    @model_validator(mode="after")
    def _one_body(self) -> Self:
        if (self.asset is None) == (self.shape is None):
            raise ValueError("an item needs either 'asset' or 'shape' (with 'size')")
        if self.asset is not None and self.asset not in ASSETS:
            raise ValueError(f"no asset {self.asset!r}; {nearest(self.asset, ASSETS)}")
        if self.shape is not None and (self.size is None or min(self.size) <= 0):
            raise ValueError("a 'shape' needs 'size' = [x, y, z], each above 0")
        if self.shape is not None and "scale" in self.model_fields_set:
            raise ValueError("'scale' is for an 'asset'; a 'shape' has its 'size'")
        if self.asset is not None and self.size is not None:
            raise ValueError("'size' is for a 'shape'; an 'asset' has its 'scale'")
        return self


class CameraSpec(_Strict):
    """A fixed camera at `position` that looks at `target`. With `depth` it measures depth, too."""

    name: Name
    position: Vec3
    target: Vec3
    fovy_degrees: Annotated[float, Field(gt=1, lt=150)] = 45.0
    width: Annotated[int, Field(ge=16, le=4096)] = 384
    height: Annotated[int, Field(ge=16, le=4096)] = 384
    depth: bool = False
    depth_noise: Annotated[float, Field(ge=0, le=0.1)] = 0.002
    """Standard deviation of a depth measurement at 1 m, in m; it grows with the square of the distance. 0 turns the
    whole noise model off, dropouts and quantisation with it."""

    @model_validator(mode="after")
    def _looks_somewhere(self) -> Self:
        if math.dist(self.position, self.target) < 1e-6:
            raise ValueError("'position' and 'target' are the same point: the camera looks nowhere")
        return self


class PlacementSpec(_Strict):
    """How items are put down at random: `gap` between any two (surface to surface), `margin` to the table's edge."""

    gap: Positive = 0.06
    margin: Annotated[float, Field(ge=0)] = 0.03


class SceneSpec(_Strict):
    """A whole scene file."""

    robot: RobotSpec
    tables: Annotated[tuple[TableSpec, ...], Field(min_length=1, alias="table")]
    items: Annotated[tuple[ItemSpec, ...], Field(min_length=1, alias="item")]
    cameras: Annotated[tuple[CameraSpec, ...], Field(min_length=1, alias="camera")]
    placement: PlacementSpec = PlacementSpec()
    timestep: Annotated[float, Field(ge=1e-4, le=0.005)] = 0.002
    """Seconds. What happens takes the longer to simulate the shorter these are."""

    @model_validator(mode="after")
    def _names_once(self) -> Self:
        for kind, names in (
            ("item or table", [*(item.name for item in self.items), *(table.name for table in self.tables)]),
            ("camera", [camera.name for camera in self.cameras]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"{kind} {twice[0]!r} is named twice")
        return self

    def restricted_to(self, objects: Mapping[str, str], file: Path) -> SceneSpec:
        """The same scene with the items of one problem alone.

        Args:
            objects: the problem's objects, name -> PDDL type.
            file: the scene file, for the error message.

        Raises:
            DomainError: an object of the problem has no body here.
        """
        bodies = [*(item.name for item in self.items), *(table.name for table in self.tables)]
        for name in objects:
            if name not in bodies:
                raise DomainError(
                    f"the problem's object {name!r} has no body: add an [[item]] or [[table]] with this name; "
                    f"{nearest(name, bodies)}",
                    file=file,
                    key="item",
                )
        return self.model_copy(update={"items": tuple(item for item in self.items if item.name in objects)})


def read_scene(file: Path) -> SceneSpec:
    """Read a scene file.

    Raises:
        DomainError: the file is missing, is no TOML, or a key is wrong; file and key are named.
    """
    said = read_toml(file, mistake=DomainError)
    try:
        return SceneSpec.model_validate(said)
    except ValidationError as error:
        path, message = first_mistake(error, SceneSpec)
        key = "".join(f"[{part}]" if part.isdigit() else f".{part}" for part in path).lstrip(".")
        raise DomainError(message, file=file, key=key or "(whole file)") from error
