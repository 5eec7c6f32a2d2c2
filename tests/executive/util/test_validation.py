"""The one mistake that is told of a file's contents, and its key."""

from __future__ import annotations

from typing import Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executive.util.validation import first_mistake


class Item(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str
    mass: float = Field(default=1.0, gt=0.0)
    class_: str = Field(default="", alias="class")


class Scene(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    items: list[Item] = []
    named: dict[str, Item] = {}
    one: Item | None = None
    many: int | list[int] = 0
    kind: Literal["a", "b"] = "a"


GOOD: dict[str, Any] = {"items": [{"name": "lemon"}], "named": {"x": {"name": "can"}}, "many": [1, 2]}


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"itms": []}, "itms", "did you mean 'items'?"),
        ({"items": [{"name": "lemon"}, {"nmae": "can"}]}, "items.1.nmae", "unknown key; did you mean 'name'?"),
        ({"items": [{"name": "lemon", "clas": "x"}]}, "items.0.clas", "did you mean 'class'?"),
        ({"named": {"x": {"name": "can", "mas": 1.0}}}, "named.x.mas", "did you mean 'mass'?"),
        ({"one": {"name": "can", "mas": 1.0}}, "one.mas", "did you mean 'mass'?"),
        ({"items": [{}]}, "items.0.name", "is missing"),
        ({"items": [{"name": "can", "mass": -1.0}]}, "items.0.mass", "should be greater than 0, got -1.0"),
        ({"one": 3}, "one", "should be a table, got 3"),
        ({"many": "two"}, "many", "should be a valid integer, got 'two'"),
        ({"many": [1, "two"]}, "many", "should be a valid integer"),
        ({"kind": "c"}, "kind", "'a' or 'b', got 'c'"),
    ],
)
def test_the_key_and_what_would_be_right_are_told(changes: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Scene.model_validate({**GOOD, **changes})
    path, message = first_mistake(caught.value, Scene)
    assert ".".join(path) == key
    assert words in message
