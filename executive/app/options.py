"""Options: each is declared once, as an annotated field of a configuration, and is known everywhere from there.

    @dataclass(frozen=True, slots=True)
    class RunConfig:
        seed: Annotated[int, Option("Fixes the scene and every random number.", least=0)] = 0

        def __post_init__(self) -> None:
            check(self)

From this follow the flag `--seed` with its help (`executive.cli.options`), the key in a run's `config.toml` and in
files for `--config`, the key in a campaign's file, and the words of the command that repeats a run. A configuration may
hold others, as tables in files; their options have flags of their own, too.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import reprlib
import types
from collections.abc import Collection, Iterator, Mapping
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

from executive.errors import InputError, OptionError, nearest
from executive.util.files import legible, read_toml

LARGEST = 2**63 - 1
"""The largest whole number that TOML has."""


class Configuration(Protocol):
    """A dataclass whose fields are options, or configurations."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


C = TypeVar("C", bound=Configuration)


@dataclass(frozen=True, slots=True)
class Option:
    """What is said of an option where it is declared.

    Attributes:
        help: its line in `--help`.
        flag: its flag, where that is not `--` and its name.
        least, most, above, below: the bounds of a number; "above" and "below" are not valid themselves.
        choices: the valid words, each with its meaning.
        offers: words that have a meaning, among other valid ones.
        default: what `--help` says of the default, where that depends on something.
    """

    help: str
    flag: str = ""
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    choices: Mapping[str, str] = field(default_factory=dict)
    offers: Mapping[str, str] = field(default_factory=dict)
    default: str = ""

    def allows(self, number: float) -> bool:
        """Return whether a number is within the bounds; NaN and infinity never are."""
        inside = math.isfinite(number) and (not isinstance(number, int) or abs(number) <= LARGEST)
        inside = inside and (self.least is None or number >= self.least) and (self.most is None or number <= self.most)
        return inside and (self.above is None or number > self.above) and (self.below is None or number < self.below)

    @property
    def bounds(self) -> str:
        """The bounds in words, such as "at least 0 and below 1"."""
        words = {"at least": self.least, "above": self.above, "at most": self.most, "below": self.below}
        told = " and ".join(f"{word} {value:g}" for word, value in words.items() if value is not None)
        return told or f"a number of at most {LARGEST}"


@dataclass(frozen=True, slots=True)
class Declared:
    """An option as a configuration declares it.

    Attributes:
        kind: its type, without None.
        default: the value where none is given; `dataclasses.MISSING` if one has to be.
        path: the names of the configurations that hold it, and its own: its key in files.
    """

    option: Option
    kind: Any
    default: Any
    path: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.path[-1]

    @property
    def flag(self) -> str:
        """The flag, or "" for an argument."""
        if self.option.flag or self.default is not MISSING:
            return self.option.flag or flag_of(self.name)
        return ""

    def check(self, value: Any) -> None:
        """Check a value that is of the option's type.

        Raises:
            OptionError: it is not among the choices, or out of bounds.
        """
        choices = self.option.choices
        if choices and value is not None and value not in choices:
            raise OptionError(f"no {self.name} {value!r}; {nearest(str(value), choices)}", option=self.name)
        if isinstance(value, int | float) and not isinstance(value, bool) and not self.option.allows(value):
            raise OptionError(f"should be {self.option.bounds}, got {value}", option=self.name)

    def read(self, value: Any) -> Any:
        """Return the value that stands for this one in a file.

        Raises:
            OptionError: it is of another type, or not valid.
        """
        from pydantic import TypeAdapter, ValidationError

        strict = self.kind not in (Path, tuple[str, ...])  # which TOML has no values of
        try:
            read = TypeAdapter(self.kind).validate_python(value, strict=strict)
        except ValidationError as error:
            should = error.errors()[0]["msg"].partition(" should ")[2]
            raise OptionError(f"should {should}, got {reprlib.repr(value)}", option=self.name) from None
        self.check(read)
        return read

    @property
    def off(self) -> str:
        """The flag that says no; "" where there is none."""
        return f"--no-{self.flag.removeprefix('--')}" if bool in (self.kind, *get_args(self.kind)) else ""


def flag_of(name: str) -> str:
    return f"--{name.replace('_', '-')}"


@functools.cache
def options(model: type, within: tuple[str, ...] = ()) -> Mapping[str, Declared]:
    """Return the options of a configuration, and of those that it holds, by their names."""
    hints, found = get_type_hints(model, include_extras=True), dict[str, Declared]()
    for each in dataclasses.fields(model):
        hint, path = hints[each.name], (*within, each.name)
        if (inner := held(hint)) is not None:
            found.update(options(inner, path))
        elif get_origin(hint) is Annotated:
            kind, option = get_args(hint)[:2]
            default = each.default if each.default_factory is MISSING else each.default_factory()
            found[each.name] = Declared(option, _without_none(kind), default, path)
    return found


def held(hint: Any) -> type | None:
    """Return the configuration that a field of this type holds, or may hold."""
    inner = _without_none(hint)
    return inner if isinstance(inner, type) and dataclasses.is_dataclass(inner) else None


