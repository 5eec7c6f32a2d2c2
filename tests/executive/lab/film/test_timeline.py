"""A film lingers at each moment between actions, and shows everything else as fast as it went."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.lab.film.timeline import mid_poses, shown
from executive.types import Dispatched, Event, Moved, Observation, Phase, SkillResult, SkillStatus, Step

PICK, PLACE = Step("pick", ("mug", "blue")), Step("place", ("mug", "white"))


def event(time: float, payload: object) -> Event:
    return Event(0, time, time, payload)  # type: ignore[arg-type]


def look(time: float) -> Event:
    return event(time, Observation(0, time, {}, np.empty(0)))


def skill(step: Step, begin: float, end: float) -> list[Event]:
    grips = event(0.5 * (begin + end), Phase("grip"))
    return [event(begin, Dispatched(step, 1, 1, 0)), grips, event(end, SkillResult(step, SkillStatus.DONE))]


RUN = [look(0.0), *skill(PICK, 0.0, 4.0), look(4.0), *skill(PLACE, 4.0, 7.0), look(7.0)]


def test_a_run_of_two_actions() -> None:
    frames = shown(RUN, fps=10, pause=0.5)
    assert mid_poses(RUN) == (0.0, 4.0, 7.0)
    assert len(frames) == 85
    assert [number for number, frame in enumerate(frames) if frame.mid_pose] == [
        *range(5), *range(45, 50), *range(80, 85)
    ]  # fmt: skip
    assert {frame.world_time for frame in frames if frame.mid_pose} == {0.0, 4.0, 7.0}
    assert [frames[at].world_time for at in (20, 30)] == pytest.approx([1.5, 2.5])
    assert [frames[at][1:] for at in (20, 30)] == [(False, "pick(mug,blue)", ""), (False, "pick(mug,blue)", "grip")]
    assert frames[52].action == "place(mug,white)"


def test_looks_during_an_action_are_no_mid_poses() -> None:
    begins, grips, ends = skill(PICK, 0.0, 4.0)
    assert mid_poses([begins, look(1.0), grips, look(3.0), ends]) == (4.0,)


def test_moving_out_of_the_way_is_no_action_and_no_mid_pose() -> None:
    moving = [event(4.0, Phase("aside")), event(6.0, Moved("aside", SkillStatus.DONE)), look(6.0)]
    frames = shown([*RUN[:5], *moving], fps=10, pause=0.5)
    between = [frame for frame in frames if 4.0 < frame.world_time < 6.0]
    assert len(between) == 19
    assert {(frame.action, frame.phase, frame.mid_pose) for frame in between} == {("", "move aside", False)}


@given(
    ends=st.lists(st.floats(0.3, 5.0), min_size=1, max_size=6),
    fps=st.integers(1, 60),
    frames=st.integers(1, 20),
)
def test_every_stop_has_its_frames_and_time_never_goes_back(ends: list[float], fps: int, frames: int) -> None:
    events, now = [look(0.0)], 0.0
    for seconds in ends:
        events += [*skill(PICK, now, now + seconds), look(now + seconds)]
        now += seconds
    pause = frames / fps
    film = shown(events, fps, pause)
    stops = mid_poses(events)
    assert len(film) == pytest.approx(fps * (now + pause * len(stops)), abs=1.01)
    times = [frame.world_time for frame in film]
    assert times == pytest.approx(sorted(times), abs=1e-9)  # differences of seconds are rounded
    for stop in stops[:-1]:  # the last one may be cut short by a part of a frame
        assert abs(sum(frame.mid_pose and frame.world_time == stop for frame in film) - frames) <= 1
    assert all(not frame.action for frame in film if frame.mid_pose)
