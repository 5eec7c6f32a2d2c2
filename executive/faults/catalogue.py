"""What can be broken: the catalogue of faults, by the word that names each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from executive.faults.image_noise import SPOILED

NONE: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault.

    Attributes:
        description: what happens.
        moment: when in an action.
        example: how it is written.
        ways: the words that say how exactly, each with what it means. Where `way` is empty, one has to be given.
        way: what is meant when no such word is given.
        keys: the arguments that it takes beside `p`, each with what it means to it.
        lasting: the fault does not strike at one moment of an action but lasts from the action's dispatch to the next
            one's; so it can be there before the first action, too (action 0).
    """

    description: str
    moment: str
    example: str
    ways: Mapping[str, str] = field(default_factory=lambda: NONE)
    way: str = ""
    keys: Mapping[str, str] = field(default_factory=lambda: NONE)
    lasting: bool = False


_ACTIONS = {"item": "only in actions that name it"}
_WHEN_DISTURBED: Mapping[str, str] = MappingProxyType(
    {"after": "after the action, before the robot looks", "before": "once the action is decided upon"}
)
_TIMES = {"times": "at most so often in one action"}


_IN_VIEW = {"seconds": "in so many seconds, in view of whoever looks (at once)"}


def _disturbance(description: str, example: str, keys: Mapping[str, str]) -> Kind:
    return Kind(description, "around an action", example, _WHEN_DISTURBED, "after", keys)


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "drop": Kind(
            "the gripper opens while something is carried; physics decides where it lands",
            "while the item is lifted, carried or lowered",
            "drop@4",
            MappingProxyType(
                {
                    "transfer": "at a random time in the middle half of the first transfer",
                    "grasp": "as the item leaves its place",
                    "release": "while the item is lowered, before it stands",
                }
            ),
            "transfer",
            _ACTIONS,
        ),
        "miss": Kind("the next grasp closes beside its item", "before the action", "miss@3", keys=_ACTIONS),
        "slip": Kind(
            "what is carried turns and slides in the grip, and is held on",
            "at a random time in the middle half of the first transfer",
            "slip:p=0.2",
            keys=_ACTIONS,
        ),
        "shove": _disturbance(
            "someone moves an item to another place",
            "shove:item=lemon,table=white-table@3",
            {"item": "the one moved", "table": "where to: a table, a drawer, or a container", **_IN_VIEW},
        ),
        "take": _disturbance("someone takes an item away for good", "take:item=lemon@2", {"item": "the one taken"}),
        "swap": _disturbance(
            "someone swaps two items",
            "swap:item=lemon,with=soda-can@2",
            {"item": "the one", "with": "the other", **_IN_VIEW},
        ),
        "tip": _disturbance(
            "an item is tipped over, and lies", "tip:item=cereal-box@1", {"item": "the one that falls"}
        ),
        "topple": _disturbance(
            "someone topples a tower: what rests on an item falls off it",
            "topple:item=small-red-metal-cube@3",
            {"item": "the one at the foot"},
        ),
        "push": _disturbance("an item is pushed to the floor", "push:item=lemon@2", {"item": "the one pushed"}),
        "block": _disturbance(
            "someone puts boxes wherever there is room on a table", "block:table=white-table@1", {"table": "which"}
        ),
        "jam": Kind(
            "the drawer that is opened or closed is stuck for a while",
            "before the action",
            "jam:drawer=left-drawer@1",
            keys={"drawer": "only in actions that name it", "seconds": "for so long, in the world's seconds (12)"},
        ),
        "roll": _disturbance(
            "a drawer that is open rolls shut by itself", "roll:drawer=left-drawer@2", {"drawer": "which"}
        ),
        "no-effect": Kind(
            "the next action does nothing, and its skill does not notice (in the symbolic world)",
            "before the action",
            "no-effect:p=0.2",
            keys=_ACTIONS,
        ),
        "exogenous": _disturbance(
            "another agent carries out an action that is possible (in the symbolic world)",
            "exogenous:p=0.1",
            {"item": "an object that the action is about"},
        ),
        "relocate": _disturbance(
            "someone moves what is out of view to another place out of view (in the symbolic world)",
            "relocate:p=0.1",
            {"item": "the one moved"},
        ),
        "camera": Kind(
            "the pictures of one camera (`camera:NAME=...`) or of all are degraded",
            "in every look",
            "camera:front=black@5-8",
            MappingProxyType(
                {
                    "black": "its pictures are black",
                    "frozen": "its pictures stay what the last one was",
                    "blurred": "its pictures are out of focus",
                    "shifted": "it was knocked: its pictures are shifted by 8 to 15 % of their width",
                    "noisy": "its pictures are noisy, each in its own way",
                    "dark": "its pictures are dark",
                    "no-depth": "it measures no depth",
                    "moved": "it was knocked: it stands 1 to 3 cm from where it is taken to stand",
                }
            ),
            keys={"amount": "; ".join(f"{way}: {meaning}" for way, meaning in SPOILED.items()), **_TIMES},
            lasting=True,
        ),
        "estimator": Kind(
            "the estimator does not answer, answers wrongly or answers late",
            "in every look",
            "estimator:wrong,item=lemon@2",
            MappingProxyType(
                {
                    "silent": "there is no answer",
                    "wrong": "the opposite is answered",
                    "slow": "answers take longer",
                }
            ),
            keys={
                "item": "only about atoms that name it",
                "share": "wrong: only of this share of atoms, drawn at every look",
                "seconds": "slow: by how many wall seconds (2)",
                **_TIMES,
            },
            lasting=True,
        ),
        "planner": Kind(
            "the planner has no answer",
            "whenever it is asked",
            "planner:timeout,times=1@3",
            MappingProxyType({"timeout": "it runs out of time", "crash": "it crashes"}),
            keys=_TIMES,
            lasting=True,
        ),
        "motion": Kind("the motion planner finds nothing", "in the action", "motion@3", keys=_ACTIONS),
        "skill": Kind(
            "the skill hangs or raises an exception",
            "in the action",
            "skill:hang@3",
            MappingProxyType({"hang": "it never ends by itself", "raise": "it raises an exception"}),
            keys=_ACTIONS,
        ),
    }
)
"""Every kind of fault, by the word that names it."""

PHYSICAL = ("drop", "miss", "slip", "shove", "take", "swap", "tip", "topple", "push", "block", "jam", "roll")
SYMBOLIC = ("no-effect", "exogenous", "relocate")
"""Those that disturb the simulated and the symbolic world (`Simulator.disturb`); the others come between the executive
and one of its parts."""

BY_SOMEONE = ("shove", "take", "swap", "tip", "topple", "push", "block", "roll", "exogenous", "relocate")
"""Disturbances: faults in which someone changes the robot's world."""
