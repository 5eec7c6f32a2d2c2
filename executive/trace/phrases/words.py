"""Words that phrases are made of: numbers with their nouns, lists, truth values, steps."""

from __future__ import annotations

from collections.abc import Collection

from executive.types import Step

MOST = 6
"""How many things a phrase lists before it counts the rest."""


def sentence(phrase: str) -> str:
    """Return a phrase as a sentence."""
    return f"{phrase[:1].upper()}{phrase[1:]}."


def step(some: Step) -> str:
    return " ".join((some.action, *some.args))


def truth(value: bool | None, unknown: str = "unknown") -> str:
    return unknown if value is None else "true" if value else "false"


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def counts(**nouns: int) -> str:
    """`8 actions, 1 replan`, from `action=8, replan=1`."""
    return ", ".join(plural(count, noun) for noun, count in nouns.items())


def listed(things: Collection[object], most: int = MOST) -> str:
    shown = ", ".join(str(thing) for thing in list(things)[:most])
    return f"{shown} and {len(things) - most} more" if len(things) > most else shown or "nothing"


def compared(what: str, about: Step | None) -> str:
    """Return what a comparison is about: what a step needs, or what came of it, or the goal."""
    if what == "goal":
        return "the goal"
    moment = {"preconditions": "before", "effects": "after"}.get(what, what)
    return f"{moment} {step(about)}" if about else moment


def opening(compiling: str, planning: bool) -> str:
    """Return what goes on before the first step."""
    return "planning" if planning else f"compiling {compiling}" if compiling else "looking at the world"


def note(wrong: str, cut_off: bool = False) -> str:
    """Return what went wrong with a step."""
    return "cut off" if cut_off else wrong


def goal(count: tuple[int, int] | None, is_assumed: bool) -> str:
    """Return how many of how many parts of the goal hold."""
    return "" if count is None else f"goal {count[0]} of {count[1]}{' assumed' * is_assumed}"


def probability(value: float | None) -> str:
    return "" if value is None else f", P {value:.2f}"
