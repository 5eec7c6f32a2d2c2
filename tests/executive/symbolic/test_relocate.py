"""Someone moves what nobody sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from executive.domain.loader import load_domain
from executive.symbolic import SymbolicWorld
from executive.types import Atom

DRAWERS = Path(__file__).parents[2] / "domains" / "drawers"


def test_what_is_out_of_view_is_moved_to_another_place_out_of_view() -> None:
    domain = load_domain(DRAWERS)
    at_top, on_tray = Atom("at", ("lemon", "top")), Atom("at", ("can", "tray"))
    for seed in range(10):
        true = {at_top, on_tray, Atom("hand-empty"), Atom("open", ("middle",))}
        world = SymbolicWorld(domain.task.atoms, true, domain.draw_action, visibility=domain.task.visibility)
        world.disturb("relocate", np.random.default_rng(seed))
        assert world.state[Atom("at", ("lemon", "bottom"))], "the middle one is open"
        assert not world.state[at_top]
        assert world.state[on_tray], "it is in view"
        told = world.disturb("relocate", np.random.default_rng(seed), item="can")
        assert "nothing" in told
