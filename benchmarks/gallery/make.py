"""Make docs/gallery anew: of each domain a run in which something goes wrong, as a film and as a recording.

    make gallery
    python -m benchmarks.gallery.make kitchen cans      (these alone)

It takes some ten minutes of a quiet core. Films are drawn anew from how things moved, after the run.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from benchmarks.gallery.films import RATE, WIDTH, Shot, film
from benchmarks.gallery.recordings import OneLayout, Small, compact
from executive.app.redrawn import Redrawn
from executive.app.run import Run, RunConfig
from executive.trace.record.recording import Recording
from executive.trace.record.thresholds import thresholds
from executive.trace.viewer.process import TRACE_FILE
from executive.types import Event, Frame

if TYPE_CHECKING:
    from examples.robosuite_panda.panda import Panda

ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "docs" / "gallery"
PANDA = "panda"


class Piece(NamedTuple):
    """A run to show: its film's speed and camera (none: no film), and whether its recording is kept."""

    name: str
    config: RunConfig
    speed: int = 2
    camera: str = "front"
    is_kept: bool = True


ORACLE = partial(RunConfig, estimator="oracle")
PIECES = (
    Piece("grocery", RunConfig("grocery", "breakfast", faults=("drop@4",))),
    Piece("blocksworld", ORACLE("blocksworld", "tower-5", 1, faults=("topple:item=large-green-metal-cube@4",)), 6),
    Piece("cans", ORACLE("cans", "one-can", 2, faults=("swap:item=can-a,with=can-c,seconds=2@2",), poses="depth")),
    Piece("kitchen", ORACLE("kitchen", "known", faults=("roll@2",)), 5),
    Piece("tabletop", ORACLE("tabletop", "one-item", faults=("drop@2",)), 1),
    Piece(
        "learned",
        ORACLE(
            "grocery", "one-item", 12, policies=(f"pick={ROOT}/examples/learned_pick/pick.safetensors",),
            grasp_noise=0.005,
        ),
        speed=3,
        is_kept=False,
    ),
    Piece(
        "symbolic",
        RunConfig("grocery", "breakfast", 3, "oracle", world="symbolic", no_effect=0.3, flip=0.05),
        camera="",
    ),
)  # fmt: skip


def make(piece: Piece, runs: Path) -> None:
    sink, folder = Small(), runs / piece.name
    with Run(replace(piece.config, runs=runs, name=piece.name, viewer=False), [sink]) as run:
        sink.begin(OneLayout(runs / "viewer" / piece.name, thresholds=thresholds(run.monitor)))
        summary = run.execute()
    assert summary["goal_true"], piece.name
    if piece.is_kept:
        compact(runs / "viewer" / piece.name / TRACE_FILE, GALLERY / f"{piece.name}.rrd")
    if piece.camera:
        recording = Recording(folder)
        with Redrawn(recording, (piece.camera,)) as drawn:
            shots = [Shot(each.time, drawn.show(each.frame)[piece.camera]) for each in recording.movements.moments]
        film(GALLERY / f"{piece.name}.webp", recording.events, shots, piece.speed)


class Filmed:
    """A sink that films a Panda as it moves: nothing draws robosuite's own world anew."""

    def __init__(self, panda: Panda) -> None:
        self._panda, self.shots, self.events = panda, list[Shot](), list[Event]()

    def write(self, event: Event) -> None:
        if not isinstance(event.payload, Frame):
            self.events.append(event)
        elif not self.shots or event.time > self.shots[-1].time + 1 / RATE - 1e-6:
            picture = self._panda.env.sim.render(WIDTH, 288, camera_name="frontview")[::-1]
            self.shots.append(Shot(event.time, picture.copy()))

    def close(self) -> None:
        """All is in memory."""


def make_panda() -> None:
    from examples.robosuite_panda.panda import Panda, play  # robosuite takes seconds

    panda = Panda()
    sink = Filmed(panda)
    assert play(panda, ["drop@2"], sinks=[sink]).goal_seen
    film(GALLERY / f"{PANDA}.webp", sink.events, sink.shots, 1)


def main() -> int:
    names = [*(piece.name for piece in PIECES), PANDA]
    wanted = sys.argv[1:] or names
    if unknown := [name for name in wanted if name not in names]:
        print(f"there is no {unknown[0]!r}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    GALLERY.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for piece in PIECES:
            if piece.name in wanted:
                make(piece, Path(folder))
        if PANDA in wanted:
            make_panda()
    return 0


if __name__ == "__main__":
    sys.exit(main())
