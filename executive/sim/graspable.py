"""Whether the gripper can take an item at all, whichever way it lies. Pure geometry; lengths are in m."""

from __future__ import annotations

from executive.sim.scene import WIDEST_GRIP, ItemShape

_THINNEST = 0.005
"""m: of what is thinner the fingers feel nothing between them, and what lies flatter they close above."""


def why_not(shape: ItemShape) -> str | None:
    """Says why the gripper can take an item in no pose in which it rests; None where it can in some."""
    extents = [2.0 * float(half) for half in shape.half]
    round_ones = [extent for axis, extent in enumerate(extents) if axis != shape.axis]
    across = min(extents) if shape.axis is None else max(round_ones)
    size = " x ".join(f"{100.0 * extent:.1f}" for extent in extents)
    if min(extents) < _THINNEST:
        return f"{shape.name}, {size} cm, is too thin to be taken: {1000.0 * _THINNEST:g} mm is the least"
    if across >= WIDEST_GRIP:
        widest = f"{1000.0 * WIDEST_GRIP:g} mm"
        return f"{shape.name}, {size} cm, is too wide to be taken in any pose: the gripper opens {widest}"
    return None
