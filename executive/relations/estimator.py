"""An estimator that answers by relations: for a world of one's own, by functions in a dict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from executive.types import Atom, Belief, Facts, Observation


class RelationEstimator:
    """An estimator that answers each atom by a relation, with certainty. A predicate without one is unanswered.

    On what a simulator knows it is an oracle, and `of` is the ground truth to score by; on what was perceived it is a
    witness.

    Args:
        scene: returns what the relations are asked of, as it is now: whatever they take as their first argument.
        relations: predicate -> a function of that and of the atom's arguments.
    """

    def __init__(
        self, scene: Callable[[], Any], relations: Mapping[str, Callable[..., bool]], name: str = "oracle"
    ) -> None:
        self._scene, self._relations, self.name = scene, dict(relations), name

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        """Return the belief at this moment, which is the observation's when this is called right after it."""
        facts = self.of([atom for atom in atoms if atom.predicate in self._relations])
        unanswered = frozenset(atoms) - facts.keys()
        return Belief(observation.id, {atom: float(facts[atom]) for atom in facts}, unanswered, self.name)

    def of(self, atoms: Sequence[Atom]) -> Facts:
        """The truth of each atom now.

        Raises:
            KeyError: there is no relation for a predicate.
        """
        scene = self._scene()
        return Facts({atom: bool(self._relations[atom.predicate](scene, *atom.args)) for atom in atoms})
