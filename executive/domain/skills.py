"""The skills by the words that a domain names them with: those that come along, and those that packages register."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points

GROUP = "executive.skills"
"""The entry-point group under which packages register skills of their own."""

COME_ALONG = {
    "pick": "executive.skills.pick:pick",
    "place": "executive.skills.place:place",
    "move": "executive.skills.move:move",
    "open": "executive.skills.drawers:open_",
    "close": "executive.skills.drawers:close",
    "home": "executive.skills.clear_view:home",
    "aside": "executive.skills.clear_view:aside",
}
"""Those of this package, and where they are: found whatever was registered when it was installed."""

LEARNED = EntryPoint("policy", "executive.skills.policy:PolicySkill", GROUP)
"""What makes a skill of a policy's file. No domain names it: which policy a run uses is an option of the run."""


def skills() -> Mapping[str, EntryPoint]:
    """All skills by name, none of them loaded yet."""
    found = {point.name: point for point in entry_points(group=GROUP)}
    return found | {name: EntryPoint(name, where, GROUP) for name, where in COME_ALONG.items()}
