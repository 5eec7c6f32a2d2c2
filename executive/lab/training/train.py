"""Training of a vision-language model for a domain (`executive train`): runs all stages of a preset, and resumes.

The training folder holds everything: the pictures, the last checkpoint of each stage, and at the end the model. A
finished stage is not run again. Several processes draw the pictures; each shard depends on the seed and its own number
alone.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executive.app.worlds import checked_stage
from executive.domain.loader import Domain, load_domain
from executive.errors import ExecutiveError, InputError
from executive.lab.collection import dataset
from executive.lab.common.folder_lock import lock, remove_partial
from executive.lab.common.process_pool import ProcessPool, WorkerLostError, run_jobs
from executive.lab.common.progress import RemainingTime, Stage
from executive.lab.config import TrainConfig
from executive.lab.training.presets import PRESETS, Preset
from executive.sim.spec import read_scene
from executive.util.files import read_json

if TYPE_CHECKING:
    from executive.lab.training.optimiser import Report

MANIFEST, PICTURES, MODEL = "training.json", "pictures", "model"


Watch = Callable[[Stage], None]


class Training:
    """One training with its checked folder. `run` starts or resumes it.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the folder holds something else.
    """

    def __init__(self, config: TrainConfig) -> None:
        self.config = config
        self.preset: Preset = PRESETS[config.recipe]
        self.domain: Domain = load_domain(config.domain, config.problem)
        checked_stage(self.domain)
        self.cameras = len(read_scene(self.domain.scene).cameras)
        self._remaining = RemainingTime(self.preset.efforts(self.cameras))
        self._cancelled = False
        self._check_folder()

    def cancel(self) -> None:
        """Makes `run` save everything and stop soon. It sets a flag: safe from any thread and signal handler."""
        self._cancelled = True

    def run(self, watch: Watch = lambda stage: None) -> Path | None:
        """Trains to the end, and returns the folder of the model; None when cancelled.

        Raises:
            InputError: another process trains in the folder, or it cannot be written to.
        """
        from executive.lab.training.optimiser import CancelledError

        held = lock(self.config.out, "training", self.config.command)
        try:
            remove_partial(self.config.out, self.config.out / PICTURES)
            self._draw(watch)
            return self._train(watch)
        except CancelledError:
            return None
        finally:
            held.release()

    # Pictures.

    def _draw(self, watch: Watch) -> None:
        from executive.lab.training import image_shards
        from executive.lab.training.optimiser import CancelledError

        folder, wanted = self.config.out / PICTURES, self.preset.shards
        folder.mkdir(exist_ok=True)
        missing = sorted(set(range(wanted)) - set(image_shards.shards(folder)))
        done, began = wanted - len(missing), time.monotonic()
        watch(self._stage("pictures", done, wanted, 0, 0.0))
        if not missing:
            return
        config, preset = self.config, self.preset
        arguments = (config.domain, config.problem, config.seed, preset.size.side, preset.moments, folder)
        pool: ProcessPool[int, None] = ProcessPool(partial(image_shards.ShardWriter, *arguments), config.jobs)
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

    def _train(self, watch: Watch) -> Path:
        from executive.lab.training import model_card, network, optimiser
        from executive.lab.training.stages import FEWER, LANGUAGE, TOGETHER, TOWER, ShardPool, Trainer
        from executive.lab.training.wordings import WORDINGS

        optimiser.use_threads(self.config.jobs)
        out, preset = self.config.out, self.preset
        questions = self.domain.subject.questions
        wordings = questions.with_name(WORDINGS) if questions is not None else None
        trainer = Trainer(self.domain, preset, self.config.seed, wordings if wordings and wordings.is_file() else None)

        def tell(report: Report) -> None:
            text = ", ".join(f"{name} {value:.3f}" for name, value in report.metrics.items())
            watch(self._stage(report.stage, report.step, report.steps, report.new, report.new * report.seconds, text))

        def stopped() -> bool:
            return self._cancelled

        folder = out / PICTURES
        if not optimiser.finished(out / FEWER, preset.fewer.steps):
            trainer.train_vision_encoder(folder, out / TOWER, tell, stopped)
            trainer.train_decoder(ShardPool(folder).states(), out / LANGUAGE, tell, stopped)
            trainer.train_jointly(folder, out / TOGETHER, tell, stopped)
        trainer.train_camera_subsets(folder, out / FEWER, tell, stopped)
        model = out / MODEL
        network.save(trainer.model, trainer.tokenizer, preset.size, model)
        parameters = sum(part.numel() for part in trainer.model.parameters())
        text = model_card.render(self.domain, preset, self.cameras, parameters, self.config.seed, self.config.command)
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
        described: dict[str, Any] = json.loads(
            json.dumps(
                {
                    "domain": self.domain.name,
                    "problem": self.domain.task.problem,
                    "atoms": [str(atom) for atom in self.domain.task.atoms],
                    "seed": self.config.seed,
                    "recipe": asdict(self.preset),
                }
            )
        )
        return described
