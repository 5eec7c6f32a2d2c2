"""Payloads as JSON values and back, driven by the type annotations of `executive.types`.

A field that is added to a payload is therefore recorded without a line here, and a record that lacks it is still read
when the field has a default. Fields that are not known are passed over, so that a reader copes with records which a
later release of the same format has enriched.
"""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from executive import types as values
from executive.types import ALWAYS, Atom, Cause, Condition, Effect, Facts, Step
from executive.util.files import legible

JsonValue = Any
"""What `json.dumps` accepts: None, bool, int, float, str, and lists and string-keyed dicts of these."""

RECORDED: Mapping[str, type] = {
    cls.__name__: cls
    for cls in get_args(values.Payload)
    if cls not in (values.Scenery, values.Frame)  # for display alone, and bulky: the viewer's file has them
}
"""The payload types that a record may hold, by name."""


def encode(value: Any) -> JsonValue:
    """Return a JSON value for anything that flows through the executive.

    Floats that JSON has no number for become "nan", "inf" and "-inf". Whatever is unknown (a Path among a run's
    settings, say) becomes its text.
    """
    match value:
        case None | bool():
            return value
        case str():
            return legible(value.value if isinstance(value, Enum) else value)
        case Atom():
            return str(value)
        case Facts():
            return list(value.literals())
        case Condition():
            return list(value.texts())
        case Step():
            return _written_step(value)
        case int() | np.integer():
            return int(value)
        case float() | np.floating():
            return float(value) if math.isfinite(value) else str(float(value))
        case np.ndarray():
            return encode(value.tolist())
        case Mapping():
            return {str(encode(key)): encode(item) for key, item in value.items()}
        case frozenset() | set():
            return sorted((encode(item) for item in value), key=str)
        case list() | tuple():
            return [encode(item) for item in value]
    if isinstance(value, Cause):  # most codes have one parameter, or none
        given = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: encode(each) for name, each in given.items() if each != _CAUSE.get(name)}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    return str(value)


_CAUSE = {field.name: field.default for field in fields(Cause)}
"""The parameters of a cause that says nothing but its code."""


def decode(hint: Any, data: JsonValue) -> Any:
    """Return the value of type `hint` that `encode` made `data` from.

    Raises:
        ValueError: when `data` is not what `encode` writes for that type; the message names the field.
    """
    return _decoder(hint)(data)


def _expect(kinds: type | tuple[type, ...], name: str, data: JsonValue) -> Any:
    if not isinstance(data, kinds) or (isinstance(data, bool) and kinds is not bool):
        raise ValueError(f"expected {name}, got {str(data)[:60]!r}")
    return data


def _text(data: JsonValue) -> str:
    text: str = _expect(str, "a text", data)
    if not text.isascii() and any("\ud800" <= each <= "\udfff" for each in text):
        raise ValueError("half a character is no text")
    return text


def _whole(data: JsonValue) -> int:
    number: int = _expect(int, "a whole number", data)
    if not -(2**63) <= number < 2**63:
        raise ValueError("a number of more than 64 bits")
    return number


def _number(data: JsonValue) -> float:
    number = float(data) if data in ("nan", "inf", "-inf") else _expect((int, float), "a number", data)
    return float(number if isinstance(number, float) else _whole(number))


def _array(data: JsonValue) -> np.ndarray[Any, np.dtype[np.float64]]:
    def numbers(part: JsonValue) -> Any:
        return [numbers(item) for item in part] if isinstance(part, list) else _number(part)

    return np.array(numbers(_expect(list, "a list of numbers", data)), dtype=np.float64)


def _picture(data: JsonValue) -> Any:
    raise ValueError("a picture is kept in a file of its own")


def _items(item: Callable[[JsonValue], Any], build: Callable[[Iterable[Any]], Any], data: JsonValue) -> Any:
    return build(item(part) for part in _expect(list, "a list", data))


