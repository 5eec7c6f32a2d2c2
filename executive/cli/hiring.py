"""Who does long work: the options that say so, for every command that has such work."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from executive.errors import InputError, nearest

if TYPE_CHECKING:
    from collections.abc import Callable

    from executive.lab.common.process_pool import Crew, J, V, Work

ENGINES = ("processes", "ray")

Jobs = Annotated[int | None, typer.Option(min=1, help="How many at a time; as many as there are cores if not given.")]
Engine = Annotated[str, typer.Option(help="Who does it: processes of this machine, or ray.")]
Address = Annotated[str | None, typer.Option(help="Of a Ray cluster, for --engine ray.")]


def check(engine: str, address: str | None) -> None:
    """Refuse what makes no sense.

    Raises:
        InputError: there is no such engine, or it has no address.
    """
    if engine not in ENGINES:
        raise InputError(f"no engine {engine!r}; {nearest(engine, ENGINES)}", key="--engine")
    if address is not None and engine != "ray":
        raise InputError("goes with --engine ray", key="--address")


def crew(
    prepare: Callable[[], Work[J, V]], jobs: int | None, engine: str, address: str | None, **chosen: Any
) -> Crew[J, V]:
    """Whoever does the jobs; `chosen` are more settings of `executive.lab.common.process_pool.Processes`.

    Raises:
        MissingError: Ray is not installed.
        ExecutiveError: Ray has no cluster there.
    """
    from executive.lab.common.process_pool import Processes
    from executive.lab.common.ray_pool import OnRay

    if engine == "ray":
        return OnRay(prepare, jobs, address=address)
    return Processes(prepare, jobs, **chosen)
