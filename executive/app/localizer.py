"""From a simulated world to a localizer for it: its cameras, and what its robot knows without looking."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from executive.app.shape_cache import with_field
from executive.errors import DomainError
from executive.faults import FaultInjector, faulty_sensing
from executive.perception import Capture, EstimatedScenes, ItemModel, Localizer
from executive.perception.assignment import LARGEST
from executive.perception.openings import Bar
from executive.perception.tracks import Hint
from executive.sim.known_models import KnownScene, item_meshes
from executive.sim.placement import Place, places
from executive.sim.spec import SceneSpec
from executive.sim.world import MujocoWorld
from executive.types import FloatArray, Observation, PosesEstimated

_MISSAID = 1e-4
"""How much less probable it is that an item is first seen elsewhere than the problem says."""


def estimate_poses(
    world: MujocoWorld, faults: FaultInjector, placed: Mapping[str, str] = MappingProxyType({}), film: float = 0.0
) -> tuple[EstimatedScenes, Sequence[Sequence[str]]]:
    """Have skills act on poses that are estimated by what a simulated world's depth cameras see, as the faults demand;
    return what draws scenes from them, and the names of items that nothing tells apart, in groups.

    Args:
        placed: the table on which the problem says that an item is at first: of identical items, nothing else says
            which is which.
        film: how often a second poses are estimated while the world moves, where some items are identical.

    Raises:
        DomainError: no camera of the scene measures depth, or too many items are identical.
    """
    spec = world.spec.model_copy(update={"items": tuple(i for i in world.spec.items if i.name in world.items)})
    models, known = item_models(spec), KnownScene(spec)
    sense = faulty_sensing(world, world.sense, faults)
    localizer = open_localizer(world, sense, models, known, _hint(world, placed))
    for names in localizer.identical:
        if len(names) > LARGEST:
            raise DomainError(f"{len(names)} items are identical, and {LARGEST} at most can be followed", key="item")
    world.localizer = localizer
    if localizer.identical and film > 0.0:
        world.film_period = 1.0 / film
    return EstimatedScenes(models, known), localizer.identical


def open_localizer(
    world: MujocoWorld,
    sense: Callable[[], Observation] | None = None,
    models: Sequence[ItemModel] | None = None,
    known: KnownScene | None = None,
    hint: Hint | None = None,
) -> Localizer:
    """Return a localizer of a world's items by its depth cameras.

    Args:
        sense: senses what the depth cameras see now, in place of the world itself.
        models: the items that are looked for, in place of those that are there.
        known: what is known of robot and room, if it was opened before.
        hint: what is known beforehand of where each of several identical items is first seen.

    Raises:
        DomainError: no camera of the scene measures depth.
        MissingError: there is no off-screen OpenGL.
    """
    if not any(camera.depth for camera in world.spec.cameras):
        raise DomainError("no camera measures depth, which poses are estimated from: set depth = true", key="camera")
    take = world.sense if sense is None else sense

    def capture() -> Capture:
        look = take()
        return Capture(look.time, look.images, look.depth, look.joints, world.gripper_joints(), world.gripper_width())

    spec = world.spec.model_copy(update={"items": tuple(i for i in world.spec.items if i.name in world.items)})
    models = item_models(spec) if models is None else models
    return Localizer(models, known or KnownScene(spec), capture, lambda: world.time, hint, bars_of(spec))


def bars_of(spec: SceneSpec) -> list[Bar]:
    """Return the bars of the handles of a scene's drawers."""
    return [
        Bar(
            drawer.name,
            drawer.bar(0.0),
            drawer.axis,
            0.5 * drawer.handle.width,
            drawer.handle.thickness,
            drawer.stroke,
        )
        for drawer in spec.drawers
    ]


def item_models(spec: SceneSpec) -> list[ItemModel]:
    """Return the shapes of a scene's items, as their makers tell them."""
    return [
        with_field(
            ItemModel(name, mesh.vertices.astype(float), mesh.faces.astype(np.int64), np.array(mesh.rgba[:3]), axis)
        )
        for name, (mesh, axis) in item_meshes(spec).items()
    ]


def _hint(world: MujocoWorld, placed: Mapping[str, str]) -> Hint:
    """How probable it is that an item is first seen somewhere, by the table that it is said to be on."""
    tables = places(world.spec)

    def hint(name: str, position: FloatArray) -> float:
        return 1.0 if name not in placed or _is_over(tables[placed[name]], position) else _MISSAID

    return hint


def localize(world: MujocoWorld) -> Callable[[], PosesEstimated]:
    """What the localizer of a world estimates when it is asked; the world goes on owning it."""

    def now() -> PosesEstimated:
        if world.localizer is None:
            raise ValueError("nothing estimates poses in this world")
        return world.localizer.now()

    return now


def _is_over(table: Place, position: FloatArray) -> bool:
    """Whether a position (3,) is over a table's top."""
    cos, sin = np.cos(table.yaw), np.sin(table.yaw)
    x, y = position[:2] - np.asarray(table.centre[:2])
    across, along = abs(cos * x + sin * y), abs(cos * y - sin * x)
    return bool(across <= 0.5 * table.size[0] and along <= 0.5 * table.size[1] and position[2] > table.centre[2])
