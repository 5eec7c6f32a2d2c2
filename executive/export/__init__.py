"""What a run leaves, in the formats of others: MCAP for robot logs, behaviour trees for plans, data sets of
LeRobot to learn from, demonstrations as values.

Each of them is read by its own side's tools; nothing of Executive is needed there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from executive.export.behaviour_trees import monitored_tree, py_tree
    from executive.export.btcpp import btcpp_xml
    from executive.export.lerobot import export_lerobot
    from executive.export.mcap_file import export_mcap
    from executive.export.plans import tree_of_problem, tree_of_run
    from executive.lab.collection.dataset import read_demonstrations
    from executive.lab.collection.demonstrations import Demonstration

__all__ = [
    "Demonstration",
    "btcpp_xml",
    "export_lerobot",
    "export_mcap",
    "monitored_tree",
    "py_tree",
    "read_demonstrations",
    "tree_of_problem",
    "tree_of_run",
]

_FROM = {
    "Demonstration": "executive.lab.collection.demonstrations",
    "read_demonstrations": "executive.lab.collection.dataset",
    "btcpp_xml": "executive.export.btcpp",
    "export_lerobot": "executive.export.lerobot",
    "export_mcap": "executive.export.mcap_file",
    "monitored_tree": "executive.export.behaviour_trees",
    "py_tree": "executive.export.behaviour_trees",
    "tree_of_problem": "executive.export.plans",
    "tree_of_run": "executive.export.plans",
}


def __getattr__(name: str) -> object:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
