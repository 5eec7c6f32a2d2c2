"""What an evaluation leaves in its folder: its numbers, every answer, pictures, and a report of all that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from executive.errors import OptionError
from executive.lab.collection.dataset import write_atomically
from executive.lab.common import html
from executive.lab.evaluation import page, plots
from executive.lab.evaluation.evaluate import Evaluation
from executive.lab.evaluation.metrics import HALF, THRESHOLDS, Answers, average_precision
from executive.lab.evaluation.mistakes import Mistake, draw
from executive.lab.evaluation.published import Published, Table, tables
from executive.lab.evaluation.store import document, save
from executive.s3e.reliability import plot_reliability
from executive.types import Atom

REPORT, SHEET = "report.html", "mistakes.jpg"
CURVES, PRECISIONS, RELIABILITY = "precision-recall.png", "average-precision.png", "reliability.png"


def write(
    folder: Path,
    evaluation: Evaluation,
    mistakes: Sequence[Mistake] = (),
    beside: Sequence[Evaluation] = (),
    published: Published | None = None,
) -> dict[str, Any]:
    """Write everything into `folder`, and return the document that `evaluation.json` holds.

    Args:
        beside: other evaluations, for tables and pictures; equal names get a number.
        published: the domain's published results.

    Raises:
        InputError: the folder cannot be written to.
    """
    try:
        made = save(folder, evaluation)
        named = distinct([evaluation, *beside])
        series = {name: each.answers for name, each in named.items()}
        pictures = {CURVES: plots.precision_recall(series, _atoms(evaluation.answers, published))}
        if all(answers.has_columns for answers in series.values()):  # else there are too many atoms for a picture
            pictures[PRECISIONS] = plots.average_precisions(series)
        for name, png in pictures.items():
            write_atomically(folder / name, png)
        if any(answers.pairs() for answers in series.values()):
            plot_reliability(folder / RELIABILITY, {name: answers.pairs() for name, answers in series.items()})
            pictures[RELIABILITY] = (folder / RELIABILITY).read_bytes()
        if mistakes:
            write_atomically(folder / SHEET, draw(mistakes))
        mistaken = int((evaluation.answers.asked & ~evaluation.answers.right(HALF)).any(axis=1).sum())
        figures = {heading: (text, pictures[name]) for name, (heading, text) in _FIGURES.items() if name in pictures}
        source = published.source if published is not None else ""
        text = page.page(made, rows(named, published), source, figures, mistakes, mistaken)
        write_atomically(folder / REPORT, text.encode())
    except OSError as error:
        raise OptionError(f"cannot be written to ({error.strerror})", file=folder, option="out") from None
    return made


def rows(named: Mapping[str, Evaluation], published: Published | None) -> list[Table]:
    """The published tables with these evaluations in them, each with what a run would believe in a row of its own."""
    ours: dict[str, Mapping[str, Any]] = {}
    for name, each in named.items():
        ours[name] = made = document(each)
        if "posterior" in made:
            first, *modified = name.split(" + ")
            ours[" + ".join([f"{first}, as believed", *modified])] = made["posterior"]
    return tables(published, ours)


def distinct(evaluations: Sequence[Evaluation]) -> dict[str, Evaluation]:
    """Evaluations by name; where two have the same one, with the data's name or a number."""
    named: dict[str, Evaluation] = {}
    for each in evaluations:
        name, count = each.name, 1
        while name in named:
            count += 1
            name = f"{each.name} #{count}"
        named[name] = each
    return named


def summary(document: Mapping[str, Any], folder: Path) -> str:
    """The result of an evaluation in a few lines."""
    number = html.number
    whole, asked = document["exact_state"], document["asked"]
    accuracy = ", ".join(f"{number(document[f'accuracy_{threshold}'])} at {threshold}" for threshold in THRESHOLDS)
    lines = [
        f"{document['name']}: {document['looks']} looks, {document['seconds_per_look']:.2f} s each",
        f"  AP        {number(document['ap_micro'])} micro, {number(document['ap_macro'])} macro (over atoms)",
        f"  accuracy  {accuracy}; the whole state in {100 * whole:.1f} % of looks",
        f"  P(true)   ECE {number(document['ece'])}, Brier {number(document['brier'], 4)}; "
        f"{document['unanswered']} of {asked} unanswered",
    ]
    if "posterior" in document:
        lines.append(_apart("as a run would believe after the look", document["posterior"]))
    for name, scores in document["predicates"].items():
        wrong = f"{scores['missed']} missed, {scores['false_alarms']} false alarms"
        lines.append(f"  {name}: AP {number(scores['ap_micro'])} micro, {number(scores['ap_macro'])} macro; {wrong}")
    believed = document.get("posterior", {})
    for name, scores in document.get("groups", {}).items():
        lines.append(_apart(f"{name}: {scores['looks']} looks", scores, believed.get("groups", {}).get(name)))
    for name, scores in document.get("combinations", {}).items():
        lines.append(_apart(f"combinations {name}", scores, believed.get("combinations", {}).get(name)))
    return "\n".join([*lines, f"report: {folder / REPORT}"])


def _apart(name: str, scores: Mapping[str, Any], believed: Mapping[str, Any] | None = None) -> str:
    number = html.number
    whole = scores["exact_state"]
    told = "" if whole is None else f", the whole state in {100 * whole:.1f} %"
    if believed is not None and believed["exact_state"] is not None:
        told += f"; as believed {number(believed['ap_micro'])}, {100 * believed['exact_state']:.1f} %"
    return f"  {name}: AP {number(scores['ap_micro'])} micro, {number(scores['ap_macro'])} macro{told}"


_FIGURES = {
    CURVES: (
        "Precision and recall",
        "Over all thresholds: of all answers, of each predicate's atoms pooled, and of single atoms: the "
        "published ones, and the one with the lowest average precision.",
    ),
    PRECISIONS: (
        "Average precision of each atom",
        "A grey mark is what chance would reach: how often the atom is true.",
    ),
    RELIABILITY: (
        "Reliability",
        "Of the answers with a probability near x, the share that is true; on the dashed line both are the same.",
    ),
}


def _atoms(answers: Answers, published: Published | None) -> list[Atom]:
    """The atoms whose curves are drawn: those that were published, and the one with the lowest."""
    if not answers.has_columns:
        return []
    known = {atom: value for atom in answers.atoms if (value := average_precision(answers.of(atom))) is not None}
    worst = [min(known, key=lambda atom: known[atom])] if known else []
    wanted = [atom for atom in (published.atoms if published is not None else ()) if atom in known]
    return list(dict.fromkeys([*wanted, *worst]))
