"""From a simulated world to a localizer for it: its cameras, and what its robot knows without looking."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from executive.app.shape_cache import with_field
from executive.errors import DomainError
from executive.faults import FaultInjector, faulty_sensing
from executive.perception import Capture, EstimatedScenes, ItemModel, Localizer
from executive.sim.known_models import KnownScene, item_meshes
from executive.sim.spec import SceneSpec
from executive.sim.world import MujocoWorld
from executive.types import Observation


def estimate_poses(world: MujocoWorld, faults: FaultInjector) -> EstimatedScenes:
    """Have skills act on poses that are estimated by what a simulated world's depth cameras see, as the faults demand;
    return what draws scenes from them.

    Raises:
        DomainError: no camera of the scene measures depth.
    """
    spec = world.spec.model_copy(update={"items": tuple(i for i in world.spec.items if i.name in world.items)})
    models, known = item_models(spec), KnownScene(spec)
    world.localizer = open_localizer(world, faulty_sensing(world, world.sense, faults), models, known)
    return EstimatedScenes(models, known)


def open_localizer(
    world: MujocoWorld,
    sense: Callable[[], Observation] | None = None,
    models: Sequence[ItemModel] | None = None,
    known: KnownScene | None = None,
) -> Localizer:
    """Return a localizer of a world's items by its depth cameras.

    Args:
        sense: senses what the depth cameras see now, in place of the world itself.
        models: the items that are looked for, in place of those that are there.
        known: what is known of robot and room, if it was opened before.

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
    return Localizer(models, known or KnownScene(spec), capture, lambda: world.time)


def item_models(spec: SceneSpec) -> list[ItemModel]:
    """Return the shapes of a scene's items, as their makers tell them."""
    return [
        with_field(
            ItemModel(name, mesh.vertices.astype(float), mesh.faces.astype(np.int64), np.array(mesh.rgba[:3]), axis)
        )
        for name, (mesh, axis) in item_meshes(spec).items()
    ]
