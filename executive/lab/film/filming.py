"""Films several runs, in a pool of processes, and goes on where it was interrupted."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from executive.app.config import RunConfig
from executive.app.worlds import make_setting
from executive.domain.loader import load_domain
from executive.errors import OptionError
from executive.lab.common.process_pool import ReportProgress, WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.lab.film.config import FilmConfig
from executive.lab.film.record import ABOUT, camera_of, film_run, read_about
from executive.sim.spec import read_scene


class Take(NamedTuple):
    """A run to film: its problem, its seed, and the film's folder."""

    problem: str | None
    seed: int
    folder: Path


class Filming:
    """Several films of new runs.

    Raises:
        DomainError: the domain or a problem has a mistake.
        OptionError: a fault or a camera is none of the domain's, or a folder has another film.
    """

    def __init__(self, config: FilmConfig) -> None:
        self.config, self._cancelled = config, False
        problems = config.problems or (None,)
        for problem in dict.fromkeys(problems):
            domain = load_domain(config.domain, problem)
            make_setting(domain, run_config(config, problem, config.seed))
            camera_of(config.camera, [each.name for each in read_scene(domain.scene).cameras])
        count = config.films or 1
        width = max(3, len(str(count - 1)))
        self.takes = [
            Take(
                problems[number % len(problems)],
                config.seed + number,
                config.out if config.films is None else config.out / f"film-{number:0{width}}",
            )
            for number in range(count)
        ]
        if config.films is None and config.out.exists():
            raise OptionError("is there already; choose another folder", file=config.out, option="out")
        for take in self.takes:
            self._check(take)

    def cancel(self) -> None:
        """Makes `run` stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    @property
    def filmer(self) -> Callable[[], Filmer]:
        """Makes what films a run in a worker process."""
        return partial(Filmer, self.config)

    def run(
        self, pool: WorkerPool[Take, dict[str, Any]], watch: Callable[[Progress], None] = lambda progress: None
    ) -> list[dict[str, Any]] | None:
        """Films what is not filmed yet, and returns what each `film.json` says; None when cancelled.

        Raises:
            ExecutiveError: whatever ended a run before its end.
        """
        missing = [take for take in self.takes if not (take.folder / ABOUT).exists()]
        for take in missing:  # what a killed process left half made
            if take.folder.exists():
                shutil.rmtree(take.folder)
        done, began, waiting = len(self.takes) - len(missing), time.monotonic(), iter(missing)
        watch(Progress(done, len(self.takes), 0, 0.0))
        new = 0
        for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled):
            for each in ended:
                each.value()
                new += 1
            watch(Progress(done + new, len(self.takes), new, time.monotonic() - began))
        if done + new < len(self.takes):
            for take in missing:
                if take.folder.exists() and not (take.folder / ABOUT).exists():
                    shutil.rmtree(take.folder, ignore_errors=True)
            return None
        return [read_about(take.folder) for take in self.takes]

    def _check(self, take: Take) -> None:
        """Check that a film that is there already is the one that is wanted."""
        if not (take.folder / ABOUT).exists():
            return
        about = read_about(take.folder)
        wanted = {"seed": take.seed, "fps": self.config.fps, "faults": list(self.config.faults)}
        if take.problem is not None:
            wanted["problem"] = load_domain(self.config.domain, take.problem).task.problem
        for key, value in wanted.items():
            if about.get(key) != value:
                why = f"has a film already whose {key} is {about.get(key)!r} and not {value!r}; choose another folder"
                raise OptionError(why, file=take.folder, option="out")


class Filmer:
    """Films one run after the other in a worker process."""

    def __init__(self, config: FilmConfig) -> None:
        self._config = config

    def __call__(self, take: Take, tell: ReportProgress) -> dict[str, Any]:
        return film_run(run_config(self._config, take.problem, take.seed), self._config, take.folder, tell)


def run_config(film: FilmConfig, problem: str | None, seed: int) -> RunConfig:
    """Return the options of a run that is filmed: its state is estimated from ground truth."""
    return RunConfig(
        film.domain,
        problem,
        seed,
        "oracle",
        film.faults,
        home_pose=film.home_pose,
        grasp_noise=film.grasp_noise,
        renderer=film.renderer,
    )
