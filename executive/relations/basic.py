"""The relations that come along: on a table, directly on a thing, with nothing on it, in a region of a table, inside a
drawer or a container, an open drawer, between the fingers, and nothing between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeVar

from executive.relations.scene import Scene

Kind = Literal["item", "table", "thing", "region", "surface", "receptacle", "drawer"]
"""The kind of an argument: an [[item]] of the scene, a [[table]], a [[region]] or a [[drawer]]; a thing, which is an
item or a surface; a surface, which is a table or a [[container]]; a receptacle, which is a container or a drawer."""

_OPEN = 0.1
"""The share of its travel from which on a drawer is open: what is less far out is closed."""

_Relation = TypeVar("_Relation", bound=Callable[..., bool])


def takes(*kinds: Kind) -> Callable[[_Relation], _Relation]:
    """Declares the kinds of a relation's parameters after the scene, in their order."""

    def declare(relation: _Relation) -> _Relation:
        vars(relation)["takes"] = kinds
        return relation

    return declare


@takes("item", "surface")
def on(scene: Scene, item: str, table: str) -> bool:
    """The item rests on the table, directly or on other items, and is not gripped.

    Where several tables carry it at once, it is on the one that its centre of mass is nearest to.
    """
    if gripping(scene, item):
        return False
    tables = scene.supports(item)
    centre = scene.items[item].centre
    return bool(tables) and table == min(tables, key=lambda name: scene.tables[name].beside(centre))


@takes("item", "thing")
def directly_on(scene: Scene, item: str, thing: str) -> bool:
    """The thing carries the item itself: they touch, the item is above the thing's middle, and it is not gripped.

    Where several things carry it, it is on the one whose centre is nearest beside its own.
    """
    return not gripping(scene, item) and scene.carrier(item) == thing


@takes("item")
def clear(scene: Scene, item: str) -> bool:
    """No other item is directly on it."""
    return not any(directly_on(scene, other, item) for other in scene.items if other != item)


@takes("item", "region")
def in_region(scene: Scene, item: str, region: str) -> bool:
    """The item rests on the region's table, directly or on other items, with its centre of mass over the region."""
    where = scene.regions[region]
    return where.holds(scene.items[item].centre, scene.tables[where.table]) and on(scene, item, where.table)


@takes("item", "receptacle")
def inside(scene: Scene, item: str, receptacle: str) -> bool:
    """The item rests on the floor of a drawer or a container, directly or on other items, with its centre of mass over
    that floor."""
    over = scene.tables[receptacle].beside(scene.items[item].centre) == 0.0
    return over and on(scene, item, receptacle)


@takes("drawer")
def open_(scene: Scene, drawer: str) -> bool:
    """The drawer is open by more than a tenth of its travel."""
    return scene.openings[drawer] > _OPEN


@takes("item")
def gripping(scene: Scene, item: str) -> bool:
    """The item is between the fingers: they feel something, and both touch it."""
    return scene.feels and all(scene.touch(scene.items[item], finger) for finger in scene.fingers)


@takes()
def gripper_empty(scene: Scene) -> bool:
    """No item is between the fingers."""
    return not any(gripping(scene, item) for item in scene.items)
