"""Relations: what makes a predicate's atoms true, as functions of a scene.

On the simulator's scene a relation is the ground truth; on the scene that perception estimates it is a witness, which
may be wrong. There is one meaning, and it stands here.

scene.py   what is where: solids, tables, fingers
convex.py  whether two convex things touch
basic.py   the relations that come along
kinds.py   which relation belongs to a predicate, and the kinds of its arguments
"""

from executive import former_names
from executive.relations.basic import (
    Kind,
    clear,
    directly_on,
    gripper_empty,
    gripping,
    in_region,
    inside,
    on,
    open_,
    takes,
)
from executive.relations.convex import Part
from executive.relations.scene import CONTACT, Region, Relation, Scene, Solid

__all__ = [
    "CONTACT",
    "Kind",
    "Part",
    "Region",
    "Relation",
    "Scene",
    "Solid",
    "clear",
    "directly_on",
    "gripper_empty",
    "gripping",
    "in_region",
    "inside",
    "on",
    "open_",
    "takes",
]


def __getattr__(name: str) -> object:
    if name in ("State", "SimState"):
        return former_names.renamed("executive.sim.relations", name, "executive.Scene", Scene)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
