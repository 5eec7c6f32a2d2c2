"""Shapes as triangles: closed, as large as they are, with normals that point outwards."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from executive.sim.triangles import triangles

SHAPES = {
    "box": ('type="box" size=".1 .2 .3"', 8 * 0.1 * 0.2 * 0.3),
    "ball": ('type="sphere" size=".1"', 4 / 3 * np.pi * 0.1**3),
    "cylinder": ('type="cylinder" size=".1 .2"', np.pi * 0.1**2 * 0.4),
    "capsule": ('type="capsule" size=".1 .2"', np.pi * 0.1**2 * 0.4 + 4 / 3 * np.pi * 0.1**3),
    "mesh": ('type="mesh" mesh="octahedron"', 4 / 3 * 0.1**3),
}
MESH = """<asset><mesh name="octahedron" smoothnormal="true" vertex=".1 0 0  -.1 0 0  0 .1 0  0 -.1 0  0 0 .1  0 0 -.1"
  face="0 2 4  2 1 4  1 3 4  3 0 4  2 0 5  1 2 5  3 1 5  0 3 5"/></asset>"""


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_encloses_its_volume_with_normals_outwards(name: str) -> None:
    attributes, volume = SHAPES[name]
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{MESH}<worldbody><geom {attributes}/></worldbody></mujoco>")
    shape = triangles(model, 0)
    assert shape is not None
    corners = shape.vertices[shape.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("fi,fi->", corners[:, 0], across) / 6 == pytest.approx(volume, rel=0.01), "counter-clockwise"
    large = np.linalg.norm(across, axis=1) > 1e-9
    towards = np.einsum("fi,fvi->fv", across[large], shape.normals[shape.faces[large]])
    assert (towards > 0).all()
    assert np.linalg.norm(shape.normals, axis=1) == pytest.approx(1.0, abs=1e-3)


def test_a_plane_is_drawn_facing_up() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="plane" size="0 0 .1"/></worldbody></mujoco>')
    shape = triangles(model, 0)
    assert shape is not None
    assert (shape.normals == [0.0, 0.0, 1.0]).all()
