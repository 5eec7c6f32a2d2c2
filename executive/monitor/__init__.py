"""What the looks amount to: three values, consistent with each other, and remembered (issue 5).

`executive.monitor.seam` has what the loop and a monitor say to each other. Pure; values in, values out.
"""

from executive.monitor.seam import Contradiction, Judgement, Memory, Monitor, Overruled, Remembered, Thresholds

__all__ = ["Contradiction", "Judgement", "Memory", "Monitor", "Overruled", "Remembered", "Thresholds"]
