"""Growing an eye for a domain (`executive train`): all stages of the recipe, each gone on with where it was left.

The folder that is trained in holds everything: the pictures, each stage's last state, and in the end the model. A stage
that is finished is not run again; pictures are drawn by several processes, each shard from the seed and its own number
alone.
"""

from __future__ import annotations

import json
import os
import shlex
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executive.app.run import checked_stage
from executive.domain.loader import Domain, load_domain
from executive.errors import ExecutiveError, InputError
from executive.lab.collection import dataset
from executive.lab.common.folder_lock import lock, sweep
from executive.lab.common.process_pool import LostError, Processes, done_by
from executive.lab.common.progress import Outlook, Stage
from executive.lab.training.presets import RECIPES, Recipe
from executive.sim.spec import read_scene
from executive.util.files import legible, read_json

if TYPE_CHECKING:
    from executive.lab.training.optimiser import Report

MANIFEST, PICTURES, MODEL = "training.json", "pictures", "model"


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """What to train, and where. `recipe` names one of `RECIPES`; `jobs` processes draw pictures, and as many threads
    train; neither changes what comes out but for rounding."""

    domain: str
    out: Path
    problem: str | None = None
    recipe: str = "small"
    seed: int = 0
    jobs: int | None = None

    def __post_init__(self) -> None:
        if self.recipe not in RECIPES:
            raise InputError(f"no recipe {self.recipe!r}; there are: {', '.join(RECIPES)}", key="--recipe")
        if self.seed < 0:
            raise InputError(f"{self.seed} is not a seed from 0 on", key="--seed")
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"{self.jobs} is not a number of processes from 1 on", key="--jobs")

    @property
    def command(self) -> str:
        """The command that trains this, and goes on with it."""
        words = ["executive", "train", self.domain, "--out", str(self.out)]
        words += ["--problem", self.problem] if self.problem is not None else []
        words += ["--recipe", self.recipe] if self.recipe != "small" else []
        return legible(shlex.join([*words, *(["--seed", str(self.seed)] if self.seed else [])]))


Watch = Callable[[Stage], None]


class Training:
    """One training, its folder checked. `run` goes on with it from where it was left.

    Raises:
        DomainError: the domain folder has a mistake.
        InputError: the folder holds something else.
    """

    def __init__(self, config: TrainConfig) -> None:
        self.config = config
        self.recipe: Recipe = RECIPES[config.recipe]
        self.domain: Domain = load_domain(config.domain, config.problem)
        checked_stage(self.domain)
        self.cameras = len(read_scene(self.domain.scene).cameras)
        self._outlook = Outlook(self.recipe.efforts(self.cameras))
        self._cancelled = False
        self._check_folder()

    def cancel(self) -> None:
        """Have `run` stop soon, with everything saved. A flag: safe from any thread and signal handler."""
        self._cancelled = True

    def run(self, watch: Watch = lambda stage: None) -> Path | None:
        """Train to the end, and return the model's folder; None when cancelled.

        Raises:
            InputError: another process trains in the folder, or it cannot be written to.
        """
        from executive.lab.training.optimiser import CancelledError

        held = lock(self.config.out, "training", self.config.command)
        try:
            sweep(self.config.out, self.config.out / PICTURES)
            self._draw(watch)
            return self._grow(watch)
        except CancelledError:
            return None
        finally:
            held.release()

    # Pictures.

    def _draw(self, watch: Watch) -> None:
        from executive.lab.training import image_shards
        from executive.lab.training.optimiser import CancelledError

        folder, wanted = self.config.out / PICTURES, self.recipe.shards
        folder.mkdir(exist_ok=True)
        missing = sorted(set(range(wanted)) - set(image_shards.shards(folder)))
        done, began = wanted - len(missing), time.monotonic()
        watch(self._stage("pictures", done, wanted, 0, 0.0))
        if not missing:
            return
        config, recipe = self.config, self.recipe
        draw = (config.domain, config.problem, config.seed, recipe.size.side, recipe.moments, folder)
        crew: Processes[int, None] = Processes(partial(image_shards.Drawing, *draw), config.jobs)
        waiting, drawn = iter(missing), 0
        with crew:
            for ended in done_by(crew, lambda: next(waiting, None), lambda: self._cancelled):
                for each in ended:
                    try:
                        each.value()
                    except LostError as error:
                        raise ExecutiveError(f"pictures {each.job}: {error}; go on with: {config.command}") from None
                drawn += len(ended)
                new = drawn + crew.under_way
                watch(self._stage("pictures", done + new, wanted, new, time.monotonic() - began))
        if self._cancelled:
            raise CancelledError("pictures")

    def _stage(self, stage: str, done: float, wanted: int, new: float, seconds: float, told: str = "") -> Stage:
        number, stages = self._outlook.place(stage)
        return Stage(stage, number, stages, done, wanted, self._outlook.left(stage, done, wanted, new, seconds), told)

    # The rest.

    def _grow(self, watch: Watch) -> Path:
        from executive.lab.training import model_card, network, optimiser
        from executive.lab.training.stages import FEWER, LANGUAGE, TOGETHER, TOWER, Eye, Pool
        from executive.lab.training.wordings import WORDINGS

        optimiser.use_threads(self.config.jobs)
        out, recipe = self.config.out, self.recipe
        questions = self.domain.subject.questions
        wordings = questions.with_name(WORDINGS) if questions is not None else None
        eye = Eye(self.domain, recipe, self.config.seed, wordings if wordings and wordings.is_file() else None)

        def tell(report: Report) -> None:
            good = ", ".join(f"{name} {value:.3f}" for name, value in report.told.items())
            watch(self._stage(report.stage, report.step, report.steps, report.new, report.new * report.seconds, good))

        def stopped() -> bool:
            return self._cancelled

        folder = out / PICTURES
        if not optimiser.finished(out / FEWER, recipe.fewer.steps):
            eye.learn_to_see(folder, out / TOWER, tell, stopped)
            eye.learn_to_read(Pool(folder).states(), out / LANGUAGE, tell, stopped)
            eye.learn_together(folder, out / TOGETHER, tell, stopped)
        eye.learn_with_fewer(folder, out / FEWER, tell, stopped)
        model = out / MODEL
        network.save(eye.model, eye.tokenizer, recipe.size, model)
        parameters = sum(part.numel() for part in eye.model.parameters())
        text = model_card.render(self.domain, recipe, self.cameras, parameters, self.config.seed, self.config.command)
        dataset.write_atomically(model / "README.md", text.encode())
        return model

    # What is kept beside it.

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
        """Everything that decides what comes out, as JSON would give it back."""
        described: dict[str, Any] = json.loads(
            json.dumps(
                {
                    "domain": self.domain.name,
                    "problem": self.domain.task.problem,
                    "atoms": [str(atom) for atom in self.domain.task.atoms],
                    "seed": self.config.seed,
                    "recipe": asdict(self.recipe),
                }
            )
        )
        return described
