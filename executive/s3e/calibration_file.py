"""The file with all that is known of a model's mistakes: `calibration.json`, beside the model or anywhere.

It is about one model as one runtime runs it in one quantisation. `correction` is for its probabilities
(`executive.s3e.calibration`), `domains` has for each domain, predicate and atom how often answers are wrong, how sure
they are, how much repeated questions repeat mistakes, and the scores of calibration looks (`executive.app.sensor_fit`).
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from executive.errors import InputError
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json
from executive.util.validation import first_mistake

FILE = "calibration.json"
"""The name of the file beside a model."""

FORMER = "trust.json"
"""The file that had `domains` in version 0.1, where `calibration.json` had the correction alone."""

FORMAT = 2
CORRELATION = 0.8
"""The assumed correlation of a model's errors about the same thing, within a moment and across moments (see
`executive.belief.SensorModel`): asked about the same thing again, a model answers the same."""

_LARGEST = 20_000_000
_ABOUT = (
    "What is known of this model's mistakes. correction: log-odds times slope plus bias corrects a probability, for "
    "the predicates named there; for all others, shared (true and false: how many labels that rests on). domains: the "
    "evidence of an answer is slope * log-odds + bias, within the bounds that false_alarms and misses set; repeats is "
    "the correlation of the errors of repeated questions, by what was changed; scores are the nonconformity of "
    "calibration looks."
)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class ScalingTable(_Table):
    slope: float
    bias: float
    true: int = 0
    false: int = 0


class CorrectionTable(_Table):
    method: str
    shared: ScalingTable
    predicates: dict[str, ScalingTable] = {}


class ErrorTable(_Table):
    false_alarms: float
    misses: float
    slope: float
    bias: float


class PredicateTable(ErrorTable):
    scores: list[float] = []
    repeats: dict[str, float] = {}


class DomainTable(_Table):
    looks: int = Field(ge=0)
    correlation_within: float = Field(
        ge=0, le=1, validation_alias=AliasChoices("correlation_within", "alike"), default=CORRELATION
    )
    correlation_across: float = Field(
        ge=0, le=1, validation_alias=AliasChoices("correlation_across", "lasting"), default=CORRELATION
    )
    predicates: dict[str, PredicateTable]
    atoms: dict[str, ErrorTable] = {}


class Document(_Table):
    about: str = _ABOUT
    format: int = FORMAT
    model: str = ""
    runtime: str = ""
    quantisation: str = ""
    correction: CorrectionTable | None = None
    domains: dict[str, DomainTable] = {}


def place(path: Path | str) -> Path:
    """Return the file that a path means: in a folder (a model's), `calibration.json`."""
    return Path(path) / FILE if os.path.isdir(path) else Path(path)


def is_in(folder: Path) -> bool:
    """Return whether a model's folder has the file, or one of version 0.1."""
    return any(os.path.isfile(folder / name) for name in (FILE, FORMER))


def read(path: Path | str) -> Document:
    """Read the file; given a folder, `calibration.json` in it. Files of version 0.1 are read with a `FutureWarning`;
    where a folder has both of these, together.

    Raises:
        InputError: the first mistake, in one line with file and key.
    """
    file = place(path)
    former = file.with_name(FORMER) if os.path.isdir(path) else None
    if former is not None and not os.path.isfile(former):
        former = None
    if former is not None and not os.path.isfile(file):
        return _read(former)
    document = _read(file)
    if former is not None and document.format == 1:
        return document.model_copy(update={"domains": _read(former).domains})
    return document


def write(path: Path | str, document: Document) -> Path:
    """Write the file atomically, given a folder, `calibration.json` in it, and return its path.

    Raises:
        InputError: it cannot be written.
    """
    file = place(path)
    told = document.model_copy(update={"about": _ABOUT, "format": FORMAT}).model_dump()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        return write_atomic(file, (json.dumps(told, indent=1, ensure_ascii=False) + "\n").encode())
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=file) from None


def _read(file: Path) -> Document:
    content = read_json(file, largest=_LARGEST)
    if not isinstance(content, dict):
        raise InputError("is not a calibration that Executive wrote", file=file)
    if content.get("kind") == "platt":
        return _from_profile(file)
    found = content.get("format")
    if found not in (1, FORMAT) or isinstance(found, bool):
        raise InputError(f"expected {FORMAT}, got {found!r:.40}", file=file, key="format")
    try:
        document = Document.model_validate(_renamed(content) if found == 1 else content)
    except ValidationError as error:
        key, message = first_mistake(error, Document)
        raise InputError(message, file=file, key=".".join(key) or None) from None
    if found == 1:
        message = f"{file} is of version 0.1, which is read until version 0.3; executive calibrate writes it anew"
        warnings.warn(message, FutureWarning, stacklevel=3)
    return document


def _from_profile(file: Path) -> Document:
    """Return a Platt profile of s3e as a file with a correction alone."""
    from executive.s3e.interchange import PlattProfile

    try:
        correction = PlattProfile.read(file).calibration().table()
    except InputError as error:
        raise error if error.file is not None else InputError(error.message, file=file, key="groups") from None
    return Document(correction=correction)


def _renamed(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the contents of a former file of corrections as what they are called now; other files' as they are."""
    correction = {key: content[key] for key in ("method", "shared", "predicates") if key in content}
    others = {key: value for key, value in content.items() if key not in correction}
    return {**others, "correction": correction} if correction else content
