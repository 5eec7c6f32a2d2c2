"""A small collection of the tray, made up: the shade of a point's pictures says which point it is, so that a scripted
model can know what is true, and be as good or bad as a test wants."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from executive.domain.loader import load_subject
from executive.lab.collection import dataset
from executive.lab.collection.dataset import Attempt, Ending, Log, Point
from executive.types import Atom, Facts, Image
from tests.executive.s3e.chat_server import Request, Response, completion
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"
TASK = load_subject(TRAY).task
CAMERAS = ("above", "side")
ON, HELD, FREE = "resting-on({}-cube,{})", "holding({}-cube)", "hand-free()"
EPISODES, STEPS = 2, 3

STATES: Sequence[frozenset[Atom]] = tuple(
    frozenset(map(Atom.parse, true))
    for true in (
        ("holding(red-cube)", "resting-on(green-cube,bench)"),
        ("hand-free()", "resting-on(red-cube,tray)", "resting-on(green-cube,bench)"),
        ("holding(green-cube)", "resting-on(red-cube,tray)"),
        ("hand-free()", "resting-on(red-cube,tray)", "resting-on(green-cube,tray)"),
        ("hand-free()", "resting-on(green-cube,tray)"),
        ("holding(red-cube)", "resting-on(green-cube,tray)"),
    )
)
"""What is true at each point, in order."""


def number_of(image: Image) -> int:
    """Which point a picture is of."""
    return round(float(image.mean()) / 30.0) - 1


def points() -> list[Point]:
    made = []
    for number, true in enumerate(STATES):
        episode, step = divmod(number, STEPS)
        picture = np.full((24, 32, 3), 30 * (number + 1), dtype=np.uint8)
        made.append(
            Point(
                seed=7,
                episode=episode,
                step=step + 1,
                action="lift(red-cube,bench)",
                time=float(number),
                joints=np.zeros(6),
                qpos=np.zeros(26),
                images=dict.fromkeys(CAMERAS, picture),
                facts=Facts.closed(true, TASK.atoms),
                surprises=(Atom.parse("hand-free()"),) if number == 4 else (),
            )
        )
    return made


def write(folder: Path, finished: bool = True, **collection: Any) -> Path:
    """The folder of the collection."""
    (folder / dataset.SHARDS).mkdir(parents=True)
    for episode in range(EPISODES):
        those = [point for point in points() if point.episode == episode]
        log = Log(episode, len(those), (Attempt("lift(red-cube,bench)", "done", ""),) * len(those), Ending.FULL)
        dataset.write_atomically(
            dataset.shard(folder, log.episode), dataset.shard_bytes("tray", log, those, TASK.atoms, CAMERAS)
        )
    manifest = {
        "format": dataset.FORMAT,
        "command": "executive collect tray --out data",
        "collection": {"problem": "fill-tray", "seed": 7, "home_pose": True, "files": "", **collection},
        "points": len(STATES),
        "finished": finished,
        "cameras": {camera: [32, 24] for camera in CAMERAS},
        "atoms": list(map(str, TASK.atoms)),
        "statistics": {"episodes": EPISODES, "points": len(STATES)},
    }
    (folder / dataset.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def knowing(
    questions: Mapping[str, Atom], say: Callable[[int, Atom, bool], float | None] = lambda number, atom, truth: None
) -> Callable[[Request], Response]:
    """A server that knows the truth, by questions (text -> atom). `say` gets the point's number, the atom and its
    truth, and may give another P(true), or one above 1 for no answer at all; without it, 0.98 or 0.02."""

    def respond(request: Request) -> Response:
        if not request.images:
            return completion({"Yes": 0.9, "No": 0.1})
        number, atom = number_of(request.images[0]), questions[request.question]
        truth = atom in STATES[number]
        told = say(number, atom, truth)
        yes = (0.98 if truth else 0.02) if told is None else told
        return completion({"Hm": 1.0} if yes > 1.0 else {"Yes": yes, "No": 1.0 - yes})

    return respond
