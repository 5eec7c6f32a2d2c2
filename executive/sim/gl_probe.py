"""Draws one picture off screen and prints who drew it, such as `llvmpipe (LLVM 15.0.7, 256 bits)`.

    python -m executive.sim.gl_probe

A program of its own, because a broken graphics driver may take the process with it (see `executive.app.doctor`).
"""

from __future__ import annotations

import mujoco
import numpy as np

from executive.util.native_libraries import keep_triton_apart

_SCENE = """<mujoco><worldbody>
  <light pos="0 0 3"/><geom type="box" size=".5 .5 .5" rgba="1 0 0 1"/><camera name="front" pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>
</worldbody></mujoco>"""  # noqa: E501


def draw() -> str:
    """The name of the OpenGL renderer, once it has drawn a red box.

    Raises:
        RuntimeError: the picture shows no red box.
        Exception: whatever MuJoCo's OpenGL binding raises.
    """
    from OpenGL import GL

    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    keep_triton_apart()
    with mujoco.Renderer(model, 48, 64) as renderer:
        renderer.update_scene(data, "front")
        red, green, _ = np.asarray(renderer.render(), dtype=int)[24, 32]
        name = GL.glGetString(GL.GL_RENDERER)
    if red < 2 * green + 20:
        raise RuntimeError("the picture that was drawn is wrong")
    return name.decode() if isinstance(name, bytes) else "a renderer without a name"


if __name__ == "__main__":
    print(draw())
