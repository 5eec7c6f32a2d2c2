"""Every parser of what comes from outside, with files that it reads and words that mean something to it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fuzzing import kept
from benchmarks.fuzzing.readers import (
    EXAMPLE,
    GROCERY,
    ROOT,
    SECOND_FILE,
    checkpoint,
    feed_address,
    feed_atoms,
    feed_calibration,
    feed_campaign,
    feed_checkpoint,
    feed_disturbance,
    feed_events,
    feed_fault,
    feed_faults,
    feed_manifest,
    feed_monitor,
    feed_outcomes,
    feed_paraphrases,
    feed_pattern,
    feed_pddl,
    feed_published,
    feed_questions,
    feed_reply,
    feed_run_config,
    feed_scene,
    feed_wording,
    feed_wordings,
)
from executive.app.config import CONFIG
from executive.app.run import RunConfig
from executive.faults import KINDS
from executive.lab.campaign.campaign_folder import MANIFEST as CAMPAIGN
from executive.lab.campaign.rows import FILE as ROWS
from executive.lab.evaluation.store import RESULTS
from executive.s3e.backends.checkpoint import CONFIG as MODEL_CONFIG
from executive.s3e.backends.checkpoint import INDEX, WEIGHTS
from executive.trace.record import monitor_file
from executive.trace.record.log import EVENTS_FILE

TRAY = ROOT / "tests" / "domains" / "tray"
PDDL = ROOT / "tests" / "data" / "pddl"


@dataclass(frozen=True, slots=True)
class Target:
    """A parser.

    Attributes:
        read: given an input and a folder to write in, reads it. Raises nothing but `ExecutiveError`.
        seeds: inputs that are read, to begin with.
        words: what means something to it.
    """

    read: Callable[[bytes, Path], object]
    seeds: Callable[[], list[bytes]]
    words: tuple[str, ...] = ()


def files(*paths: Path) -> Callable[[], list[bytes]]:
    return lambda: [path.read_bytes() for path in paths]


def _pairs() -> list[bytes]:
    pairs = [(folder / "domain.pddl", folder / "problem.pddl") for folder in (GROCERY, TRAY)]
    pairs += [
        (PDDL / "dishes.pddl", PDDL / "dishes-problem.pddl"),
        (PDDL / "sliding-tiles.pddl", PDDL / "fifteen.pddl"),
    ]
    return [domain.read_bytes() + SECOND_FILE + problem.read_bytes() for domain, problem in pairs]


def _shortened(file: Path, lines: int = 12, every: int = 9) -> Callable[[], list[bytes]]:
    """A few runs of lines of a long file, its first line always among them."""

    def seeds() -> list[bytes]:
        whole = file.read_bytes().splitlines(keepends=True)
        kinds: dict[bytes, bytes] = {}
        for line in whole:
            kinds.setdefault(re.search(rb'"type": "(\w+)"', line)[1], line)  # type: ignore[index]
        parts = [whole[start : start + lines] for start in range(0, len(whole), every * lines)]
        return [b"".join(kinds.values()), *(b"".join([whole[0], *part]) for part in parts)]

    return seeds


_REPLIES = [
    {"choices": [{"logprobs": {"content": [{"token": "yes", "logprob": -0.1, "top_logprobs": [
        {"token": "yes", "logprob": -0.1}, {"token": " No", "logprob": -2.5}, {"token": "x", "logprob": None}]}]}}]},
    {"choices": [{"message": {"role": "assistant", "content": "Is the lemon on the wooden table?"}}]},
    {"error": {"message": "no such model", "code": 404}},
    {"data": [{"id": "eye"}, {"id": "scribe"}]},
]  # fmt: skip

_SCALING = {"slope": 1.2, "bias": -0.1, "true": 30, "false": 60}
_CALIBRATION = {
    "about": "",
    "format": 2,
    "model": "m",
    "runtime": "transformers",
    "correction": {"method": "platt", "shared": _SCALING, "predicates": {"on-table": _SCALING}},
    "domains": {
        "grocery": {
            "looks": 40,
            "correlation_within": 0.5,
            "predicates": {
                "on-table": {
                    "false_alarms": 0.01, "misses": 0.02, "slope": 1.0, "bias": 0.0, "scores": [0.1, 0.9],
                    "repeats": {"again": 0.7},
                }
            },
        }
    },
}  # fmt: skip
_FORMER = {"format": 1, "model": "m", **_CALIBRATION["correction"]}  # type: ignore[dict-item]

TARGETS: Mapping[str, Target] = {
    "pddl": Target(
        feed_pddl,
        _pairs,
        (
            "define",
            "domain",
            "problem",
            ":types",
            ":constants",
            ":predicates",
            ":action",
            ":objects",
            ":init",
            ":goal",
            ":parameters",
            ":precondition",
            ":effect",
            "?x",
            "and",
            "not",
            "forall",
            "either",
            "or",
            "when",
            "=",
            "-",
        ),
    ),
    "domain.toml": Target(
        feed_manifest,
        files(GROCERY / "domain.toml"),
        ("../problem.pddl", "/etc/passwd", "scene.toml", "~", "C:\\\\x", "robot-gripping(?item)", "closer", "moves"),
    ),
    "scene.toml": Target(
        feed_scene, files(GROCERY / "scene.toml", TRAY / "scene.toml"), ("shape", "box", "size", "inf")
    ),
    "questions.toml": Target(
        feed_questions,
        files(GROCERY / "questions.toml"),
        ("{item}", "{1}", "{}", "{item.__class__}", "{item!r}", "{{", "?", "lemon"),
    ),
    "wordings.toml": Target(
        feed_wordings, files(GROCERY / "wordings.toml"), ("(a|b)", "(|)", "{item}", "{1}", "{", "(")
    ),
    "paraphrases.toml": Target(feed_paraphrases, files(GROCERY / "paraphrases.toml"), ("{item}", "{2}", "?", "[]")),
    "outcomes.toml": Target(feed_outcomes, files(GROCERY / "outcomes.toml"), ("pick", "done", "no path", "[0, 0, 0]")),
    "published.toml": Target(feed_published, files(GROCERY / "published.toml"), ("ap_micro", "curves", "nan")),
    "fault": Target(
        feed_fault,
        lambda: [kind.example.encode() for kind in KINDS.values()],
        (*KINDS, *{way for kind in KINDS.values() for way in kind.ways}, "@", ":", ",", "=", "p=0.3", "@5-8", "times="),
    ),
    "faults.toml": Target(
        feed_faults, lambda: [b'faults = ["drop@4", "camera:front=black@5-8"]\n'], ("faults", "drop@1")
    ),
    "campaign.toml": Target(
        feed_campaign,
        files(ROOT / "benchmarks" / "campaigns" / "grasp-drop.toml"),
        ("seeds", "vlm", "../x", "drop:p=2"),
    ),
    "config.toml": Target(feed_run_config, files(EXAMPLE / CONFIG), (*RunConfig.__dataclass_fields__, "oracle", "vlm")),
    "events.jsonl": Target(
        feed_events,
        _shortened(EXAMPLE / EVENTS_FILE),
        ("Started", "Resumed", "Observation", "Belief", "Plan", "Dispatched", "Decision", "Ended", "images/../x.jpg"),
    ),
    "monitor.json": Target(feed_monitor, files(EXAMPLE / monitor_file.FILE), ("plain", "fused", "NaN", "Infinity")),
    "calibration.json": Target(
        feed_calibration, lambda: [json.dumps(_CALIBRATION).encode()], ("slope", "NaN", "1e999")
    ),
    "reply": Target(
        feed_reply,
        lambda: [json.dumps(reply).encode() for reply in _REPLIES],
        ("logprob", "-1e999", "NaN", "token", "[]"),
    ),
    "address": Target(
        feed_address,
        lambda: [b"http://127.0.0.1:8000/v1", b"https://[::1]:1/v1/chat/completions"],
        ("://", "@", "[", "]", "localhost", "%"),
    ),
    "wording": Target(
        feed_wording,
        lambda: [b"Is the lemon on the wooden table?", b'<think>hm</think> "Is it?"'],
        ("the lemon", "?", "not", "no", "<think>", "</think>", "wood table"),
    ),
    "model config": Target(feed_checkpoint(MODEL_CONFIG), lambda: [checkpoint()[MODEL_CONFIG]], ("model_type", "NaN")),
    "safetensors": Target(
        feed_checkpoint(WEIGHTS),
        lambda: [checkpoint()[WEIGHTS]],
        ("data_offsets", "shape", "dtype", "__metadata__"),
    ),
    "weights index": Target(
        feed_checkpoint(INDEX),
        lambda: [b'{"weight_map": {"w": "model-1.safetensors"}}'],
        ("weight_map", "../x", "/etc"),
    ),
    "campaign.json": Target(
        kept.feed_campaign_kept(CAMPAIGN), lambda: [kept.campaign()[CAMPAIGN]], ("seeds", "places", "[]", "{}")
    ),
    "episodes.jsonl": Target(
        kept.feed_campaign_kept(ROWS), lambda: [kept.campaign()[ROWS]], ("seed", "outcome", "failed", "null")
    ),
    "dataset.json": Target(kept.feed_collection, kept.collections, ("finished", "false", "null", "episodes", "[]")),
    "evaluation.json": Target(kept.feed_results, lambda: [kept.evaluation()[RESULTS]], ("about", "name", "[]", "{}")),
    "answers.npz": Target(kept.feed_answers, kept.answers, ("descr", "<f8", "|b1", "|O", "(2, 2)", "[[0.5]]", '"a"')),
    "snapshot": Target(
        kept.feed_snapshot, kept.snapshots, ("descr", "<f8", "PCG64", "state", "(9,)", "[[0.5]]", '"a"')
    ),
    "replies.json": Target(kept.feed_replies, kept.replies, ("replies", "null", "Is the lemon on the wooden table?")),
    "picture": Target(kept.feed_picture, kept.pictures),
    "recorded picture": Target(
        kept.feed_recorded_picture, lambda: kept.pictures(["JPEG"]), ("%!PS-Adobe-3.0 EPSF-3.0",)
    ),
    "disturbance": Target(
        feed_disturbance, lambda: [b"lights cameras jpeg=40 blurred=3 noisy=40 dark=0.7"], ("=", "jpeg=", "dark=")
    ),
    "atom pattern": Target(
        feed_pattern, lambda: [b"on-table(*,wood-table) robot-gripping", b"*(lemon?[ab])"], ("*", "*a" * 40, "[!", "]")
    ),
    "atom": Target(feed_atoms, lambda: [b"on-table(lemon,wood-table)\nnot free()\n"], ("not ", "(", ")", ",", "()")),
}
"""By what is read."""