def _mapping(key: Callable[[JsonValue], Any], item: Callable[[JsonValue], Any], data: JsonValue) -> Any:
    return {key(name): item(part) for name, part in _expect(dict, "an object", data).items()}


def _object(cls: type, data: JsonValue) -> Any:
    parts: dict[str, Any] = {}
    hints = _hints(cls)
    for field in fields(cls):
        if field.name in _expect(dict, f"an object ({cls.__name__})", data):
            try:
                parts[field.name] = decode(hints[field.name], data[field.name])
            except ValueError as error:
                raise ValueError(f"{field.name}: {error}") from None
        elif field.default is MISSING and field.default_factory is MISSING:
            raise ValueError(f"{field.name} is missing")
    try:
        return cls(**parts)
    except TypeError as error:
        raise ValueError(str(error)) from None


def _written_step(step: Step) -> JsonValue:
    """Literals that come about whatever holds are written as they are, any other effect with its condition."""
    effects: list[JsonValue] = []
    for effect in step.effects:
        literals = encode(effect.facts)
        effects += literals if effect.condition == ALWAYS else [{"when": encode(effect.condition), "then": literals}]
    parts = {"action": encode(step.action), "args": encode(step.args), "preconditions": encode(step.precondition)}
    return {**parts, "effects": effects, **({} if step.cost == 1.0 else {"cost": encode(step.cost)})}


_STEP: Mapping[str, Callable[[JsonValue], Any]] = {
    "action": lambda data: _text(data),
    "args": lambda data: decode(tuple[str, ...], data),
    "preconditions": lambda data: decode(Condition, data),
    "effects": lambda data: _read_effects(data),
    "cost": lambda data: _number(data),
}


def _read_step(data: JsonValue) -> Step:
    parts: dict[str, Any] = {"cost": 1.0, **_expect(dict, "an object (Step)", data)}
    read = []
    for name, decoder in _STEP.items():
        if name not in parts:
            raise ValueError(f"{name} is missing")
        try:
            read.append(decoder(parts[name]))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    return Step(*read)


def _read_effects(data: JsonValue) -> tuple[Effect, ...]:
    listed = _expect(list, "a list", data)
    plain = decode(Facts, [each for each in listed if not isinstance(each, dict)])
    conditional = (each for each in listed if isinstance(each, dict))
    effects = [Effect(decode(Condition, each.get("when")), decode(Facts, each.get("then"))) for each in conditional]
    return (*((Effect(ALWAYS, plain),) if plain else ()), *effects)


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


_LEAVES: Mapping[Any, Callable[[JsonValue], Any]] = {
    Any: lambda data: data,
    str: _text,
    bool: functools.partial(_expect, bool, "true or false"),
    int: _whole,
    float: _number,
    Atom: lambda data: Atom.parse(_expect(str, "an atom", data)),
    Facts: lambda data: Facts.parse(*(_expect(str, "a literal", item) for item in _expect(list, "a list", data))),
    Condition: lambda data: Condition.parse(*map(_text, _expect(list, "a list", data))),
    Step: _read_step,
    values.FloatArray: _array,
    values.Image: _picture,
    values.DepthImage: _picture,
}


@functools.cache
def _decoder(hint: Any) -> Callable[[JsonValue], Any]:
    """Built once a type, because a record is read line by line."""
    if hint in _LEAVES:
        return _LEAVES[hint]
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))  # only `X | None` is in use
        return lambda data: None if data is None else decode(inner, data)
    if origin in (tuple, frozenset):
        return functools.partial(_items, _decoder(args[0]), origin)
    if origin is not None and issubclass(origin, Mapping):
        return functools.partial(_mapping, _decoder(args[0]), _decoder(args[1]))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint
    if isinstance(hint, type) and is_dataclass(hint):
        return functools.partial(_object, hint)
    raise TypeError(f"{hint!r} cannot be recorded")
