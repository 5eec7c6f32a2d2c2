"""The rules of the paper's Appendix D, in a real scene with skills that do what the test wants."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from executive.domain.loader import load_domain
from executive.errors import InputError
from executive.lab.collection import episode
from executive.lab.collection.dataset import Ending
from executive.lab.collection.episode import MOST_FAILURES, Collector, Episode, instances
from executive.lab.common.process_pool import ReportProgress
from executive.lab.config import MOST_POINTS
from executive.protocols import SkillContext
from executive.types import Image, SkillResult, SkillStatus, Step

TRAY = load_domain(Path(__file__).parents[3] / "domains" / "tray")
Act = Callable[[Step, SkillContext, int], SkillStatus]


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Episode]:
    """Play an episode whose every action is `act`, which is told how many there were before it."""

    def play(
        act: Act, *, seed: int = 0, number: int = 0, most: int = MOST_POINTS, tell: ReportProgress = lambda done: None
    ) -> Episode:
        begun: list[Step] = []

        def skill(step: Step, context: SkillContext) -> SkillResult:
            begun.append(step)
            return SkillResult(step, act(step, context, len(begun) - 1), "as told")

        monkeypatch.setattr(episode, "load_skills", lambda domain: dict.fromkeys(domain.skills, skill))
        collector = Collector(TRAY, seed, home_pose=True, grasp_noise=0.0, slips=0.0)
        return collector.play(number, most, tell)

    return play


def every(*statuses: SkillStatus) -> Act:
    """These statuses in turn, again and again."""
    return lambda step, context, count: statuses[count % len(statuses)]


DONE, MISSED = SkillStatus.DONE, SkillStatus.GRASP_MISSED


def test_an_episode_is_over_after_twenty_completed_actions(play: Callable[..., Episode]) -> None:
    log, points = play(every(DONE))
    assert (MOST_POINTS, log.points, len(log.attempts), log.ending) == (20, 20, 20, Ending.FULL)
    assert [point.step for point in points] == list(range(1, 21))
    assert {image.shape for point in points for image in point.images.values()} == {(192, 256, 3)}


def test_an_episode_is_over_after_five_failures_in_a_row(play: Callable[..., Episode]) -> None:
    log, points = play(every(MISSED))
    assert (MOST_FAILURES, len(log.attempts), log.ending, points) == (5, 5, Ending.FAILURES, [])


def test_failures_that_are_not_in_a_row_end_nothing(play: Callable[..., Episode]) -> None:
    log, points = play(every(MISSED, MISSED, MISSED, MISSED, DONE))
    assert (len(points), len(log.attempts), log.ending) == (20, 100, Ending.FULL)


def test_points_are_made_of_completed_actions_alone(play: Callable[..., Episode]) -> None:
    log, points = play(every(MISSED, DONE))
    assert [point.action for point in points] == [attempt.action for attempt in log.attempts if attempt.done]
    assert all(attempt.reason == "as told" for attempt in log.attempts)


def test_only_what_applies_is_tried_and_all_of_it(play: Callable[..., Episode]) -> None:
    """Nothing moves, so what applies is to lift either cube from where it stands."""
    log, points = play(every(DONE))
    on = {atom.args for atom in points[0].facts.true if atom.predicate == "resting-on"}
    assert {attempt.action for attempt in log.attempts} == {f"lift({cube},{support})" for cube, support in on}
    assert {cube for cube, _ in on} == {"red-cube", "green-cube"}


def test_labels_are_what_is_true_not_what_was_meant(play: Callable[..., Episode]) -> None:
    """The skill says that it is done and does nothing: all of its effects are surprises."""
    _, points = play(every(DONE))
    steps = {str(step): step for step in instances(TRAY.parsed)}
    for point in points:
        assert point.facts == points[0].facts
        assert set(point.surprises) == set(steps[point.action].unconditional)


def test_an_episode_is_over_when_nothing_applies(play: Callable[..., Episode]) -> None:
    def sweep(step: Step, context: SkillContext, count: int) -> SkillStatus:
        world = context.handle.body
        for item, start in world._places.items():
            world.data.qpos[start : start + 3] = [2.0, 0.3 * len(item), 0.03]  # to the floor
        return DONE

    log, points = play(sweep)
    assert (len(points), log.ending) == (1, Ending.STUCK)
    assert {atom.predicate for atom in points[0].facts.true} == {"hand-free"}


def test_a_skill_that_raises_ends_its_episode(play: Callable[..., Episode], caplog: pytest.LogCaptureFixture) -> None:
    def crash(step: Step, context: SkillContext, count: int) -> SkillStatus:
        if count:
            raise RuntimeError("a bug")
        return DONE

    log, points = play(crash)
    assert (len(points), log.ending) == (1, Ending.CRASHED)
    assert (log.attempts[-1].status, log.attempts[-1].reason) == ("crashed", "RuntimeError: a bug")
    assert "a bug" in caplog.text


def test_an_error_of_the_set_up_is_not_swallowed(play: Callable[..., Episode]) -> None:
    def refuse(step: Step, context: SkillContext, count: int) -> SkillStatus:
        raise InputError("wrong set-up")

    with pytest.raises(InputError, match="wrong set-up"):
        play(refuse)


def test_an_episode_is_cut_where_it_is_told(play: Callable[..., Episode]) -> None:
    whole, cut = play(every(MISSED, DONE)), play(every(MISSED, DONE), most=3)
    assert (cut.log.points, cut.log.ending) == (3, Ending.CUT)
    assert cut.log.attempts == whole.log.attempts[:6]


def test_each_point_is_told_of(play: Callable[..., Episode]) -> None:
    told: list[float] = []
    play(every(MISSED, DONE), most=3, tell=told.append)
    assert told == [1, 2, 3]


def test_seed_and_number_decide_where_things_stand(play: Callable[..., Episode]) -> None:
    def first(**chosen: int) -> Image:
        return play(every(DONE), most=1, **chosen).points[0].images["front"]

    assert np.array_equal(first(seed=4, number=2), first(seed=4, number=2))
    assert not np.array_equal(first(seed=4, number=2), first(seed=4, number=3))
    assert not np.array_equal(first(seed=4, number=2), first(seed=5, number=2))


def test_items_start_upright_wherever_the_problem_has_them(play: Callable[..., Episode]) -> None:
    """The problem puts both cubes on the bench; a collection has them anywhere."""
    stands = {play(every(DONE), number=number, most=1).points[0].facts.true for number in range(6)}
    assert {atom.args[1] for true in stands for atom in true if atom.args} == {"bench", "tray"}
