"""Whole episodes of a campaign in which the simulator refuses to say anything but to who scores."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from executive.core.loop import Executive
from executive.lab.campaign.config_file import read_campaign
from executive.lab.campaign.episode import Simulated
from executive.lab.campaign.scoring import Scorer
from executive.sim.solids import Solids
from executive.sim.truth import Truth
from executive.sim.world import MujocoWorld

CAMPAIGN = """
title = "Nothing is told"
seeds = 2
[[domains]]
domain = "grocery"
problems = ["one-item"]
[faults]
none = []
drop = ["drop@1"]
[estimators]
vlm = {}
[run]
poses = "depth"
"""


class Silence:
    """The simulator is silent while the loop runs, and speaks to the scorer in between."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.silent, self.refused, self.scored = False, 0, 0
        for kind, names in (
            (MujocoWorld, ("pose", "poses", "gripped", "touched_by")),
            (Truth, ("of", "scene")),
            (Solids, ("scene",)),
        ):
            for name in names:
                monkeypatch.setattr(kind, name, self._guarded(getattr(kind, name), name))
        write, run = Scorer.write, Executive.run

        def scored(scorer: Scorer, *event: Any) -> None:
            with self.spoken(False):
                self.scored += 1
                write(scorer, *event)

        def played(loop: Executive) -> Any:
            with self.spoken(True):
                return run(loop)

        monkeypatch.setattr(Scorer, "write", scored)
        monkeypatch.setattr(Executive, "run", played)

    @contextmanager
    def spoken(self, silent: bool) -> Iterator[None]:
        before, self.silent = self.silent, silent
        try:
            yield
        finally:
            self.silent = before

    def _guarded(self, tell: Callable[..., Any], name: str) -> Callable[..., Any]:
        def told(*arguments: Any) -> Any:
            if self.silent:
                self.refused += 1
                raise AssertionError(f"the simulator is asked for the truth: {name}")
            return tell(*arguments)

        return told


@pytest.mark.slow
def test_a_campaign_needs_the_truth_for_its_scores_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    silence, play = Silence(monkeypatch), Simulated(tmp_path)
    rows = [play(episode) for episode in read_campaign(tmp_path / "campaign.toml").episodes()]
    assert len(rows) == 4
    assert [(row.outcome, row.goal_seen, row.goal_true) for row in rows] == [("goal-reached", True, True)] * 4
    assert sum(len(row.strikes) for row in rows) == 2
    assert silence.refused == 0
    assert silence.scored > 100


@pytest.mark.slow
def test_who_asks_all_the_same_is_caught(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same with the oracle, which asks at its first look: the run crashes."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("vlm = {}", "oracle = {}"))
    silence, (episode, *_) = Silence(monkeypatch), read_campaign(tmp_path / "campaign.toml").episodes()
    assert Simulated(tmp_path)(episode).outcome == "crashed"
    assert silence.refused > 0
