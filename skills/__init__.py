"""The skills of the robot, and what they are made of.

A skill hands the function that does its work to `perform`, which gives it an `Attempt` to work on and reports how it
ended. What such a function calls stands here: look, reach, approach, grasp, carry, release, retreat, and `take` and
`put`, which are made of these.
"""

from executive.skills.arm import ArmSkill, Attempt, SkillError
from executive.skills.collision import Held
from executive.skills.in_the_way import blockers
from executive.skills.library import (
    Way,
    approach,
    carry,
    close_fist,
    grasp,
    grasps_of,
    in_hand,
    is_free,
    look,
    reach,
    release,
    retreat,
    spots_for,
    surface,
)
from executive.skills.manipulation import (
    check_rests,
    move_aside,
    nudge,
    put,
    regrasp,
    table_under,
    take,
    uncover,
)
from executive.skills.perform import go_home, perform
from executive.skills.policy import POLICY_FORMAT, Policy, PolicySkill, Sensed, turned
from executive.skills.surfaces import Surface
from executive.skills.towers import carrier, check_stands, tower

__all__ = [
    "POLICY_FORMAT",
    "ArmSkill",
    "Attempt",
    "Held",
    "Policy",
    "PolicySkill",
    "Sensed",
    "SkillError",
    "Surface",
    "Way",
    "approach",
    "blockers",
    "carrier",
    "carry",
    "check_rests",
    "check_stands",
    "close_fist",
    "go_home",
    "grasp",
    "grasps_of",
    "in_hand",
    "is_free",
    "look",
    "move_aside",
    "nudge",
    "perform",
    "put",
    "reach",
    "regrasp",
    "release",
    "retreat",
    "spots_for",
    "surface",
    "table_under",
    "take",
    "tower",
    "turned",
    "uncover",
]
