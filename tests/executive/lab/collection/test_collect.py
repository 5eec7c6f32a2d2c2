"""A collection is the same whoever plays its episodes, when, and in how many sittings. The tray, with real skills."""

from __future__ import annotations

import json
import multiprocessing
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from executive import cli
from executive.errors import DomainError, ExecutiveError, InputError, OptionError
from executive.lab.collection import dataset
from executive.lab.collection.collect import FRUITLESS, Collection
from executive.lab.collection.dataset import Attempt, Ending, Log
from executive.lab.collection.episode import MOST_FAILURES
from executive.lab.common.progress import Progress
from executive.lab.config import CollectConfig

TRAY = Path(__file__).parents[3] / "domains" / "tray"
COMMAND = [sys.executable, "-m", "executive", "collect", str(TRAY)]


def config(out: Path, points: int = 5, **chosen: Any) -> CollectConfig:
    """Two points an episode, so that five take three, and grasps that go wrong now and then."""
    return CollectConfig(str(TRAY), out, points, **{"seed": 2, "grasp_noise": 0.012, "per_episode": 2, **chosen})


def collect(made: CollectConfig, warn: Callable[[str], None] = print) -> dict[str, Any]:
    with Collection(made, warn) as collection:
        manifest = collection.run()
    assert manifest is not None
    return manifest


def content(out: Path) -> list[tuple[Any, Any]]:
    """The rows, and all that is said beside them, of each episode."""
    tables = [pq.read_table(path) for path in sorted((out / dataset.SHARDS).iterdir())]
    return [(table.to_pylist(), json.loads(table.schema.metadata[b"executive"])) for table in tables]


@pytest.fixture(scope="module")
def five(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five points, collected by one process."""
    out = tmp_path_factory.mktemp("five") / "data"
    collect(config(out, jobs=1))
    return out


@pytest.fixture
def copy(five: Path, tmp_path: Path) -> Path:
    """A folder of one's own with the five points."""
    return Path(shutil.copytree(five, tmp_path / "copy"))


def test_points_are_as_many_as_asked_for(five: Path) -> None:
    points = list(dataset.read(five))
    assert [(point.episode, point.step) for point in points] == [(0, 1), (0, 2), (1, 1), (1, 2), (2, 1)]
    assert {point.seed for point in points} == {2}
    assert all(len(point.facts) == 7 for point in points)
    assert {point.images["front"].shape for point in points} == {(192, 256, 3)}


def test_numbers_of_the_manifest_are_those_of_the_files(five: Path) -> None:
    manifest, shards = dataset.read_manifest(five), content(five)
    attempts = [Attempt(*attempt) for _, said in shards for attempt in said["attempts"]]
    counted = manifest["statistics"]
    assert manifest["finished"]
    assert counted["points"] == sum(len(rows) for rows, _ in shards) == 5
    assert sum(sum(statuses.values()) for statuses in counted["attempts"].values()) == len(attempts)
    assert sum(statuses.get("done", 0) for statuses in counted["attempts"].values()) == 5
    assert {name: sum(each.values()) for name, each in counted["predicates"].items()} == {
        "hand-free": 5,
        "holding": 10,
        "resting-on": 20,
    }
    assert str(dataset.read_manifest(five)["command"]) in (five / dataset.CARD).read_text()


def test_processes_share_the_work_and_change_nothing(five: Path, tmp_path: Path) -> None:
    collect(config(tmp_path / "two", jobs=2))
    assert content(tmp_path / "two") == content(five)


def test_what_is_missing_or_damaged_is_collected_again(five: Path, copy: Path) -> None:
    dataset.shard(copy, 1).unlink()
    damaged = dataset.shard(copy, 0)
    damaged.write_bytes(damaged.read_bytes()[:1000])
    (copy / dataset.SHARDS / ".episode-00001.parquet.123").write_bytes(b"what a killed process left")
    warnings: list[str] = []
    collect(config(copy, jobs=1), warnings.append)
    assert content(copy) == content(five)
    assert len(warnings) == 1
    assert "episode-00000.parquet: is damaged" in warnings[0]
    assert "it is collected again" in warnings[0]


def test_a_collection_can_be_extended_but_not_made_smaller(five: Path, tmp_path: Path) -> None:
    out = tmp_path / "grows"
    collect(config(out, points=3, jobs=1))
    assert [len(rows) for rows, _ in content(out)] == [2, 1]
    collect(config(out, points=5, jobs=1))
    assert content(out) == content(five)
    with pytest.raises(InputError, match="holds a collection of 5 points, which can be extended but not made smaller"):
        Collection(config(out, points=4))


def test_what_is_finished_is_left_alone(copy: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (copy / dataset.SHARDS).iterdir()}
    watched: list[Progress] = []
    with Collection(config(copy)) as collection:
        collection.run(watched.append)
    assert {path: path.stat().st_mtime_ns for path in (copy / dataset.SHARDS).iterdir()} == before
    assert watched == []


def test_a_cancelled_collection_goes_on_later(five: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    with Collection(config(out, jobs=1)) as collection:

        def watch(progress: Progress) -> None:
            if progress.points >= 2:
                collection.cancel()

        assert collection.run(watch) is None
    assert not dataset.read_manifest(out)["finished"]
    assert len(content(out)) < 3
    collect(config(out, jobs=1))
    assert content(out) == content(five)


def test_a_process_that_dies_is_one_line_and_costs_nothing_finished(tmp_path: Path) -> None:
    def kill(progress: Progress) -> None:
        for child in multiprocessing.active_children():
            child.kill()

    with (
        Collection(config(tmp_path / "data", jobs=1)) as collection,
        pytest.raises(ExecutiveError, match=r"^episode 0: its process died .*; resume with: executive collect "),
    ):
        collection.run(kill)
    Collection(config(tmp_path / "data")).close()


@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        ({"seed": 3}, "seed is 2 there and 3 here"),
        ({"home_pose": False}, "home pose is True there and False here"),
        ({"grasp_noise": 0.0}, "grasp noise is 0.012 there and 0.0 here"),
        ({"slips": 0.5}, "slips is 0.05 there and 0.5 here"),
    ],
)
def test_another_collection_in_the_same_folder_is_refused(five: Path, changed: Any, difference: str) -> None:
    with pytest.raises(InputError, match=f"holds another collection .{difference}.; choose another folder"):
        Collection(config(five, **changed))


