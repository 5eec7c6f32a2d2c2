"""Published results of a domain's task, and tables in their layout with our own rows beside them.

A domain may have a file `published.toml`:

    source = "Who found this out, in a sentence."
    columns = ["accuracy_0.3", "ap_micro"]          # keys of `executive.lab.evaluation.metrics.Scores.document`
    curves = ["robot-gripping(milk-carton)"]        # atoms whose precision-recall curves are published, too

    [[table]]
    name = "Table 1"
    title = "what it compares"
    [table.rows]
    "72B + Instruct + Pose" = [0.90, 0.88]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.errors import DomainError, nearest
from executive.lab.evaluation.metrics import THRESHOLDS
from executive.types import Atom
from executive.util.files import read_toml
from executive.util.validation import first_mistake

FILE = "published.toml"

HEADS = {
    **{f"accuracy_{threshold}": f"θ = {threshold}" for threshold in THRESHOLDS},
    "ap_micro": "AP (micro)",
    "ap_macro": "AP (macro)",
    "exact_state": "whole state",
}
"""What may be tabled, and what its column is called."""

UNTRANSLATED = "(no trans"
"""In the name of a row that was asked without translation."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _Group(_Strict):
    """The looks that a row of ours is about: at so many objects at most, or at those of a subset."""

    most: int | None = Field(default=None, ge=1)
    subset: str | None = None

    @property
    def name(self) -> str:
        """As of `executive.lab.evaluation.varying`."""
        return f"at most {self.most}" if self.most is not None else str(self.subset)


class _Table(_Strict):
    name: str = Field(min_length=1)
    title: str = ""
    groups: dict[str, _Group] = {}
    rows: dict[str, list[float]]


class Published(_Strict):
    """A whole `published.toml`."""

    source: str = Field(min_length=1)
    columns: list[str] = Field(min_length=1)
    curves: list[str] = []
    table: list[_Table] = []

    @property
    def atoms(self) -> tuple[Atom, ...]:
        return tuple(Atom.parse(curve.lower()) for curve in self.curves)


class Row(NamedTuple):
    """One line of a table: what was measured, the numbers (None where there is none), and whether it is ours."""

    name: str
    values: tuple[float | None, ...]
    ours: bool


class Table(NamedTuple):
    """A table as it is to be printed. `best` is the highest value of each column."""

    name: str
    title: str
    heads: tuple[str, ...]
    rows: tuple[Row, ...]
    best: tuple[float | None, ...]


def read(folder: Path) -> Published | None:
    """The published results in a domain's folder, if it has any.

    Raises:
        DomainError: the file is wrong; file and key are named.
    """
    file = folder / FILE
    if not file.exists():
        return None
    said = read_toml(file, mistake=DomainError)
    try:
        published = Published.model_validate(said)
    except ValidationError as error:
        key, message = first_mistake(error, Published)
        raise DomainError(message, file=file, key=".".join(key)) from None
    _check(published, file)
    return published


def tables(published: Published | None, ours: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """The published tables with our rows (name -> scores as a document) in their places; without any published, a
    table of ours alone.

    A row of ours stands after those whose name says the same after its first part (`+ Instruct + Pose`). One that was
    asked without translation stands in the tables that have such rows. A table with groups has a row of ours for each
    of them that the evaluation has.
    """
    if published is None:
        heads = tuple(HEADS)
        return [_made("", "", heads, [_row(name, scores, heads) for name, scores in ours.items()])]
    made = []
    columns = tuple(published.columns)
    for table in published.table:
        rows = [Row(name, tuple(values), False) for name, values in table.rows.items()]
        if table.groups:
            for name, scores in ours.items():
                _add_groups(rows, table, name, scores.get("groups", {}), columns)
            made.append(_made(table.name, table.title, columns, rows))
            continue
        untranslated = any(UNTRANSLATED in name for name in table.rows)
        for name, scores in ours.items():
            if untranslated or UNTRANSLATED not in name:
                rows.insert(_place(name, rows), _row(name, scores, columns))
        made.append(_made(table.name, table.title, columns, rows))
    return made


def _check(published: Published, file: Path) -> None:
    for column in published.columns:
        if column not in HEADS:
            raise DomainError(f"no column {column!r}; {nearest(column, HEADS)}", file=file, key="columns")
    for text in published.curves:
        try:
            Atom.parse(text)
        except ValueError as error:
            raise DomainError(str(error), file=file, key="curves") from None
    for table in published.table:
        for label, group in table.groups.items():
            if (group.most is None) == (group.subset is None):
                raise DomainError("has either 'most' or 'subset'", file=file, key=f"table.groups.{label!r}")
        for name, values in table.rows.items():
            if len(values) != len(published.columns):
                message = f"has {len(values)} numbers, and there are {len(published.columns)} columns"
                raise DomainError(message, file=file, key=f"table.rows.{name!r}")


def _add_groups(
    rows: list[Row], table: _Table, name: str, groups: Mapping[str, Mapping[str, Any]], columns: Sequence[str]
) -> None:
    """Put a row of ours for each group after the published rows with the same modifications."""
    known = frozenset[str]().union(*(_modifications(_ungrouped(each)) for each in table.rows))
    told = _modifications(name) & known
    alike = [at for at, row in enumerate(rows) if _modifications(_ungrouped(row.name)) & known == told]
    place = alike[-1] + 1 if alike else len(rows)
    for label, group in reversed(table.groups.items()):
        if group.name in groups:
            rows.insert(place, _row(f"{name} ({label})", groups[group.name], columns))


def _ungrouped(name: str) -> str:
    return name.partition(" (")[0]


def _place(name: str, rows: Sequence[Row]) -> int:
    alike = [index for index, row in enumerate(rows) if _modifications(row.name) == _modifications(name)]
    return alike[-1] + 1 if alike else len(rows)


def _modifications(name: str) -> frozenset[str]:
    return frozenset(part.strip() for part in name.split(" + ")[1:])


def _row(name: str, scores: Mapping[str, float | None], columns: Sequence[str]) -> Row:
    return Row(name, tuple(scores[column] for column in columns), True)


def _made(name: str, title: str, columns: Sequence[str], rows: Sequence[Row]) -> Table:
    each = list(zip(*(row.values for row in rows), strict=True))
    best = tuple(max((value for value in column if value is not None), default=None) for column in each)
    return Table(name, title, tuple(HEADS[column] for column in columns), tuple(rows), best)
