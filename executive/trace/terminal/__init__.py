"""The live view of a run in a terminal."""

from executive.trace.terminal.sink import TerminalSink

__all__ = ["TerminalSink"]