def _without_none(hint: Any) -> Any:
    if get_origin(hint) not in (Union, types.UnionType):
        return hint
    return Union[tuple(arg for arg in get_args(hint) if arg is not type(None))]  # noqa: UP007  (of any number)


def changed(config: Configuration) -> Iterator[tuple[Declared, Any]]:
    """Iterate over the options that are not as they would be if they were not given, with their values."""
    known = options(type(config)).values()
    plain = type(config)(**{each.name: getattr(config, each.name) for each in known if each.default is MISSING})
    for each in known:
        value = _value(config, each)
        if value is not None and (each.default is MISSING or value != _value(plain, each, each.default)):
            yield each, value


def _value(config: Configuration, option: Declared, otherwise: Any = None) -> Any:
    """Return an option's value; `otherwise` where there is no configuration that holds it."""
    value: Any = config
    for name in option.path:
        if value is None:
            return otherwise
        value = getattr(value, name)
    return value


def check(config: Configuration) -> None:
    """Check each option of a configuration by itself.

    Raises:
        OptionError: a value is not among the choices, or out of bounds.
    """
    for each in options(type(config)).values():
        if len(each.path) == 1:
            each.check(getattr(config, each.name))


def command_words(config: Configuration, without: Collection[str] = ()) -> list[str]:
    """Return the command-line arguments that stand for a configuration; for each option that has its default, none."""
    words: list[str] = []
    for each, value in changed(config):
        if each.name in without:
            continue
        if isinstance(value, bool):
            words.append(each.flag if value else each.off)
        else:
            for part in value if isinstance(value, tuple) else (value,):
                words += [each.flag, str(part)] if each.flag else [str(part)]
    return words


def as_toml(config: Configuration) -> str:
    """Return a configuration as TOML: a line for each value that is not None, and a table for each configuration."""
    values = {each.name: getattr(config, each.name) for each in dataclasses.fields(config)}
    tables: dict[str, Any] = {name: value for name, value in values.items() if dataclasses.is_dataclass(value)}
    lines = [
        # JSON's texts, numbers, booleans and arrays of these are TOML's, but for this character and pairs of escapes.
        f"{name} = {json.dumps(_written(value), ensure_ascii=False)}".replace("\x7f", "\\u007f")
        for name, value in values.items()
        if value is not None and name not in tables
    ]
    for name, table in tables.items():
        lines += ["", f"[{name}]", as_toml(table).rstrip("\n")]
    return "\n".join(lines) + "\n"


def _written(value: Any) -> Any:
    """Return the value as it is in the file, without lone surrogates, which paths may have and TOML may not."""
    if isinstance(value, tuple):
        return [_written(each) for each in value]
    return legible(str(value)) if isinstance(value, str | Path) else value


def make(model: type[C], values: Mapping[str, Any], file: Path | None = None) -> C:
    """Make a configuration.

    Args:
        values: by the names of options, wherever in the configuration they are.
        file: a TOML file for the options that are not among the values.

    Raises:
        InputError: the file is missing, or has a mistake.
        OptionError: there is a mistake among the values.
    """
    found = {} if file is None else read_values(model, read_toml(file), file)
    try:
        return _built(model, {**found, **values})
    except OptionError as error:
        if file is None or error.option in values:
            raise
        raise InputError(error.message, file=file, key=".".join(options(model)[error.option].path)) from None


def read_values(
    model: type, table: Mapping[str, Any], file: Path, key: str = "", names: Collection[str] = ()
) -> dict[str, Any]:
    """Return the values of options in a table of a file, by the names of the options.

    Args:
        key: the table's own; none for the whole file.
        names: the options that it may have; all, if there are none.

    Raises:
        InputError: a key is unknown, or a value is of another type or not valid.
    """
    found: dict[str, Any] = {}
    known, hints = options(model), get_type_hints(model)
    valid = names or hints.keys()
    for name, value in table.items():
        path = f"{key}.{name}".lstrip(".")
        if name not in valid:
            raise InputError(f"unknown key; {nearest(name, valid)}", file=file, key=path)
        if (inner := held(hints[name])) is None:
            try:
                found[name] = known[name].read(value)
            except OptionError as error:
                raise InputError(error.message, file=file, key=path) from None
        elif isinstance(value, Mapping):
            found.update(read_values(inner, value, file, path))
        else:
            raise InputError(f"should be a table, got {reprlib.repr(value)}", file=file, key=path)
    return found


def _built(model: type[C], values: Mapping[str, Any]) -> C:
    hints, parts = get_type_hints(model), dict[str, Any]()
    for each in dataclasses.fields(model):
        if (inner := held(hints[each.name])) is not None:
            if not values.keys().isdisjoint(options(inner)):
                parts[each.name] = _built(inner, values)
        elif each.name in values:
            parts[each.name] = values[each.name]
        elif each.default is MISSING and each.default_factory is MISSING:
            raise OptionError("is missing", option=each.name)
    return model(**parts)
