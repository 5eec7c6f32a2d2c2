"""What one writes to run a robot behind a socket: the connection, the world and two skills, with a limit to everything.

    python -m examples.real_robot.client

The robot here is a fake one that loses packets, answers late and refuses; docs/how-to/real-robot.md goes through this.
"""

from __future__ import annotations

import base64
import json
import socket
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from examples.own_world import FOLDER, PATCH, Board, ColourEstimator
from examples.real_robot.fake_robot import FakeRobot
from executive import (
    Ended,
    FastDownwardPlanner,
    Image,
    Phase,
    Sink,
    SkillContext,
    SkillResult,
    SkillStatus,
    Step,
    TerminalSink,
    TickedWorld,
    make_executive,
    read_task,
)

SPEED = 8.0
"""Cups a second: below the robot's own limit, which is the last line of defence and not the first."""
REPLY, TRIES, TICK, PATIENCE = 0.05, 12, 0.02, 2.0
"""Seconds for an answer, how often it is asked for, seconds between two readings, and the most that a motion takes."""


class SilentError(Exception):
    """The robot does not answer."""


class RefusedError(Exception):
    """The robot answers that it will not."""


class Connection:
    """Orders with numbers: an answer to another one is thrown away, and an order that is sent again is done once."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(address)
        self._number = time.time_ns() % 2**31  # not that of a process before this one

    def ask(self, do: str, **what: Any) -> Mapping[str, Any]:
        self._number += 1
        packet = json.dumps({"number": self._number, "do": do, **what}).encode()
        for _ in range(TRIES):
            try:
                self._socket.send(packet)
                until = time.monotonic() + REPLY
                while (left := until - time.monotonic()) > 0:
                    self._socket.settimeout(left)
                    answer: dict[str, Any] = json.loads(self._socket.recv(65536))
                    if answer["number"] != self._number:
                        continue
                    if answer["refused"]:
                        raise RefusedError(answer["refused"])
                    return answer
            except (TimeoutError, ConnectionError, ValueError):
                continue
        raise SilentError(f"no answer to {do!r} in {TRIES * REPLY:.1f} s")

    def close(self) -> None:
        self._socket.close()


class Rail(TickedWorld):
    """The robot as the loop sees it. Its clock is the wall's."""

    def __init__(self, connection: Connection, marbles: int, cups: Sequence[str]) -> None:
        super().__init__()
        self.robot, self.cups, self._shape = connection, tuple(cups), ((marbles + 1) * PATCH, len(cups) * PATCH, 3)
        self._start, self._state = time.monotonic(), dict[str, Any]()
        self._state = dict(connection.ask("state"))

    @property
    def time(self) -> float:
        return time.monotonic() - self._start

    @property
    def holds(self) -> bool:
        return bool(self._state["holds"])

    @property
    def moving(self) -> bool:
        return bool(self._state["moving"])

    def joints(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([self._state["at"]])

    def pictures(self, cameras: Collection[str] | None) -> dict[str, Image]:
        """No picture, where there is none to be had: what it would show is then unanswered, and looked at again."""
        if cameras is not None and "front" not in cameras:
            return {}
        try:
            pixels = base64.b64decode(self.robot.ask("look")["picture"])
        except SilentError:
            return {}
        return {"front": np.frombuffer(pixels, np.uint8).reshape(self._shape)}

    def tick(self) -> None:
        """A control period: wait, read the robot's state, and do what is due."""
        time.sleep(TICK)
        self._state = dict(self.robot.ask("state"))
        self.passed()

    def stop(self) -> None:
        """Stand still. If this cannot be delivered either, the robot's own watchdog has stopped it."""
        self.robot.ask("stop")


def move(context: SkillContext, cup: str, phase: str) -> bool:
    """Over a cup; False once cancelled. The robot is stopped before this is left, whatever it is left by."""
    rail: Rail = context.handle
    context.announce(Phase(phase, seconds=len(rail.cups) / SPEED))
    arrived, until = False, rail.time + PATIENCE
    try:
        rail.robot.ask("move", to=rail.cups.index(cup), speed=SPEED)
        rail.tick()
        while rail.moving and not context.cancelled():
            if rail.time > until:
                raise SilentError("the motion does not end")
            rail.tick()
        if not rail.moving and abs(rail.joints()[0] - rail.cups.index(cup)) > 0.01:
            raise RefusedError("it stopped on the way")
        arrived = not context.cancelled()
        return arrived
    finally:
        if not arrived:
            rail.stop()


def carry_out(step: Step, context: SkillContext) -> SkillResult:
    """take(marble, cup) and put(marble, cup). Whatever goes wrong is a status, and no exception."""
    rail: Rail = context.handle
    start, (marble, cup), takes = rail.time, step.args, step.action == "take"
    status, reason = SkillStatus.DONE, ""
    try:
        if not move(context, cup, "approach" if takes else "transfer"):
            status = SkillStatus.CANCELLED
        elif not takes and not rail.holds:
            status = SkillStatus.DROPPED
        else:
            context.announce(Phase("grip" if takes else "release", seconds=TICK))
            rail.robot.ask("close" if takes else "open", marble=marble)
            rail.tick()
            if takes and not rail.holds:
                status = SkillStatus.GRASP_MISSED
    except SilentError as error:
        status, reason = SkillStatus.TIMED_OUT, str(error)
    except RefusedError as error:
        status, reason = SkillStatus.NO_PATH, f"the robot refuses: {error}"
    return SkillResult(step, status, reason, rail.time - start)


def play(address: tuple[str, int], sinks: Sequence[Sink] = ()) -> Ended:
    schema = read_task(FOLDER / "domain.pddl", FOLDER / "problem.pddl")
    marbles = [name for name, kind in schema.task.objects.items() if kind == "marble"]
    cups = [name for name, kind in schema.task.objects.items() if kind == "cup"]
    connection = Connection(address)
    try:
        executive = make_executive(
            schema.task,
            FastDownwardPlanner(schema),
            Rail(connection, len(marbles), cups),
            skills={"take": carry_out, "put": carry_out},
            estimator=ColourEstimator(marbles, cups),
            sinks=sinks,
            domain="marbles",
        )
        return executive.run()
    finally:
        connection.close()


if __name__ == "__main__":
    board = Board({"red": "left", "blue": "middle"}, ("left", "middle", "right"))
    with FakeRobot(board, loss=0.2, lag=0.02, refusals=0.2, seed=1) as robot:
        sys.exit(not play(robot.address, [TerminalSink(sys.stdout)]).goal_seen)
