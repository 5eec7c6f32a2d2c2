"""A campaign is the same however many sittings it takes; a folder holds one, and what is damaged is played again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from executive.app.config import MonitorConfig
from executive.errors import InputError
from executive.lab.campaign.campaign_folder import MANIFEST, WORK, CampaignFolder, read_manifest
from executive.lab.campaign.design import Campaign, Configuration, Episode, Place
from executive.lab.campaign.episode import Row
from executive.lab.campaign.rows import FILE, Rows, read_rows
from executive.lab.common.progress import Progress
from tests.executive.lab.campaign.players import FAULTS, Here, campaign, lasting, play

COMMAND = "executive bench things.toml"


def kept(out: Path) -> dict[tuple[str, ...], Row]:
    def refuse(line: str) -> None:
        raise AssertionError(line)

    return {key: lasting(row) for key, row in read_rows(out, refuse).items()}


def sit(out: Path, made: Campaign | None = None, warn: Callable[[str], None] = print, **chosen: Any) -> Here:
    """Have everything played that is missing."""
    pool = Here()
    with CampaignFolder(made or campaign(), out, COMMAND, warn) as folder:
        assert folder.play(folder.wanted(**chosen), pool)
    return pool


@pytest.fixture(scope="module")
def whole() -> dict[tuple[str, ...], Row]:
    """What a campaign in one sitting comes to."""
    return {episode.key: lasting(play(episode)) for episode in campaign().episodes()}


def test_every_episode_has_its_row(tmp_path: Path, whole: dict[tuple[str, ...], Row]) -> None:
    pool = sit(tmp_path / "out")
    assert kept(tmp_path / "out") == whole
    assert len(pool.done) == len(whole) == campaign().size
    manifest = read_manifest(tmp_path / "out")
    assert (manifest["title"], manifest["command"], manifest["episodes"]) == ("Things and places", COMMAND, 24)
    assert not (tmp_path / "out" / WORK).exists()


@pytest.mark.parametrize("after", [0, 1, 7, 23])
def test_one_that_was_cancelled_goes_on_with_what_it_lacks(
    tmp_path: Path, whole: dict[tuple[str, ...], Row], after: int
) -> None:
    pool = Here()
    with CampaignFolder(campaign(), tmp_path, COMMAND) as folder:

        def watch(progress: Progress) -> None:
            if progress.new >= after:
                folder.cancel()

        assert not folder.play(folder.wanted(), pool, watch)
    assert len(kept(tmp_path)) == after
    assert len(sit(tmp_path).done) == len(whole) - after
    assert kept(tmp_path) == whole
    assert sit(tmp_path).done == []


def test_progress_counts_what_there_is_and_what_is_new(tmp_path: Path) -> None:
    sit(tmp_path, seeds=1)
    told: list[Progress] = []
    with CampaignFolder(campaign(), tmp_path, COMMAND) as folder:
        folder.play(folder.wanted(), Here(), told.append)
    assert [(each.points, each.wanted, each.new) for each in told] == [(6 + new, 24, new) for new in range(19)]


def test_what_failed_is_left_alone_until_it_is_to_be_tried_again(
    tmp_path: Path, whole: dict[tuple[str, ...], Row]
) -> None:
    class Unlucky(Here):
        def do(self, job: Episode) -> Row:
            if job.seed == 2:
                raise RuntimeError("no luck")
            return super().do(job)

    with CampaignFolder(campaign(), tmp_path, COMMAND) as folder:
        assert folder.play(folder.wanted(), Unlucky())
        assert folder.missing(folder.wanted()) == []
        folder.retry()
        assert len(folder.missing(folder.wanted())) == 6
        assert folder.play(folder.wanted(), Here())
    assert kept(tmp_path) == whole


def test_a_part_is_played_first_and_the_rest_later(tmp_path: Path, whole: dict[tuple[str, ...], Row]) -> None:
    sit(tmp_path, only=["oracle"], seeds=2)
    assert {(row.estimator, row.seed) for row in kept(tmp_path).values()} == {("oracle", 0), ("oracle", 1)}
    sit(tmp_path)
    assert kept(tmp_path) == whole
    with (
        CampaignFolder(campaign(), tmp_path, COMMAND) as folder,
        pytest.raises(InputError, match="did you mean 'oracle'"),
    ):
        folder.wanted(only=["orakle"])


def test_what_a_kill_left_and_what_is_damaged_is_played_again(
    tmp_path: Path, whole: dict[tuple[str, ...], Row]
) -> None:
    sit(tmp_path)
    lines = (tmp_path / FILE).read_bytes().splitlines(keepends=True)
    lines[3] = b'{"domain": "things"}\n'
    lines[8] = lines[8][: len(lines[8]) // 2] + b"\x00\xff\n"
    (tmp_path / FILE).write_bytes(b"".join(lines)[:-20])
    (tmp_path / WORK).mkdir()
    (tmp_path / WORK / "episode-x").write_text("what a killed process left")
    warnings: list[str] = []
    assert len(sit(tmp_path, warn=warnings.append).done) == 3
    assert kept(tmp_path) == whole
    assert [line.removeprefix(f"{tmp_path / FILE}: ") for line in warnings] == [
        "line 4: is damaged; it is played again",
        "line 9: is damaged; it is played again",
    ]
    assert not (tmp_path / WORK).exists()


def test_rows_come_back_as_they_were(tmp_path: Path, whole: dict[tuple[str, ...], Row]) -> None:
    with Rows(tmp_path) as rows:
        for row in whole.values():
            rows.add(row)
    assert read_rows(tmp_path, print) == whole
    assert [row.key for row in whole.values()] == list(whole)


def test_rows_from_before_a_blind_outcome_had_a_name_of_its_own_count_the_same(
    tmp_path: Path, whole: dict[tuple[str, ...], Row]
) -> None:
    sit(tmp_path)
    text = (tmp_path / FILE).read_text()
    assert '"plan-completed"' in text
    (tmp_path / FILE).write_text(text.replace('"plan-completed"', '"goal-reached"'))
    assert kept(tmp_path) == whole


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"faults": MappingProxyType({**FAULTS, "drops": ("drop:p=0.4",)})}, "the faults 'drops' were others"),
        ({"places": (Place("things", "fake", "things", files="5678"),)}, "the files of 'things/fake' were others"),
        (
            {"configurations": (Configuration("oracle", kind="oracle", monitor_config=MonitorConfig(memory=False)),)},
            "the configuration 'oracle' was another one",
        ),
        ({"options": MappingProxyType({"grasp_noise": 0.01})}, "grasp noise is 0.0 there and 0.01 here"),
    ],
)
def test_another_campaign_in_the_same_folder_is_refused(tmp_path: Path, changes: Any, difference: str) -> None:
    sit(tmp_path, seeds=1)
    with pytest.raises(InputError, match=f"holds another campaign .{difference}.; choose another folder with --out"):
        CampaignFolder(campaign(**changes), tmp_path, COMMAND)


def test_another_version_is_another_campaign_but_not_before_anything_was_played(tmp_path: Path) -> None:
    CampaignFolder(campaign(), tmp_path, COMMAND).__exit__(None, None, None)
    manifest = read_manifest(tmp_path)
    manifest["campaign"]["versions"]["mujoco"] = "2.0"
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    (tmp_path / FILE).unlink()
    sit(tmp_path, seeds=1)
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"mujoco is 2\.0 there and "):
        CampaignFolder(campaign(), tmp_path, COMMAND)


def test_a_campaign_may_grow(tmp_path: Path, whole: dict[tuple[str, ...], Row]) -> None:
    small = campaign(2, faults=MappingProxyType({"none": ()}), configurations=(Configuration("oracle", kind="oracle"),))
    sit(tmp_path, small)
    assert len(sit(tmp_path).done) == 22
    assert kept(tmp_path) == whole


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(InputError, match="is not empty and holds no campaign"):
        CampaignFolder(campaign(), tmp_path / "thesis", COMMAND)
    with pytest.raises(InputError, match="is not a folder"):
        CampaignFolder(campaign(), tmp_path / "thesis" / "chapter.txt", COMMAND)
    with (
        CampaignFolder(campaign(), tmp_path / "out", COMMAND),
        pytest.raises(InputError, match="another process is working in this folder, playing a campaign since"),
    ):
        CampaignFolder(campaign(), tmp_path / "out", COMMAND)
    CampaignFolder(campaign(), tmp_path / "out", COMMAND).__exit__(None, None, None)


@pytest.mark.parametrize(
    ("text", "told"),
    [("", "is not JSON"), ("[]", "is damaged: "), ('{"format": 2}', "format: is damaged: should be 1, got 2")],
)
def test_a_damaged_manifest_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(InputError, match="holds no campaign"):
        read_manifest(tmp_path)
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(InputError, match=told):
        read_manifest(tmp_path)
    with pytest.raises(InputError, match=told):
        CampaignFolder(campaign(), tmp_path, COMMAND)
