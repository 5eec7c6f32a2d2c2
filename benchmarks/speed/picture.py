"""A picture against MuJoCo's off-screen rendering as it comes: all triangles, four samples a pixel, shadows; and with
its depth against one after the other."""

from __future__ import annotations

import statistics
from unittest import mock

import mujoco

from benchmarks.speed.table import Row, side_by_side
from executive.domain.loader import load_domain
from executive.sim import meshes, scene
from executive.sim.rendering import Drawing


def measure(everything: bool) -> list[Row]:
    from executive.sim.world import MujocoWorld

    domain = load_domain("grocery")
    world = MujocoWorld(domain.scene, domain.task.objects)
    with mock.patch.object(meshes, "lighten"):
        spec = scene.build(world.spec)
    spec.visual.quality.offsamples = 4
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = world.data.qpos
    mujoco.mj_forward(model, data)
    drawing = Drawing(world.model)
    ours, theirs, ratios, notes = [], [], [], []
    once, twice, halves = [], [], []
    with mujoco.Renderer(model, 384, 384) as renderer:
        for camera in world.spec.cameras:

            def plainly(name: str = camera.name) -> None:
                renderer.update_scene(data, name)
                renderer.render()

            plainly()
            drawing.picture(world.data, camera)
            mine, other, ratio = side_by_side(
                lambda camera=camera: drawing.picture(world.data, camera),  # type: ignore[misc]
                plainly,
                40 if everything else 8,
            )
            ours.append(mine)
            theirs.append(other)
            ratios.append(ratio)
            notes.append(f"{camera.name} {ratio:.1f}")
            mine, other, ratio = side_by_side(
                lambda camera=camera: drawing.picture_and_depth(world.data, camera),  # type: ignore[misc]
                lambda camera=camera: (drawing.picture(world.data, camera), drawing.depth(world.data, camera)),  # type: ignore[misc]
                40 if everything else 8,
            )
            once.append(mine)
            twice.append(other)
            halves.append(ratio)
    drawing.close()
    world.close()
    least = min(ratios)
    by_camera = ", ".join(f"{each:.1f}" for each in halves)
    return [
        Row("picture of one camera", statistics.mean(ours), statistics.mean(theirs), "s", "2.5 times", least >= 2.5,
            "mujoco.Renderer at 384x384, its defaults", f"ratios {', '.join(notes)}"),
        Row("picture and depth of one camera", statistics.mean(once), statistics.mean(twice), "s", "1.5 times",
            min(halves) >= 1.5, "the same, one after the other", f"ratios {by_camera}"),
    ]  # fmt: skip
