"""What a `scene.toml` may say: tables, items, cameras, the robot's place and home pose; and drawers and containers, of
which `fixtures.py` tells. Data only, checked at birth.

Lengths are in m, angles in rad unless a key says degrees, positions in the world frame (z up, the floor at z = 0,
+x from the robot towards the tables).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from executive.errors import DomainError, nearest
from executive.sim.described import attributes_of, keys_of
from executive.sim.fixtures import Colour, ContainerSpec, DrawerSpec, Floor, Name, Positive, Rectangle, Strict, Vec3
from executive.sim.part_spec import Material, PartSpec
from executive.util.files import read_toml
from executive.util.validation import first_mistake

ASSETS = ("milk", "bread", "lemon", "can", "cereal", "bottle")
"""robosuite's objects that an item may be made from."""

TEXTURES = {"wood": "light-wood.png", "dark-wood": "dark-wood.png", "ceramic": "ceramic.png"}
"""robosuite's textures that a table may wear."""


class RobotSpec(Strict):
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


class TableSpec(Strict):
    """A box whose top face, at `centre`, carries items. `size` is the full extent along its own x, y and z; a `rim`
    stands that much higher around it."""

    name: Name
    centre: Vec3
    size: tuple[Positive, Positive, Positive]
    yaw: float = 0.0
    rgba: Colour = (1.0, 1.0, 1.0, 1.0)
    texture: Literal["wood", "dark-wood", "ceramic"] | None = None
    rim: Annotated[float, Field(ge=0, le=0.2)] = 0.0


class RegionSpec(Strict):
    """A rectangle of a table's top. `centre` is where its middle is from the middle of the table, and `size` its full
    extent, both along the table's own x and y; it is painted where it has a colour. What is put into it where something
    stands already goes on top of that, or beside it where the region is for `several`."""

    name: Name
    table: Name
    centre: tuple[float, float]
    size: tuple[Positive, Positive]
    rgba: Colour | None = None
    several: bool = False


class ItemPart(Strict):
    """The keys of an item that a value of an attribute decides."""

    asset: str | None = None
    scale: Positive | tuple[Positive, Positive, Positive] | None = None
    shape: Literal["box", "cylinder", "sphere"] | None = None
    size: Vec3 | None = None
    rgba: Colour | None = None
    material: Material | None = None
    mass: Positive | None = None
    friction: Positive | None = None

    def keys_said(self) -> dict[str, Any]:
        return self.model_dump(exclude_none=True)


class ItemSpec(Strict):
    """A thing to be moved: a robosuite asset, scaled along its own x, y and z, a primitive shape, or several parts."""

    name: Name
    asset: str | None = None
    scale: Positive | tuple[Positive, Positive, Positive] = 1.0
    shape: Literal["box", "cylinder", "sphere"] | None = None
    size: Vec3 | None = None
    """Full extents of a primitive: (x, y, z); a cylinder's or a sphere's diameter is x."""
    rgba: Colour | None = None
    material: Material | None = None
    """What it is made of, which decides how it shines."""
    parts: Annotated[tuple[PartSpec, ...], Field(alias="part", max_length=40)] = ()
    grip: tuple[float, float] | None = None
    """Where the fingers take it as it stands, along its own x and y, where that is not the middle of all of it."""
    attributes: Mapping[str, str] = {}
    """What it is described by: attribute -> value, of the scene's `[attributes]`."""
    mass: Positive = 0.1
    friction: Positive = 0.95

    @model_validator(mode="after")
    def _one_body(self) -> Self:
        if (self.asset is not None) + (self.shape is not None) + bool(self.parts) != 1:
            raise ValueError("an item needs one of 'asset', 'shape' (with 'size') and [[item.part]]")
        if self.parts and (said := {"size", "scale", "rgba", "material"} & self.model_fields_set):
            raise ValueError(f"{min(said)!r} is said by each [[item.part]], where an item has them")
        if self.asset is not None and self.asset not in ASSETS:
            raise ValueError(f"no asset {self.asset!r}; {nearest(self.asset, ASSETS)}")
        if self.shape is not None and (self.size is None or min(self.size) <= 0):
            raise ValueError("a 'shape' needs 'size' = [x, y, z], each above 0")
        if self.shape is not None and "scale" in self.model_fields_set:
            raise ValueError("'scale' is for an 'asset'; a 'shape' has its 'size'")
        if self.asset is not None and self.size is not None:
            raise ValueError("'size' is for a 'shape'; an 'asset' has its 'scale'")
        if self.shape == "sphere" and self.size is not None and len(set(self.size)) > 1:
            raise ValueError("a sphere's 'size' is its diameter three times")
        return self

    def is_round(self, geom: str) -> bool:
        """Whether one of its parts, by the name of its geom, is round about the item's z axis."""
        return any(
            part.is_round_about_z and geom == f"{self.name}/part-{number}" for number, part in enumerate(self.parts)
        )


