"""Items that are made from the words that describe them: what a scene says of each attribute's values, put together.

A scene's `[attributes.NAME]` gives each value of an attribute (`small`, `red`) some keys of an item. An item is then
described by one value of each attribute: in a list (`attributes = ["small", "red", "metal", "cube"]`), or by its name
(`small-red-metal-cube`), so that a problem may have objects that no scene lists.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from executive.errors import nearest

Attributes = Mapping[str, Mapping[str, Any]]
"""attribute -> value -> keys of an item."""


def attributes_of(words: Iterable[str], attributes: Attributes) -> dict[str, str]:
    """The value of each attribute among `words`: attribute -> value, in the attributes' order.

    Raises:
        ValueError: a word is no value, or an attribute has no value or two.
    """
    found: dict[str, str] = {}
    known = {value: name for name, values in attributes.items() for value in values}
    for word in words:
        if word not in known:
            raise ValueError(f"{word!r} is no value of an attribute; {nearest(word, known)}")
        if known[word] in found:
            raise ValueError(f"{found[known[word]]!r} and {word!r} are two values of {known[word]!r}")
        found[known[word]] = word
    for name, values in attributes.items():
        if name not in found:
            raise ValueError(f"no value of {name!r} is said; {nearest('', values)}")
    return {name: found[name] for name in attributes}


def keys_of(described: Mapping[str, str], attributes: Attributes) -> dict[str, Any]:
    """The keys of an item that has these values (attribute -> value)."""
    keys: dict[str, Any] = {}
    for name, value in described.items():
        keys |= attributes[name][value]
    return keys
