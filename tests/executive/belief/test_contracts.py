"""Every monitor keeps its contract and has its kind."""

from __future__ import annotations

from typing import Any

from executive import belief
from executive.app.config import FUSED, PLAIN, PRESETS
from executive.belief import ActionModel, BayesMonitor, ErrorModel, Monitor, SensorModel, ThresholdMonitor, Thresholds
from executive.trace.record import monitor_file
from executive.types import Facts, Step
from tests.contracts import MonitorContract
from tests.executive.belief import piles
from tests.executive.belief.hands import ATOMS, HAND, NETWORK, truth
from tests.fakes import pick

SENSOR = SensorModel(other=ErrorModel(0.05, 0.05))


class _Hands(MonitorContract):
    def moments(self) -> tuple[Facts, Step, Facts]:
        before = {"cup": "desk", "jug": "rack", "pot": "tray"}
        return truth(before), pick("cup", "desk"), truth({**before, "cup": HAND})


class TestThreshold(_Hands):
    def make(self) -> Monitor:
        return ThresholdMonitor(ATOMS)


class TestThresholdsWithUnknowns(_Hands):
    def make(self) -> Monitor:
        return ThresholdMonitor(ATOMS, Thresholds(0.1, 0.9))


class TestFused(_Hands):
    def make(self) -> Monitor:
        return BayesMonitor(NETWORK, SENSOR, ActionModel())


class TestFusedWithoutMemory(_Hands):
    def make(self) -> Monitor:
        return BayesMonitor(NETWORK, SENSOR, None)


class TestListedStates(MonitorContract):
    def make(self) -> Monitor:
        return BayesMonitor(belief.MutexNetwork(piles.ATOMS), SENSOR, ActionModel(), space=piles.listed())

    def moments(self) -> tuple[Facts, Step, Facts]:
        after = {piles.at("c", "u"), *(piles.START - {piles.at("c", "t")})}
        return Facts.closed(piles.START, piles.ATOMS), piles.put("c", "u"), Facts.closed(after, piles.ATOMS)


def test_every_monitor_has_a_kind_that_a_record_keeps_and_a_configuration_asks_for() -> None:
    public: list[Any] = [each for each in vars(belief).values() if isinstance(each, type)]
    kinds = [each.kind for each in public if hasattr(each, "looked") and each is not Monitor]
    assert sorted(kinds) == sorted(monitor_file.KINDS) == sorted([PLAIN, FUSED])
    assert {config.kind for config in PRESETS.values()} == {PLAIN, FUSED}