class CameraSpec(Strict):
    """A fixed camera at `position` that looks at `target`. With `depth` it measures depth, too."""

    name: Name
    position: Vec3
    target: Vec3
    fovy_degrees: Annotated[float, Field(gt=1, lt=150)] = 45.0
    width: Annotated[int, Field(ge=16, le=4096)] = 384
    height: Annotated[int, Field(ge=16, le=4096)] = 384
    renderer: Literal["mujoco", "mitsuba"] = "mujoco"
    """What draws its pictures: MuJoCo's OpenGL, or Mitsuba's path tracer (the extra `photoreal`), at a hundred times
    the cost. Depth is MuJoCo's either way."""
    depth: bool = False
    depth_noise: Annotated[float, Field(ge=0, le=0.1)] = 0.002
    """Standard deviation of a depth measurement at 1 m, in m; it grows with the square of the distance. 0 turns the
    whole noise model off, dropouts and quantisation with it."""

    @model_validator(mode="after")
    def _looks_somewhere(self) -> Self:
        if math.dist(self.position, self.target) < 1e-6:
            raise ValueError("'position' and 'target' are the same point: the camera looks nowhere")
        return self


class PlacementSpec(Strict):
    """How items are put down at random: `gap` between any two (surface to surface), `margin` to the table's edge."""

    gap: Positive = 0.06
    margin: Annotated[float, Field(ge=0)] = 0.03


