"""How the readers of what Executive itself has written are given an input: collections, evaluations, campaigns,
snapshots; and of pictures. As in `readers`, nothing is raised but `ExecutiveError`."""

from __future__ import annotations

import dataclasses
import io
import json
import struct
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.fuzzing.readers import GROCERY, grocery, written
from executive.errors import InputError
from executive.lab.campaign.campaign_folder import MANIFEST as CAMPAIGN
from executive.lab.campaign.episode import Row
from executive.lab.campaign.results import METRICS, load_results
from executive.lab.campaign.rows import FILE as ROWS
from executive.lab.collection import dataset
from executive.lab.evaluation import store
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.metrics import Answers
from executive.s3e.pictures import read_picture
from executive.s3e.questions.language_model import LanguageModel, Reply
from executive.s3e.questions.templates import Templates
from executive.sim.world import MujocoWorld
from executive.trace.record import pictures as recorded
from executive.types import Atom

ROW = Row("grocery", "breakfast", "drop 0.3", "oracle", "full", 3, "goal-reached", "executive run grocery", actions=4)

_COLLECTION = {
    "format": dataset.FORMAT,
    "command": "executive collect grocery",
    "collection": {"domain": "grocery", "problem": "grocery", "seed": 7, "files": "f", "home_pose": True},
    "points": 40,
    "finished": True,
    "cameras": {"front": {"width": 384, "height": 384}},
    "atoms": ["on-table(lemon,wood-table)"],
    "statistics": {"points": 40, "episodes": 0, "surprising_points": 3},
}
_CAMPAIGN = {
    "format": 1,
    "title": "Drops",
    "about": "",
    "command": "executive bench drops.toml",
    "seeds": [3, 4],
    "episodes": 2,
    "campaign": {
        "places": {"grocery/breakfast": "f"},
        "faults": {"drop 0.3": ["drop:p=0.3"]},
        "contenders": {"oracle, full": {"kind": "oracle"}},
        "options": {"home_pose": True},
        "versions": {"executive": "0.1"},
    },
}


def feed_collection(data: bytes, scratch: Path) -> None:
    written(scratch, dataset.MANIFEST, data)
    for point in dataset.read(scratch):
        raise AssertionError(f"there are no episodes in this folder, and one has {point}")


def collections() -> list[bytes]:
    return [json.dumps(_COLLECTION, indent=1).encode()]


def arrays(data: bytes) -> bytes:
    """A file of arrays with what a JSON text says is in them; the text itself where it is none."""
    buffer = io.BytesIO()
    try:
        found: dict[str, Any] = {name: _array(values) for name, values in json.loads(data).items()}
        np.savez(buffer, **found)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError, struct.error):
        return data
    return buffer.getvalue()


def _array(said: object) -> npt.NDArray[Any]:
    return np.frombuffer(said.encode(), np.uint8) if isinstance(said, str) else np.array(said)


def _as_json(kept: bytes) -> bytes:
    with np.load(io.BytesIO(kept)) as found:
        arrays = {name: found[name] for name in found.files}
    said = {name: each.tobytes().decode() if each.dtype == np.uint8 else each.tolist() for name, each in arrays.items()}
    return json.dumps(said).encode()


def feed_results(data: bytes, scratch: Path) -> None:
    for file, content in evaluation().items():
        written(scratch, file, data if file == store.RESULTS else content)
    store.load(scratch)


def feed_answers(data: bytes, scratch: Path) -> None:
    for file, content in evaluation().items():
        written(scratch, file, arrays(data) if file == store.ANSWERS else content)
    store.document(store.load(scratch))


@cache
def evaluation() -> dict[str, bytes]:
    """The files of a small evaluation."""
    atoms = (Atom("on-table", ("lemon", "wood-table")), Atom("robot-gripper-empty"))
    answers = Answers(atoms, np.array([[0.9, 0.1], [0.2, np.nan]]), np.array([[True, False], [False, True]]))
    made = Evaluation("eye", {"model": "m"}, answers, ((0, 1), (0, 2)), np.array([False, True]), np.array([0.1, 0.2]))
    with tempfile.TemporaryDirectory() as folder:
        store.save(Path(folder), made)
        return {name: (Path(folder) / name).read_bytes() for name in (store.RESULTS, store.ANSWERS)}


def answers() -> list[bytes]:
    kept = evaluation()[store.ANSWERS]
    return [kept, _as_json(kept)]


def feed_campaign_kept(name: str) -> Callable[[bytes, Path], None]:
    """A campaign's folder that is whole, but for one of its two files."""

    def read(data: bytes, scratch: Path) -> None:
        for file, content in campaign().items():
            written(scratch, file, data if file == name else content)
        for row in load_results(scratch).rows:
            for metric in METRICS:
                metric.of(row)

    return read


@cache
def campaign() -> dict[str, bytes]:
    row = json.dumps(dataclasses.asdict(ROW)).encode() + b"\n"
    return {CAMPAIGN: json.dumps(_CAMPAIGN, indent=1).encode(), ROWS: row}


@cache
def world() -> MujocoWorld:
    return MujocoWorld(GROCERY / "scene.toml", {**grocery().task.objects}, seed=0)


def feed_snapshot(data: bytes, scratch: Path) -> None:
    world().restore(arrays(data))


def snapshots() -> list[bytes]:
    kept = world().snapshot()
    return [kept, _as_json(kept)]


def feed_replies(data: bytes, scratch: Path) -> None:
    """What a language model wrote the last time: it is taken, or the model is asked again."""

    class Model:
        name = "scribe"

        def write(self, system: str, prompts: object, attempt: int) -> list[Reply]:
            assert isinstance(prompts, list)
            return [Reply("Is it?") for _ in prompts]

    translator = LanguageModel(Model(), "", Templates.read(GROCERY / "questions.toml"), cache=scratch / "cache")
    if not (scratch / "cache").exists():
        translator.translate(grocery().task)
    (file,) = (scratch / "cache").iterdir()
    file.write_bytes(data)
    questions = translator.translate(grocery().task)
    if questions.text.keys() != set(grocery().task.atoms):
        raise AssertionError("an atom is not asked about")
    if any("no replies of a model can be read" in warning for warning in questions.warnings):
        raise InputError("refused")


def replies() -> list[bytes]:
    atoms = grocery().task.atoms[:3]
    return [json.dumps({"about": "", "replies": {str(atom): ["Is it?", None] for atom in atoms}}, indent=1).encode()]


def feed_picture(data: bytes, scratch: Path) -> None:
    picture = read_picture(written(scratch, "picture", data))
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise AssertionError(f"{picture.shape} {picture.dtype} is no picture")


def feed_recorded_picture(data: bytes, scratch: Path) -> None:
    recorded.read_picture(written(scratch, "0000-front.jpg", data))


def pictures(kinds: Sequence[str] = ("PNG", "JPEG", "GIF", "WEBP", "BMP", "TIFF", "PPM")) -> list[bytes]:
    from PIL import Image

    shades = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(6, 8, 3)
    files = []
    for kind in kinds:
        buffer = io.BytesIO()
        Image.fromarray(shades).save(buffer, kind)
        files.append(buffer.getvalue())
    return files
