"""What the benchmark of monitors counts is what it says, and what it looks for it finds."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import monitor
from benchmarks.monitored import configurations, figures, looks, spoiling
from benchmarks.monitored.configurations import FULL, ORACLE, PLAIN, SETTINGS, flipped
from benchmarks.monitored.courses import courses, flipping, graded
from executive.belief import EXACT, ActionModel, MutexNetwork
from executive.domain.loader import load_domain
from executive.faults import parse_fault
from executive.lab.campaign.design import Episode
from executive.lab.campaign.episode import Row, Simulated
from executive.lab.campaign.scoring import Strike
from executive.planning.mutex_groups import find_mutexes


@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> list[Episode]:
    estimators = configurations.oracles(tmp_path_factory.mktemp("calibration"))
    return list(configurations.campaign("symbolic", configurations.grocery([None]), estimators, 2).episodes())


def of(episodes: list[Episode], estimator: str, *settings: str) -> list[Row]:
    return [
        Simulated()(episode)
        for episode in episodes
        if episode.configuration.estimator == estimator and episode.configuration.monitor in (settings or SETTINGS)
    ]


def test_an_honest_eye_misses_nothing_and_is_alarmed_by_nothing(episodes: list[Episode]) -> None:
    told = figures.scores(of(episodes, ORACLE))
    assert list(told) == [(ORACLE, setting) for setting in SETTINGS]
    for each in told.values():
        assert (each.success, each.false_success, each.missed, each.alarms, each.needless) == (1, 0, 0, 0, 0)
        assert each.delay is not None
    assert len({each.replans for each in told.values()}) == 1


def test_answers_that_are_turned_around_alarm_the_plain_threshold_and_the_same_seed_counts_the_same(
    episodes: list[Episode],
) -> None:
    plain = of(episodes, flipped(0.1), PLAIN)
    assert [replace(row, wall_seconds=0.0) for row in plain] == [
        replace(row, wall_seconds=0.0) for row in of(episodes, flipped(0.1), PLAIN)
    ]
    alarms = figures.score(plain).alarms
    assert alarms is not None
    assert alarms > 0.2
    # They belong to the estimator, and are nothing that it could notice.
    assert not any(strike.kind == "estimator" for row in plain for strike in row.strikes)


def row(outcome: str = "goal-reached", true: bool = True, **counts: object) -> Row:
    return Row("d", "p", "f", "e", "m", 0, outcome, "", goal_true=true, **counts)  # type: ignore[arg-type]


def test_figures_are_shares_and_means() -> None:
    drop, camera = Strike("drop", "drop@1", 1, 2.0, 0.5), Strike("camera", "camera:black@1", 1, 2.0, 9.0)
    told = figures.score(
        [
            row(actions=4, looks=6, questions=60, quiet=3, alarms=1, failed=1, missed=1, needless=1, strikes=(drop,)),
            row(true=False, actions=4, looks=4, questions=20, quiet=1, failed=3, replans=2, strikes=(camera,)),
            row("partial", actions=2, looks=0, needless=0),
        ]
    )
    assert told.success == told.false_success == pytest.approx(1 / 3)
    assert (told.missed, told.alarms, told.delay) == (0.25, 0.25, 0.5)
    assert told.needless == pytest.approx(1 / 3)
    assert told.replans == pytest.approx(2 / 3)
    assert (told.looks, told.questions) == (1.0, 8.0)
    assert figures.score([row()]).missed is None


@pytest.mark.parametrize(("success", "needless", "false"), [(0.98, 0.3, 0.01), (0.96, 0.31, 0.02)])
def test_targets_are_reached_or_not(success: float, needless: float, false: float) -> None:
    well = figures.score([row()])
    noisy = replace(well, success=success, needless=needless, false_success=false)
    found = {(ORACLE, FULL): well, (ORACLE, PLAIN): well, (flipped(0.05), FULL): noisy, (flipped(0.05), PLAIN): well}
    targets = figures.of_loop("here", found)
    reached = [target.reached for target in targets if ORACLE not in target.what]
    assert reached == [success > 0.97] * 3
    assert ("NOT REACHED" in figures.told(targets)) is not reached[0]
    assert figures.table(found).count("\n") == 4


@given(st.floats(0.05, 0.95), st.floats(4.0, 40.0))
def test_an_amount_is_found_at_which_half_is_right(where: float, steepness: float) -> None:
    def rate(amount: float) -> float:
        return 1.0 / (1.0 + math.pow(2.0, steepness * (amount - where)))

    assert abs(rate(spoiling.found(rate, 0.0, 1.0)) - 0.5) <= 2 * spoiling.NEAR


def test_bad_pictures_are_a_fault_of_their_eye_and_their_calibration_tells_one_from_another(tmp_path: Path) -> None:
    domain = load_domain("grocery")
    network = MutexNetwork(domain.task.atoms, find_mutexes(domain.parsed).groups)
    taken = courses(domain, 6, 10, 0)
    some, other = (looks.trusted(network, taken, graded(seed)) for seed in (0, 1))
    first, again, second = (configurations.spoiled("noisy=40", trust, tmp_path) for trust in (some, some, other))
    assert first == again
    assert first.calibration != second.calibration
    (fault,) = map(parse_fault, first.faults)
    assert (fault.kind, fault.way, fault.amount, fault.action) == ("camera", "noisy", 40.0, 0)


def test_each_part_of_a_monitor_makes_more_of_the_same_looks() -> None:
    domain = load_domain("grocery")
    network = MutexNetwork(domain.task.atoms, find_mutexes(domain.parsed).groups)
    taken = courses(domain, 6, 20, 0)
    exact = [
        looks.judged(each, taken, flipping(0.0, 0)) for _, each in looks.settings(domain, network, EXACT, ActionModel())
    ]
    assert [each.state for each in exact] == [1.0] * 3
    sensor = looks.trusted(network, courses(domain, 30, 20, 1), graded(0)).sensor_model
    states = [
        looks.judged(each, taken, graded(2)).state for _, each in looks.settings(domain, network, sensor, ActionModel())
    ]
    assert states == sorted(states)
    assert states[2] - states[0] > 0.2
    for each in looks.coverage("graded", network, courses(domain, 60, 20, 3), graded(4)):
        assert each.measured == pytest.approx(each.asked, abs=0.02)


def test_the_command_goes_on_where_it_was_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = []
    for seeds in (1, 1, 2):
        words = ["--only", "symbolic", "--symbolic-seeds", str(seeds), "--out", str(tmp_path), "--jobs", "1", "--json"]
        monkeypatch.setattr(sys, "argv", ["monitor", *words])
        assert monitor.main() == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1]
    assert {each["episodes"] for each in told[2]["symbolic"]["episodes"]} == {2}
    assert {target["reached"] for target in told[2]["targets"]} <= {True, False}
    assert len((tmp_path / "symbolic" / "episodes.jsonl").read_text().splitlines()) == 2 * 16
    monkeypatch.setattr(sys, "argv", ["monitor", "--data", str(tmp_path / "none"), "--out", str(tmp_path)])
    assert monitor.main() == 2
    assert capsys.readouterr().err.count("\n") == 1
