"""From a task to a plan: Fast Downward, the task written for it, its mutex groups, and the order of goals."""

from executive.planning.fast_downward import FastDownwardPlanner

__all__ = ["FastDownwardPlanner"]
