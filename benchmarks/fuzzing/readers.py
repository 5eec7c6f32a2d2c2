"""How each parser is given an input: written to where it looks, read, and what was read used as a run would.

Each takes the input and a folder to write in, and raises nothing but `ExecutiveError`.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import random
import shutil
import struct
from collections.abc import Callable, Iterable, Iterator
from functools import cache, lru_cache
from pathlib import Path
from unittest import mock

from executive.app.config import CONFIG, read_config
from executive.app.estimate import choose
from executive.app.resume import PastRun
from executive.app.sensor_fit import load_outcomes
from executive.belief import ThresholdMonitor
from executive.domain.loader import Domain, load_domain, load_subject
from executive.domain.pddl import Schema, Stated, read_task, read_vocabulary
from executive.errors import InputError
from executive.faults import parse_fault, read_faults
from executive.lab.campaign.config_file import read_campaign
from executive.lab.evaluation import published
from executive.lab.evaluation.disturbance import Disturbance
from executive.lab.evaluation.paraphrases import Paraphrases
from executive.lab.training.wordings import Wordings
from executive.replay import Record, replay
from executive.replay.comparison import side_by_side
from executive.s3e.backends.checkpoint import CONFIG as MODEL_CONFIG
from executive.s3e.backends.checkpoint import INDEX, WEIGHTS, inspect
from executive.s3e.backends.dialect import Dialect
from executive.s3e.backends.interface import YES_NO
from executive.s3e.backends.openai_backend import hear, text
from executive.s3e.backends.openai_client import base_url
from executive.s3e.backends.openai_replies import ReplyError, decoded, model_names, refusal
from executive.s3e.calibration import Calibration
from executive.s3e.questions.language_model import LanguageModel, Reply
from executive.s3e.questions.templates import Templates
from executive.sim.spec import read_scene
from executive.trace.record import monitor_file
from executive.trace.record.log import EVENTS_FILE, read_events
from executive.trace.report.explain import explain, print_lines
from executive.trace.report.summary import print_summary, summarise
from executive.trace.story.story import Story
from executive.trace.terminal.comparison import Pair, print_pairs
from executive.types import Atom, Facts

ROOT = Path(__file__).resolve().parents[2]
GROCERY = ROOT / "domains" / "grocery"
EXAMPLE = ROOT / "runs" / "example"


def written(folder: Path, name: str, data: bytes) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / name
    file.write_bytes(data)
    return file


@cache
def grocery() -> Domain:
    return load_domain(GROCERY)


SECOND_FILE = b";;;; and the problem:\n"


def feed_pddl(data: bytes, scratch: Path) -> None:
    """A domain and, after a line that says so, its problem."""
    first, _, second = data.partition(SECOND_FILE)
    _both(written(scratch, "domain.pddl", first), written(scratch, "problem.pddl", second))


def _both(domain: Path, problem: Path) -> None:
    try:
        schema = read_task(domain, problem)
    except InputError:
        read_vocabulary(domain, problem)  # takes more, and no more than InputError from it either
        return
    for name, action in schema.actions.items():
        for args in list(schema.typing.tuples([kind for _, kind in action.parameters]))[:3]:
            try:
                schema.ground(name, args)
            except ValueError:  # this one contradicts itself
                continue


def feed_manifest(data: bytes, scratch: Path) -> None:
    """The PDDL beside it stays as it is, and is read once; so are the words that packages register."""
    folder = scratch / "domain"
    if not folder.exists():
        shutil.copytree(GROCERY, folder)
    written(folder, "domain.toml", data)
    with mock.patch.multiple("executive.domain.loader", read_task=_task, read_vocabulary=_vocabulary):
        try:
            load_domain(folder)
        finally:
            load_subject(folder)


_unstated, _vocabulary = lru_cache(16)(read_task), lru_cache(16)(read_vocabulary)


def _task(domain: Path, problem: Path, seen: frozenset[str], stated: Stated) -> Schema:
    """As `read_task`: what a manifest states is no key of a cache."""
    return read_task(domain, problem, seen, stated) if any(stated) else _unstated(domain, problem, seen)


def feed_scene(data: bytes, scratch: Path) -> None:
    file = written(scratch, "scene.toml", data)
    scene = read_scene(file)
    scene.restricted_to({scene.items[0].name: "item"}, file)


def feed_questions(data: bytes, scratch: Path) -> None:
    Templates.read(written(scratch, "questions.toml", data)).translate(grocery().task)


def feed_wordings(data: bytes, scratch: Path) -> None:
    templates = Templates.read(GROCERY / "questions.toml")
    wordings = Wordings.of(grocery().task, templates, written(scratch, "wordings.toml", data))
    dice = random.Random(0)
    for atom in grocery().task.atoms:
        wordings.draw(atom, dice)


def feed_paraphrases(data: bytes, scratch: Path) -> None:
    Paraphrases.read(written(scratch, "paraphrases.toml", data), grocery().task)


def feed_outcomes(data: bytes, scratch: Path) -> None:
    load_outcomes(written(scratch, "outcomes.toml", data), grocery().parsed.actions)


def feed_published(data: bytes, scratch: Path) -> None:
    found = published.read(written(scratch, published.FILE, data).parent)
    published.tables(found, {"ours": dict.fromkeys(published.HEADS, 0.5)})


def feed_fault(data: bytes, scratch: Path) -> None:
    said = data.decode(errors="replace")
    fault = parse_fault(said)
    if parse_fault(str(fault)) != fault:
        raise AssertionError(f"{said!r} is read as {fault}, which is read as something else")
    with contextlib.suppress(InputError):
        parse_fault(said, ["lemon", "milk"], ["wood-table"], ["front"])


def feed_faults(data: bytes, scratch: Path) -> None:
    read_faults(written(scratch, "faults.toml", data))


def feed_campaign(data: bytes, scratch: Path) -> None:
    """The domains that it names are read once: these have targets of their own, and would take most of the time."""
    with mock.patch("executive.lab.campaign.config_file.load_domain", _known_domain):
        read_campaign(written(scratch, "campaign.toml", data)).described()


@cache
def _known_domain(where: str | Path, problem: str | None = None) -> Domain:
    return load_domain(where, problem)


def feed_run_config(data: bytes, scratch: Path) -> None:
    written(scratch / "run", CONFIG, data)
    read_config(scratch / "run")


def feed_events(data: bytes, scratch: Path) -> None:
    """Everything that reads a record: reading alone, the story, the summary, the words, resuming, replaying."""
    folder = scratch / "run"
    if not folder.exists():
        shutil.copytree(EXAMPLE / "images", folder / "images")
    written(folder, EVENTS_FILE, data)
    events = list(read_events(folder))
    story = Story()
    for event in events:
        story.tell(event)
    PastRun.of(folder)
    if story.started is None:
        return
    with io.TextIOWrapper(io.BytesIO(), encoding="utf-8") as paper, _watched_loop():
        print_summary(summarise(events), folder, paper)
        print_lines(explain(events), paper)
        for record in Record.all(events):
            replayed = replay(record, ThresholdMonitor(record.started.task.atoms))
            rows = side_by_side(record, replayed)
            print_pairs([Pair(*row, row.agree, row.same) for row in rows], ("recorded", "replayed"), paper)


class _NoCrash(logging.Handler):
    """The loop goes on in a replay, and logs what it crashes with."""

    def emit(self, record: logging.LogRecord) -> None:
        raise AssertionError(f"{record.getMessage()}: {record.exc_info and record.exc_info[1]!r}")


@contextlib.contextmanager
def _watched_loop() -> Iterator[None]:
    log, handler = logging.getLogger("executive"), _NoCrash(logging.ERROR)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


def feed_monitor(data: bytes, scratch: Path) -> None:
    written(scratch / "run", monitor_file.FILE, data)
    monitor_file.load(scratch / "run", grocery().task.atoms)


def feed_calibration(data: bytes, scratch: Path) -> None:
    calibration = Calibration.load(written(scratch, "calibration.json", data))
    for probability in (0.0, 0.3, 1.0):
        calibrated = calibration(grocery().task.atoms[0], probability)
        if not 0.0 <= calibrated <= 1.0:
            raise AssertionError(f"{calibrated} is no probability")


def feed_reply(data: bytes, scratch: Path) -> None:
    """What a chat server sends, as an answer, as text, as its list of models and as a refusal."""
    Dialect().after(refusal(500, "1e309", data).words or "", 500, {"messages": []}, known=False)
    try:
        reply = decoded(data)
    except ReplyError:
        raise InputError("refused") from None
    taken = 0
    for read in (lambda: hear(reply, YES_NO), lambda: text(reply), lambda: model_names(reply)):
        try:
            read()
            taken += 1
        except ReplyError:
            continue
    if not taken:
        raise InputError("refused")


def feed_address(data: bytes, scratch: Path) -> None:
    base_url(data.decode(errors="replace"))


def feed_disturbance(data: bytes, scratch: Path) -> None:
    Disturbance.parse(data.decode(errors="replace").split(" "))


def feed_pattern(data: bytes, scratch: Path) -> None:
    choose(grocery().task.atoms, data.decode(errors="replace").split(" "))


def feed_wording(data: bytes, scratch: Path) -> None:
    """What a language model writes when it is asked for a question: it is taken, or the domain's own words are."""
    said = data.decode(errors="replace")

    class Model:
        name = "scribe"

        def write(self, system: str, prompts: Iterable[str], attempt: int) -> list[Reply]:
            return [Reply(said) for _ in prompts]

    task = grocery().task
    asked = LanguageModel(Model(), "", Templates.read(GROCERY / "questions.toml")).translate(task)
    if asked.text.keys() != set(task.atoms):
        raise AssertionError("an atom is not asked about")


