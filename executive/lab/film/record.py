"""Films of runs: the video of one camera, and the truth of each frame beside it.

A film's folder has `film.mp4`, `frames.parquet` (`executive.lab.film.frames`), the record of a run that was made for it
in `run/`, and, once all of that is there, `film.json`: what was filmed, and how it went.
"""

from __future__ import annotations

import json
import os
import shutil
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from executive.app.config import RunConfig, read_config
from executive.app.redrawn import Redrawn
from executive.errors import InputError, OptionError, nearest
from executive.lab.collection.collect import version_of
from executive.lab.film import timeline
from executive.lab.film.config import FilmConfig
from executive.lab.film.frames import Frames, write_frames
from executive.trace.record.frames import FRAMES_FILE
from executive.trace.record.recording import Recording
from executive.types import Atom, Event, Facts, Frame, Image, Observation
from executive.util.atomic_write import write_atomic
from executive.util.files import read_json, reason
from executive.util.video_file import video_writer

if TYPE_CHECKING:
    from executive.app.run import Run
    from executive.sim.world import MujocoWorld

VIDEO, TRUTH, ABOUT, RUN = "film.mp4", "frames.parquet", "film.json", "run"

ROUNDED = 1e-3
"""m within which the poses of a recorded run touch: each coordinate may be a fifth of a millimetre off."""

_KEYFRAMES = 50

Tell = Callable[[float], None]


class Shot(NamedTuple):
    """A moment of a run: the world's clock in s, where everything was, and what was true."""

    time: float
    frame: Frame
    truth: Facts


class _Recorder:
    """A sink that keeps each moment of a run with its truth: of what moves, and whenever the robot looks."""

    def __init__(self, fps: int) -> None:
        self._fps = fps
        self.shots: list[Shot] = []
        self._world: MujocoWorld | None = None

    def begin(self, run: Run) -> None:
        """Watch this run's world from now on."""
        from executive.sim.truth import Truth

        domain = run.domain
        self._world, self._atoms = run.world, domain.task.atoms
        self._truth = Truth(run.world, domain.relations, domain.task.parameters, domain.files[0])
        self._world.frame_period = min(self._world.frame_period, 1.0 / self._fps)

    def write(self, event: Event) -> None:
        if self._world is None or not isinstance(event.payload, Frame | Observation):
            return
        frame = event.payload if isinstance(event.payload, Frame) else self._world.frame()
        self.shots.append(Shot(event.time, frame, self._truth.watched(self._atoms)))

    def close(self) -> None:
        """Keep what was recorded: it is drawn after the run."""


def film_run(config: RunConfig, film: FilmConfig, folder: Path, tell: Tell = lambda done: None) -> dict[str, Any]:
    """Execute a run, film it into a folder that is made, and return what is in its `film.json`.

    Args:
        config: of the run, whose record is put into the folder.
        tell: is told which share is done, from 0 to 1.

    Raises:
        DomainError: the domain has a mistake.
        InputError: the folder is there already, there is no such camera, or the run crashed.
        MissingError: the machine lacks something.
    """
    from executive.app.run import Run

    _make(folder)
    try:
        recorder = _Recorder(film.fps)
        config = replace(config, runs=folder, name=RUN, viewer=False)
        with Run(config, [recorder]) as run:
            camera = camera_of(film.camera, [each.name for each in run.world.spec.cameras])
            recorder.begin(run)
            summary = run.execute()
            recording = Recording(folder / RUN)

            def show(frame: Frame) -> Image:
                run.world.show(frame)
                return np.asarray(run.world.render(camera))

            about = {
                "problem_option": config.problem,
                "seed": config.seed,
                "faults": list(config.faults),
                "goal_true": summary["goal_true"],
            }
            return _write(folder, film, camera, recording, recorder.shots, show, about, tell)
    except BaseException:  # Ctrl-C too: half a film is left nowhere
        shutil.rmtree(folder, ignore_errors=True)
        raise


