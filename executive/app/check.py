"""Says what a domain and its problem have, once they are read: how much there is to ask, to plan with, and to know."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod

from executive.app.monitors import check_invariants
from executive.domain.loader import Domain, load_domain
from executive.errors import DomainError
from executive.planning.mutex_groups import find_mutexes


@dataclass(frozen=True, slots=True)
class Report:
    """What a domain and one of its problems have.

    Attributes:
        features: what of PDDL they use.
        objects: how many there are of each type.
        fluents: the atoms that some action may change, which are estimated.
        statics: the atoms that none changes; `true_statics` of them are true.
        actions: the grounded actions that can become possible; None where that was not found out in time.
        groups: the mutex groups.
        seconds: the wall time that it took.
        unreachable: why no state can reach the goal, where that is plain from what never changes.
    """

    domain: str
    problem: str
    features: tuple[str, ...]
    objects: Mapping[str, int]
    fluents: int
    statics: int
    true_statics: int
    actions: int | None
    groups: int
    seconds: float
    unreachable: str | None = None


def check(where: str, problem: str | None = None, seconds: float = 30.0) -> Report:
    """Read a domain's folder, or a PDDL file with its problem, and count what is in it.

    Args:
        seconds: the wall time that grounding may take.

    Raises:
        DomainError: it is refused.
        MissingError: Fast Downward's translator is not installed.
    """
    began = time.monotonic()
    domain = load_domain(where, problem)
    if domain.scene_file is not None:
        from executive.app.worlds import checked_stage

        checked_stage(domain)
    mutexes = find_mutexes(domain.parsed, timeout=seconds, leaves_open=domain.leaves_open)
    check_invariants(domain, mutexes.groups)
    task, schema = domain.task, domain.parsed
    return Report(
        domain=task.name,
        problem=task.problem,
        features=tuple(sorted(schema.features)),
        objects=dict(sorted(Counter(task.objects.values()).items())),
        fluents=len(task.atoms),
        statics=_statics(domain),
        true_statics=len(task.static),
        actions=mutexes.actions,
        groups=len(mutexes.groups),
        seconds=time.monotonic() - began,
        unreachable=None if schema.unreachable is None else "line {}: {}".format(*schema.unreachable),
    )


def _statics(domain: Domain) -> int:
    """Count the grounded atoms of the static predicates."""
    schema = domain.parsed
    size = {kind: len(schema.typing.members(kind)) for kinds in schema.predicates.values() for kind in kinds}
    return sum(prod(size[kind] for kind in schema.predicates[name]) for name in schema.static)


def line_of(error: DomainError) -> int | None:
    """Return the line that an error is about, where it names one."""
    found = re.match(r"line (\d+)", error.key or "")
    return None if found is None else int(found[1])
