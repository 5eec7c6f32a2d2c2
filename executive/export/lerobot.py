"""Runs or demonstrations as a data set of LeRobot, in its format v3.0: for each episode a Parquet file of rows and a
video a camera."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from executive.errors import InputError
from executive.export.episodes import Episode, Row, Source
from executive.trace.record.recording import Recording
from executive.types import FloatArray, Image
from executive.util.extras import needed
from executive.util.files import reason
from executive.util.video_file import EXTRA, PIXELS, video_writer

VERSION = "v3.0"
MANIFEST = "dataset.json"
"""What tells a collection's folder from a run's."""
PICTURES = "observation.images."
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_KEYFRAMES = 2
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_SAMPLED = 8
"""One picture in so many counts for the statistics, and one pixel in so many of it each way."""

Tell = Callable[[int, int], None]


def export_lerobot(
    sources: Sequence[Path | str],
    out: Path | str,
    fps: int = 10,
    cameras: Sequence[str] = (),
    task: str | None = None,
    tell: Tell = lambda done, total: None,
) -> Path:
    """Write runs of one domain, an episode each, or collections with demonstrations, an episode an action, as a data
    set of LeRobot, whole or not at all; return its folder.

    The features of a row are `observation.state` and `action` (joints and gripper), `observation.images.CAMERA`, and
    `next.done` and `next.success`, which the last row of an episode has. Those of a run have `loop.atoms` (the
    probability of each atom), `loop.cycle`, `loop.step`, `loop.decision` and `loop.reason`, too; those of a
    demonstration `skill.action`, `skill.phase` and `skill.surprises`.

    Args:
        fps: rows a second of the world's clock.
        cameras: which ones; without any, all.
        task: what the robot is to do, in words; without it, each run's goal, or each action.
        tell: is told how many rows are done, and of how many.

    Raises:
        InputError: a run or a collection does not have what it takes, they do not go together, or the folder is there
            already.
        MissingError: the extra `video` is not installed, or the machine lacks what the simulator needs.
    """
    needed("av", EXTRA, "to write videos")
    folder = Path(out)
    if folder.exists():
        raise InputError("is there already; another folder is to be named", file=folder)
    if not folder.absolute().parent.is_dir():
        raise InputError("there is no such folder", file=folder.absolute().parent)
    if not 1 <= fps <= 100:
        raise InputError(f"1 to 100 rows a second, not {fps}", key="--fps")
    if not sources:
        raise InputError("there is no run to export")
    episodes = [episode for source in sources for episode in _episodes(Path(source), fps)]
    for other in episodes[1:]:
        if (other.features, other.joint_names) != (episodes[0].features, episodes[0].joint_names):
            why = f"has other atoms or joints than {episodes[0].name}; all of a data set have the same"
            raise InputError(why, file=other.name)
    draft = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        _Writer(draft, episodes, cameras, task, tell).write()
        draft.rename(folder)
    except OSError as error:
        raise InputError(f"cannot be written ({reason(error)})", file=folder) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return folder


def _episodes(source: Path, fps: int) -> Sequence[Source]:
    """The episodes of a run or of a collection."""
    if not os.path.exists(source / MANIFEST):
        return [Episode(Recording(source), fps)]
    from executive.export.demonstrated import demonstrated_episodes

    return demonstrated_episodes(source, fps)


class _Writer:
    def __init__(
        self, folder: Path, episodes: Sequence[Source], cameras: Sequence[str], task: str | None, tell: Tell
    ) -> None:
        self._folder, self._episodes, self._cameras = folder, episodes, cameras
        self._tasks = [task or episode.task for episode in episodes]
        self._statistics: dict[str, list[FloatArray]] = {}
        self._shapes: dict[str, tuple[int, int]] = {}
        self._tell, self._done, self._total = tell, 0, sum(map(len, episodes))

    def write(self) -> None:
        tasks = sorted({*self._tasks})
        listed = [self._episode(number, tasks.index(task)) for number, task in enumerate(self._tasks)]
        _parquet(self._folder / _EPISODES, _columns(listed))
        self._write_tasks(tasks)
        meta = self._folder / "meta"
        (meta / "stats.json").write_text(json.dumps(self._stats(), indent=2))
        (meta / "info.json").write_text(json.dumps(self._info(len(tasks)), indent=2))

    def _episode(self, number: int, task: int) -> dict[str, Any]:
        """Write an episode's rows and videos, and return its line in the list of episodes."""
        episode, table = self._episodes[number], dict[str, list[Any]]()
        with episode.draw(self._cameras) as drawn, ExitStack() as open_files:
            videos: dict[str, Callable[[Image], None]] = {}
            for at, row in enumerate(episode.rows()):
                last = at == len(episode) - 1
                for name, value in self._row(row, number, at, task, last, episode.success).items():
                    table.setdefault(name, []).append(value)
                for camera, picture in drawn.show(row.moment).items():
                    key = f"{PICTURES}{camera}"
                    if key not in videos:
                        file = self._folder / _VIDEO.format(video_key=key, chunk_index=0, file_index=number)
                        writer = video_writer(file, picture.shape, episode.fps, _KEYFRAMES)
                        videos[key] = open_files.enter_context(writer)
                        self._shapes[key] = (picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2)
                    videos[key](picture)
                    if at % _SAMPLED == 0:
                        pixels = picture[::_SAMPLED, ::_SAMPLED].reshape(-1, 3) / 255.0
                        self._statistics.setdefault(key, []).append(pixels)
                self._done += 1
                self._tell(self._done, self._total)
        for name, column in table.items():
            if not isinstance(column[0], str):
                self._statistics.setdefault(name, []).append(
                    np.array(column, dtype=np.float64).reshape(len(column), -1)
                )
        _parquet(self._folder / _DATA.format(chunk_index=0, file_index=number), table)
        return self._listed(number, len(episode), self._tasks[number], list(videos))

    def _row(self, row: Row, episode: int, at: int, task: int, last: bool, success: bool) -> dict[str, Any]:
        first = self._done - at
        return {
            "observation.state": row.state.astype(np.float32),
            "action": row.action.astype(np.float32),
            **row.more,
            "next.done": last,
            "next.success": last and success,
            "timestamp": np.float32(row.time),
            "frame_index": at,
            "episode_index": episode,
            "index": first + at,
            "task_index": task,
        }

    def _listed(self, number: int, length: int, task: str, videos: Sequence[str]) -> dict[str, Any]:
        episode, start = self._episodes[number], self._done - length
        places = {
            f"videos/{key}/{name}": value
            for key in videos
            for name, value in {
                "chunk_index": 0,
                "file_index": number,
                "from_timestamp": 0.0,
                "to_timestamp": length / episode.fps,
            }.items()
        }
        return {
            "episode_index": number,
            "tasks": [task],
            "length": length,
            "data/chunk_index": 0,
            "data/file_index": number,
            "dataset_from_index": start,
            "dataset_to_index": start + length,
            **places,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **{f"executive/{name}": value for name, value in episode.about().items()},
        }

    def _write_tasks(self, tasks: Sequence[str]) -> None:
        """The tasks, as a table of pandas whose index they are."""
        kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
        columns = [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, (kind, numpy) in kinds.items()
        ]
        index = {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        told = {"index_columns": ["task"], "column_indexes": [index], "columns": columns, "pandas_version": "2.0.0"}
        table = {"task_index": [*range(len(tasks))], "task": [*tasks]}
        _parquet(self._folder / "meta" / "tasks.parquet", table, {"pandas": json.dumps(told)})

    def _stats(self) -> dict[str, Any]:
        """The statistics of each feature over all episodes; those of pictures are of a sample of them, by channel."""
        found = {}
        for name, parts in self._statistics.items():
            values = np.concatenate(parts)
            told = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
            told |= {word: np.quantile(values, share, axis=0) for word, share in _QUANTILES.items()}
            if name.startswith(PICTURES):
                told = {word: value.reshape(3, 1, 1) for word, value in told.items()}
            found[name] = {word: value.tolist() for word, value in told.items()} | {"count": [self._done]}
        return found

    def _info(self, tasks: int) -> dict[str, Any]:
        first = self._episodes[0]
        joints = [*first.joint_names]
        features: dict[str, Any] = {
            "observation.state": _feature("float32", len(joints), joints),
            "action": _feature("float32", len(joints), joints),
            **{key: _video_feature(*shape, first.fps) for key, shape in self._shapes.items()},
            **{
                name: _feature(each.kind, len(each.names) or 1, [*each.names] or None)
                for name, each in first.features.items()
            },
            "next.done": _feature("bool"),
            "next.success": _feature("bool"),
            "timestamp": _feature("float32"),
            **{name: _feature("int64") for name in ("frame_index", "episode_index", "index", "task_index")},
        }
        return {
            "codebase_version": VERSION,
            "robot_type": None,
            "fps": first.fps,
            "features": features,
            "total_episodes": len(self._episodes),
            "total_frames": self._done,
            "total_tasks": tasks,
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "data_path": _DATA,
            "video_path": _VIDEO,
            "splits": {"train": f"0:{len(self._episodes)}"},
        }


def _feature(kind: str, size: int = 1, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [size], "names": names}


def _video_feature(height: int, width: int, fps: int) -> dict[str, Any]:
    told = {"height": height, "width": width, "codec": "h264", "pix_fmt": PIXELS, "fps": fps, "channels": 3}
    info = {f"video.{name}": value for name, value in told.items()} | {"video.is_depth_map": False, "has_audio": False}
    return {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"], "info": info}


def _columns(rows: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _parquet(file: Path, columns: dict[str, list[Any]], metadata: dict[str, str] | None = None) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays: dict[str, Any] = {}
    for name, values in columns.items():
        if isinstance(values[0], np.ndarray):
            flat = pa.array(np.concatenate(values))
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat, len(values[0]))
        else:
            arrays[name] = pa.array(values)
    file.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(arrays).replace_schema_metadata(metadata), file)
