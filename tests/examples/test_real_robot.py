"""A robot behind a socket that loses packets, answers late and refuses: the task is done all the same, or the robot
stands still; it never moves faster than it may, and no order is carried out twice."""

from __future__ import annotations

import numpy as np
import pytest

from examples.own_world import Board
from examples.real_robot import client
from examples.real_robot.client import Connection, Rail, RefusedError, SilentError, carry_out, play
from examples.real_robot.fake_robot import SPEED_LIMIT, FakeRobot
from executive import Event, Phase, SkillContext, SkillStatus, Step
from executive.types import News, OutcomeKind

CUPS = ("left", "middle", "right")


def board() -> Board:
    return Board({"red": "left", "blue": "middle"}, CUPS)


@pytest.mark.parametrize(("loss", "lag", "refusals"), [(0.0, 0.0, 0.0), (0.2, 0.02, 0.0), (0.1, 0.01, 0.3)])
def test_the_marbles_arrive_whatever_the_network_does(loss: float, lag: float, refusals: float) -> None:
    there = board()
    with FakeRobot(there, loss, lag, refusals, seed=1) as robot:
        ended = play(robot.address)
        assert ended.outcome is OutcomeKind.GOAL_REACHED
        assert there.where == {"red": "right", "blue": "right"}
        assert 0.0 < robot.fastest <= client.SPEED < SPEED_LIMIT
        assert not robot.moving
    assert (robot.refused > 0) is (refusals > 0)
    assert ended.actions >= 4 + robot.refused


class Cut:
    """A sink that cuts the connection for good while something is carried."""

    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot

    def write(self, event: Event) -> None:
        if isinstance(event.payload, Phase) and event.payload.name == "transfer":
            self.robot.loss = 1.0

    def close(self) -> None: ...


def test_a_robot_that_cannot_be_reached_any_more_stands_still_and_the_run_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "TRIES", 2)
    there = board()
    with FakeRobot(there) as robot:
        ended = play(robot.address, [Cut(robot)])
        assert not ended.goal_seen
        assert ended.outcome is not OutcomeKind.CRASHED
        assert not robot.moving
    assert there.where["blue"] == "middle"


def test_it_stops_by_itself_when_nobody_speaks_to_it_while_it_moves() -> None:
    with FakeRobot(board()) as robot:
        connection = Connection(robot.address)
        connection.ask("move", to=2.0, speed=0.5)  # four seconds, if it went on
        robot._thread.join(timeout=1.5)
        assert not robot.moving
        assert robot.stops == 1
        assert 0.0 < robot.at < 2.0
        connection.close()


def test_it_refuses_to_move_too_fast() -> None:
    with FakeRobot(board()) as robot:
        connection = Connection(robot.address)
        with pytest.raises(RefusedError, match="no faster"):
            connection.ask("move", to=2.0, speed=SPEED_LIMIT + 1)
        assert (robot.goal, robot.fastest) == (0.0, 0.0)
        connection.close()


def test_an_order_that_is_sent_again_is_carried_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "TRIES", 100)
    monkeypatch.setattr(client, "REPLY", 0.02)
    with FakeRobot(board(), loss=0.5, seed=3) as robot:
        connection = Connection(robot.address)
        for _ in range(20):
            connection.ask("close", marble="red")
        assert robot.obeyed == 20
        connection.close()


def test_silence_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "TRIES", 3)
    with FakeRobot(board(), loss=1.0) as robot:
        connection = Connection(robot.address)
        with pytest.raises(SilentError, match="'state'"):
            connection.ask("state")
        connection.close()


def test_a_cancelled_skill_leaves_the_robot_standing() -> None:
    with FakeRobot(board()) as robot:
        connection = Connection(robot.address)
        rail, told = Rail(connection, 2, CUPS), list[News]()
        context = SkillContext(rail, np.random.default_rng(0), told.append, lambda: bool(told))
        result = carry_out(Step.strips("take", ("red", "right")), context)
        assert result.status is SkillStatus.CANCELLED
        rail.tick()
        assert not rail.moving
        assert robot.board.held is None
        connection.close()


def test_without_a_picture_nothing_is_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "TRIES", 1)
    with FakeRobot(board()) as robot:
        connection = Connection(robot.address)
        rail = Rail(connection, 2, CUPS)
        assert rail.observe().images["front"].shape == board().picture().shape
        robot.loss = 1.0
        assert rail.observe().images == {}
        connection.close()
