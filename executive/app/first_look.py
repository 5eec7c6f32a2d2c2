"""Does what every run begins with, in its order, and prints what came of it: the scene is set, its cameras' pictures
are drawn, and the model that comes with the domain looks at them. No action is taken, and nothing is left behind.

    python -X faulthandler -m executive.app.first_look

A program of its own, because libraries of machine code that do not get along end the process (see
`executive.app.doctor`)."""

from __future__ import annotations

import tempfile
from pathlib import Path

from executive.app.run import RunConfig, run
from executive.types import Belief, Event


class _Beliefs:
    """A sink that keeps what the looks came to."""

    def __init__(self) -> None:
        self.seen: list[Belief] = []

    def write(self, event: Event) -> None:
        if isinstance(event.payload, Belief):
            self.seen.append(event.payload)

    def close(self) -> None: ...


def look() -> str:
    """What the first look of a run came to.

    Raises:
        RuntimeError: it came to nothing.
        Exception: whatever a run raises that cannot begin.
    """
    beliefs = _Beliefs()
    with tempfile.TemporaryDirectory() as folder:
        config = RunConfig("grocery", problem="one-item", max_actions=0, max_looks=1, runs=Path(folder), viewer=False)
        summary = run(config, [beliefs])
    answered = sum(len(belief.probability) for belief in beliefs.seen)
    if not answered:
        raise RuntimeError(f"a look has no answer to anything ({summary['outcome']})")
    model, seconds = summary["estimator"].partition(":")[2], summary["wall_seconds"]
    took = seconds["observe"] + seconds["estimate"]
    return f"{model} answers {answered} questions about pictures of the grocery scene in {took:.1f} s"


if __name__ == "__main__":
    print(look())
