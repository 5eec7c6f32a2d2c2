"""Towers: what items stand on, and whether it still stands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from executive.skills import surfaces, transforms
from executive.skills.arm import Attempt, SkillError
from executive.skills.library import look, surface
from executive.skills.manipulation import table_under
from executive.types import SkillStatus


def carrier(attempt: Attempt, item: str) -> str | None:
    """Returns the name of what an item rests on, another item or a table; None where it is on neither.

    Raises:
        SkillError: NOT_THERE where the item is seen nowhere.
    """
    pose, shapes = look(attempt, item), attempt.handle.shapes
    poses = {name: transforms.matrix(pose) for name, pose in attempt.obstacles().items()}
    for name in sorted(poses.keys() - {item} - attempt.handle.unknown):
        if surfaces.rests_on(pose, shapes[item], poses[name], shapes[name]):
            return name
    return table_under(attempt, item)


def tower(attempt: Attempt, target: str) -> list[str]:
    """Returns the items that a surface is made of, from the top one down: the item, or the highest one in the region,
    and what it rests on. None for a table."""
    top = surface(attempt, target)
    if not top.is_item:
        return []
    found: list[str] = []
    below: str | None = top.name
    while below is not None and below in attempt.handle.shapes and below not in found:
        found.append(below)
        below = carrier(attempt, below)
    return found


def check_stands(attempt: Attempt, items: Sequence[str]) -> None:
    """Looks whether the items of a tower (see `tower`) still rest on each other. What is not seen is not in question.

    Raises:
        SkillError: COLLAPSED where they do not.
    """
    shapes, poses = attempt.handle.shapes, attempt.obstacles()
    for upper, lower in pairwise(items):
        if upper in poses and lower in poses:
            one, other = transforms.matrix(poses[upper]), transforms.matrix(poses[lower])
            if not surfaces.rests_on(one, shapes[upper], other, shapes[lower]):
                raise SkillError(SkillStatus.COLLAPSED, f"{upper} fell off {lower}")
