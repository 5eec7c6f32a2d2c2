"""What decisions, events and outcomes are called in English, for terminal, viewer and reports alike.

Phrases are clauses in the present tense, without a capital letter or a full stop; `sentence` adds both. What comes from
outside (a skill's words, an error) may hold anything; who prints a phrase sees to that.
"""

from executive.trace.phrases.events import (
    EVENTS,
    account,
    action,
    blinded,
    contradiction,
    depth_left_out,
    event,
    ground,
    look,
    look_cause,
    overruled,
    plan,
    plan_title,
)
from executive.trace.phrases.reasons import REASONS, why
from executive.trace.phrases.words import (
    MOST,
    compared,
    counts,
    goal,
    listed,
    note,
    opening,
    plural,
    probability,
    sentence,
    step,
    truth,
)

__all__ = [
    "EVENTS",
    "MOST",
    "REASONS",
    "account",
    "action",
    "blinded",
    "compared",
    "contradiction",
    "counts",
    "depth_left_out",
    "event",
    "goal",
    "ground",
    "listed",
    "look",
    "look_cause",
    "note",
    "opening",
    "overruled",
    "plan",
    "plan_title",
    "plural",
    "probability",
    "sentence",
    "step",
    "truth",
    "why",
]
