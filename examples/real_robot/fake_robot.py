"""A robot that is none, behind a real socket: a hand on a rail above cups of marbles, which is asked by UDP.

It loses packets, answers late and refuses, as often as a test wants. Like a robot controller it has safety of its own:
it refuses to move faster than its limit, and stands still when it has heard nothing for a while.
"""

from __future__ import annotations

import base64
import json
import random
import socket
import threading
import time
from collections.abc import Mapping
from typing import Any

from examples.own_world import HAND, Board

SPEED_LIMIT, WATCHDOG, TICK = 12.0, 0.5, 0.005
"""Cups a second; seconds without a packet after which it stops by itself; seconds."""


class FakeRobot:
    """Use it as a context manager; `address` is where it listens.

    Args:
        loss: the share of packets that are lost, each way.
        lag: the most seconds that an answer takes.
        refusals: the share of commands that it refuses for no reason that anyone could see.
    """

    def __init__(self, board: Board, loss: float = 0.0, lag: float = 0.0, refusals: float = 0.0, seed: int = 0) -> None:
        self.board, self.loss, self.lag, self.refusals = board, loss, lag, refusals
        self.at, self.goal, self.speed, self.fastest = 0.0, 0.0, 0.0, 0.0
        self.stops = self.obeyed = self.refused = 0
        self._chance, self._mood = random.Random(seed), random.Random(seed + 1)
        self._last, self._heard = (0, b""), 0.0
        self._over = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(TICK)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self) -> FakeRobot:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()

    @property
    def moving(self) -> bool:
        return self.at != self.goal

    def _live(self) -> None:
        before = time.monotonic()
        while not self._over.is_set():
            try:
                packet, sender = self._socket.recvfrom(2048)
                if self._chance.random() >= self.loss:
                    self._heard = time.monotonic()
                    self._reply(packet, sender)
            except TimeoutError:
                pass
            now = time.monotonic()
            self._move(now - before)
            before = now

    def _move(self, seconds: float) -> None:
        if self.moving and time.monotonic() - self._heard > WATCHDOG:
            self.goal = self.at
            self.stops += 1
        way = max(-self.speed * seconds, min(self.speed * seconds, self.goal - self.at))
        self.at = self.goal if abs(self.goal - self.at) < 1e-6 else self.at + way

    def _reply(self, packet: bytes, sender: tuple[str, int]) -> None:
        order = json.loads(packet)
        if order["number"] != self._last[0]:  # one that is sent again, because the answer was lost, is not done again
            self._last = (order["number"], json.dumps(self._answer(order)).encode())
        time.sleep(self._chance.uniform(0.0, self.lag))
        if self._chance.random() >= self.loss:
            self._socket.sendto(self._last[1], sender)

    def _answer(self, order: Mapping[str, Any]) -> dict[str, Any]:
        refused = self._refused(order)
        if refused:
            self.refused += 1
        else:
            self._obey(order)
        picture = base64.b64encode(self.board.picture().tobytes()).decode() if order["do"] == "look" else ""
        state = {"at": self.at, "moving": self.moving, "holds": self.board.held is not None}
        return {"number": order["number"], "refused": refused, **state, "picture": picture}

    def _refused(self, order: Mapping[str, Any]) -> str:
        if order["do"] == "move" and not 0.0 < order["speed"] <= SPEED_LIMIT:
            return f"no faster than {SPEED_LIMIT:g} cups a second"
        if order["do"] in ("move", "close", "open") and self._mood.random() < self.refusals:
            return "protective stop"
        return ""

    def _obey(self, order: Mapping[str, Any]) -> None:
        self.obeyed += 1
        cup = self.board.cups[round(self.at)]
        match order["do"]:
            case "move":
                self.goal, self.speed = float(order["to"]), float(order["speed"])
                self.fastest = max(self.fastest, self.speed)
            case "stop":
                self.goal = self.at
            case "close":
                found = [marble for marble, place in self.board.where.items() if place == cup]
                if self.board.held is None and order["marble"] in found:
                    self.board.where[order["marble"]] = HAND
            case "open" if self.board.held is not None:
                self.board.where[self.board.held] = cup
