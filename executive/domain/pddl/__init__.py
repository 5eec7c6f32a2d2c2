"""PDDL: two files in, one `Schema` out; what is not understood is refused by name.

Understood are types, constants and predicates; actions whose conditions are conjunctions of literals (negative ones
too), `=` and `forall`; goals of the same kind without `=`. Whatever else PDDL knows (disjunctions, conditional effects,
numbers, time) is refused at load with its line, never dropped (scenario 22), so that the executive's own reading of
an action is exact. What no action changes is what `:init` says of it, unless somebody is to look. The order of
sections is free, and case is ignored, as PDDL demands. Who asks about atoms and does not plan reads no more than the
words (`read_vocabulary`), of any domain whatever its actions are like.
"""

from executive.domain.pddl.reader import MOST_ATOMS, read_task, read_vocabulary
from executive.domain.pddl.schema import Action, Condition, Equality, Forall, Literal, Said, Schema, Typing

__all__ = [
    "MOST_ATOMS",
    "Action",
    "Condition",
    "Equality",
    "Forall",
    "Literal",
    "Said",
    "Schema",
    "Typing",
    "read_task",
    "read_vocabulary",
]