class SceneSpec(Strict):
    """A whole scene file."""

    robot: RobotSpec
    tables: Annotated[tuple[TableSpec, ...], Field(min_length=1, alias="table")]
    items: Annotated[tuple[ItemSpec, ...], Field(alias="item")] = ()
    regions: Annotated[tuple[RegionSpec, ...], Field(alias="region")] = ()
    containers: Annotated[tuple[ContainerSpec, ...], Field(alias="container")] = ()
    drawers: Annotated[tuple[DrawerSpec, ...], Field(alias="drawer")] = ()
    attributes: Mapping[str, Mapping[str, ItemPart]] = {}
    """What items can be described by: attribute -> value -> what it decides of an item."""
    cameras: Annotated[tuple[CameraSpec, ...], Field(min_length=1, alias="camera")]
    placement: PlacementSpec = PlacementSpec()
    timestep: Annotated[float, Field(ge=1e-4, le=0.005)] = 0.002
    """Seconds. What happens takes the longer to simulate the shorter these are."""

    @model_validator(mode="before")
    @classmethod
    def _from_attributes(cls, said: Any) -> Any:
        """Gives items with `attributes` the keys that these stand for; what an item says itself counts for more."""
        if not isinstance(said, Mapping) or not isinstance(said.get("item"), list):
            return said
        known = {
            name: values if isinstance(values, Mapping) else {}
            for name, values in (said.get("attributes") or {}).items()
        }
        items = []
        for item in said["item"]:
            words = item.get("attributes") if isinstance(item, Mapping) else None
            if isinstance(words, list) and all(isinstance(word, str) for word in words):
                try:
                    described = attributes_of(words, known)
                except ValueError as error:
                    raise ValueError(f"item {item.get('name')!r}: {error}") from None
                item = {**keys_of(described, known), **item, "attributes": described}
            items.append(item)
        return {**said, "item": items}

    @model_validator(mode="after")
    def _names_once(self) -> Self:
        if not self.items and not self.attributes:
            raise ValueError("there is no [[item]], and no [attributes] that items can be described by")
        tables = [table.name for table in self.tables]
        for kind, names in (
            ("item, table, region, container or drawer", [name for named in self._bodies.values() for name in named]),
            ("camera", [camera.name for camera in self.cameras]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"{kind} {twice[0]!r} is named twice")
        for region in self.regions:
            if region.table not in tables:
                raise ValueError(
                    f"region {region.name!r} is on no table {region.table!r}; {nearest(region.table, tables)}"
                )
        return self

    @property
    def _bodies(self) -> dict[str, list[str]]:
        return {
            "item": [item.name for item in self.items],
            "table": [table.name for table in self.tables],
            "region": [region.name for region in self.regions],
            "container": [container.name for container in self.containers],
            "drawer": [drawer.name for drawer in self.drawers],
        }

    @property
    def covered(self) -> tuple[Rectangle, ...]:
        """What containers, and drawers wherever they slide, cover of the room seen from above."""
        return (*(each.covers for each in self.containers), *(each.covers for each in self.drawers))

    @property
    def kinds(self) -> dict[str, str]:
        """What each name stands for: an item, a table, a region, a container or a drawer."""
        return {name: kind for kind, names in self._bodies.items() for name in names}

    @property
    def floors(self) -> dict[str, Floor]:
        """The floors of containers, and of drawers as far as they are open at first, by name."""
        drawers = (drawer.floor(drawer.open * drawer.stroke) for drawer in self.drawers)
        return {floor.name: floor for floor in (*(each.floor for each in self.containers), *drawers)}

    def with_drawers(self, opened: Mapping[str, float]) -> SceneSpec:
        """The same scene with some drawers (name -> share of their travel) as far open at first."""
        drawers = (
            each.model_copy(update={"open": min(1.0, max(0.0, float(opened.get(each.name, each.open))))})
            for each in self.drawers
        )
        return self.model_copy(update={"drawers": tuple(drawers)})

    def restricted_to(self, objects: Mapping[str, str], file: Path) -> SceneSpec:
        """The same scene with the items of one problem alone; those that it does not list are made from their names.

        Args:
            objects: the problem's objects, name -> PDDL type.
            file: the scene file, for the error message.

        Raises:
            DomainError: an object of the problem has no body here.
        """
        bodies, made = self.kinds, []
        for name in objects:
            if name not in bodies:
                made.append(self._described(name, file))
        items = (*(item for item in self.items if item.name in objects), *made)
        return self.model_copy(update={"items": items})

    def _described(self, name: str, file: Path) -> ItemSpec:
        """The item that a name describes, such as small-red-metal-cube.

        Raises:
            DomainError: it describes none.
        """
        why = f"add an [[item]], [[table]], [[container]] or [[drawer]] with this name; {nearest(name, self.kinds)}"
        if self.attributes:
            parts = {
                key: {v: part.keys_said() for v, part in values.items()} for key, values in self.attributes.items()
            }
            try:
                described = attributes_of(name.split("-"), parts)
                return ItemSpec.model_validate({**keys_of(described, parts), "name": name, "attributes": described})
            except ValidationError as error:
                why = f"made from its name, {first_mistake(error, ItemSpec)[1]}"
            except ValueError as error:
                why = f"as a description of an item, {error}; or add an [[item]] with this name"
        raise DomainError(f"the problem's object {name!r} has no body: {why}", file=file, key="item")


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
