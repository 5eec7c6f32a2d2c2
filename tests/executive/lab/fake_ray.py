"""As much of Ray as a pool needs, in this process: what an actor is asked is done when somebody waits for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Died(BaseException):
    """An actor that is killed from outside, as a player raises it."""


class RayActorError(Exception):
    """What Ray raises then."""


class Reference:
    def __init__(self, actor: Actor, call: Callable[[], Any]) -> None:
        self.actor, self.call = actor, call


class Method:
    def __init__(self, actor: Actor, name: str) -> None:
        self.actor, self.name = actor, name

    def remote(self, *arguments: Any) -> Reference:
        return Reference(self.actor, lambda: getattr(self.actor.made, self.name)(*arguments))


class Actor:
    def __init__(self, made: Any) -> None:
        self.made, self.dead = made, False

    def __getattr__(self, name: str) -> Method:
        return Method(self, name)


class Remote:
    def __init__(self, ray: FakeRay, kind: type) -> None:
        self.ray, self.kind = ray, kind

    def remote(self, *arguments: Any) -> Actor:
        self.ray.actors.append(Actor(self.kind(*arguments)))
        return self.ray.actors[-1]


class FakeRay:
    """The module. `hangs` says of an actor's call whether it never comes to an end."""

    def __init__(self, cores: int = 2) -> None:
        self.cores, self.actors, self.started = cores, list[Actor](), list[dict[str, Any]]()
        self.down = 0
        self.hangs: Callable[[Reference], bool] = lambda reference: False

    def init(self, **options: Any) -> None:
        if options.get("address") == "nowhere":
            raise ConnectionError("could not find any running Ray instance\nat nowhere")
        self.started.append(options)

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": float(self.cores)}

    def remote(self, **options: Any) -> Callable[[type], Remote]:
        assert options == {"num_cpus": 1, "max_restarts": 0}
        return lambda kind: Remote(self, kind)

    def wait(self, references: list[Reference], num_returns: int, timeout: float) -> tuple[list[Any], list[Any]]:
        ready = [each for each in references if not self.hangs(each)][-num_returns:]
        return ready, [each for each in references if each not in ready]

    def get(self, reference: Reference) -> Any:
        assert not reference.actor.dead
        try:
            return reference.call()
        except Died:
            raise RayActorError("the actor died unexpectedly") from None

    def kill(self, actor: Actor) -> None:
        actor.dead = True

    def shutdown(self) -> None:
        self.down += 1
