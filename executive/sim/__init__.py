"""The simulated world: MuJoCo with robosuite's assets. `truth` is for scoring and for the oracle alone."""

from executive.util.requirements import choose_renderer

# MuJoCo chooses its OpenGL binding by the environment at its first import, so it has to be set before.
choose_renderer()
