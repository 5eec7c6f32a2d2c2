"""What the looks amount to: three values, consistent with each other, and remembered (issue 5).

`executive.belief.interface` has what the loop and a monitor say to each other. Pure; values in, values out.
"""

from executive.belief.action_model import ActionModel, Chances
from executive.belief.bayes_filter import BayesMonitor
from executive.belief.interface import Judgement, Memory, Monitor, Thresholds
from executive.belief.mutex_inference import Group, MutexNetwork
from executive.belief.sensor_model import EXACT, ErrorModel, SensorModel
from executive.belief.threshold import ThresholdMonitor

__all__ = [
    "EXACT",
    "ActionModel",
    "BayesMonitor",
    "Chances",
    "ErrorModel",
    "Group",
    "Judgement",
    "Memory",
    "Monitor",
    "MutexNetwork",
    "SensorModel",
    "ThresholdMonitor",
    "Thresholds",
]
