"""The relation of each predicate of a domain, and the kinds of its arguments.

With `relation = "on"` the relation takes the predicate's own arguments in their order; with `relation = "on(?tool,
tray)"` it takes the named ones, where an object of the scene may be named directly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from inspect import signature
from itertools import permutations
from pathlib import Path
from types import MappingProxyType

from executive.errors import DomainError, nearest, unregistered
from executive.relations import basic
from executive.relations.scene import Relation, Scene
from executive.types import Atom, Task

COME_ALONG: Mapping[str, Relation] = MappingProxyType(
    {
        "on": basic.on,
        "directly-on": basic.directly_on,
        "clear": basic.clear,
        "in-region": basic.in_region,
        "inside": basic.inside,
        "open": basic.open_,
        "gripping": basic.gripping,
        "gripper-empty": basic.gripper_empty,
    }
)
"""Those of this package by name."""

ANY_OF: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "thing": frozenset({"item", "table", "container"}),
        "surface": frozenset({"table", "container"}),
        "receptacle": frozenset({"container", "drawer"}),
    }
)
"""What an argument of a kind may be that is no kind of the scene's."""


@dataclass(frozen=True, slots=True)
class RelationKind:
    """A relation with its name and terms: indices of a predicate's arguments, or names of objects of the scene. Without
    terms it takes all arguments in their order."""

    name: str
    relation: Relation
    terms: tuple[int | str, ...] | None = None

    @property
    def kinds(self) -> tuple[str, ...] | None:
        """The kinds of the relation's arguments, if it declares them (`executive.takes`)."""
        declared: tuple[str, ...] | None = getattr(self.relation, "takes", None)
        return declared

    @property
    def count(self) -> int:
        """The number of the relation's arguments."""
        return len(signature(self.relation).parameters) - 1 if self.kinds is None else len(self.kinds)

    def about(self, atom: Atom) -> tuple[str, ...]:
        """The relation's arguments for an atom of the predicate."""
        if self.terms is None:
            return atom.args
        return tuple(term if isinstance(term, str) else atom.args[term] for term in self.terms)

    def holds(self, scene: Scene, atom: Atom) -> bool:
        """Whether an atom of the predicate is true in a scene."""
        return bool(self.relation(scene, *self.about(atom)))


def relations() -> dict[str, Relation]:
    """The relations by name: those that come along, and those that installed packages register."""
    points = entry_points(group="executive.relations")
    return {**{point.name: point.load() for point in points if point.name not in COME_ALONG}, **COME_ALONG}


def names() -> set[str]:
    """The names of all relations, without loading any."""
    return COME_ALONG.keys() | {point.name for point in entry_points(group="executive.relations")}


def read_relation_kinds(
    declared: Mapping[str, str], parameters: Mapping[str, Sequence[str]], file: Path | None = None
) -> dict[str, RelationKind]:
    """Reads the relation of each predicate.

    Args:
        declared: predicate -> its relation in the domain file.
        parameters: predicate -> the names of its parameters, whose number is checked.
        file: the domain file, for error messages.

    Raises:
        DomainError: a relation is not registered, or takes another number of things than it is given.
    """
    known = relations()
    kinds = {}
    for predicate, text in declared.items():
        key = f"predicates.{predicate}.relation"
        name, bracket, rest = text.partition("(")
        if name not in known:
            raise DomainError(unregistered("relation", name, known), file=file, key=key)
        own = [f"?{each}" for each in parameters.get(predicate, ())]
        words = [word.strip() for word in rest.removesuffix(")").split(",") if word.strip()]
        terms = tuple(own.index(word) if word in own else word for word in words) if bracket else None
        kind = RelationKind(name, known[name], terms)
        has = len(own) if terms is None else len(terms)
        if (predicate in parameters or terms is not None) and kind.count != has:
            raise DomainError(
                f"{name!r} needs {kind.count} object{'s' * (kind.count != 1)}, "
                f"{'this predicate has' if terms is None else 'here are'} {has}",
                file=file,
                key=key,
            )
        kinds[predicate] = kind
    return kinds


def check_kinds(kinds: Mapping[str, RelationKind], task: Task, kind_of: Mapping[str, str], file: Path) -> None:
    """Checks the arguments of relations against the objects of the scene. An argument is right if some object that may
    stand there is of the kind; a predicate of which no atom could ever be true is a mistake.

    Args:
        kind_of: each object of the scene -> "item", "table", "region", "container" or "drawer".

    Raises:
        DomainError: the first mistake; says which order would be right, if one is.
    """
    for predicate, kind in kinds.items():
        key = f"predicates.{predicate}.relation"
        atoms = [atom for atom in task.atoms if atom.predicate == predicate]
        if kind.kinds is None or not atoms:
            continue
        names = task.parameters.get(predicate, [str(index + 1) for index in range(len(atoms[0].args))])
        shown = [f"?{name}" for name in names]
        there = {
            word: {kind_of[atom.args[index]] for atom in atoms if atom.args[index] in kind_of}
            for index, word in enumerate(shown)
        }
        terms = kind.terms if kind.terms is not None else range(len(shown))
        words = [term if isinstance(term, str) else shown[term] for term in terms]
        for word in words:
            if word not in shown:
                if word not in kind_of:
                    raise DomainError(f"the scene has no {word!r}; {nearest(word, kind_of)}", file=file, key=key)
                there[word] = {kind_of[word]}
        right = [order for order in permutations(words) if _fits(order, kind.kinds, there)]
        if tuple(words) in right:
            continue
        wanted = ", ".join(map(_one, kind.kinds))
        given = ", ".join(f"{word} is {' or '.join(map(_one, sorted(there[word])))}" for word in words)
        hint = f'; write relation = "{kind.name}({", ".join(right[0])})"' if right else ""
        raise DomainError(f"{kind.name!r} is about {wanted}, in this order, and {given}{hint}", file=file, key=key)


def _fits(order: Sequence[str], kinds: Sequence[str], there: Mapping[str, set[str]]) -> bool:
    return all(there[word] & ANY_OF.get(kind, {kind}) for word, kind in zip(order, kinds, strict=True))


def _one(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
