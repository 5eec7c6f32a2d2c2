"""What is wrong with a file's contents, from pydantic's errors: one mistake, with the key that it is about."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from executive.errors import nearest


def first_mistake(error: ValidationError, model: type[BaseModel]) -> tuple[tuple[str, ...], str]:
    """Return the key and a message for the mistake that is to be told first.

    Args:
        model: the model that the contents were validated as.
    """
    # A misspelt key is also a missing one.
    first = min(error.errors(), key=lambda entry: entry["type"] != "extra_forbidden")
    path = _path(first["loc"], model)
    if first["type"] == "extra_forbidden":
        return path, f"unknown key; {nearest(path[-1], _fields(_at(model, path[:-1]) or model))}"
    return path, message_of(first)


def message_of(mistake: ErrorDetails) -> str:
    """Return what is wrong with a value, in one line."""
    if mistake["type"] == "missing":
        return "is missing"
    kind = "should be a table" if mistake["type"] in ("model_type", "dict_type") else mistake["msg"]
    should = kind.partition("should ")[2]
    return f"should {should}, got {reprlib.repr(mistake['input'])}" if should else kind.removeprefix("Value error, ")


def _path(loc: Sequence[int | str], model: type[BaseModel]) -> tuple[str, ...]:
    """Return a mistake's key, without the kind that pydantic appends where a value may be of two."""
    path: list[str] = []
    hint: Any = model
    for part in loc:
        inner = _inside(hint, part)
        if inner is None and path and not _fields(hint):
            break
        path.append(str(part))
        hint = inner
    return tuple(path)


def _at(model: Any, path: Sequence[str]) -> Any:
    """Return the type of what has this key."""
    for part in path:
        model = _inside(model, part)
    return model


def _inside(hint: Any, part: int | str) -> Any:
    """Return the type of a part of a value; None where the type has no such part."""
    for kind in _kinds(hint):
        origin, args = get_origin(kind), get_args(kind)
        if fields := _fields(kind):
            return fields.get(str(part))
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return args[1]
        if origin in (list, tuple, frozenset) and str(part).isdigit():
            return args[0]
    return None


def _kinds(hint: Any) -> tuple[Any, ...]:
    """Return the types that a value may be of."""
    if get_origin(hint) is Annotated:
        return _kinds(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return tuple(kind for arg in get_args(hint) for kind in _kinds(arg))
    return (hint,)


def _fields(hint: Any) -> Mapping[str, Any]:
    """Return the types of a model's keys, by their names in files; none for what is no model."""
    for kind in _kinds(hint):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
    return {}
