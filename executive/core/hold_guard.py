"""The hold guard: asks about the carried item a few times in a transfer, and warns the skill once it seems lost."""

from __future__ import annotations

import logging
from collections.abc import Callable

from executive.errors import ExecutiveError
from executive.protocols import World
from executive.types import Atom, Belief, Guarded, Payload, Phase

_CONFIRM = 0.2
"""World seconds between an answer that the item is gone and the look that has to confirm it."""

CARRYING = "transfer"
"""The phase in which a skill carries something through the air."""

log = logging.getLogger(__name__)


class HoldGuard:
    """Watches one skill at work.

    A single answer that the item is gone ends nothing: an estimator is wrong more often than a grip fails. It is asked
    once more a moment later, and the skill is warned if that answer agrees. What the hand feels is left to the skill.

    Args:
        atom: what is true as long as the item is held.
        looks: how many looks to take in a transfer.
        glance: asks about one atom, now.
        emit: reports each answer.
    """

    def __init__(
        self, atom: Atom, looks: int, world: World, glance: Callable[[Atom], Belief], emit: Callable[[Payload], None]
    ) -> None:
        self._atom, self._looks, self._world, self._glance, self._emit = atom, looks, world, glance, emit
        self._phase, self._doubted, self._lost, self._over = 0, False, False, False

    def on_phase(self, phase: Phase) -> None:
        """A phase begins; looks that were scheduled for the one before are not taken."""
        self._phase += 1
        self._doubted = False
        if phase.name == CARRYING:
            for number in range(1, self._looks + 1):
                self._schedule(phase.seconds * number / (self._looks + 1))

    def lost(self) -> str:
        """Return why the carried item is taken to be lost; empty while it is not."""
        return f"{self._atom} is seen no longer" if self._lost else ""

    def close(self) -> None:
        """The skill is over; looks that are still due are not taken."""
        self._over = True

    def _schedule(self, delay: float) -> None:
        phase = self._phase
        self._world.schedule(delay, lambda: self._look(phase))

    def _look(self, phase: int) -> None:
        if self._over or self._lost or phase != self._phase:
            return
        try:
            belief = self._glance(self._atom)
        except ExecutiveError:  # the set-up is to blame
            raise
        except Exception:  # if it fails again after the skill, the loop can answer for it
            log.warning("the look at %s while it is carried failed", self._atom, exc_info=True)
            return
        held = belief.truth(self._atom)
        self._lost = held is False and self._doubted
        if held is False and not self._doubted:
            self._schedule(_CONFIRM)
        self._doubted = held is False
        self._emit(Guarded(self._atom, held, self._lost, belief.observation_id))
