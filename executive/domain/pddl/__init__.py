"""PDDL: two files in, one `Schema` out; what is not understood is refused by name.

Understood is classical PDDL: types, constants, every formula over predicates and equality in preconditions, goals and
the conditions of effects, axioms, and costs of actions. Time, preferences, trajectory constraints, probabilities,
processes and numeric fluents are refused at load with their line, never dropped (scenario 22), so that the executive's
own reading of an action is exact. What no action changes is what `:init` says of it, unless somebody is to look. The
order of sections is free, and case is ignored, as PDDL demands. Who asks about atoms and does not plan reads no more
than the words (`read_vocabulary`), of any domain whatever its actions are like.
"""

from executive.domain.pddl.forms import Fragment
from executive.domain.pddl.formulas import (
    And,
    Axiom,
    Equality,
    Exists,
    Forall,
    Formula,
    LiftedEffect,
    Literal,
    Or,
    conjuncts,
    literals,
    negated,
)
from executive.domain.pddl.grounding import written_out
from executive.domain.pddl.priors import StatedPrior, ground_priors
from executive.domain.pddl.reader import MOST_ATOMS, Stated, read_task, read_vocabulary
from executive.domain.pddl.schema import Action, Said, Schema
from executive.domain.pddl.typing import OBJECT, Typing

__all__ = [
    "MOST_ATOMS",
    "OBJECT",
    "Action",
    "And",
    "Axiom",
    "Equality",
    "Exists",
    "Forall",
    "Formula",
    "Fragment",
    "LiftedEffect",
    "Literal",
    "Or",
    "Said",
    "Schema",
    "Stated",
    "StatedPrior",
    "Typing",
    "conjuncts",
    "ground_priors",
    "literals",
    "negated",
    "read_task",
    "read_vocabulary",
    "written_out",
]