def feed_checkpoint(name: str) -> Callable[[bytes, Path], None]:
    """A checkpoint's folder that is whole, but for one file."""

    def read(data: bytes, scratch: Path) -> None:
        folder = scratch / "model"
        if not folder.exists():
            for part, content in checkpoint().items():
                written(folder, part, content)
        if name == INDEX:
            (folder / WEIGHTS).unlink(missing_ok=True)
            written(folder, "model-1.safetensors", checkpoint()[WEIGHTS])
        written(folder, name, data)
        inspect(folder, "model")

    return read


def checkpoint() -> dict[str, bytes]:
    """The smallest whole checkpoint."""
    header = json.dumps({"w": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}).encode()
    return {
        MODEL_CONFIG: json.dumps({"model_type": "fast_vlm", "text_config": {"vocab_size": 8}}).encode(),
        WEIGHTS: struct.pack("<Q", len(header)) + header + bytes(8),
        "tokenizer.json": b'{"version": "1.0"}',
        "processor_config.json": b"{}",
    }


def feed_atoms(data: bytes, scratch: Path) -> None:
    for line in data.decode(errors="replace").splitlines():
        try:
            facts = Facts.parse(line)
        except ValueError:
            continue
        if Facts.parse(*facts.literals()) != facts or any(Atom.parse(str(atom)) != atom for atom in facts):
            raise AssertionError(f"{line!r} is not read back")
