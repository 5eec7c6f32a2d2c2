"""Does what every run begins with, in the same order, and prints the result: tries the drivers, assembles the run,
renders the cameras' pictures, and has the domain's shipped model answer questions about them.

    python -X faulthandler -m executive.app.first_look

It is a program of its own because native libraries that are incompatible crash the process (see
`executive.app.doctor`)."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from executive.app.run import Run, RunConfig
from executive.core.observer import CameraObserver
from executive.util import requirements


def look() -> str:
    """Return a line about a run's first look. No plan is made and nothing moves, so that nothing has to be compiled;
    the run's folder is a temporary one.

    Raises:
        RuntimeError: the look has no answers.
        Exception: any error of a run that cannot begin.
    """
    requirements.require()
    with tempfile.TemporaryDirectory() as folder:
        config = RunConfig("grocery", problem="one-item", runs=Path(folder), viewer=False)
        with Run(config) as prepared:
            observer, atoms = prepared.executive.observer, prepared.domain.task.atoms
            assert isinstance(observer, CameraObserver)  # the default is to look
            estimator = observer.estimator
            begin = time.perf_counter()
            belief = estimator.estimate(prepared.world.observe(), atoms)
            seconds = time.perf_counter() - begin
    if not belief.probability:
        raise RuntimeError(f"{estimator.name} answers none of {len(atoms)} questions")
    name, count = estimator.name.partition(":")[2], f"{len(belief.probability)} of {len(atoms)}"
    return f"{name} answers {count} questions about a scene's pictures in {seconds:.1f} s"


if __name__ == "__main__":
    print(look())
