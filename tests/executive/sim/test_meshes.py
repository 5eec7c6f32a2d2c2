"""Meshes that are only looked at have fewer triangles, look as before, and change nothing that moves."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.sim import meshes, scene
from executive.sim.spec import read_scene
from tests.executive.sim.stage import ROOT

SPEC = read_scene(ROOT / "domains" / "grocery" / "scene.toml")


@given(st.integers(0, 999), st.integers(0, 80), st.sampled_from([0.002, 0.05, 1.0]))
def test_every_triangle_that_is_left_is_near_one_that_was(seed: int, count: int, cell: float) -> None:
    chance = np.random.default_rng(seed)
    vertices = chance.uniform(-0.2, 0.2, (40, 3))
    triangles = chance.integers(0, 40, (count, 3))
    fewer, kept = meshes.simplified(vertices, triangles, cell)
    assert len(kept) <= len(triangles)
    assert set(kept.ravel().tolist()) == set(range(len(fewer))), "no vertex is left that no triangle has"
    assert all(len(set(triangle)) == 3 for triangle in kept.tolist())
    corners = vertices[triangles] if count else np.empty((0, 3, 3))
    for triangle in fewer[kept]:
        distance = np.abs(corners - triangle).max(axis=(1, 2))
        assert distance.min() <= cell, "each corner moves within its cube alone"


def test_a_mesh_without_vertices_stays_what_it_is() -> None:
    vertices, triangles = meshes.simplified(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    assert (len(vertices), len(triangles)) == (0, 0)


def test_a_wavefront_file_is_read_with_polygons_slashes_and_counts_from_the_end(tmp_path: Path) -> None:
    file = tmp_path / "square.obj"
    file.write_text(
        "# a square\nvn 0 0 1\nv 0 0 0\nv 1 0 0\nv  1 1.5e0 0 0.5 0.5 0.5\nv 0 1 0\nvt 0 0\n"
        "f 1/1/1 2//1 3\nf 1 2 3 -1\n"
    )
    vertices, triangles = meshes.read_obj(file)
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1.5, 0], [0, 1, 0]]
    assert triangles.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


def test_what_moves_and_what_touches_is_the_same_and_what_is_drawn_is_a_third(monkeypatch: pytest.MonkeyPatch) -> None:
    light = scene.build(SPEC).compile()
    monkeypatch.setattr(meshes, "lighten", lambda spec: None)
    heavy = scene.build(SPEC).compile()
    assert light.nmeshface < 0.45 * heavy.nmeshface
    moving = [body for body in range(heavy.nbody) if heavy.body_weldid[body] != 0]
    for name in ("body_mass", "body_inertia", "body_ipos", "body_pos", "body_quat"):
        np.testing.assert_allclose(getattr(light, name)[moving], getattr(heavy, name)[moving], rtol=1e-9, atol=1e-12)
    touching = np.flatnonzero((heavy.geom_contype != 0) | (heavy.geom_conaffinity != 0))
    for name in ("geom_pos", "geom_size", "geom_quat", "geom_friction"):
        np.testing.assert_array_equal(getattr(light, name)[touching], getattr(heavy, name)[touching])
    drawn = [_picture(model) for model in (light, heavy)]
    apart = np.abs(drawn[0].astype(int) - drawn[1]).max(axis=2)
    assert (apart > 30).mean() < 0.01


def test_the_model_to_plan_in_has_no_mesh_that_nothing_touches() -> None:
    model = scene.build(SPEC, visuals=False).compile()
    used = {int(each) for each in model.geom_dataid if each >= 0}
    assert used == set(range(model.nmesh))


def _picture(model: mujoco.MjModel) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    data = mujoco.MjData(model)
    for name, angle in zip(scene.JOINTS, SPEC.robot.home, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    options = mujoco.MjvOption()
    options.geomgroup[:] = 0
    options.geomgroup[scene.VISUAL] = 1
    with mujoco.Renderer(model, 384, 384) as renderer:
        renderer.update_scene(data, "hand", options)
        return np.array(renderer.render())
