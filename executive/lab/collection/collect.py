"""Data collection (the paper's Appendix D): which episodes are played, by how many processes, and what is kept.

A collection is its first episodes, as many as it takes for the points that were asked for; the last one is cut. An
episode depends on the seed and its own number alone, so it does not matter which process plays it, nor when: a
collection that was killed resumes with the episodes that are missing, and one may be extended to more points.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from types import TracebackType
from typing import Any, NamedTuple

from executive.app.worlds import checked_stage
from executive.domain.loader import Domain, load_domain
from executive.errors import ExecutiveError, InputError
from executive.lab.collection import data_card, dataset
from executive.lab.collection.dataset import Log
from executive.lab.collection.episode import MOST_FAILURES, Collector
from executive.lab.common.folder_lock import lock, remove_partial
from executive.lab.common.process_pool import ProcessPool, ReportProgress, WorkerLostError, WorkerPool, run_jobs
from executive.lab.common.progress import Progress
from executive.lab.config import CollectConfig, read_range
from executive.lab.problems import ProblemMaker
from executive.sim.initial_state import InitialState
from executive.sim.spec import read_scene

FRUITLESS = 10
"""Episodes without a single point after which a collection is given up."""

DECIDING = ("executive", "daqp", "mink", "mujoco", "numpy", "ompl", "pillow", "robosuite", "scipy", "toppra")
"""Packages that the data may differ with, so that a collection is not continued with another version of one."""


_ON_REQUEST = ("renderer", "masks", "objects", "subset", "demonstrations")


class Task(NamedTuple):
    """An episode to play, and the number of points after which it is cut."""

    episode: int
    most: int


class Played(NamedTuple):
    """The log of a finished episode, and the content of its file."""

    log: Log
    shard: bytes


class Collection:
    """One collection, its folder checked and what is there already read. A context manager that holds the folder.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the folder holds something else, or another process collects in it.
    """

    def __init__(self, config: CollectConfig, warn: Callable[[str], None] = lambda line: None) -> None:
        self.config = config
        self.domain = load_domain(config.domain, config.problem)
        checked_stage(self.domain)
        problem_maker(config)
        self._what = _described(config, self.domain)
        self._digest = dataset.digest(self._what)
        self._cancelled = False
        self._cameras = {camera.name: [camera.width, camera.height] for camera in read_scene(self.domain.scene).cameras}
        self._check_folder()
        self._lock = lock(config.out, "collecting", config.command)
        try:
            remove_partial(config.out, config.out / dataset.SHARDS)
            self._logs = self._read_logs(warn)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Collection:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Releases the lock of the folder."""
        self._lock.release()

    @property
    def player(self) -> Callable[[], Player]:
        """Makes the `Player` of this collection in a worker process."""
        return partial(Player, self.config, self._digest, tuple(self._cameras))

    def cancel(self) -> None:
        """Makes `run` stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    def run(
        self,
        watch: Callable[[Progress], None] = lambda progress: None,
        make_pool: Callable[[], WorkerPool[Task, Played]] | None = None,
    ) -> dict[str, Any] | None:
        """Collects the missing points, writes the data card, and returns the manifest; None when cancelled.

        Args:
            watch: called a few times a second.
            make_pool: makes the pool that plays missing episodes. Without it processes are spawned, so that a script
                that calls this has to guard its entry point with `if __name__ == "__main__"` (multiprocessing).
        """
        if self._lacking():
            self._write_manifest(finished=False)
            self._drop_cut()
            pool = ProcessPool[Task, Played](self.player, self.config.jobs) if make_pool is None else make_pool()
            with pool as players:
                self._collect(players, watch)
            if self._cancelled:
                return None
            self._cut()
        logs = [self._logs[number] for number in sorted(self._logs)]
        manifest = self._write_manifest(finished=False, statistics=data_card.statistics(self.config.out, logs))
        text = data_card.render(manifest)
        dataset.write_atomically(self.config.out / dataset.CARD, text.encode())
        return self._write_manifest(finished=True, statistics=manifest["statistics"])

    # Which episodes.

    def _lacking(self) -> bool:
        """Whether episodes are missing: a complete collection has its first episodes, and exactly the requested
        points."""
        numbers = sorted(self._logs)
        points = sum(log.points for log in self._logs.values())
        whole = all(self._logs[number].ending is not dataset.Ending.CUT for number in numbers[:-1])
        return not (numbers == list(range(len(numbers))) and whole and points == self.config.points)

    def _drop_cut(self) -> None:
        """Drops the episode that was cut short: it is played again up to the number of points that is requested now."""
        for number in [number for number, log in self._logs.items() if log.ending is dataset.Ending.CUT]:
            del self._logs[number]

    def _next(self, busy: AbstractSet[int]) -> Task | None:
        """The first missing episode, if points would be lacking even with full episodes before it, and how many of its
        points are needed.

        So no episode is played in vain, and the set of episodes does not depend on the speed of the workers.
        """
        full, before, number = self.config.per_episode, 0, 0
        while number in self._logs or number in busy:
            before += self._logs[number].points if number in self._logs else full
            number += 1
        left = self.config.points - before
        certain = not any(other < number for other in busy)  # else episodes before it may turn out to be short
        return Task(number, min(left, full) if certain else full) if left > 0 else None

    def _cut(self) -> None:
        """Removes the points beyond the requested number."""
        left = self.config.points
        for number in sorted(self._logs):
            if self._logs[number].points > left:
                self._logs[number] = dataset.cut_shard(self.config.out, self._digest, self._logs[number], left)
            left -= self._logs[number].points

    # The work.

    def _collect(self, pool: WorkerPool[Task, Played], watch: Callable[[Progress], None]) -> None:
        kept, began = sum(log.points for log in self._logs.values()), time.monotonic()
        playing: set[int] = set()

        def next_task() -> Task | None:
            task = self._next(playing)
            if task is not None:
                playing.add(task.episode)
            return task

        made = 0
        for results in run_jobs(pool, next_task, lambda: self._cancelled):
            for each in results:
                playing.remove(each.job.episode)
                try:
                    self._keep(each.value())
                except WorkerLostError as error:
                    raise ExecutiveError(
                        f"episode {each.job.episode}: {error}; resume with: {self.config.command}"
                    ) from None
                made += self._logs[each.job.episode].points
            self._give_up_if_fruitless()
            new = round(made + pool.running_progress)
            watch(Progress(min(kept + new, self.config.points), self.config.points, new, time.monotonic() - began))

    def _keep(self, played: Played) -> None:
        try:
            dataset.write_atomically(dataset.shard(self.config.out, played.log.episode), played.shard)
        except OSError as error:
            raise InputError(f"cannot be written to ({error.strerror})", file=self.config.out) from None
        self._logs[played.log.episode] = played.log

    def _give_up_if_fruitless(self) -> None:
        if len(self._logs) >= FRUITLESS and not any(log.points for log in self._logs.values()):
            attempts = [attempt for log in self._logs.values() for attempt in log.attempts]
            last = (
                f"{attempts[-1].action}: {attempts[-1].status} ({attempts[-1].reason})" if attempts else "none applies"
            )
            raise InputError(
                f"no action was completed in {len(self._logs)} episodes; the last one: {last}", file=self.domain.folder
            )

    # The folder.

    def _check_folder(self) -> None:
        out = self.config.out
        if os.path.exists(out) and not out.is_dir():
            raise InputError("is not a folder", file=out)
        if not os.path.exists(out) or all(entry.name.startswith(".") for entry in out.iterdir()):
            return
        if not (out / dataset.MANIFEST).exists():
            raise InputError(
                f"is not empty and holds no collection (no {dataset.MANIFEST}); choose another folder with --out",
                file=out,
            )
        manifest = dataset.read_manifest(out)
        difference = _difference(manifest["collection"], self._what)
        if difference is not None:
            raise InputError(f"holds another collection ({difference}); choose another folder with --out", file=out)
        if manifest["points"] > self.config.points:
            raise InputError(
                f"holds a collection of {manifest['points']} points, which can be extended but not made smaller; "
                "choose another folder with --out",
                file=out,
            )

    def _read_logs(self, warn: Callable[[str], None]) -> dict[int, Log]:
        """Reads the episodes that are there. A damaged one is left out, with a warning."""
        folder, logs = self.config.out / dataset.SHARDS, {}
        if not (self.config.out / dataset.MANIFEST).exists():
            self._write_manifest(finished=False)
        folder.mkdir(exist_ok=True)
        for path in sorted(folder.iterdir()):
            number = path.stem.removeprefix("episode-")
            if not number.isdecimal() or path != dataset.shard(self.config.out, int(number)):
                raise InputError("is not a file of a collection; remove it", file=path)
            try:
                logs[int(number)] = dataset.read_log(self.config.out, self._digest, int(number))
            except InputError as error:
                warn(f"{error}; it is collected again")
        return logs

    def _write_manifest(self, finished: bool, statistics: Mapping[str, Any] | None = None) -> dict[str, Any]:
        manifest = {
            "format": dataset.FORMAT,
            "command": self.config.command,
            "collection": self._what,
            "points": self.config.points,
            "finished": finished,
            "cameras": self._cameras,
            "atoms": [] if self.config.objects else [str(atom) for atom in self.domain.task.atoms],
            "statistics": statistics,
        }
        text = json.dumps(manifest, indent=2) + "\n"
        dataset.write_atomically(self.config.out / dataset.MANIFEST, text.encode())
        return manifest


class Player:
    """Plays the episodes of a collection; each worker process makes its own.

    Args:
        digest: of the description of the collection; it is written to each file.
    """

    def __init__(self, config: CollectConfig, digest: str, cameras: Sequence[str]) -> None:
        self._config, self._digest, self._cameras = config, digest, cameras
        self._maker = problem_maker(config)
        domain = load_domain(config.domain, config.problem)
        self._collector = None if self._maker is not None else self._collect(domain)

    def __call__(self, task: Task, tell: ReportProgress) -> Played:
        collector = self._collector or self._with_others(task.episode)
        log, points = collector.play(*task, tell)
        domain, varying, masks = collector.domain, self._maker is not None, self._config.masks
        objects = _objects(domain) if varying or masks else None
        atoms = domain.task.atoms
        shard = dataset.shard_bytes(
            self._digest, log, points, atoms, self._cameras, objects, masks, varying, self._config.demonstrations
        )
        return Played(log, shard)

    def _collect(self, domain: Domain, start: InitialState | None = None) -> Collector:
        config = self._config
        return Collector(
            domain,
            config.seed,
            config.home_pose,
            config.grasp_noise,
            config.slips,
            config.per_episode,
            config.renderer,
            config.masks,
            start,
            config.demonstrations,
        )

    def _with_others(self, episode: int) -> Collector:
        """What collects an episode that has objects of its own, and starts as its problem declares."""
        assert self._maker is not None
        with self._maker.domain(episode + 1) as domain:
            return self._collect(domain, checked_stage(domain))


def problem_maker(config: CollectConfig) -> ProblemMaker | None:
    """What makes the problems of a collection with other objects in each episode, whose numbers count from 1."""
    if config.objects is None:
        return None
    return ProblemMaker(config.domain, *read_range(config.objects), config.seed, config.subset, config.combinations)


def _objects(domain: Domain) -> dict[str, tuple[str, ...]]:
    """The items of a problem in the scene's order, each with the values of its attributes."""
    items = read_scene(domain.scene).restricted_to(domain.task.objects, domain.scene).items
    return {item.name: tuple(item.attributes.values()) for item in items}


