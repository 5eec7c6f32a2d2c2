"""What the last look showed: through which cameras, which atoms it changed, and what was made of its answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from executive.types import (
    Atom,
    Belief,
    Blinded,
    Contradiction,
    Event,
    Judged,
    Looked,
    LookKind,
    Observation,
    Overruled,
    Remembered,
)


@dataclass(frozen=True, slots=True)
class Change:
    """An atom that a look takes for something else than was known before (None: it cannot be told)."""

    atom: Atom
    before: bool | None
    now: bool | None
    probability: float | None


@dataclass(frozen=True, slots=True)
class LookLine:
    """One look. `cameras` are those that took part; of `atoms` atoms it asked about `questions`; `answers` are what it
    was told, `unanswered` what it was not, with the estimator's `errors`, and `blinded` the cameras that were left out,
    each with the reason."""

    id: int
    cause: str = ""
    kind: LookKind | None = None
    cameras: tuple[str, ...] = ()
    questions: int = 0
    atoms: int = 0
    answers: Mapping[Atom, float] = field(default_factory=dict)
    unanswered: frozenset[Atom] = frozenset()
    errors: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    overruled: tuple[Overruled, ...] = ()
    blinded: Mapping[str, str] = field(default_factory=dict)


class Looks:
    """Folds events into the last look. What a guard's glance shows changes nothing that is known: it asks about what is
    carried and tells the skill."""

    def __init__(self) -> None:
        self.last: LookLine | None = None
        self.glance: LookLine | None = None
        self.seen_in: dict[str, int] = {}
        """The last look, glances among them, that each camera took part in."""
        self.blinded: Mapping[str, str] = {}
        self.remembered: Mapping[Atom, Remembered] = {}
        self.probability: Mapping[Atom, float] = {}
        """What is made of each atom, whether the last look told it or not."""
        self.observations = 0
        """The number of the observation that comes next."""
        self._open = LookLine(-1)
        self._previous: LookLine | None = None
        self._truth: dict[Atom, bool] = {}
        self._before: dict[Atom, bool] = {}

    @property
    def latest(self) -> LookLine:
        """The look that was taken last, a glance or not, as far as it is known."""
        return self._open

    def tell(self, event: Event) -> None:
        """Take in the next event, whatever it is."""
        match event.payload:
            case Observation(id=number, cause=cause, images=images):
                self._begin(LookLine(number, cause, cameras=tuple(images)))
                self.observations = max(self.observations, number + 1)
                self.blinded = {camera: why for camera, why in self.blinded.items() if camera not in images}
            case Blinded(camera=camera, reason=reason):
                self._open = replace(self._open, blinded={**self._open.blinded, camera: reason})
                self.blinded = {**self.blinded, camera: reason}
            case Belief() as belief:
                self._take(belief)
            case Looked() as looked:
                self._account(looked)
            case Judged() as judged:
                self._judge(judged)

    def _begin(self, line: LookLine) -> None:
        self._open, self._previous, self._before = line, self.last, dict(self._truth)

    def _take(self, belief: Belief) -> None:
        """Without a judgement to follow, an answer is what it says; a judgement takes its place."""
        if belief.observation_id != self._open.id:  # told, not seen
            self._begin(LookLine(belief.observation_id))
        now: dict[Atom, bool | None] = {atom: belief.truth(atom) for atom in belief.probability}
        now |= dict.fromkeys(belief.unanswered)
        errors = (answer.error for answers in belief.evidence.values() for answer in answers if answer.error)
        self._open = replace(
            self._open,
            answers=belief.probability,
            unanswered=belief.unanswered,
            errors=tuple(dict.fromkeys(errors)),
            questions=len(now),
        )
        self.probability = {**self.probability, **belief.probability}
        self._learn(now, belief.probability)

    def _account(self, looked: Looked) -> None:
        line = replace(
            self._open, kind=looked.kind, cameras=looked.cameras, questions=looked.questions, atoms=looked.atoms
        )
        self.seen_in |= dict.fromkeys(looked.cameras, looked.observation_id)
        if looked.kind is LookKind.GUARD:
            self._open = self.glance = replace(line, changes=())
            self._truth, self.last = dict(self._before), self._previous
        else:
            self._open = self.last = line

    def _judge(self, judged: Judged) -> None:
        self.remembered, self.probability = judged.remembered, judged.probability
        self._open = replace(self._open, contradictions=judged.contradictions, overruled=judged.overruled)
        self._truth = {atom: kept.value for atom, kept in judged.remembered.items()}
        self._learn(dict(judged.seen), judged.probability)

    def _learn(self, now: Mapping[Atom, bool | None], probability: Mapping[Atom, float]) -> None:
        changes = [
            Change(atom, self._before.get(atom), value, probability.get(atom))
            for atom, value in sorted(now.items())
            if atom in self._before and value is not self._before[atom]
        ]
        self._truth |= {atom: value for atom, value in now.items() if value is not None}
        # What came true is the news; what is no longer so follows from it.
        changes.sort(key=lambda change: (change.now is not True, change.atom))
        self._open = replace(self._open, changes=tuple(changes))
        self.last = self._open
