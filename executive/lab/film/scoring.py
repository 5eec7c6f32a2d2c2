"""How good the estimates of films are: over all frames, at mid-poses and during actions, each frame alone and with
memory; and the paper's Tables 2 and 4 with those rows in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from executive.errors import InputError
from executive.lab.common.html import number
from executive.lab.evaluation.metrics import Answers, BoolArray, scores
from executive.lab.evaluation.published import Published, Table, tables
from executive.lab.film.watch import Watched

FRAMES, MID_POSES, DURING_ACTIONS, WITH_MEMORY = "frames", "mid_poses", "during_actions", "with_memory"

MID = "Mid-poses"
"""What the paper's tables call estimates between actions."""


def scored(watched: Sequence[Watched]) -> dict[str, Any]:
    """Return the scores of films, pooled: `frames`, `mid_poses` and `during_actions`, and the same `with_memory`, None
    where there was none.

    Raises:
        InputError: the films have different atoms.
    """
    first = watched[0]
    for each in watched:
        if each.atoms != first.atoms:
            raise InputError(f"{each.name} has other atoms than {first.name}; films of one task are scored together")
    mid = np.concatenate([each.mid_pose for each in watched])
    alone = _together([each.alone for each in watched])
    remembered = [each.with_memory for each in watched]
    kept = [each for each in remembered if each is not None]
    memory = _parts(_together(kept), mid) if len(kept) == len(watched) else None
    return {**_parts(alone, mid), WITH_MEMORY: memory}


def _parts(answers: Answers, mid: BoolArray) -> dict[str, Any]:
    chosen = {FRAMES: np.ones_like(mid), MID_POSES: mid, DURING_ACTIONS: ~mid}
    return {name: _document(answers.where(where)) for name, where in chosen.items()}


def _document(answers: Answers) -> dict[str, Any]:
    return {"looks": answers.looks, **scores(answers).document()}


def _together(each: Sequence[Answers]) -> Answers:
    return Answers(
        each[0].atoms,
        np.concatenate([answers.probability for answers in each]),
        np.concatenate([answers.truth for answers in each]),
    )


def rows(documents: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, float | None]]:
    """Return the rows of the paper's tables for evaluations: name -> what `scored` returned."""
    found: dict[str, Mapping[str, float | None]] = {}
    for name, document in documents.items():
        for part, what in ((FRAMES, name), (MID_POSES, f"{name} + {MID}")):
            if document[part]["looks"]:
                found[what] = document[part]
    return found


def tabled(published: Published | None, documents: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the published tables with these evaluations in them, as text that is Markdown, too."""
    made = [_text(table) for table in tables(published, rows(documents))]
    source = [f"* {published.source}"] if published is not None else []
    return "\n\n".join([*made, *source])


def memory_table(documents: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what memory is worth at mid-poses and during actions, as a table."""
    heads = ("AP (micro)", "AP (macro)", "θ = 0.5", "whole state", "frames")
    keys = ("ap_micro", "ap_macro", "accuracy_0.5", "exact_state", "looks")
    lines = []
    for name, document in documents.items():
        for what, parts in (("each frame alone", document), ("with memory", document[WITH_MEMORY])):
            for part, words in ((FRAMES, "all frames"), (MID_POSES, "mid-poses"), (DURING_ACTIONS, "during actions")):
                if parts is not None and parts[part]["looks"]:
                    values = [number(parts[part][key]) if key != "looks" else str(parts[part][key]) for key in keys]
                    lines.append((f"{name}: {words}, {what}", *values))
    return "What memory between frames is worth\n\n" + _aligned(("", *heads), lines)


def _text(table: Table) -> str:
    """One table: ours have an arrow, the best of each column an asterisk."""
    lines = []
    for row in table.rows:
        values = [
            f"{number(value)}{'*' if value is not None and value == best else ''}"
            for value, best in zip(row.values, table.best, strict=True)
        ]
        # As the paper prints it; the plus is where a row's name is taken apart.
        lines.append((f"{'> ' if row.ours else ''}{row.name.replace(f' + {MID}', f' {MID}')}", *values))
    head = f"{table.name}: {table.title}\n\n" if table.name else ""
    return head + _aligned(("", *table.heads), lines)


def _aligned(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[column]) for row in (heads, *lines)) for column in range(len(heads))]
    rule = [f"{'-' * (width - 1)}:" if column else "-" * width for column, width in enumerate(widths)]

    def line(cells: Sequence[str]) -> str:
        first, *others = zip(cells, widths, strict=True)
        return " | ".join([f"| {first[0]:<{first[1]}}", *(f"{cell:>{width}}" for cell, width in others)]) + " |"

    return "\n".join(map(line, (heads, rule, *lines)))
