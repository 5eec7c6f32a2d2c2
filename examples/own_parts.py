"""A skill and a relation of one's own for the simulator that comes along; docs/how-to/own-world.md registers them."""

from __future__ import annotations

from executive import Scene, SkillContext, SkillResult, SkillStatus, Step, takes


@takes("item")
def upright(scene: Scene, item: str) -> bool:
    """upright(item): its own z axis points up, to within 15 degrees."""
    up = scene.items[item].rotation[2, 2]
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