# Inside.


def _described(config: CollectConfig, domain: Domain) -> dict[str, Any]:
    """Everything that decides what the points are, but how many."""
    return {
        "domain": domain.name,
        "problem": domain.task.problem,
        "files": domain.fingerprint(),
        "seed": config.seed,
        "home_pose": config.home_pose,
        "grasp_noise": config.grasp_noise,
        "slips": config.slips,
        "points_per_episode": config.per_episode,
        "failures_in_a_row": MOST_FAILURES,
        "jpeg_quality": dataset.JPEG_QUALITY,
        "versions": {name: version_of(name) for name in DECIDING},
        # Not where they are not asked for, so that collections from before are continued.
        **{name: value for name in _ON_REQUEST if (value := getattr(config, name))},
        **({"combinations": config.combinations} if config.combinations != "all" else {}),
    }


def version_of(name: str) -> str:
    """The version of an installed package."""
    from executive import __version__

    try:
        return __version__ if name == "executive" else version(name)
    except PackageNotFoundError:
        return "unknown"


def _difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """The first thing in which two descriptions differ, in words."""
    for key, value in here.items():
        other = there.get(key)
        if value == other:
            continue
        if isinstance(value, Mapping) and isinstance(other, Mapping):
            return _difference(other, value)
        if key == "files":
            return "the domain's files were others"
        return f"{key.replace('_', ' ')} is {other} there and {value} here"
    return None
