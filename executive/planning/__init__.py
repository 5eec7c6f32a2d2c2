"""From a task to a plan: Fast Downward, any planner of unified-planning, mutex groups, and the order of goals."""

from executive.planning.fast_downward import FastDownwardPlanner
from executive.planning.unified_planning import UnifiedPlanner

__all__ = ["FastDownwardPlanner", "UnifiedPlanner"]
