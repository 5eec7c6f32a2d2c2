"""State estimation: from the estimator's raw answers to true, false or unknown for each atom.

A monitor makes the answers consistent with the task's mutex groups and combines them with earlier looks.
`executive.belief.interface` has the protocol between the loop and a monitor. All of it is pure: values in, values out.
"""

from executive.belief.action_model import ActionModel, Chances
from executive.belief.bayes_filter import BayesMonitor
from executive.belief.constrained import ConstrainedNetwork
from executive.belief.interface import Judgement, Memory, Monitor, Thresholds
from executive.belief.mutex_inference import Group, MutexNetwork
from executive.belief.sensor_model import EXACT, ErrorModel, SensorModel
from executive.belief.state_space import StateSpace
from executive.belief.threshold import ThresholdMonitor
from executive.belief.witnesses import WitnessModel

__all__ = [
    "EXACT",
    "ActionModel",
    "BayesMonitor",
    "Chances",
    "ConstrainedNetwork",
    "ErrorModel",
    "Group",
    "Judgement",
    "Memory",
    "Monitor",
    "MutexNetwork",
    "SensorModel",
    "StateSpace",
    "ThresholdMonitor",
    "Thresholds",
    "WitnessModel",
]
