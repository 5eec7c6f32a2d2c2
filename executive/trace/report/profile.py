"""Where a run's time went, for people: `executive run --profile`."""

from __future__ import annotations

from typing import TextIO

from executive.util.profile import OTHER, Profile

_LEAST = 0.005
"""Of the whole; what takes less is told together."""

_IMPORT = "import modules"


def print_profile(profile: Profile, stream: TextIO) -> None:
    """Print the stages, the longest first, and the packages whose import took longest."""
    from rich.text import Text

    from executive.trace.terminal.console import console_for

    console = console_for(stream)

    def line(name: str, seconds: float) -> None:
        text = Text(f"{seconds:8.2f} s {seconds / max(profile.total, 1e-9):6.1%}  ", "dim") + Text(name)
        console.print(text, soft_wrap=True)

    stages = dict(profile.stages)
    other = stages.pop(OTHER, 0.0)
    stages[_IMPORT] = sum(profile.imports.values())
    console.print(Text("time went to"), soft_wrap=True)
    for name, seconds in sorted(stages.items(), key=lambda each: -each[1]):
        if seconds >= _LEAST * profile.total:
            line(name, seconds)
        else:
            other += seconds
    line(OTHER, other)
    line("all", profile.total)
    most = [f"{name} {seconds:.2f}" for name, seconds in profile.imports.items()][:10]
    if most:
        console.print(Text(f"imports, s: {', '.join(most)}"), soft_wrap=True)