def test_another_version_is_another_collection(copy: Path) -> None:
    manifest = dataset.read_manifest(copy)
    manifest["collection"]["versions"]["mujoco"] = "2.0"
    (copy / dataset.MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"mujoco is 2\.0 there and "):
        Collection(config(copy))


def test_folders_of_others_are_left_alone(tmp_path: Path, copy: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(InputError, match="is not empty and holds no collection"):
        Collection(config(tmp_path / "thesis"))
    with pytest.raises(InputError, match="is not a folder"):
        Collection(config(tmp_path / "thesis" / "chapter.txt"))
    (copy / dataset.SHARDS / "mine.parquet").write_bytes(b"")
    with pytest.raises(InputError, match=r"mine\.parquet: is not a file of a collection"):
        Collection(config(copy))


def test_one_process_at_a_time_holds_a_folder(copy: Path) -> None:
    told = rf"another process is working in this folder, collecting since .*: process {os.getpid()} on .*, executive"
    with Collection(config(copy)), pytest.raises(InputError, match=told):
        Collection(config(copy))
    Collection(config(copy)).close()


def test_a_domain_with_a_mistake_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(DomainError):
        Collection(CollectConfig("no-such-domain", tmp_path / "data"))
    assert not (tmp_path / "data").exists()


def test_a_domain_in_which_nothing_succeeds_is_given_up(copy: Path) -> None:
    failed = tuple(Attempt("lift(red-cube,bench)", "unreachable", "too far") for _ in range(MOST_FAILURES))
    with Collection(config(copy)) as collection:
        collection._logs = {number: Log(number, 0, failed, Ending.FAILURES) for number in range(FRUITLESS)}
        with pytest.raises(InputError, match=r"no action was completed in 10 episodes; .*: unreachable \(too far\)"):
            collection._give_up_if_fruitless()


@pytest.mark.parametrize("wrong", [{"points": 0}, {"seed": -1}, {"grasp_noise": -0.1}, {"slips": 2.0}, {"jobs": 0}])
def test_configurations_refuse_nonsense(tmp_path: Path, wrong: Any) -> None:
    with pytest.raises(OptionError) as caught:
        CollectConfig("tray", tmp_path, **wrong)
    assert [caught.value.option] == list(wrong)


def test_the_command_makes_the_same_collection_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every option that changes the data is in it, and the defaults are those of the command line."""
    from executive.lab.collection import collect as collecting

    made: list[CollectConfig] = []

    def remember(config: CollectConfig, warn: object) -> None:
        made.append(config)
        raise InputError("enough")

    monkeypatch.setattr(collecting, "Collection", remember)
    changed: list[dict[str, Any]] = [{}, {"home_pose": False, "grasp_noise": 0.0, "slips": 0.25, "problem": "one"}]
    for chosen in changed:
        wanted = CollectConfig("tray", tmp_path / "a folder", 7, seed=5, **chosen)
        assert cli.exit_code(shlex.split(wanted.command)[1:]) == cli.BAD_INPUT
        assert made.pop() == wanted


def test_the_command_line_prints_what_was_collected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "collect",
        str(TRAY),
        "--points",
        "1",
        "--out",
        str(tmp_path / "data"),
        "--jobs",
        "1",
        "--no-home-pose",
    ]
    assert cli.exit_code([*arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == dataset.read_manifest(tmp_path / "data")
    assert "1 of 1 points" in err
    assert cli.exit_code(arguments) == 0
    assert capsys.readouterr().out.startswith("1 points (1 episode) in ")


def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(tmp_path: Path) -> None:
    out = tmp_path / "data"
    process = subprocess.Popen(
        [*COMMAND, "--points", "500", "--out", str(out), "--jobs", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # so that the signal goes to the whole group, as a terminal sends it
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "0 of 500 points\n"
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=120)
    assert process.returncode == cli.INTERRUPTED
    assert said[0] == ""
    first, *_, last = said[1].splitlines()
    assert first.startswith("stopping; ")
    assert last.startswith("interrupted; finished episodes are kept, continue with: executive collect ")
    assert not dataset.read_manifest(out)["finished"]
