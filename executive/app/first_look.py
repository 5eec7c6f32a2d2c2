"""Does what every run begins with, in its order, and prints what came of it: the drivers are tried, everything is put
together, the cameras' pictures are drawn, and the model that comes with the domain looks at them.

    python -X faulthandler -m executive.app.first_look

A program of its own, because libraries of machine code that do not get along end the process (see
`executive.app.doctor`)."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from executive.app.run import Run, RunConfig
from executive.util import requirements


def look() -> str:
    """What a run's first look comes to. No plan is made and nothing moves, so that nothing has to be compiled for it;
    the run's folder is a temporary one.

    Raises:
        RuntimeError: it has no answer to anything.
        Exception: whatever a run raises that cannot begin.
    """
    requirements.require()
    with tempfile.TemporaryDirectory() as folder:
        config = RunConfig("grocery", problem="one-item", runs=Path(folder), viewer=False)
        with Run(config) as prepared:
            eye, atoms = prepared.executive.estimator, prepared.domain.task.atoms
            assert eye is not None  # the default is to look
            begin = time.perf_counter()
            belief = eye.estimate(prepared.world.observe(), atoms)
            seconds = time.perf_counter() - begin
    if not belief.probability:
        raise RuntimeError(f"{eye.name} answers none of {len(atoms)} questions")
    name, told = eye.name.partition(":")[2], f"{len(belief.probability)} of {len(atoms)} questions"
    return f"{name} answers {told} about a scene's pictures in {seconds:.1f} s"


if __name__ == "__main__":
    print(look())
