"""The statistics of a collection, and its data card in the format of model hubs."""

from __future__ import annotations

import json
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from executive.lab.collection import dataset
from executive.lab.collection.dataset import Log
from executive.types import Atom, SkillStatus

_WHAT = """{points} points: what the cameras of a simulated robot see after each completed action, and the truth of all
{atoms}atoms of the planning task at that moment."""

_METHOD = """Collected as in Appendix D of the S3E paper. At a reset the robot is at home and the items stand upright at
random. An applicable action, chosen uniformly by the true state, is carried out in full by planned motions, contact and
friction. If it completes (its skill reports `{done}`), the cameras are rendered and saved with the true state; else,
another action is chosen, and nothing is put right in between. A reset follows {failures_in_a_row} failures in a row,
{points_per_episode} completed actions, or a state in which no action applies. The robot {home}. Imperfection: where an
item is gripped is off by a normally distributed error with a standard deviation of {noise} in x and in y; and with a
probability of {often} an action that carries something loses it on the way, because the gripper opens."""

_SURPRISES = """After {points} points ({share}) the state is not what the action's effects alone would have made of the
state before."""


def statistics(folder: Path, logs: Sequence[Log]) -> dict[str, Any]:
    """Points, episodes and how they ended; attempts per action and status; how often each predicate's atoms are true;
    and how many points are not what the action's effects alone would have made of the state before."""
    endings = Counter(str(log.ending) for log in logs)
    attempts: dict[str, Counter[str]] = {}
    truth: dict[str, Counter[bool]] = {}
    surprising = 0
    for log in logs:
        for attempt in log.attempts:
            attempts.setdefault(attempt.action.partition("(")[0], Counter())[attempt.status] += 1
        for row in dataset.columns(folder, log.episode, "atoms", "surprises"):
            surprising += bool(row["surprises"])
            for atom, value in dataset.truth_of(row).items():
                truth.setdefault(Atom.parse(atom).predicate, Counter())[value] += 1
    return {
        "points": sum(log.points for log in logs),
        "episodes": len(logs),
        "endings": dict(sorted(endings.items())),
        "attempts": {action: dict(sorted(attempts[action].items())) for action in sorted(attempts)},
        "predicates": {name: {"true": truth[name][True], "false": truth[name][False]} for name in sorted(truth)},
        "surprising_points": surprising,
    }


def render(manifest: Mapping[str, Any]) -> str:
    """The data card, in the hub's format: a header in YAML, then Markdown."""
    what, counted = manifest["collection"], manifest["statistics"]
    points = counted["points"]
    surprising = counted["surprising_points"]
    name = f"{what['domain']} / {what['problem']}"
    noise, often = f"{1000 * what['grasp_noise']:g} mm", f"{100 * what['slips']:g} %"
    home = "returns to its home pose after each action" if what["home_pose"] else "stays where each action ends"
    return f"""---
pretty_name: {json.dumps(f"Executive: {name}")}
task_categories:
- visual-question-answering
tags:
- robotics
- symbolic-state-estimation
- pddl
- simulation
size_categories:
- {_size(points)}
configs:
- config_name: default
  data_files: {dataset.SHARDS}/*.parquet
---
# {name}

{_paragraph(_WHAT.format(points=points, atoms=f"{len(manifest['atoms'])} " if manifest["atoms"] else ""))}

```sh
{manifest["command"]}
```

{_paragraph(_METHOD.format(**what, done=SkillStatus.DONE, noise=noise, often=often, home=home))}

{_paragraph(_SURPRISES.format(points=surprising, share=_share(surprising, points)))}

## How often atoms are true
{_table(("predicate", "true", "false", "true in"), _balance(counted["predicates"]))}

## Actions
{_table(("action", "tried", "done", "share", "failed"), _actions(counted["attempts"]))}

## Episodes
{_table(("ended because", "episodes"), counted["endings"].items())}

## Cameras
{_table(("camera", "column", "width", "height"), _cameras(manifest["cameras"]))}

## Columns
One Parquet file an episode.

| column | what |
|---|---|
| `seed`, `episode`, `step` | the collection's seed; the episode from 0; the completed action from 1 within it |
| `action` | the action that was completed |
| `image_...` | a picture (JPEG, quality {what["jpeg_quality"]}) |
{_more_columns(what)}| `surprises` | the atoms whose truth is not what the action's effects alone would have made it |
| `joints` | the arm's joint positions, rad |
| `qpos` | MuJoCo's positions of everything, from which the moment can be drawn anew |
| `time` | simulated seconds since the reset |

```python
from datasets import load_dataset

points = load_dataset("parquet", data_files="{dataset.SHARDS}/*.parquet", split="train")
points.flatten()    # a column of each atom
```

`executive.lab.collection.dataset.read(folder)` reads the same without that package.

## Made with
Seed {what["seed"]}. {", ".join(f"{package} {version}" for package, version in what["versions"].items())}.
SHA-256 of the domain's files: `{what["files"]}`.
"""


def _more_columns(what: Mapping[str, Any]) -> str:
    """The rows of columns that depend on what was asked for."""
    rows = []
    if "masks" in what:
        rows.append(("`mask_...`", "which of `objects` each pixel shows, from 1 on (PNG)"))
    if "masks" in what or "objects" in what:
        rows.append(("`objects`", "the items, each with the values of its attributes"))
    if "demonstrations" in what:
        rows.append(
            (
                "`demonstration`",
                "how the arm moved, ten times a second: `joints` (rad) and `gripper` (m) as measured, the grip point's "
                "pose `hand` by them, the `command` (rad, and how far the fingers shall close), the skill's `phase`, "
                "and `qpos` to draw it from",
            )
        )
        rows.append(("`located`", "where the skill was told that an item is, with the error of that, and its box"))
    kind = "a list, as each episode has atoms of its own" if "objects" in what else "a struct with one bool an atom"
    rows.append(("`atoms`", f"the truth of every atom: {kind}"))
    return "".join(f"| {name} | {meaning} |\n" for name, meaning in rows)


def _paragraph(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), width=120)


def _size(points: int) -> str:
    """The hub's name for the order of magnitude."""
    steps = [("n<1K", 1_000), ("1K<n<10K", 10_000), ("10K<n<100K", 100_000), ("100K<n<1M", 1_000_000)]
    return next((name for name, limit in steps if points < limit), "n>1M")


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} %" if whole else "none"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _balance(predicates: Mapping[str, Mapping[str, int]]) -> Iterable[Sequence[object]]:
    for name, count in predicates.items():
        yield f"`{name}`", count["true"], count["false"], _share(count["true"], count["true"] + count["false"])


def _actions(attempts: Mapping[str, Mapping[str, int]]) -> Iterable[Sequence[object]]:
    for action, statuses in attempts.items():
        tried, done = sum(statuses.values()), statuses.get(SkillStatus.DONE, 0)
        failed = ", ".join(f"{status} {count}" for status, count in statuses.items() if status != SkillStatus.DONE)
        yield f"`{action}`", tried, done, _share(done, tried), failed or "none"


def _cameras(cameras: Mapping[str, Sequence[int]]) -> Iterable[Sequence[object]]:
    for camera, (width, height) in cameras.items():
        yield camera, f"`{dataset.IMAGE}{camera}`", width, height
