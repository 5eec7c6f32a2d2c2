"""Options are declared once: files, flags and the words of a command say the same of them."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from executive import cli
from executive.app import run as assemble
from executive.app.config import CONFIG, MONITORS, PRESETS, EstimatorConfig, MonitorConfig, RunConfig
from executive.app.options import as_toml, command_words, make, options
from executive.errors import InputError, OptionError
from executive.lab.config import RECIPES, CollectConfig, EvalConfig, TrainConfig
from executive.lab.training.presets import PRESETS as TRAINING_PRESETS

CONFIGURATIONS = (RunConfig, CollectConfig, EvalConfig, TrainConfig)

EYES = st.builds(
    EstimatorConfig,
    vlm=st.none() | st.text(min_size=1),
    translator=st.sampled_from(["templates", "none"]),
    instructions=st.sampled_from([True, False, "paper", "own.md"]),
    per_image=st.booleans(),
    calibration=st.none() | st.just(Path("c.json")),
    cameras=st.sampled_from([(), ("front",), ("front,hand",)]),
)
MONITORING = st.builds(MonitorConfig, alpha=st.none() | st.just(0.05), memory=st.booleans())
RUNS = st.builds(
    RunConfig,
    st.text(min_size=1),
    problem=st.none() | st.text(min_size=1),
    seed=st.integers(0, 2**63 - 1),
    faults=st.lists(st.text()).map(tuple),
    grasp_noise=st.floats(0.0, 1.0),
    max_looks=st.none() | st.integers(1, 100),
    patience=st.floats(1e-3, 1e9),
    guard=st.booleans(),
    eye=EYES,
    monitor=MONITORING,
)


@pytest.fixture
def assembled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[RunConfig]:
    """The configurations that the command line has made, none of which is run."""
    made: list[RunConfig] = []

    def remember(config: RunConfig, *rest: object, **more: object) -> None:
        made.append(config)
        raise InputError("enough")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(assemble, "Run", remember)
    return made


@given(config=RUNS)
@example(config=RunConfig("\x85\x7f", eye=EstimatorConfig("\u2028\x85\n\U00010000")))
def test_a_configuration_is_read_as_it_was_written(config: RunConfig, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.mktemp("run") / CONFIG
    file.write_text(as_toml(config), encoding="utf-8")
    assert make(RunConfig, {}, file) == config


@pytest.mark.parametrize("model", CONFIGURATIONS)
def test_every_option_is_told_and_has_a_flag_of_its_own(model: type) -> None:
    flags = [each.flag for each in options(model).values() if each.flag]
    assert len(set(flags)) == len(flags)
    assert all(each.option.help.endswith(".") for each in options(model).values())


def test_presets_and_their_meanings_have_the_same_names() -> None:
    assert PRESETS.keys() == MONITORS.keys()
    assert RECIPES.keys() == TRAINING_PRESETS.keys()


def test_what_has_its_default_is_no_word_of_the_command() -> None:
    assert command_words(RunConfig("grocery")) == ["grocery"]
    words = command_words(RunConfig("grocery", viewer=False, faults=("a", "b"), monitor=MonitorConfig(memory=False)))
    assert words == ["grocery", "--fault", "a", "--fault", "b", "--no-trace-viewer", "--no-memory"]
    assert command_words(RunConfig("grocery", viewer=False), without=("viewer",)) == ["grocery"]


@pytest.mark.parametrize(
    ("values", "option"),
    [
        ({"estimator": "orakle"}, "estimator"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**63}, "seed"),
        ({"patience": 0.0}, "patience"),
        ({"patience": float("inf")}, "patience"),
        ({"max_seconds": float("nan")}, "max_seconds"),
        ({"alpha": 1.0}, "alpha"),
        ({"translator": "lmm"}, "translator"),
        ({"estimator": "oracle", "vlm": "m"}, "estimator"),
        ({"server": "not an address"}, "server"),
    ],
)
def test_a_mistake_is_named_by_its_option(values: dict[str, Any], option: str) -> None:
    with pytest.raises(OptionError) as caught:
        make(RunConfig, {"domain": "grocery", **values})
    assert (caught.value.option, caught.value.file) == (option, None)


@pytest.mark.parametrize(
    ("text", "key", "hint"),
    [
        ("sede = 3", "sede", "'seed'"),
        ("[monitor]\nalhpa = 0.1", "monitor.alhpa", "'alpha'"),
        ("seed = '3'", "seed", "'3'"),
        ("guard = 1", "guard", "1"),
        ("faults = 'drop@4'", "faults", "'drop@4'"),
        ("monitor = 3", "monitor", "3"),
        ("[eye]\ntranslator = 'lmm'", "eye.translator", "'llm'"),
        ("[eye]\nllm = 'writer'", "eye.llm", "`translator`"),
        ("[monitor]\nthreshold = 0.5\nalpha = 0.1", "monitor.alpha", "`threshold`"),
        ("max_looks = 0", "max_looks", "0"),
    ],
)
def test_a_mistake_in_a_file_is_named_by_its_key(tmp_path: Path, text: str, key: str, hint: str) -> None:
    file = tmp_path / "own.toml"
    file.write_text(f"domain = 'grocery'\n{text}\n")
    with pytest.raises(InputError) as caught:
        make(RunConfig, {}, file)
    assert (caught.value.file, caught.value.key) == (file, key)
    assert hint in caught.value.message


def test_a_run_takes_its_options_from_a_file_and_flags_override_it(tmp_path: Path, assembled: list[RunConfig]) -> None:
    file = tmp_path / "own.toml"
    config = RunConfig("grocery", seed=3, faults=("drop@4",), guard=False, monitor=MonitorConfig(memory=False))
    file.write_text(as_toml(config))
    assert cli.exit_code(["run", "--config", str(file)]) == cli.BAD_INPUT
    assert assembled.pop() == config
    line = f"run tray --config {file} --seed 0 --guard --vlm m --alpha 0.1"
    assert cli.exit_code(shlex.split(line)) == cli.BAD_INPUT
    eye, monitor = EstimatorConfig("m"), MonitorConfig(alpha=0.1, memory=False)
    assert assembled.pop() == RunConfig("tray", seed=0, faults=("drop@4",), eye=eye, monitor=monitor)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("run --config {file} --threshold 0.5", "error: {file}: monitor.alpha: sets the thresholds by an error rate"),
        ("run --config {file} --patience 0", "error: --patience: should be above 0, got 0.0"),
        ("run --config nowhere.toml", "error: nowhere.toml: there is no such file"),
        ("run grocery --threshold 0.5 --trust t.json", "error: --trust: excludes --threshold, which"),
        ("run grocery --estimator oracle --vlm m", "--vlm and --server go with --estimator vlm"),
        ("run", "error: domain: is missing"),
    ],
)
def test_the_command_line_says_flags_and_files_their_keys(
    tmp_path: Path, assembled: list[RunConfig], capsys: pytest.CaptureFixture[str], line: str, says: str
) -> None:
    file = tmp_path / "own.toml"
    file.write_text("domain = 'grocery'\n[monitor]\nalpha = 0.1\n")
    assert cli.exit_code(shlex.split(line.format(file=file))) == cli.BAD_INPUT
    assert says.format(file=file) in capsys.readouterr().err
    assert assembled == []
