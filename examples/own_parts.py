"""A skill and a relation of one's own for the simulator that comes along; docs/own-world.md registers them."""

from __future__ import annotations

from executive.protocols import SkillContext
from executive.sim.relations import State, takes
from executive.types import SkillResult, SkillStatus, Step


@takes("item")
def upright(state: State, item: str) -> bool:
    """upright(item): its own z axis points up, to within 15 degrees."""
    up = state.data.body(item).xmat[8]
    return bool(up > 0.966)


def wait(step: Step, context: SkillContext) -> SkillResult:
    """wait(): stand still for two seconds."""
    body = context.handle.body
    start = body.time
    while body.time < start + 2.0:
        if context.cancelled():
            return SkillResult(step, SkillStatus.CANCELLED, seconds=body.time - start)
        body.advance()
    return SkillResult(step, SkillStatus.DONE, seconds=body.time - start, planned_seconds=2.0)
