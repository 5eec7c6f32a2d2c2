"""Colours with a meaning, for the viewer: sRGB, made for its dark background."""

from __future__ import annotations

from typing import TypeAlias

from executive.trace.story.story import Mark, Standing

Colour: TypeAlias = tuple[int, int, int]

GREEN: Colour = (80, 190, 120)
RED: Colour = (235, 95, 80)
AMBER: Colour = (235, 175, 60)
BLUE: Colour = (90, 155, 240)
PURPLE: Colour = (170, 120, 230)
GREY: Colour = (150, 156, 166)
DIM: Colour = (95, 100, 110)
WHITE: Colour = (225, 228, 232)
SILVER: Colour = (140, 158, 185)
"""For what has no meaning and may stand on a light ground as well: in a browser that asks for it, panels are light."""

COLOUR_OF: dict[Mark | Standing, Colour] = {
    Mark.PENDING: GREY,
    Mark.CURRENT: BLUE,
    Mark.DONE: GREEN,
    Mark.FAILED: RED,
    Mark.SKIPPED: DIM,
    Mark.DROPPED: DIM,
    Standing.SURPRISE: RED,
    Standing.DOUBT: AMBER,
    Standing.EXPECTED: GREEN,
}
LANES: tuple[Colour, ...] = (
    (66, 112, 176),
    (64, 140, 130),
    (128, 98, 170),
    (160, 112, 60),
    (150, 84, 110),
    (96, 124, 64),
    (84, 100, 150),
)
"""For states without a meaning of their own, told apart by hue; white text is readable on all of them."""
REACHED: Colour = (52, 140, 84)
TO_GO: Colour = (84, 100, 110)
"""For how much of the goal holds."""
CURVES: tuple[Colour, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (240, 228, 66),
    (204, 121, 167),
    (213, 94, 0),
    (148, 140, 240),
    (170, 200, 120),
    (200, 170, 140),
    (120, 200, 210),
)
"""For curves, told apart also by those who see few hues (after Okabe and Ito), brightened for the dark background."""
CYAN: Colour = (90, 220, 235)
