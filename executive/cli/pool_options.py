"""The options of every command that runs jobs in a process pool or on Ray."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from executive.app.options import Option, check
from executive.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Callable

    from executive.lab.common.process_pool import J, V, Work, WorkerPool

ENGINES = MappingProxyType({"processes": "of this machine", "ray": "on a Ray cluster"})

Jobs = Annotated[int | None, typer.Option(min=1, help="How many at a time; as many as there are cores if not given.")]


@dataclass(frozen=True, slots=True)
class PoolConfig:
    """What runs the jobs.

    Raises:
        OptionError: there is no such engine, or it has no address.
    """

    engine: Annotated[str, Option("What runs the jobs: processes of this machine, or ray.", choices=ENGINES)] = (
        "processes"
    )
    address: Annotated[str | None, Option("Of a Ray cluster, for --engine ray.")] = None

    def __post_init__(self) -> None:
        check(self)
        if self.address is not None and self.engine != "ray":
            raise OptionError("goes with `engine` ray", option="address")

    def open(self, prepare: Callable[[], Work[J, V]], jobs: int | None, **chosen: Any) -> WorkerPool[J, V]:
        """The pool that runs the jobs; `chosen` are more arguments of `executive.lab.common.process_pool.ProcessPool`.

        Raises:
            MissingError: Ray is not installed.
            ExecutiveError: Ray has no cluster there.
        """
        from executive.lab.common.process_pool import ProcessPool
        from executive.lab.common.ray_pool import RayPool

        if self.engine == "ray":
            return RayPool(prepare, jobs, address=self.address)
        return ProcessPool(prepare, jobs, **chosen)
