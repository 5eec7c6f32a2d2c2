"""The paper's Experiment 2 on films of the simulator, its Tables 2 and 4: `python -m benchmarks.film --vlm MODEL`.

Twenty runs of the tabletop's problems are filmed, with seeds of their own, and kept in a folder, so that another model
is measured on the same films. The model is asked with the domain's questions, and with the atoms themselves (no trans).
`--scripted 0.05` adds an estimator without a model, which says the truth but for mistakes: each answer is wrong for
that share of the film, in spells of half a second on average.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from executive.app.config import EstimatorConfig
from executive.cli.pool_options import PoolConfig
from executive.domain.loader import load_domain
from executive.lab.common.progress import show_progress
from executive.lab.config import EvalConfig
from executive.lab.evaluation import published, store
from executive.lab.evaluation.metrics import BoolArray
from executive.lab.evaluation.posterior import open_single_look
from executive.lab.film.config import FilmConfig
from executive.lab.film.evaluate import FilmEvaluator, load_document
from executive.lab.film.filming import Filming
from executive.lab.film.frames import Frames, read_truth
from executive.lab.film.memory import FilmMemory
from executive.lab.film.record import TRUTH, films_in, read_about
from executive.lab.film.scoring import memory_table, scored, tabled
from executive.lab.film.watch import Watched, watch
from executive.types import Atom, Belief, Observation

DOMAIN = "tabletop"
PROBLEMS = ("exchange", "gather", "sort", "one-item", "fetch")
FIRST_SEED = 920_000
SPELL = 0.5
"""Mean seconds for which a scripted answer stays wrong."""
SURE = 0.9


class Scripted:
    """Says the truth with the probability `SURE`, but where a mistake is due.

    Args:
        share: of the film for which each answer is wrong.
    """

    name = "scripted"

    def __init__(self, frames: Frames, fps: int, share: float, seed: int) -> None:
        self._frames, self._wrong = frames, spells(frames.truth.shape, fps, share, seed)

    def estimate(self, observation: Observation, atoms: Sequence[Atom]) -> Belief:
        row = self._frames.at(observation.time)
        so = self._frames.truth[row] != self._wrong[row]
        said = {atom: SURE if value else 1.0 - SURE for atom, value in zip(atoms, so, strict=True)}
        return Belief(observation.id, said, source=self.name)


def spells(shape: tuple[int, ...], fps: int, share: float, seed: int) -> BoolArray:
    """Which answers (frames, atoms) are wrong: a Markov chain of each atom."""
    rng = np.random.default_rng([seed, 0xF11])
    leave = min(1.0, 1.0 / (SPELL * fps))
    begin = min(1.0, leave * share / max(1e-9, 1.0 - share))
    wrong = np.zeros(shape, dtype=bool)
    now = rng.random(shape[1]) < share
    for row in range(shape[0]):
        wrong[row] = now
        now = np.where(now, rng.random(shape[1]) >= leave, rng.random(shape[1]) < begin)
    return wrong


def scripted(films: Sequence[Path], share: float) -> dict[str, Any]:
    """The scores of the scripted estimator on films."""
    found = []
    for number, folder in enumerate(films):
        about = read_about(folder)
        domain = load_domain(DOMAIN, about["problem_option"])
        frames = read_truth(folder / TRUTH, domain.task.atoms)
        eye = Scripted(frames, about["fps"], share, number)
        nothing = np.zeros((1, 1, 3), dtype=np.uint8)  # it looks at no picture
        pictures = ((float(moment), nothing) for moment in frames.times)
        seen = watch(eye, frames, "none", pictures, FilmMemory(open_single_look(domain, None)))
        rows = [(s.time, s.row, s.probability, s.remembered, s.seconds) for s in seen]
        found.append(Watched.of(folder.name, frames, rows))
    return scored(found)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--films", type=int, default=20)
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first film")
    parser.add_argument("--folder", type=Path, default=Path("films"), help="where films and evaluations are kept")
    parser.add_argument("--vlm", help="a model: a folder or a hub id")
    parser.add_argument("--server", help="address of an OpenAI-compatible server that has it")
    parser.add_argument("--scripted", type=float, help="share of wrong answers of an estimator without a model")
    parser.add_argument("--jobs", type=int, help="processes that film and watch; as many as there are cores")
    given = parser.parse_args(arguments)
    films = given.folder / f"{DOMAIN}-{given.seed}"
    filming = Filming(FilmConfig(DOMAIN, films, PROBLEMS, seed=given.seed, films=given.films))
    with PoolConfig().open(filming.filmer, given.jobs) as pool, show_progress(sys.stderr, "films") as progress:
        filming.run(pool, progress)
    there = films_in(films)[: given.films]
    documents: dict[str, Any] = {}
    if given.scripted is not None:
        documents[f"scripted, {given.scripted:g} wrong"] = scripted(there, given.scripted)
    if given.vlm or given.server:
        for translator in ("templates", "none"):
            name = Path(given.vlm or given.server).name
            out = given.folder / f"{name}-{translator}-{given.seed}-{given.films}"
            document = evaluate(films, out, given, translator)
            documents[document["name"]] = document
    print(tabled(published.read(load_domain(DOMAIN).files[0].parent), documents))
    print(f"\n{memory_table(documents)}")
    abouts = [read_about(folder) for folder in there]
    seconds, frames = sum(each["seconds"] for each in abouts), sum(each["frames"] for each in abouts)
    reached = sum(each["goal_true"] for each in abouts)
    print(f"\n{len(there)} films, {frames} frames, {seconds:.0f} s; {reached} of the runs reached their goal")
    for name, document in documents.items():
        if "wall" in document:
            print(f"{name}: {document['wall']:.0f} s of wall time, {document['processor']:.3f} processor s a frame")


def evaluate(films: Path, out: Path, given: argparse.Namespace, translator: str) -> dict[str, Any]:
    """The document of one evaluation: that of an earlier one with the same options, or a new one."""
    if (out / store.RESULTS).is_file():
        return load_document(out)
    eye = EstimatorConfig(vlm=given.vlm, server=given.server, translator=translator)
    evaluator = FilmEvaluator(EvalConfig(DOMAIN, films, eye, looks=given.films), out)
    out.mkdir(parents=True, exist_ok=True)
    began, before = time.monotonic(), processor_seconds()
    jobs = given.jobs or 1
    with (
        PoolConfig().open(evaluator.watcher, jobs, single_threaded=jobs > 1) as pool,
        show_progress(sys.stderr, "frames") as progress,
    ):
        document = evaluator.run(pool, progress)
    assert document is not None  # nothing cancels it but Ctrl-C, which ends this process
    evaluator.tell(document)
    spent = processor_seconds() - before
    return {**document, "wall": time.monotonic() - began, "processor": spent / document["frames"]["looks"]}


def processor_seconds() -> float:
    """What the processes that have ended took of the processors."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
