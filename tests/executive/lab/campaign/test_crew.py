"""Whoever plays, the rows are the same; an episode that comes to grief costs itself alone."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import pytest

from executive.errors import ExecutiveError, MissingError
from executive.lab.campaign.crew import Crew, Processes
from executive.lab.campaign.design import Episode
from executive.lab.campaign.episode import FAILED, Player, Row
from executive.lab.campaign.on_ray import OnRay
from tests.executive.lab.campaign import players
from tests.executive.lab.campaign.fake_ray import Died, FakeRay, Reference
from tests.executive.lab.campaign.players import DIES, HANGS, RAISES, campaign, lasting, play


def played(crew: Crew, episodes: Sequence[Episode]) -> dict[tuple[str, ...], Row]:
    """The rows of the episodes, by their keys."""
    rows: list[Row] = []
    left = list(episodes)
    while len(rows) < len(episodes):
        while left and crew.free:
            crew.hand(left.pop(0))
        rows += crew.gather(60.0)
    assert len({row.key for row in rows}) == len(rows)
    return {row.key: lasting(row) for row in rows}


def expected(episodes: Sequence[Episode]) -> dict[tuple[str, ...], Row]:
    return {episode.key: lasting(play(episode)) for episode in episodes}


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    """In place of the module."""
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    return fake


def test_the_same_episodes_give_the_same_rows_whoever_plays_them(ray: FakeRay) -> None:
    episodes = list(campaign().episodes())
    same = expected(episodes)
    with Processes(players.symbolic, 2, 600.0) as processes:
        assert played(processes, episodes) == same
        assert processes.free == 2
    with OnRay(players.symbolic, None, 600.0) as on_ray:
        assert on_ray.free == ray.cores
        assert played(on_ray, episodes) == same
    assert len(ray.actors) == ray.cores
    assert all(actor.dead for actor in ray.actors)


def test_the_real_ray_gives_them_too() -> None:
    pytest.importorskip("ray", reason="the extra executive[ray] is not installed")
    episodes = list(campaign(2).episodes())
    with OnRay(players.symbolic, 2, 600.0) as on_ray:
        assert played(on_ray, episodes) == expected(episodes)


def test_a_process_that_raises_dies_or_hangs_costs_one_episode() -> None:
    episodes = list(campaign(5, faults={"none": ()}).episodes())[1::2]
    with Processes(players.troubled, 1, 600.0) as crew:
        rows = played(crew, [episode for episode in episodes if episode.seed != HANGS])
        assert [row.seed for row in rows.values() if row.outcome != FAILED] == [0, 4]
        failed = {row.seed: row.error for row in rows.values() if row.outcome == FAILED}
        assert failed.keys() == {RAISES, DIES}
        assert failed[RAISES] == "RuntimeError: a bug in two lines"
        assert failed[DIES].startswith("its process died by signal 9 (was there enough memory?")
        (member,) = crew._members
        crew._limit = 0.2
        ((key, row),) = played(crew, episodes[HANGS : HANGS + 1]).items()
        assert (key, row.outcome) == (episodes[HANGS].key, FAILED)
        assert row.error == "took longer than 0.2 s and was ended"
        assert (member.process.is_alive(), crew.free) == (False, 1)


def test_processes_leave_with_their_crew() -> None:
    (episode,) = list(campaign(HANGS + 1, faults={"none": ()}).episodes())[-1:]
    with Processes(players.troubled, 1, 600.0) as crew:
        crew.hand(episode)
        assert (crew.gather(0.0), crew.free) == ([], 0)
        pid = crew._members[0].process.pid
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_an_actor_that_dies_or_hangs_costs_one_episode(ray: FakeRay) -> None:
    def prepare() -> Player:
        return play_or_not

    def play_or_not(episode: Episode) -> Row:
        if episode.seed == DIES:
            raise Died
        if episode.seed == RAISES:
            raise ValueError("a bug")
        return play(episode)

    hanging: list[Reference] = []
    ray.hangs = lambda reference: reference in hanging
    episodes = list(campaign(5, faults={"none": ()}).episodes())[1::2]
    with OnRay(prepare, 1, 600.0) as crew:
        rows = played(crew, [episode for episode in episodes if episode.seed != HANGS])
        failed = {row.seed: row.error for row in rows.values() if row.outcome == FAILED}
        assert failed == {
            RAISES: "ValueError: a bug",
            DIES: "its process died: the actor died unexpectedly",
        }
        crew.hand(episodes[HANGS])
        hanging += crew._busy
        crew._limit = 0.0
        (row,) = crew.gather(1.0)
        assert (row.seed, row.outcome, row.error) == (HANGS, FAILED, "took longer than 0 s and was ended")
        assert crew.free == 1
    assert all(actor.dead for actor in ray.actors)
    assert ray.down == 1


def test_a_cluster_is_joined_or_made(ray: FakeRay) -> None:
    OnRay(players.symbolic, 3, 1.0)
    OnRay(players.symbolic, None, 1.0, "auto")
    assert [(each.get("num_cpus"), each.get("address")) for each in ray.started] == [(3, None), (None, "auto")]
    with pytest.raises(ExecutiveError, match="Ray cannot be used: could not find any running Ray instance at nowhere"):
        OnRay(players.symbolic, None, 1.0, "nowhere")


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingError, match=r"extra executive\[ray\]; install it with: pip install 'executive\[ray\]'"):
        OnRay(players.symbolic, None, 1.0)


def test_nobody_is_hired_before_there_is_work() -> None:
    with Processes(players.symbolic, 3, 1.0) as crew:
        assert (crew.free, crew.gather(0.0), crew._members) == (3, [], [])
