"""The smallest eye, trained from nothing to a checkpoint that anybody loads, in one sitting or several."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from executive import cli
from executive.errors import InputError
from executive.lab.common.folder_lock import lock
from executive.lab.common.progress import Stage
from executive.lab.config import TrainConfig
from executive.lab.training import optimiser
from executive.lab.training.presets import Schedule
from executive.lab.training.train import MANIFEST, Training
from executive.s3e.backends.transformers_backend import TransformersBackend
from tests.executive.sim.stage import ROOT

TRAY = ROOT / "tests" / "domains" / "tray"


def config(out: Path, **chosen: object) -> TrainConfig:
    return TrainConfig(str(TRAY), out, recipe="smallest", jobs=1, **chosen)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("eye") / "out"
    seen: list[Stage] = []
    model = Training(config(out)).run(seen.append)
    assert model is not None
    assert list(dict.fromkeys(stage.stage for stage in seen)) == ["pictures", "tower", "language", "together", "fewer"]
    assert all(stage.done <= stage.wanted for stage in seen)
    numbers = {stage.stage: (stage.number, stage.stages) for stage in seen}
    assert list(numbers.values()) == [(number, 5) for number in range(1, 6)]
    assert seen[-1].left == 0.0
    assert all(stage.left > 0.0 for stage in seen[:-1] if stage.left is not None)
    return out


def test_what_is_grown_is_a_checkpoint_like_any_other(trained: Path) -> None:
    backend = TransformersBackend(trained / "model")
    picture = np.full((64, 64, 3), 128, np.uint8)
    look = backend.look([picture, picture], "Answer yes or no.")
    answers = look.ask(["Is the red cube on the tray?", "Is anything there?"])
    assert [answer.error for answer in answers] == ["", ""]
    assert look.path == "shared"


def test_a_finished_training_is_not_run_again(trained: Path) -> None:
    before = (trained / "model" / "model.safetensors").read_bytes()
    seen: list[Stage] = []
    Training(config(trained)).run(seen.append)
    assert {stage.stage for stage in seen} == {"pictures"}
    assert (trained / "model" / "model.safetensors").read_bytes() == before


def test_a_training_in_two_sittings_comes_to_the_same(trained: Path, tmp_path: Path) -> None:
    """The pictures are there, the encoder is not, and it is stopped after each report."""
    out = tmp_path / "again"
    shutil.copytree(trained, out)
    for name in ("tower.pt", "language.pt", "together.pt", "fewer.pt"):
        (out / name).unlink()
    shutil.rmtree(out / "model")
    sittings = 0
    while True:
        training = Training(config(out))
        model = training.run(lambda stage, training=training: training.cancel())  # type: ignore[misc]
        sittings += 1
        if model is not None:
            break
        assert sittings < 60
    assert sittings > 3
    one, other = (torch.load(folder / "fewer.pt", weights_only=True)["parts"] for folder in (trained, out))
    for part in one:
        for name, value in one[part].items():
            assert torch.allclose(value.float(), other[part][name].float(), atol=1e-5), (part, name)


def test_what_a_killed_training_left_half_written_is_in_nobodys_way(trained: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    shutil.copytree(trained, out)
    shutil.rmtree(out / "pictures" / "shard-0001")
    (out / "pictures" / ".shard-0001.99").mkdir()
    (out / ".tower.pt.99").write_bytes(b"half")
    assert Training(config(out)).run() is not None
    assert {each.name for each in (out / "pictures").iterdir()} == {"shard-0000", "shard-0001"}
    assert not (out / ".tower.pt.99").exists()
    for name in ("pictures", "facts"):
        one, other = ((folder / "pictures" / "shard-0001" / f"{name}.npy").read_bytes() for folder in (trained, out))
        assert one == other


def test_one_training_at_a_time_in_a_folder(trained: Path) -> None:
    held = lock(trained, "training", "executive train")
    with pytest.raises(InputError, match="another process is working in this folder, training since"):
        Training(config(trained)).run()
    held.release()


def test_another_training_is_refused(trained: Path) -> None:
    with pytest.raises(InputError, match="another training"):
        Training(config(trained, seed=5))


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="holds no training"):
        Training(config(tmp_path))
    assert not (tmp_path / MANIFEST).exists()


def test_a_recipe_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["train", str(TRAY), "--out", str(tmp_path / "x"), "--recipe", "huge"]) == 2
    message = capsys.readouterr().err
    assert all(word in message for word in ("--recipe", "'huge'", "fine", "small", "smallest"))
    assert not (tmp_path / "x").exists()


def test_the_manifest_says_what_decides(trained: Path) -> None:
    manifest = json.loads((trained / MANIFEST).read_text(encoding="utf-8"))
    assert manifest["seed"] == 0
    assert manifest["recipe"]["shards"] == 2


def test_a_stage_resumes_where_it_stopped(tmp_path: Path) -> None:
    def train(file: Path, stops: tuple[int, ...]) -> torch.Tensor:
        torch.manual_seed(0)
        part = torch.nn.Linear(3, 1)
        done = 0

        def step_loss(step: int, rng: np.random.Generator) -> tuple[torch.Tensor, dict[str, float]]:
            nonlocal done
            done += 1
            x = torch.from_numpy(rng.normal(size=(8, 3))).float()
            return (part(x) - x.sum(1, keepdim=True)).square().mean(), {}

        for stop in (*stops, 10**6):
            limit = done + stop

            def enough(limit: int = limit) -> bool:
                return done >= limit

            try:
                optimiser.train_stage("line", file, {"part": part}, Schedule(60, 0.1, 5), step_loss, 1, stopped=enough)
            except optimiser.CancelledError:
                continue
        return part.weight.detach().clone()

    whole, parts = train(tmp_path / "a.pt", ()), train(tmp_path / "b.pt", (7, 1, 13))
    assert torch.allclose(whole, parts, atol=1e-6)
    assert float((whole - 1.0).abs().max()) < 0.3
