"""These tests import mujoco themselves, which chooses how it draws at that moment: `executive.sim` says how, before."""

import executive.sim  # noqa: F401
