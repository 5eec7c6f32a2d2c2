"""Renders one picture with a variant of Mitsuba after one with OpenGL, and prints the variant.

    python -m executive.sim.photoreal_probe llvm_ad_rgb

A program of its own, because an LLVM that does not fit ends the process instead of raising anything.
"""

from __future__ import annotations

import sys
from contextlib import suppress

import numpy as np


def draw(variant: str) -> None:
    """Render a lit ball.

    Raises:
        RuntimeError: the picture shows none.
        Exception: whatever Mitsuba raises.
    """
    with suppress(Exception):  # Mesa's driver brings an LLVM of its own, which has to be there when it is tried
        from executive.sim import gl_probe

        gl_probe.draw()
    import mitsuba

    mitsuba.set_variant(variant)
    scene = mitsuba.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "light": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": {"type": "roughplastic", "alpha": 0.2}},
            "sensor": {
                "type": "perspective",
                "to_world": mitsuba.ScalarTransform4f().look_at([0, -4, 1], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 32, "height": 24, "rfilter": {"type": "box"}},
            },
        }
    )
    picture = np.array(mitsuba.render(scene, spp=4, seed=1))[..., :3]
    if not np.isfinite(picture).all() or not 0.9 < picture[0, 0].mean() < 1.1 or picture[12, 16].mean() > 0.9:
        raise RuntimeError("the picture that was rendered is wrong")


if __name__ == "__main__":
    draw(sys.argv[1])
    print(sys.argv[1])
