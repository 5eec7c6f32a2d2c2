"""Training of a vision-language model for a domain (`executive train`): runs all stages of a preset, and resumes.

How long it takes is measured first, by a few steps; where it has to fit into a budget, that decides the number of
steps, once: what was decided is kept in the folder.

The training folder holds everything: the pictures, the last checkpoint of each stage, and at the end the model. A
finished stage is not run again. Several processes draw the pictures; each shard depends on the seed and its own number
alone.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executive.app.worlds import checked_stage
from executive.domain.loader import Domain, load_domain
from executive.errors import ExecutiveError, InputError, OptionError
from executive.lab.collection import dataset
from executive.lab.common.folder_lock import lock, remove_partial
from executive.lab.common.process_pool import ProcessPool, WorkerLostError, run_jobs
from executive.lab.common.progress import RemainingTime, Stage
from executive.lab.config import TrainConfig, read_range
from executive.lab.problems import ProblemMaker
from executive.lab.training import warm_start
from executive.lab.training.described import shards
from executive.lab.training.described.space import DescribedSpace, is_described
from executive.lab.training.presets import PRESETS, Pace, Preset
from executive.sim.spec import read_scene
from executive.trace.record.codec import decode
from executive.util.files import read_json

if TYPE_CHECKING:
    from executive.lab.training import pace
    from executive.lab.training.optimiser import Report
    from executive.lab.training.stages import Trainer

MANIFEST, PACE, PICTURES, MODEL = "training.json", "pace.json", "pictures", "model"

STAGES = ("pictures", "tower", "language", "together", "fewer")

Watch = Callable[[Stage], None]

_MARGIN = 0.9
"""The share of a budget that is planned for: a training also saves, loads and writes."""


class Training:
    """One training with its checked folder. `run` starts or resumes it.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the folder holds something else.
    """

    def __init__(self, config: TrainConfig) -> None:
        self.config = config
        self._whole: Preset = PRESETS[config.recipe]
        self.domain: Domain = load_domain(config.domain, config.problem)
        checked_stage(self.domain)
        self.cameras = len(read_scene(self.domain.scene).cameras)
        self._space = self._described_space()
        if self._space is not None:
            self._whole = self._whole.in_parts()
        self._start = None if config.start is None else warm_start.find(config.start)
        if self._start is not None:
            warm_start.check(self._start, self._whole.size, config.recipe)
            alike = warm_start.is_alike(self._start, self._whole.size)
            if config.further and not alike:
                message = (
                    f"goes on with a model of the size that {config.recipe!r} makes, and {config.start} is another"
                )
                raise OptionError(message, option="further")
            whole = self._whole
            self._whole = whole.furthered(self.cameras) if config.further else whole.warmed(self.cameras, alike)
        if config.data:
            self._whole = replace(self._whole, shards=len(shards.parts_of(self._data)))
        self._remaining = RemainingTime(dict.fromkeys(STAGES, 1.0))
        self._cancelled = False
        self._check_folder()

    @property
    def is_measured(self) -> bool:
        """Whether it was measured before how fast this machine is."""
        return (self.config.out / PACE).is_file()

    def cancel(self) -> None:
        """Makes `run` save everything and stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    def run(
        self, watch: Watch = lambda stage: None, tell: Callable[[Mapping[str, float]], None] = lambda seconds: None
    ) -> Path | None:
        """Trains to the end, and returns the folder of the model; None when cancelled.

        Args:
            tell: receives the expected seconds of each stage, before the first one.

        Raises:
            InputError: another process trains in the folder, it cannot be written to, or the budget is too small.
        """
        from executive.lab.training.optimiser import CancelledError

        held = lock(self.config.out, "training", self.config.command)
        try:
            remove_partial(self.config.out, self.config.out / PICTURES)
            pace = self._pace()
            self.preset = self._fitted(pace)
            efforts = self.preset.efforts(pace)
            self._remaining = RemainingTime(efforts)
            tell(efforts)
            self._draw(watch)
            return self._train(watch)
        except CancelledError:
            return None
        finally:
            held.release()

    # What changes from problem to problem.

    @property
    def _data(self) -> tuple[Path, ...]:
        return tuple(map(Path, self.config.data))

    def _described_space(self) -> DescribedSpace | None:
        """The vocabulary of the domain's scenes, where objects change from problem to problem and are described.

        Raises:
            InputError: a collection may not be trained on.
        """
        config = self.config
        if not is_described(self.domain, config.problem):
            if config.data:
                message = "is for domains whose objects change from problem to problem (that have a problems.toml)"
                raise OptionError(message, option="data")
            return None
        least, most = read_range(config.objects)
        ProblemMaker(config.domain, least, most, config.seed)
        space = DescribedSpace.of(self.domain, most)
        for folder in self._data:
            shards.check_collection(folder, self.domain, space)
        return space

    # Time.

    def _pace(self) -> Pace:
        """How long steps take here, as measured when the training began."""
        from executive.lab.training import pace
        from executive.lab.training.optimiser import CancelledError, use_threads

        file = self.config.out / PACE
        if file.is_file():
            try:
                kept: Pace = decode(Pace, read_json(file))
                return kept
            except ValueError as error:
                raise InputError(f"{error}; remove it, and the pace is measured anew", file=file) from None
        use_threads(self.config.jobs)
        if self.config.data:  # nothing is drawn: what there is is taken over, and serves to measure by
            self._draw(lambda stage: None)
            there: tuple[Any, Path | None] = None, self.config.out / PICTURES
        else:
            there = self._writer, None
        measured = pace.measure(there[0], self._trainer, self.config.jobs, lambda: self._cancelled, there[1])
        if measured is None:
            raise CancelledError("pace")
        dataset.write_atomically(file, (json.dumps(asdict(measured), indent=2) + "\n").encode())
        return measured

    def _fitted(self, pace: Pace) -> Preset:
        minutes = self.config.minutes
        if minutes is None:
            return self._whole
        try:
            return self._whole.fitted(pace, _MARGIN * 60.0 * minutes)
        except ValueError as error:
            needed = sum(self._whole.efforts(pace).values()) / 60.0 / _MARGIN
            message = f"{minutes:g} are too few: all of it takes {needed:.0f} here, and {error}"
            raise OptionError(message, option="minutes") from None

    # Pictures.

    @property
    def _writer(self) -> Callable[[int, Path], pace.Writer]:
        """Makes what writes shards of so many moments into a folder."""
        from executive.lab.training import image_shards

        config, size = self.config, self._whole.size
        if self._space is None:
            named = partial(image_shards.ShardWriter, config.domain, config.problem, config.seed, size.side)
            return partial(named, mask=size.mask)
        return partial(shards.Drawn, config.domain, read_range(config.objects), config.seed, size.side)

    def _draw(self, watch: Watch) -> None:
        from executive.lab.training import image_shards
        from executive.lab.training.optimiser import CancelledError

        folder = self.config.out / PICTURES
        wanted = self._whole.shards if self.config.data else self.preset.shards
        folder.mkdir(exist_ok=True)
        missing = sorted(set(range(wanted)) - set(image_shards.shards(folder)))
        done, began = wanted - len(missing), time.monotonic()
        watch(self._stage("pictures", done, wanted, 0, 0.0))
        if not missing:
            return
        config = self.config
        job: Callable[[], pace.Writer]
        if config.data:
            side = self._whole.size.side
            job = partial(shards.Collected, config.domain, read_range(config.objects), self._data, side, folder)
        else:
            job = partial(self._writer, self.preset.moments, folder)
        pool: ProcessPool[int, None] = ProcessPool(job, config.jobs)
        waiting, drawn = iter(missing), 0
        with pool:
            for ended in run_jobs(pool, lambda: next(waiting, None), lambda: self._cancelled):
                for each in ended:
                    try:
                        each.value()
                    except WorkerLostError as error:
                        raise ExecutiveError(f"pictures {each.job}: {error}; resume with: {config.command}") from None
                drawn += len(ended)
                new = drawn + pool.running_progress
                watch(self._stage("pictures", done + new, wanted, new, time.monotonic() - began))
        if self._cancelled:
            raise CancelledError("pictures")

    def _stage(self, stage: str, done: float, wanted: int, new: float, seconds: float, metrics: str = "") -> Stage:
        number, stages = self._remaining.place(stage)
        return Stage(
            stage, number, stages, done, wanted, self._remaining.left(stage, done, wanted, new, seconds), metrics
        )

    # The network.

    def _trainer(self) -> Trainer:
        from executive.lab.training.stages import Trainer
        from executive.lab.training.wordings import WORDINGS

        questions = self.domain.subject.questions
        wordings = questions.with_name(WORDINGS) if questions is not None else None
        there = wordings if wordings and wordings.is_file() else None
        preset = getattr(self, "preset", self._whole)
        if self._space is None:
            return Trainer(self.domain, preset, self.config.seed, there, self._start)
        from executive.lab.training.described.trainer import DescribedTrainer

        return DescribedTrainer(self.domain, self._space, preset, self.config.seed, there, self._start)

    def _train(self, watch: Watch) -> Path:
        from executive.lab.training import model_card, network, optimiser
        from executive.lab.training.stages import FEWER, LANGUAGE, TOGETHER, TOWER

        optimiser.use_threads(self.config.jobs)
        out, preset = self.config.out, self.preset
        trainer = self._trainer()

        def tell(report: Report) -> None:
            text = ", ".join(f"{name} {value:.3f}" for name, value in report.metrics.items())
            watch(self._stage(report.stage, report.step, report.steps, report.new, report.new * report.seconds, text))

        def stopped() -> bool:
            return self._cancelled

        folder = out / PICTURES
        if not optimiser.finished(out / FEWER, preset.fewer.steps):
            trainer.train_vision_encoder(folder, out / TOWER, tell, stopped)
            trainer.train_decoder(trainer.pool(folder).states(), out / LANGUAGE, tell, stopped)
            trainer.train_jointly(folder, out / TOGETHER, tell, stopped)
        trainer.train_camera_subsets(folder, out / FEWER, tell, stopped)
        model = out / MODEL
        network.save(trainer.model, trainer.tokenizer, preset.size, model)
        parameters = sum(part.numel() for part in trainer.model.parameters())
        start = self._start.resolve().name if self._start is not None else None
        told = (parameters, self.config.seed, self.config.command, start, self._space is not None)
        text = model_card.render(self.domain, preset, self.cameras, *told)
        dataset.write_atomically(model / "README.md", text.encode())
        return model

    # The folder.

    def _check_folder(self) -> None:
        out, what = self.config.out, self._described()
        if os.path.exists(out) and not out.is_dir():
            raise InputError("is not a folder", file=out)
        file = out / MANIFEST
        if os.path.exists(file):
            if read_json(file) != what:
                raise InputError("holds another training; choose another folder with --out", file=out)
            return
        if os.path.exists(out) and any(not entry.name.startswith(".") for entry in out.iterdir()):
            raise InputError(f"is not empty and holds no training (no {MANIFEST}); choose another folder", file=out)
        try:
            out.mkdir(parents=True, exist_ok=True)
            dataset.write_atomically(file, (json.dumps(what, indent=2) + "\n").encode())
        except OSError as error:
            raise InputError(f"cannot be written to ({error.strerror})", file=out) from None

    def _described(self) -> dict[str, Any]:
        """Everything that the model depends on, as JSON gives it back."""
        described: dict[str, Any] = {
            "domain": self.domain.name,
            "problem": self.domain.task.problem,
            "atoms": [str(atom) for atom in self.domain.task.atoms],
            "seed": self.config.seed,
            "recipe": asdict(self._whole),
        }
        # Not where they are not asked for, so that trainings from before are continued.
        if not self._whole.further:
            del described["recipe"]["further"]
        if self._start is not None:
            described["from"] = {"model": self._start.resolve().name, "weights": warm_start.digest(self._start)}
        if self._space is not None:
            described["atoms"], described["objects"] = [], self.config.objects
            described["values"], described["held_out"] = list(self._space.values), list(self._space.held_out)
        if self.config.data:
            described["data"] = [dataset.read_manifest(folder)["collection"] for folder in self._data]
        if self.config.minutes is not None:
            described["minutes"] = self.config.minutes
        told: dict[str, Any] = json.loads(json.dumps(described))
        return told
