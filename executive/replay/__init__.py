"""A run's decisions once more, from its record: no model looks, no simulator moves, no planner searches."""

from executive.replay.comparison import Comparison, Row, compare_run, side_by_side
from executive.replay.engine import Replay, replay
from executive.replay.record import Decided, Record

__all__ = ["Comparison", "Decided", "Record", "Replay", "Row", "compare_run", "replay", "side_by_side"]
