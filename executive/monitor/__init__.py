"""What the looks amount to: three values, consistent with each other, and remembered (issue 5).

`executive.monitor.seam` has what the loop and a monitor say to each other. Pure; values in, values out.
"""

from executive.monitor.actions import ActionModel, Chances
from executive.monitor.eye import EXACT, Eye, Reading
from executive.monitor.fused import FusedMonitor
from executive.monitor.groups import Group, Network
from executive.monitor.plain import PlainMonitor
from executive.monitor.seam import Judgement, Memory, Monitor, Thresholds

__all__ = [
    "EXACT",
    "ActionModel",
    "Chances",
    "Eye",
    "FusedMonitor",
    "Group",
    "Judgement",
    "Memory",
    "Monitor",
    "Network",
    "PlainMonitor",
    "Reading",
    "Thresholds",
]
