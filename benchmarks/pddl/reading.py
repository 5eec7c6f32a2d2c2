"""Reads public planning tasks: how many are read, in which time, and what the others are refused for.

    python -m benchmarks.pddl.reading FOLDER [--json]

FOLDER has `accepted.jsonl`, the tasks that Fast Downward's translator accepts, one a line ({"domain", "problem"}), and
may have `refused.jsonl`, those that it does not. What is refused is counted by the feature that it is refused for.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from executive.domain.pddl import read_task
from executive.errors import DomainError

LISTS = ("accepted", "refused")
_FEATURE = re.compile(r"not supported: (.+)$")


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a task. `refused_because` is empty for one that was read; `error` is a bug's, if there was one."""

    list: str
    task: str
    seconds: float
    fluents: int = 0
    statics: int = 0
    derived: int = 0
    refused_because: str = ""
    line: str = ""
    error: str = ""


def read(folder: Path, name: str, entry: dict[str, str]) -> Row:
    """Read one task."""
    task = f"{entry['domain'].split('/')[0]}/{Path(entry['problem']).stem}"
    began = time.perf_counter()
    try:
        found = read_task(folder / entry["domain"], folder / entry["problem"]).task
    except DomainError as error:
        return Row(name, task, time.perf_counter() - began, refused_because=error.message, line=error.key or "")
    except Exception as error:  # a bug, and what is to be found out here
        return Row(name, task, time.perf_counter() - began, error=f"{type(error).__name__}: {error}")
    sizes = len(found.atoms), len(found.static), len(found.derived.rules)
    return Row(name, task, time.perf_counter() - began, *sizes)


def told(rows: Sequence[Row]) -> str:
    """Tables of what was read and of what was refused."""
    lines = [f"{'':<12}{'tasks':>7}{'read':>7}{'share':>9}{'errors':>8}{'median s':>10}{'most s':>8}"]
    for name in LISTS:
        some = [row for row in rows if row.list == name]
        if some:
            seconds = sorted(row.seconds for row in some)
            taken = sum(not row.refused_because and not row.error for row in some)
            errors = sum(bool(row.error) for row in some)
            middle = seconds[len(seconds) // 2]
            share = taken / len(some)
            lines.append(
                f"{name:<12}{len(some):>7}{taken:>7}{share:>9.1%}{errors:>8}{middle:>10.3f}{seconds[-1]:>8.2f}"
            )
    for name in LISTS:
        refused = [row for row in rows if row.list == name and row.refused_because]
        for feature, count in Counter(map(_feature, refused)).most_common():
            lines.append(f"{name}, refused {count:>4}: {feature}")
    lines += [f"{row.task}: {row.error}" for row in rows if row.error]
    return "\n".join(lines)


def _feature(row: Row) -> str:
    feature = _FEATURE.search(row.refused_because)
    return feature[1] if feature else "no PDDL that is understood"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", action="store_true", help="print a row a task for programs")
    arguments = parser.parse_args(argv)
    rows = []
    for name in LISTS:
        file = arguments.folder / f"{name}.jsonl"
        for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
            rows.append(read(arguments.folder, name, json.loads(line)))
    print(json.dumps([asdict(row) for row in rows], indent=1) if arguments.json else told(rows))
    return int(any(row.error for row in rows))


if __name__ == "__main__":
    sys.exit(main())
