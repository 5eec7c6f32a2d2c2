"""Points and logs of a small collection, made up rather than simulated."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from executive.lab.collection import dataset
from executive.lab.collection.dataset import Attempt, Ending, Log, Point
from executive.types import Atom, Facts, Image

ATOMS = (Atom("on", ("lemon", "table")), Atom("holding", ("lemon",)), Atom("hand-free"))
CAMERAS = ("front", "hand")
COLLECTION = "this one"


def picture(shade: int) -> Image:
    """A smooth picture, which JPEG keeps well: 24 rows, 32 columns."""
    rows, columns = np.mgrid[0:24, 0:32]
    return np.stack([rows * 8, columns * 7, np.full_like(rows, shade)], axis=2).astype(np.uint8)


def point(episode: int, step: int, held: bool) -> Point:
    return Point(
        seed=3,
        episode=episode,
        step=step,
        action="pick(lemon,table)" if held else "place(lemon,table)",
        time=1.5 * step,
        joints=np.linspace(-1.0, 1.0, 6),
        qpos=np.linspace(0.0, 1.0, 54),
        images={camera: picture(10 * step + index) for index, camera in enumerate(CAMERAS)},
        facts=Facts(dict(zip(ATOMS, (not held, held, not held), strict=True))),
        surprises=(ATOMS[0],) if step == 2 else (),
    )


def points_of(log: Log) -> list[Point]:
    return [point(log.episode, step + 1, step % 2 == 0) for step in range(log.points)]


def log(episode: int, statuses: Sequence[str], ending: Ending = Ending.FULL) -> Log:
    attempts = tuple(Attempt("pick(lemon,table)", status, "" if status == "done" else "why") for status in statuses)
    return Log(episode, list(statuses).count("done"), attempts, ending)


LOGS = (log(0, ["done", "dropped", "done", "done"]), log(1, ["no path"] * 5, Ending.FAILURES), log(2, ["done"]))


def write(folder: Path, logs: Sequence[Log] = LOGS, finished: bool = True) -> Path:
    """A folder as a collection leaves it, but for its card."""
    (folder / dataset.SHARDS).mkdir(parents=True)
    for each in logs:
        dataset.write_atomically(
            dataset.shard(folder, each.episode), dataset.shard_bytes(COLLECTION, each, points_of(each), ATOMS, CAMERAS)
        )
    manifest = {
        "format": dataset.FORMAT,
        "command": "executive collect x",
        "collection": {},
        "points": sum(each.points for each in logs),
        "finished": finished,
        "cameras": {camera: [32, 24] for camera in CAMERAS},
        "atoms": list(map(str, ATOMS)),
        "statistics": {"episodes": len(logs)},
    }
    (folder / dataset.MANIFEST).write_text(json.dumps(manifest))
    return folder
