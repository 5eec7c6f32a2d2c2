"""Payloads as JSON values and back, driven by the type annotations of `executive.types`.

A field that is added to a payload is therefore recorded without a line here, and a record that lacks it is still read
when the field has a default. Fields that are not known are passed over, so that a reader copes with records which a
later release of the same format has enriched.
"""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic_core import SchemaValidator, ValidationError
from pydantic_core import core_schema as cs

from executive import types as values
from executive.types import ALWAYS, Atom, Cause, Condition, Effect, Facts, FloatArray, Step
from executive.util.files import legible

JsonValue = Any
"""What `json.dumps` accepts: None, bool, int, float, str, and lists and string-keyed dicts of these."""

RECORDED: Mapping[str, type] = {
    cls.__name__: cls
    for cls in get_args(values.Payload)
    if cls
    not in (values.Scenery, values.Frame, values.PointCloud)  # for display alone, and bulky: the viewer's file has them
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
    try:
        return _validator(hint).validate_python(data)
    except ValidationError as error:
        from executive.util.validation import message_of  # imports pydantic, and records are read without

        first = error.errors(include_url=False)[0]
        raise ValueError(": ".join((*map(str, first["loc"]), message_of(first)))) from None
    except TypeError as error:  # of a payload's own checks
        raise ValueError(str(error)) from None


@functools.cache
def _validator(hint: Any) -> SchemaValidator:
    """Built once a type, because a record is read line by line."""
    return SchemaValidator(_schema(hint))


def _schema(hint: Any) -> cs.CoreSchema:
    """What pydantic's core is to accept for a type, and to make of it."""
    if hint in _LEAVES:
        return _LEAVES[hint]
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))  # only `X | None` is in use
        return cs.nullable_schema(_schema(inner))
    if origin in (tuple, frozenset):
        return cs.no_info_after_validator_function(origin, cs.list_schema(_schema(args[0]), strict=True))
    if origin is not None and issubclass(origin, Mapping):
        return cs.dict_schema(_schema(args[0]), _schema(args[1]), strict=True)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return cs.no_info_after_validator_function(hint, _TEXT)
    if isinstance(hint, type) and is_dataclass(hint):
        hints = get_type_hints(hint)
        return _object(
            hint,
            {
                field.name: (hints[field.name], field.default is MISSING and field.default_factory is MISSING)
                for field in fields(hint)
            },
        )
    raise TypeError(f"{hint!r} cannot be recorded")


def _object(make: Callable[..., Any], parts: Mapping[str, tuple[Any, bool]]) -> cs.CoreSchema:
    """What is made of an object's parts: each with its type, and whether it has to be there."""
    known = {name: cs.typed_dict_field(_schema(hint), required=required) for name, (hint, required) in parts.items()}
    return cs.no_info_after_validator_function(
        lambda given: make(**given), cs.typed_dict_schema(known, extra_behavior="ignore")
    )


def _written_step(step: Step) -> JsonValue:
    """Literals that come about whatever holds are written as they are, any other effect with its condition."""
    effects: list[JsonValue] = []
    for effect in step.effects:
        literals = encode(effect.facts)
        effects += literals if effect.condition == ALWAYS else [{"when": encode(effect.condition), "then": literals}]
    parts = {"action": encode(step.action), "args": encode(step.args), "preconditions": encode(step.precondition)}
    return {**parts, "effects": effects, **({} if step.cost == 1.0 else {"cost": encode(step.cost)})}


def _read_effects(listed: list[JsonValue]) -> tuple[Effect, ...]:
    plain = decode(Facts, [each for each in listed if not isinstance(each, dict)])
    conditional = (each for each in listed if isinstance(each, dict))
    effects = [Effect(decode(Condition, each.get("when")), decode(Facts, each.get("then"))) for each in conditional]
    return (*((Effect(ALWAYS, plain),) if plain else ()), *effects)


def _array(data: list[JsonValue]) -> FloatArray:
    if any(isinstance(each, list) for each in data):
        return np.array([_array(decode(list, each)) for each in data], dtype=np.float64)
    return np.array(decode(tuple[float, ...], data), dtype=np.float64)


def _no_picture(data: JsonValue) -> Any:
    raise ValueError("a picture is kept in a file of its own")


_TEXT = cs.str_schema(strict=True, min_length=0)  # with a length, half a character is no text
_LIST = cs.list_schema(strict=True)
_LEAVES: dict[Any, cs.CoreSchema] = {
    Any: cs.any_schema(),
    list: _LIST,
    str: _TEXT,
    bool: cs.bool_schema(strict=True),
    int: cs.int_schema(strict=True, ge=-(2**63), lt=2**63),
    float: cs.no_info_before_validator_function(
        lambda data: float(data) if data in ("nan", "inf", "-inf") else data, cs.float_schema(strict=True)
    ),
    Atom: cs.no_info_after_validator_function(Atom.parse, _TEXT),
    Facts: cs.no_info_after_validator_function(lambda listed: Facts.parse(*listed), cs.list_schema(_TEXT, strict=True)),
    Condition: cs.no_info_after_validator_function(
        lambda listed: Condition.parse(*listed), cs.list_schema(_TEXT, strict=True)
    ),
    FloatArray: cs.no_info_after_validator_function(_array, _LIST),
    values.Image: cs.no_info_plain_validator_function(_no_picture),
    values.DepthImage: cs.no_info_plain_validator_function(_no_picture),
    tuple[Effect, ...]: cs.no_info_after_validator_function(_read_effects, _LIST),
}
_LEAVES[Step] = _object(
    lambda preconditions, cost=1.0, **parts: Step(precondition=preconditions, cost=cost, **parts),
    {
        "action": (str, True),
        "args": (tuple[str, ...], True),
        "preconditions": (Condition, True),
        "effects": (tuple[Effect, ...], True),
        "cost": (float, False),
    },
)
