"""What the looks amount to: three values, consistent with each other, and remembered (issue 5).

`executive.monitor.seam` has what the loop and a monitor say to each other. Pure; values in, values out.
"""

from executive.monitor.plain import PlainMonitor
from executive.monitor.seam import Judgement, Memory, Monitor, Thresholds

__all__ = ["Judgement", "Memory", "Monitor", "PlainMonitor", "Thresholds"]
