"""A run as a short film whose captions say when something went wrong, when that was noticed, and what was done.

It goes as fast as it happened around the failure, faster elsewhere, and stands still where a caption comes in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from executive.trace import phrases
from executive.trace.viewer.colours import AMBER, BLUE, GREEN, GREY, PURPLE, WHITE, Colour
from executive.types import (
    Compared,
    Decision,
    DecisionKind,
    Dispatched,
    Ended,
    Event,
    FaultInjected,
    Guarded,
    Image,
    Plan,
    SkillResult,
)

RATE = 10
"""Pictures a second, of the film as of what is recorded."""
HOLD, LAST = 1.4, 3.0
"""Seconds for which the film stands still where a caption comes in, and at its end."""
BEFORE, AFTER = 0.6, 1.4
"""Seconds around a failure that are shown as fast as they were."""
WIDTH, MARGIN, LINE = 384, 8, 15
ROWS = 8
"""Lines of text below the picture."""
QUALITY = 62
GROUND: Colour = (30, 33, 39)
FONT = ImageFont.load_default(12)


class Moment(NamedTuple):
    """A caption that comes in at a time of the world's clock, in s."""

    time: float
    title: str
    text: str
    colour: Colour


def moments(events: Sequence[Event]) -> Iterator[Moment]:
    """The failure, how it was noticed, what was decided, and how it ended."""
    stage, plans = "", 0
    for event in events:
        payload, time = event.payload, event.time
        plans += isinstance(payload, Plan)
        match payload:
            case FaultInjected() if not stage:
                stage = "failed"
                yield Moment(time, "failure", payload.detail, PURPLE)
            case Guarded(held=False, atom=atom) if stage == "failed":
                stage = "noticed"
                yield Moment(time, "noticed", f"a glance while moving: {atom} is seen no longer", AMBER)
            case SkillResult() if stage in ("", "failed") and not payload.done:
                stage = "noticed"
                yield Moment(time, "noticed", phrases.event(payload), AMBER)
            case Compared(verdict=verdict) if stage == "failed" and verdict.violated:
                stage = "noticed"
                wrong = ", ".join(str(atom) for atom in sorted(verdict.violated)[:2])
                yield Moment(time, "noticed", f"a look, which is not as expected in {wrong}", AMBER)
            case Decision(kind=kind) if stage == "noticed" and kind is not DecisionKind.LOOK_AGAIN:
                stage = "planned" if kind is DecisionKind.REPLAN else "recovered"
                if stage == "recovered":
                    yield Moment(time, "decided", phrases.event(payload), BLUE)
            case Plan() if stage == "planned":
                stage = "recovered"
                yield Moment(time, "decided", f"plan again: {phrases.plan(payload, plans)}", BLUE)
            case Ended():
                yield Moment(time, "end", phrases.event(payload), GREEN)


class Shot(NamedTuple):
    """What a camera sees at a moment of the world's clock, in s."""

    time: float
    picture: Image


def film(file: Path, events: Sequence[Event], shots: Sequence[Shot], speed: int) -> None:
    """Write an animated WebP, which browsers and GitHub show among text."""
    told, times = list(moments(events)), [shot.time for shot in shots]
    failed = [moment.time for moment in told if moment.title == "failure"] or [moment.time for moment in told[:1]]
    clock, waiting = times[0], list(told)
    pictures: list[Picture.Image] = []
    durations: list[int] = []
    while True:
        shown = [moment for moment in told if moment.time <= clock + 1e-6]
        slow = any(time - BEFORE <= clock < time + AFTER for time in failed)
        pace = 1 if slow else speed
        shot = shots[max(0, int(np.searchsorted(times, clock + 1e-6)) - 1)]
        pictures.append(page(shot.picture, clock, pace, doing(events, clock), shown))
        comes_in = [moment for moment in waiting if moment.time <= clock + 1e-6]
        waiting = waiting[len(comes_in) :]
        durations.append(round(1000 * (1 / RATE + HOLD * len({moment.time for moment in comes_in}))))
        if clock >= events[-1].time:
            break
        clock = min([clock + pace / RATE, events[-1].time, *(moment.time for moment in waiting)])
    durations[-1] = round(1000 * LAST)
    pictures[0].save(
        file, save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=QUALITY, method=4,
        minimize_size=False, kmax=60, kmin=30,
    )  # fmt: skip
    print(f"{file.name}: {len(pictures)} pictures, {sum(durations) / 1000:.1f} s, {file.stat().st_size // 1024} kB")
    for moment in told:
        print(f"    {moment.time:.1f} s, {moment.title}: {moment.text}")


def doing(events: Sequence[Event], clock: float) -> str:
    """What the robot does at a time, in words."""
    text = ""
    for event in events:
        if event.time > clock + 1e-6:
            break
        match event.payload:
            case Dispatched(step=step):
                text = phrases.step(step)
            case SkillResult():
                text = "looking"
            case Ended():
                text = ""
    return text


def page(picture: Image, clock: float, pace: int, action: str, told: Sequence[Moment]) -> Picture.Image:
    """A picture with its captions below."""
    drawn = Picture.fromarray(picture)
    if drawn.width != WIDTH:
        drawn = drawn.resize((WIDTH, round(drawn.height * WIDTH / drawn.width)), Picture.Resampling.LANCZOS)
    whole = Picture.new("RGB", (WIDTH, drawn.height + LINE * (ROWS + 1) + MARGIN), GROUND)
    whole.paste(drawn, (0, 0))
    pen, y = ImageDraw.Draw(whole), drawn.height + MARGIN // 2
    stamp = f"{clock:.1f} s" + (f"  x{pace}" if pace > 1 else "")
    room = WIDTH - 3 * MARGIN - FONT.getlength(stamp)
    while FONT.getlength(action) > room:
        action = action.rstrip(".")[:-1] + "..."
    pen.text((MARGIN, y), action, WHITE, FONT)
    pen.text((WIDTH - MARGIN, y), stamp, GREY, FONT, anchor="ra")
    y += LINE + 3
    for moment in told:
        head = f"{moment.title}, {moment.time:.1f} s: "
        letters = (WIDTH - 2 * MARGIN) / (FONT.getlength(head + moment.text) / len(head + moment.text))
        most = 3 if moment.colour is BLUE else 2
        lines = wrap(
            head + moment.text, int(letters) - 2, max_lines=most, placeholder=" …", subsequent_indent="   ",
            break_on_hyphens=False,
        )  # fmt: skip
        for number, line in enumerate(lines):
            pen.text((MARGIN, y), line, moment.colour, FONT)
            if number == 0:  # the title stands out: drawn twice, a pixel apart
                pen.text((MARGIN + 0.6, y), head.partition(",")[0], moment.colour, FONT)
            y += LINE
    return whole
