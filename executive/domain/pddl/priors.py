"""Where things usually are: probabilities of atoms, as a manifest or a file of learned ones states them."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from executive.domain.pddl.forms import Form, Fragment
from executive.domain.pddl.schema import Schema
from executive.errors import nearest
from executive.types import Atom


@dataclass(frozen=True, slots=True, eq=False)
class StatedPrior:
    """An atom, maybe with variables in place of objects, and how probable each such atom is at first."""

    atom: Fragment
    probability: float


def ground_priors(
    stated: Sequence[StatedPrior], schema: Schema, others: Collection[str] = (), *, lenient: bool = False
) -> Mapping[Atom, float]:
    """Return the probability of each atom of a task of which something is stated. What names more objects goes before
    what has variables in their places.

    Args:
        others: objects that the problem at hand lacks and that may be named all the same.
        lenient: whether objects that nobody knows are passed over, too.

    Raises:
        DomainError: by the text's own `fail`, with what is wrong with it.
    """
    fluent, found = frozenset(schema.task.atoms), dict[Atom, tuple[int, float]]()
    for each in stated:
        form, text = each.atom.definition, each.atom
        if not 0.0 <= each.probability <= 1.0:
            text.fail(1, f"expected a probability from 0 to 1, got {each.probability:g}")
        kinds = _kinds(form, text, schema)
        terms = [term.word for term in form.rest]
        missing = [term for term in terms if not term.startswith("?") and term not in schema.typing.objects]
        for term in missing:
            if term not in others and not lenient:
                text.fail(1, f"unknown object {term}; {nearest(term, [*schema.typing.objects, *others])}")
        if missing:
            continue
        named = sum(not term.startswith("?") for term in terms)
        for args in _instances(terms, kinds, schema):
            atom = Atom(form.head, args)
            if atom not in fluent:
                continue
            if atom in found and found[atom][0] == named and found[atom][1] != each.probability:
                text.fail(1, f"{atom} has two probabilities, {found[atom][1]:g} and {each.probability:g}")
            if atom not in found or found[atom][0] <= named:
                found[atom] = named, each.probability
    return {atom: probability for atom, (_, probability) in sorted(found.items())}


def _kinds(form: Form, text: Fragment, schema: Schema) -> tuple[str, ...]:
    name = form.head
    if form.items is None or any(part.items is not None for part in form.items):
        text.fail(1, f"{form} is no atom such as (at ?thing shelf)")
    if name not in schema.predicates:
        text.fail(1, f"unknown predicate in {form}; {nearest(name, schema.predicates)}")
    if name in schema.static | schema.derived:
        text.fail(1, f"{name} never changes, or is computed: nobody has to find it out")
    kinds = schema.predicates[name]
    if len(kinds) != len(form.rest):
        text.fail(1, f"{form} does not fit the declared ({' '.join((name, *kinds))})")
    return kinds


def _instances(terms: Sequence[str], kinds: Sequence[str], schema: Schema) -> list[tuple[str, ...]]:
    """The tuples of objects that the terms stand for: the same variable stands for the same object."""
    variables = {term: kind for term, kind in zip(terms, kinds, strict=True) if term.startswith("?")}
    found = []
    for objects in itertools.product(*(schema.typing.members(kind) for kind in variables.values())):
        bound = dict(zip(variables, objects, strict=True))
        found.append(tuple(bound.get(term, term) for term in terms))
    return found
