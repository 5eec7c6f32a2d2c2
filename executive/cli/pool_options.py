"""The options of every command that runs jobs in a process pool or on Ray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from executive.errors import InputError, nearest

if TYPE_CHECKING:
    from collections.abc import Callable

    from executive.lab.common.process_pool import J, V, Work, WorkerPool

ENGINES = ("processes", "ray")

Jobs = Annotated[int | None, typer.Option(min=1, help="How many at a time; as many as there are cores if not given.")]
Engine = Annotated[str, typer.Option(help="What runs the jobs: processes of this machine, or ray.")]
Address = Annotated[str | None, typer.Option(help="Of a Ray cluster, for --engine ray.")]


def check(engine: str, address: str | None) -> None:
    """Checks the two options against each other.

    Raises:
        InputError: there is no such engine, or it has no address.
    """
    if engine not in ENGINES:
        raise InputError(f"no engine {engine!r}; {nearest(engine, ENGINES)}", key="--engine")
    if address is not None and engine != "ray":
        raise InputError("goes with --engine ray", key="--address")


def make_pool(
    prepare: Callable[[], Work[J, V]], jobs: int | None, engine: str, address: str | None, **chosen: Any
) -> WorkerPool[J, V]:
    """The pool that runs the jobs; `chosen` are more arguments of `executive.lab.common.process_pool.ProcessPool`.

    Raises:
        MissingError: Ray is not installed.
        ExecutiveError: Ray has no cluster there.
    """
    from executive.lab.common.process_pool import ProcessPool
    from executive.lab.common.ray_pool import RayPool

    if engine == "ray":
        return RayPool(prepare, jobs, address=address)
    return ProcessPool(prepare, jobs, **chosen)
