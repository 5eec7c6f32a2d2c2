"""The simulated world: MuJoCo with robosuite's assets. `truth` is for scoring and for the oracle alone."""

import os
import sys

if sys.platform == "linux":
    # Off-screen drawing; mujoco chooses its OpenGL binding by this at its first import, so it has to be set before.
    os.environ.setdefault("MUJOCO_GL", "egl")
