"""How text reaches a person: in colour on a terminal, plain elsewhere."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TextIO

from rich.console import Console


def console_for(stream: TextIO, environment: Mapping[str, str] = os.environ) -> Console:
    """A console on `stream` that prints what it is given and nothing more (no markup, no guessed highlights).

    Colour only on a terminal, and not where NO_COLOR is set (https://no-color.org) or TERM is "dumb".
    """
    plain = bool(environment.get("NO_COLOR")) or environment.get("TERM") == "dumb"
    return Console(file=stream, markup=False, highlight=False, emoji=False, no_color=plain or None)
