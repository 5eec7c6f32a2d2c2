"""The report of an evaluation as one HTML file that opens offline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from executive.lab.common.html import code, number, render, share
from executive.lab.evaluation.metrics import THRESHOLDS
from executive.lab.evaluation.mistakes import Mistake
from executive.lab.evaluation.published import Table
from executive.s3e.reliability import BINS

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
    about = document["about"]
    return render(
        "evaluation",
        title=f"{document['name']} on {about['domain']}",
        remarks=_remarks(document),
        tiles=_tiles(document),
        tables=tables,
        source=source,
        scored=[*_SCORED],
        predicates=_by_predicate(document),
        actions=_by_action(document),
        apart=_apart(document),
        atoms=_by_atom(document),
        figures=figures,
        mistaken=mistaken,
        mistakes=mistakes,
        looks=document["looks"],
        most=LISTED,
        bins=BINS,
        never_true=document["never_true"],
        command=about["command"],
        system_prompt=about["system_prompt"],
    )


def _remarks(document: Mapping[str, Any]) -> list[str]:
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
    return said


def _tiles(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        (number(document["ap_micro"]), "average precision, micro"),
        (number(document["ap_macro"]), "average precision, macro"),
        (number(document["accuracy_0.5"]), "accuracy at θ = 0.5"),
        (share(document["exact_state"]), "looks with the whole state right"),
        *_believed(document),
        (number(document["ece"]), "expected calibration error"),
        (f"{document['seconds_per_look']:.2f} s", "a look, median"),
    ]


def _believed(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    if "posterior" not in document:  # an older evaluation, or of what no run could carry out
        return []
    return [(share(document["posterior"]["exact_state"]), "the same, as a run would believe after the look")]


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
    accuracy = [number(scores[f"accuracy_{threshold}"]) for threshold in THRESHOLDS]
    counts = [f"{scores[key]:,}" if scores[key] else "0" for key in ("missed", "false_alarms", "unanswered")]
    return [
        number(scores["ap_micro"]),
        number(scores["ap_macro"]),
        *accuracy,
        *counts,
        number(scores["ece"]),
        number(scores["brier"], 4),
    ]


def _by_predicate(document: Mapping[str, Any]) -> list[list[str]]:
    each = [[code(name), _true_in(scores), *_scored(scores)] for name, scores in document["predicates"].items()]
    return [*each, ["all", _true_in(document), *_scored(document)]]


def _by_action(document: Mapping[str, Any]) -> list[list[str]]:
    if not document["looks_by_action"]["surprising"]["looks"]:
        return []
    names = {"expected": "what its effects say", "surprising": "something else"}
    return [
        [names[key], f"{scores['looks']:,}", share(scores["exact_state"]), *_scored(scores)]
        for key, scores in document["looks_by_action"].items()
    ]


def _apart(document: Mapping[str, Any]) -> list[list[str]]:
    """The looks at so many objects, and those of each subset; and the answers about what training saw and did not."""
    rows = [
        [name, f"{scores['looks']:,}", share(scores["exact_state"]), *_scored(scores)]
        for name, scores in document.get("groups", {}).items()
        if scores["looks"]
    ]
    rows += [
        [f"combinations {name}", "", share(scores["exact_state"]), *_scored(scores)]
        for name, scores in document.get("combinations", {}).items()
        if scores["asked"]
    ]
    believed = document.get("posterior")
    return rows + ([[f"{row[0]}, as believed", *row[1:]] for row in _apart(believed)] if believed else [])


def _by_atom(document: Mapping[str, Any]) -> list[list[str]]:
    return [
        [code(name), _true_in(scores), *(cell for index, cell in enumerate(_scored(scores)) if index != 1)]
        for name, scores in document["atoms"].items()
    ]


def _true_in(scores: Mapping[str, Any]) -> str:
    return share(scores["true"] / scores["asked"] if scores["asked"] else None)
