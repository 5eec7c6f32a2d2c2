"""A campaign whose workers look through one model: the rows are those of workers that have a model each."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from executive import cli
from executive.app.config import EstimatorConfig
from executive.app.run import RunConfig
from executive.cli import campaign_commands
from executive.lab.campaign.design import Configuration, Episode, Place
from executive.lab.campaign.episode import Row, Simulated, row_of
from executive.lab.common.process_pool import ProcessPool
from executive.s3e.backends.interface import YES_NO, Answer, AnswerWords, Backend
from executive.s3e.backends.shared_client import HostEndedError, kept
from executive.s3e.backends.shared_host import ModelHost
from executive.types import Image
from tests.executive.lab.campaign import players
from tests.executive.lab.campaign.players import lasting
from tests.executive.s3e.checkpoints import build

TRAY = Path(__file__).parents[3] / "domains" / "tray"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with random weights, which sees something else each time."""
    return build("fastvlm", tmp_path_factory.mktemp("models") / "tiny", answering=16.0)


def episodes(model: Path, seeds: int) -> list[Episode]:
    eye = EstimatorConfig(str(model))
    who = Configuration("tiny", kind="vlm", eye=eye)
    place = Place("tray", "fill-tray", str(TRAY))
    limits: dict[str, Any] = {"viewer": False, "max_actions": 1, "max_looks": 4, "max_replans": 2}
    return [
        Episode(place, "none", who, seed, RunConfig(str(TRAY), seed=seed, estimator="vlm", eye=eye, **limits))
        for seed in range(seeds)
    ]


def test_the_rows_are_those_of_one_with_a_model_of_its_own(model: Path, tmp_path: Path, one_thread: None) -> None:
    wanted = episodes(model, 2)
    rows: list[Row] = []
    with (
        ModelHost() as host,
        ProcessPool(partial(Simulated, tmp_path, host.address), 2, 600.0, host.revive, single_threaded=True) as pool,
    ):
        for episode in wanted:
            pool.submit(episode)
        while len(rows) < len(wanted):
            rows += map(row_of, pool.gather(60.0))
        assert kept(host.address) == 2, "each worker keeps the look that it is at"
    own = Simulated(tmp_path)
    assert sorted(map(lasting, rows), key=lambda row: row.seed) == [lasting(own(episode)) for episode in wanted]
    assert [row.error for row in rows] == ["", ""]
    assert min(row.questions for row in rows) > 0


class Dying:
    """A model that ends its process with the first question."""

    name = "dying"

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> Dying:
        return self

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        os._exit(9)


class Undecided(Dying):
    """One that takes everything for as likely as not."""

    name = "undecided"

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        return [Answer(question, 0.5, 0.5) for question in questions]


def dying_or_not(model: str) -> Backend:
    """The first model of a folder dies."""
    first = Path(model) / "first"
    if first.exists():
        first.unlink()
        return Dying()
    return Undecided()


def test_an_episode_that_loses_its_model_fails_and_the_next_one_does_not(tmp_path: Path) -> None:
    """What a robot did that could see nothing any more is no result."""
    (tmp_path / "first").touch()
    one, another, last = episodes(tmp_path, 3)
    with ModelHost(dying_or_not) as host:
        play = Simulated(tmp_path, host.address)
        for episode in (one, another):
            with pytest.raises(HostEndedError, match="the process that holds the model has ended"):
                play(episode)
        host.revive()
        assert play(another).error == ""
        assert host.pid is not None
        os.kill(host.pid, signal.SIGKILL)
        with pytest.raises(HostEndedError):
            play(last)
        host.revive()
        assert play(last).questions > 0


def test_before_an_episode_is_handed_out_there_is_time_to_see_to_things() -> None:
    told: list[int] = []
    with ProcessPool(players.symbolic, 1, 600.0, lambda: told.append(len(told))) as pool:
        for episode in islice(players.campaign().episodes(), 2):
            pool.submit(episode)
            while not pool.gather(60.0):
                pass
    assert told == [0, 1]


LOCAL, DISTANT = EstimatorConfig("a folder"), EstimatorConfig(server="http://127.0.0.1:9/v1")
SEEING = Configuration("vlm", kind="vlm")
BLIND = [Configuration("oracle"), Configuration("distant", kind="vlm", eye=DISTANT)]


@pytest.mark.parametrize(
    ("configurations", "said", "jobs", "gpu", "shared"),
    [
        ([*BLIND, SEEING], None, 2, True, True),
        ([Configuration("vlm", kind="vlm", eye=LOCAL)], None, 2, True, True),
        ([SEEING], None, 2, False, False),
        ([SEEING], None, 1, True, False),
        ([SEEING], True, 1, False, True),
        ([SEEING], False, 2, True, False),
        (BLIND, None, 2, True, False),
        (BLIND, True, 2, True, False),
    ],
)
def test_a_model_is_shared_where_that_saves_a_gpu_from_more_of_them_or_it_is_wanted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    configurations: list[Configuration],
    said: bool | None,
    jobs: int,
    gpu: bool,
    shared: bool,
) -> None:
    place = Place("tray", "fill-tray", str(TRAY))
    wanted = [
        Episode(place, "none", who, 0, RunConfig(str(TRAY), estimator=who.kind, eye=who.eye)) for who in configurations
    ]
    monkeypatch.setattr("executive.s3e.backends.loading.has_gpu", lambda: gpu)
    with campaign_commands._processes(tmp_path, wanted, jobs, 600.0, said) as pool:
        assert isinstance(pool, ProcessPool)
        assert (pool.free, pool.gather(0.0)) == (jobs, [])
        assert (len(pool._prepare.args) == 2) is shared  # type: ignore[attr-defined]


@pytest.mark.parametrize("option", ["--share-model", "--no-share-model"])
def test_with_ray_there_is_none_to_share(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["bench", "any.toml", "--engine", "ray", option]) == cli.BAD_INPUT
    assert capsys.readouterr().err == (
        f"error: {option}: goes with --engine processes; with Ray, each process holds a model of its own\n"
    )
