"""What is written is read back, by us and by Hugging Face's `datasets`; what is damaged is named."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.errors import InputError
from executive.lab.collection import dataset
from executive.lab.collection.dataset import Ending
from tests.executive.lab import samples
from tests.executive.test_imports import HEAVY, loaded_by


def test_points_come_back_in_order(tmp_path: Path) -> None:
    written = [point for log in samples.LOGS for point in samples.points_of(log)]
    read = list(dataset.read(samples.write(tmp_path)))
    assert len(read) == len(written)
    for one, other in zip(read, written, strict=True):
        assert (one.seed, one.episode, one.step, one.action) == (other.seed, other.episode, other.step, other.action)
        assert (one.time, one.facts, one.surprises) == (other.time, other.facts, other.surprises)
        assert np.array_equal(one.joints, other.joints)
        assert one.images.keys() == other.images.keys()
        for camera, image in one.images.items():
            assert image.shape == (24, 32, 3)
            assert image.dtype == np.uint8
            assert np.abs(image.astype(int) - other.images[camera]).mean() < 6  # JPEG loses a little


def test_only_the_cameras_that_are_asked_for_are_decoded(tmp_path: Path) -> None:
    folder = samples.write(tmp_path)
    assert {tuple(point.images) for point in dataset.read(folder, ["hand"])} == {("hand",)}
    with pytest.raises(InputError, match="did you mean 'hand'"):
        dataset.read(folder, ["hands"])


def test_logs_come_back(tmp_path: Path) -> None:
    folder = samples.write(tmp_path)
    assert [dataset.read_log(folder, samples.COLLECTION, log.episode) for log in samples.LOGS] == list(samples.LOGS)


def test_every_column_has_a_feature_and_pictures_are_pictures(tmp_path: Path) -> None:
    schema = pq.read_schema(dataset.shard(samples.write(tmp_path), 0))
    features = json.loads(schema.metadata[b"huggingface"])["info"]["features"]
    assert list(features) == schema.names
    pictures = {name for name, feature in features.items() if feature.get("_type") == "Image"}
    assert pictures == {f"image_{camera}" for camera in samples.CAMERAS}
    assert list(features["atoms"]) == [field.name for field in schema.field("atoms").type]
    assert all(feature == {"dtype": "bool", "_type": "Value"} for feature in features["atoms"].values())


def test_the_package_datasets_reads_it(tmp_path: Path) -> None:
    hub = pytest.importorskip("datasets", reason="no dependency; the features are tested without it, too")
    folder = samples.write(tmp_path / "made")
    files = str(folder / dataset.SHARDS / "*.parquet")
    loaded = hub.load_dataset("parquet", data_files=files, split="train", cache_dir=str(tmp_path / "cache"))
    assert len(loaded) == 4
    assert loaded[0]["image_hand"].size == (32, 24)
    assert loaded[0]["atoms"] == {str(atom): value for atom, value in samples.point(0, 1, True).facts.items()}


@pytest.mark.parametrize("points", [1, 2])
def test_cutting_leaves_the_episode_as_if_it_had_stopped_there(tmp_path: Path, points: int) -> None:
    folder = samples.write(tmp_path)
    cut = dataset.cut_shard(folder, samples.COLLECTION, samples.LOGS[0], points)
    assert cut == dataset.read_log(folder, samples.COLLECTION, 0)
    assert cut.ending is Ending.CUT
    assert [attempt.status for attempt in cut.attempts] == ["done", "dropped", "done"][: 2 * points - 1]
    assert [point.step for point in dataset.read(folder) if point.episode == 0] == list(range(1, points + 1))


@settings(max_examples=30, deadline=None)
@given(st.floats(min_value=0.0, max_value=1.0, exclude_max=True))
def test_a_truncated_shard_is_named_wherever_it_ends(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    folder = samples.write(tmp_path_factory.mktemp("cut"))
    path = dataset.shard(folder, 0)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"episode-00000\.parquet: is damaged"):
        dataset.read_log(folder, samples.COLLECTION, 0)
    with pytest.raises(InputError, match=r"is damaged .*; collect it again with: executive collect x"):
        list(dataset.read(folder))


def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    folder = samples.write(tmp_path)
    path = dataset.shard(folder, 0)
    content = bytearray(path.read_bytes())
    content[content.index(b"\xff\xd8\xff") + 40] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(InputError, match="is damaged"):
        dataset.read_log(folder, samples.COLLECTION, 0)


def test_a_shard_of_another_collection_or_place_is_refused(tmp_path: Path) -> None:
    folder = samples.write(tmp_path)
    with pytest.raises(InputError, match="belongs to another collection"):
        dataset.read_log(folder, "that one", 0)
    dataset.shard(folder, 0).rename(dataset.shard(folder, 5))
    with pytest.raises(InputError, match="belongs to another collection"):
        dataset.read_log(folder, samples.COLLECTION, 5)


@pytest.mark.parametrize("name", [b"surprises", b"image_front", b"qpos"])
def test_a_shard_whose_columns_have_no_names_is_damaged(tmp_path: Path, name: bytes) -> None:
    folder = samples.write(tmp_path)
    file = dataset.shard(folder, 0)
    file.write_bytes(file.read_bytes().replace(name, b"\xff" + name[1:]))
    for read in (lambda: list(dataset.read(folder)), lambda: dataset.read_log(folder, samples.COLLECTION, 0)):
        with pytest.raises(InputError, match=r"episode-00000\.parquet: is damaged"):
            read()


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 4_000), st.integers(0, 255))
def test_a_shard_with_a_wrong_byte_is_read_or_named(tmp_path: Path, before_its_end: int, byte: int) -> None:
    folder = tmp_path / "collection"
    if not folder.exists():
        samples.write(folder)
    file = dataset.shard(folder, 0)
    whole = file.read_bytes()
    at = max(0, len(whole) - before_its_end)
    try:
        file.write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
        for read in (lambda: list(dataset.read(folder)), lambda: dataset.read_log(folder, samples.COLLECTION, 0)):
            with contextlib.suppress(InputError):
                read()
    finally:
        file.write_bytes(whole)


def test_a_missing_shard_is_named(tmp_path: Path) -> None:
    folder = samples.write(tmp_path)
    dataset.shard(folder, 2).unlink()
    with pytest.raises(InputError, match=r"episode-00002\.parquet: there is no such file"):
        list(dataset.read(folder))


def test_what_is_not_finished_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not finished; resume with: executive collect x"):
        dataset.read(samples.write(tmp_path, finished=False))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "is no collection"),
        ("{", "is not JSON"),
        ("[]", "is of format None"),
        ('{"format": 99}', "is of format 99"),
        (f'{{"format": {dataset.FORMAT}}}', "collection: is missing"),
    ],
)
def test_a_manifest_that_is_none_is_named(tmp_path: Path, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / dataset.MANIFEST).write_text(text)
    with pytest.raises(InputError, match=message):
        dataset.read(tmp_path)


def test_importing_the_format_loads_nothing_heavy() -> None:
    assert loaded_by("import executive.lab.collection.dataset").isdisjoint({*HEAVY, "pyarrow"})
