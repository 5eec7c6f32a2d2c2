"""What a look changed in what is known."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.trace.story.last_look import Change, Looks
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Event,
    Facts,
    Judged,
    Looked,
    LookKind,
    Observation,
    Overruled,
    Payload,
    Remembered,
)
from tests.executive.trace.strategies import events

LEMON, CAN = Atom("on-table", ("lemon", "wood-table")), Atom("on-table", ("can", "wood-table"))
PICTURE = np.zeros((2, 2, 3), np.uint8)


def look(number: int, probability: dict[Atom, float], judged: dict[Atom, float] | None = None) -> list[Payload]:
    told: list[Payload] = [
        Observation(number, 0.0, {"front": PICTURE}, np.zeros(6), "why"),
        Belief(number, probability),
        Looked(number, LookKind.FULL, len(probability), 2, ("front",)),
    ]
    if judged is not None:
        told.append(Judged(number, judged, Facts({atom: value >= 0.5 for atom, value in judged.items()})))
    return told


def after(*payloads: Payload) -> Looks:
    looks = Looks()
    for payload in payloads:
        looks.tell(Event(0, 0.0, 0.0, payload))
    return looks


def test_the_first_look_changes_nothing() -> None:
    last = after(*look(0, {LEMON: 0.9, CAN: 0.1})).last
    assert last is not None
    assert (last.changes, last.questions, last.cameras, last.cause) == ((), 2, ("front",), "why")


def test_a_change_tells_what_was_and_what_is() -> None:
    last = after(*look(0, {LEMON: 0.9, CAN: 0.1}), *look(1, {LEMON: 0.2, CAN: 0.8})).last
    assert last is not None
    assert last.changes == (Change(CAN, False, True, 0.8), Change(LEMON, True, False, 0.2))


def test_a_judgement_takes_the_place_of_the_answers() -> None:
    """The look says that the lemon is gone; what else is known says that it is there."""
    overruled = Overruled(LEMON, False, 0.3, True, 0.9)
    first, second = look(0, {LEMON: 0.9}, {LEMON: 0.95}), look(1, {LEMON: 0.3})
    seen = Judged(1, {LEMON: 0.9}, Facts({LEMON: True}), overruled=(overruled,))
    last = after(*first, *second, seen).last
    assert last is not None
    assert last.changes == ()
    assert last.overruled == (overruled,)


def test_what_is_remembered_has_not_changed_and_is_known_as_such() -> None:
    kept = {CAN: Remembered(True, 2, 0.9)}
    looks = after(
        *look(0, {LEMON: 0.9, CAN: 0.9}, {LEMON: 0.9, CAN: 0.9}),
        *look(1, {LEMON: 0.9}),
        Judged(1, {LEMON: 0.9, CAN: 0.8}, Facts({LEMON: True}), remembered=kept),
    )
    assert looks.last is not None
    assert looks.last.changes == ()
    assert looks.remembered == kept


def test_a_glance_changes_nothing_and_is_told_apart() -> None:
    before = look(0, {LEMON: 0.9})
    looks = after(
        *before,
        Observation(1, 0.0, {"hand": PICTURE}, np.zeros(6)),
        Belief(1, {LEMON: 0.0}),
        Looked(1, LookKind.GUARD, 1, 2, ("hand",)),
    )
    assert looks.last == after(*before).last
    assert looks.glance is not None
    assert looks.glance.answers == {LEMON: 0.0}
    assert looks.seen_in == {"front": 0, "hand": 1}
    later = after(*before, *look(2, {LEMON: 0.9})).last
    assert later is not None
    assert later.changes == ()


def test_a_camera_that_is_left_out_is_until_its_next_picture() -> None:
    picture, bad = look(0, {LEMON: 0.9})[0], Blinded("front", "black", 0)
    assert after(picture, bad).blinded == {"front": "black"}
    assert after(picture, bad, *look(1, {LEMON: 0.9})).blinded == {}


@given(st.lists(events, max_size=20))
def test_a_change_is_always_one(some: list[Event]) -> None:
    looks = Looks()
    for event in some:
        looks.tell(event)
        assert all(change.before is not change.now for change in (looks.last.changes if looks.last else ()))
