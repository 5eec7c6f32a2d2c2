"""The options of films."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from executive.app.config import DOMAIN_NAME, HOME_POSE, RENDERER
from executive.app.options import Option, check
from executive.errors import OptionError


@dataclass(frozen=True, slots=True)
class FilmConfig:
    """The options of films of runs.

    Attributes:
        problems: those that are filmed, in turn; without any, the domain's default.
        seed: of the first film; each further one has the next.
        camera: without it, the scene's first.
        run: a recorded run to film, in place of new ones.

    Raises:
        OptionError: a value is not valid, or two options exclude each other.
    """

    domain: Annotated[str, DOMAIN_NAME]
    out: Annotated[Path, Option("The folder for the film, or for the films.", flag="--out")]
    problems: Annotated[
        tuple[str, ...], Option("One of the domain's problems; repeat it to film several in turn.", flag="--problem")
    ] = ()
    seed: Annotated[int, Option("Fixes the scene and every random number; of the first of several.", least=0)] = 0
    films: Annotated[
        int | None, Option("Film so many runs, each with the next seed, in a folder each.", least=1, most=10_000)
    ] = None
    run: Annotated[Path | None, Option("A recorded run, or its name in runs/, to film in place of a new one.")] = None
    fps: Annotated[int, Option("Frames a second.", least=1, most=100)] = 10
    camera: Annotated[str | None, Option("The camera that films; the scene's first if not given.")] = None
    pause: Annotated[
        float, Option("Seconds for which the film lingers where the robot looks between actions.", above=0, most=60)
    ] = 0.5
    faults: Annotated[
        tuple[str, ...], Option("Break something: drop@4, shove:p=0.3 (see: executive faults).", flag="--fault")
    ] = ()
    home_pose: Annotated[bool, HOME_POSE] = True
    grasp_noise: Annotated[float, Option("Standard deviation of the grasp, in m.", least=0, most=1)] = 0.0
    renderer: Annotated[str | None, RENDERER] = None

    def __post_init__(self) -> None:
        check(self)
        if self.pause * self.fps < 1.0:
            raise OptionError(f"at {self.fps} frames a second, that is none: a mid-pose has no frame", option="pause")
        if self.run is not None:
            new = {"films": self.films, "problems": self.problems, "faults": self.faults, "renderer": self.renderer}
            if said := [name for name, value in new.items() if value]:
                raise OptionError("is of new runs, and excludes `run`", option=said[0])