def film_recording(run: Path, film: FilmConfig, tell: Tell = lambda done: None) -> dict[str, Any]:
    """Film a recorded run into the folder `film.out`, which is made, and return what is in its `film.json`.

    What was true is worked out from the recorded poses, which are a tenth of a second apart and rounded (`ROUNDED`).

    Raises:
        InputError: the folder is there already, or the run was not in the simulator or does not say how things moved.
        MissingError: the machine lacks something.
    """
    from executive.sim.truth import Truth

    recording = Recording(run)
    moments = recording.movements.moments
    if not moments:
        raise InputError("does not say how things moved", file=run / FRAMES_FILE)
    with Redrawn(recording) as drawn:
        camera = camera_of(film.camera, drawn.cameras)
        drawn.cameras = (camera,)
        domain, atoms = drawn.domain, recording.started.task.atoms
        truth = Truth(drawn.world, domain.relations, domain.task.parameters, domain.files[0])
        _make(film.out)
        try:
            shots = [Shot(each.time, each.frame, truth.of_frame(each.frame, atoms, ROUNDED)) for each in moments]
            about = {
                "problem_option": read_config(run).problem,
                "seed": recording.started.seed,
                "recorded": str(run),
            }
            return _write(
                film.out, film, camera, recording, shots, lambda frame: drawn.show(frame)[camera], about, tell
            )
        except BaseException:  # Ctrl-C too: half a film is left nowhere
            shutil.rmtree(film.out, ignore_errors=True)
            raise


def read_about(folder: Path) -> dict[str, Any]:
    """Return what a film's `film.json` says.

    Raises:
        InputError: the folder holds no film, or a damaged one.
    """
    if not os.path.isfile(folder / ABOUT):
        raise InputError(f"holds no film: it has no {ABOUT}", file=folder)
    about = read_json(folder / ABOUT)
    kinds = {"domain": str, "problem": str, "fps": int, "frames": int}
    if not isinstance(about, dict) or any(not isinstance(about.get(key), kind) for key, kind in kinds.items()):
        raise InputError("is not what Executive wrote: it does not say what was filmed", file=folder / ABOUT)
    return about


def films_in(folder: Path) -> list[Path]:
    """Return the films in a folder: itself, or those in it in the order of their names; none where there are none."""
    if os.path.isfile(folder / ABOUT):
        return [folder]
    return sorted(each.parent for each in folder.glob(f"*/{ABOUT}")) if os.path.isdir(folder) else []


def _write(
    folder: Path,
    film: FilmConfig,
    camera: str,
    recording: Recording,
    shots: Sequence[Shot],
    show: Callable[[Frame], Image],
    about: Mapping[str, Any],
    tell: Tell,
) -> dict[str, Any]:
    if not shots:
        raise InputError("the run ended before anything was seen in it", file=folder)
    started, ended = recording.started, recording.ended
    rows = timeline.shown(recording.events, film.fps, film.pause)
    times = [shot.time for shot in shots]
    at = [max(0, bisect_right(times, row.world_time + 1e-9) - 1) for row in rows]
    picture: Image | None = None
    last = -1
    first = show(shots[0].frame)
    with video_writer(folder / VIDEO, first.shape, film.fps, _KEYFRAMES) as add:
        for number, shot in enumerate(at):
            if picture is None or shot != last:  # where the film lingers, nothing is drawn anew
                picture, last = show(shots[shot].frame), shot
            add(picture)
            tell((number + 1) / len(at))
    write_frames(folder / TRUTH, _frames(started.task.atoms, film.fps, rows, [shots[shot].truth for shot in at]))
    document = {
        "executive": version_of("executive"),
        "domain": started.domain,
        "problem": started.task.problem,
        **about,
        "camera": camera,
        "fps": film.fps,
        "pause": film.pause,
        "frames": len(rows),
        "mid_poses": len(timeline.mid_poses(recording.events)),
        "seconds": len(rows) / film.fps,
        "outcome": "" if ended is None else ended.outcome.value,
        "actions": 0 if ended is None else ended.actions,
    }
    write_atomic(folder / ABOUT, (json.dumps(document, indent=2) + "\n").encode())
    return document


def _frames(atoms: tuple[Atom, ...], fps: int, rows: Sequence[timeline.Shown], truth: Sequence[Facts]) -> Frames:
    return Frames(
        atoms,
        np.arange(len(rows)) / fps,
        np.array([[facts[atom] for atom in atoms] for facts in truth]),
        np.array([row.mid_pose for row in rows]),
        tuple(row.action for row in rows),
        tuple(row.phase for row in rows),
        np.array([row.world_time for row in rows]),
    )


def camera_of(wanted: str | None, there: Sequence[str]) -> str:
    """Return the camera that films, of those that are there: the first one if none is wanted.

    Raises:
        OptionError: there is no such camera.
    """
    if wanted is not None and wanted not in there:
        raise OptionError(f"there is no camera {wanted!r}; {nearest(wanted, there)}", option="camera")
    return wanted or there[0]


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise OptionError("is there already; choose another folder", file=folder, option="out") from None
    except OSError as error:
        raise OptionError(f"cannot be made ({reason(error)})", file=folder, option="out") from None
