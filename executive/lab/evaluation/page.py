"""The report of an evaluation as one HTML file that opens offline."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from executive.lab.common import html
from executive.lab.evaluation.metrics import THRESHOLDS
from executive.lab.evaluation.mistakes import Answered, Mistake
from executive.lab.evaluation.published import Table
from executive.s3e.reliability import BINS
from executive.trace.record.pictures import to_jpeg

LISTED = 8
"""Answers that are listed below the pictures of a mistake."""


def page(
    document: Mapping[str, Any],
    tables: Sequence[Table],
    source: str,
    figures: Mapping[str, tuple[str, bytes]],
    mistakes: Sequence[Mistake],
    mistaken: int,
) -> str:
    """The whole file.

    Args:
        document: as of `executive.lab.evaluation.store.document`.
        source: whose the other rows of the tables are, in a sentence; empty without any.
        figures: heading -> (what is to be seen, PNG).
        mistaken: in how many looks there is a mistake.
    """
    title = f"{document['name']} on {document['about']['domain']}"
    parts = [
        _about(document),
        _tiles(document),
        *(_published(table, source) for table in tables),
        _by_predicate(document),
        _by_action(document),
        _by_atom(document),
        *(html.figure(heading, text, png) for heading, (text, png) in figures.items()),
        _mistakes(mistakes, mistaken, document["looks"]),
        _method(document),
    ]
    return html.page(title, parts)


def _about(document: Mapping[str, Any]) -> str:
    about = document["about"]
    data = about["data"]
    pose = "with the home pose" if data["home_pose"] else "without the home pose"
    seed = "" if data["seed"] is None else f" (seed {data['seed']})"
    said = [f"{document['looks']} looks of {data['folder']}{seed}, {pose}"]
    told = about["instructions"]
    whose = f" ({told})" if isinstance(told, str) else ""
    said += [f"with instructions{whose}" if told else "without instructions"]
    said += [f"cameras: {', '.join(about['cameras'])}"] if "cameras" in about else []  # older ones do not say
    said += [] if about.get("abstention", True) else ["always answered"]
    said += {"templates": ["questions from templates"], "llm": ["questions worded by a language model"]}.get(
        about["translator"], ["no translation"]
    )
    said += ["each picture on its own"] if about["per_image"] else []
    said += ["calibrated"] if about["calibrated"] else ["not calibrated"]
    if about["paraphrases"]:
        said += [
            f"worded as in {about['paraphrases']}" + ("" if about["rename"] else ", objects under their own names")
        ]
    said += [f"disturbed: {spec}" for spec in about["disturb"]]
    return html.tags(said)


def _tiles(document: Mapping[str, Any]) -> str:
    shown = [
        (html.number(document["ap_micro"]), "average precision, micro"),
        (html.number(document["ap_macro"]), "average precision, macro"),
        (html.number(document["accuracy_0.5"]), "accuracy at θ = 0.5"),
        (html.share(document["exact_state"]), "looks with the whole state right"),
        (html.number(document["ece"]), "expected calibration error"),
        (f"{document['seconds_per_look']:.2f} s", "a look, median"),
    ]
    return html.tiles(shown)


def _published(table: Table, source: str) -> str:
    rows = []
    before = None
    for row in table.rows:
        group = row.name.partition(" + ")[2]
        marks = [name for name, given in (("ours", row.ours), ("gap", before not in (None, group))) if given]
        before = group
        cells = [f"<td>{escape(row.name)}</td>"]
        for value, best in zip(row.values, table.best, strict=True):
            strong = ' class="best"' if value is not None and value == best else ""
            cells.append(f"<td{strong}>{html.number(value, 3 if row.ours else 2)}</td>")
        rows.append(f'<tr class="{" ".join(marks)}">{"".join(cells)}</tr>')
    heads = "".join(f"<th>{escape(head)}</th>" for head in ("", *table.heads))
    title = ": ".join(part for part in (table.name, table.title) if part) or "Results"
    note = f"Accuracy at three thresholds, and average precision. Marked rows are ours. {source}" if source else ""
    table_ = f'<div class="wide"><table><tr>{heads}</tr>{"".join(rows)}</table></div>'
    return f"<h2>{escape(title)}</h2><p>{escape(note)}</p>{table_}"


_SCORED = (
    "AP micro",
    "AP macro",
    *(f"θ = {threshold}" for threshold in THRESHOLDS),
    "missed",
    "false alarms",
    "unanswered",
    "ECE",
    "Brier",
)


def _scored(scores: Mapping[str, Any]) -> list[str]:
    accuracy = [html.number(scores[f"accuracy_{threshold}"]) for threshold in THRESHOLDS]
    counts = [f"{scores[key]:,}" if scores[key] else "0" for key in ("missed", "false_alarms", "unanswered")]
    return [
        html.number(scores["ap_micro"]),
        html.number(scores["ap_macro"]),
        *accuracy,
        *counts,
        html.number(scores["ece"]),
        html.number(scores["brier"], 4),
    ]


def _by_predicate(document: Mapping[str, Any]) -> str:
    rows = [
        [
            f"<code>{escape(name)}</code>",
            html.share(scores["true"] / scores["asked"] if scores["asked"] else None),
            *_scored(scores),
        ]
        for name, scores in document["predicates"].items()
    ]
    rows.append(
        ["all", html.share(document["true"] / document["asked"] if document["asked"] else None), *_scored(document)]
    )
    text = "Missed: true, and not taken for it at 0.5. False alarms: false, and not taken for that."
    return f"<h2>Predicates</h2><p>{text}</p>{html.table(('predicate', 'true in', *_SCORED), rows)}"


def _by_action(document: Mapping[str, Any]) -> str:
    if not document["looks_by_action"]["surprising"]["looks"]:
        return ""
    names = {"expected": "what its effects say", "surprising": "something else"}
    rows = [
        [names[key], f"{scores['looks']:,}", html.share(scores["exact_state"]), *_scored(scores)]
        for key, scores in document["looks_by_action"].items()
    ]
    text = "The looks that a monitor is there for: those after an action that changed more, or less, than it should."
    heads = ("the action did", "looks", "whole state", *_SCORED)
    return f"<h2>When an action goes wrong</h2><p>{text}</p>{html.table(heads, rows)}"


def _by_atom(document: Mapping[str, Any]) -> str:
    heads = ("atom", "true in", "AP", *_SCORED[2:])
    rows = [
        [f"<code>{escape(name)}</code>", html.share(scores["true"] / scores["asked"] if scores["asked"] else None)]
        + [cell for index, cell in enumerate(_scored(scores)) if index != 1]
        for name, scores in document["atoms"].items()
    ]
    return f"<h2>Atoms</h2>{html.table(heads, rows)}"


def _mistakes(mistakes: Sequence[Mistake], mistaken: int, looks: int) -> str:
    if mistaken:
        text = f"{mistaken:,} of {looks:,} looks have a mistake at 0.5. The worst ones, one for each episode and atom:"
    else:
        text = "There is no mistake at 0.5. The answers that were nearest to one, one for each episode and atom:"
    return f"<h2>The worst answers</h2><p>{text}</p>{html.lines(map(_mistake, mistakes))}"


def _mistake(mistake: Mistake) -> str:
    data = base64.b64encode(to_jpeg(mistake.picture, 85)).decode()
    where = f"<b>episode {mistake.episode}, step {mistake.step}</b> after <code>{escape(mistake.action)}</code>"
    rows = '<colgroup><col class="atom"><col class="truth"><col class="said"><col></colgroup>'
    rows += "".join(map(_answer, mistake.answers[:LISTED]))
    more = len(mistake.answers) - LISTED
    rows += f'<tr><td colspan="4">and {more} more</td></tr>' if more > 0 else ""
    cameras = " · ".join(mistake.cameras)
    head = f"<header><div>{where}</div><span>{escape(cameras)}</span></header>"
    image = f'<img alt="{escape(cameras)}" src="data:image/jpeg;base64,{data}">'
    return f'<section class="mistake">{head}{image}<table>{rows}</table></section>'


def _answer(answer: Answered) -> str:
    known = answer.probability is not None
    said = f"P(true) {answer.probability:.3f}" if answer.probability is not None else "unanswered"
    bar = f'<span class="bar"><i style="width:{100 * (answer.probability or 0.0):.1f}%"></i></span>' if known else ""
    return (
        f'<tr class="{"wrong" if answer.wrong else ""}"><td><code>{escape(str(answer.atom))}</code></td>'
        f"<td>is {'true' if answer.truth else 'false'}</td>"
        f'<td>{bar}<span class="said">{said}</span></td><td>{escape(answer.question)}</td></tr>'
    )


def _method(document: Mapping[str, Any]) -> str:
    never = document["never_true"]
    left_out = f" Never true here, and left out of the macro average: {', '.join(never)}." if never else ""
    text = (
        "Every atom is a label. Micro pools all answers; macro is the mean over atoms. An unanswered atom is right at "
        "no threshold, and is ranked last. The whole state is right when every atom is, at 0.5. The expected "
        f"calibration error is over {BINS} bins of P(true).{left_out}"
    )
    command = escape(document["about"]["command"])
    prompt = escape(document["about"]["system_prompt"])
    blocks = f"<pre>{command}</pre><p>The system prompt:</p><pre>{prompt}</pre>"
    return f"<h2>How this was measured</h2><p>{escape(text)}</p>{blocks}"
