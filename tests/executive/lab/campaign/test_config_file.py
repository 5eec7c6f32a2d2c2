"""A campaign's file says what is played; every mistake in it is one line with file and key."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.app.config import PRESETS, EstimatorConfig, MonitorConfig
from executive.app.estimators import open_estimator
from executive.domain.loader import load_subject
from executive.errors import DomainError, InputError
from executive.lab.campaign.config_file import check, model_digest, read_campaign
from executive.lab.campaign.design import KEYS
from tests.executive.lab.campaign.players import FAULTS, campaign

ROOT = Path(__file__).parents[4]
TRAY = ROOT / "tests" / "domains" / "tray"
HEAD = f"""title = "Two cubes and a tray"
seeds = 2
[[domains]]
domain = "{TRAY}"
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "some.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_what_a_file_leaves_out_goes_without_saying(tmp_path: Path) -> None:
    made = read_campaign(written(tmp_path, HEAD))
    assert (made.title, made.seeds, made.size, made.minutes) == ("Two cubes and a tray", (0, 1), 2, 20.0)
    assert [str(place) for place in made.places] == ["tray/fill-tray"]
    assert [str(who) for who in made.configurations] == ["oracle"]
    first, second = made.episodes()
    assert first.key == ("tray", "fill-tray", "no faults", "oracle", "", "0")
    assert (first.config.domain, first.config.problem, first.config.seed) == (str(TRAY), None, 0)
    assert (first.config.viewer, first.config.monitor, second.config.seed) == (False, MonitorConfig(), 1)


def test_everything_that_a_file_can_say(tmp_path: Path) -> None:
    (tmp_path / "eye").mkdir()
    (tmp_path / "eye" / "config.json").write_text("{}")
    (tmp_path / "known").write_text("{}")
    text = """
        title = "All"
        about = "Two\\nlines"
        seeds = [7, 3]
        minutes = 0.5
        [[domains]]
        domain = "grocery"
        problems = ["breakfast", "one-item"]
        [faults]
        "none" = []
        "some" = ["drop:p=0.3,item=lemon", "camera:front=black@2-"]
        [estimators]
        none = {}
        oracle = {}
        papers = { estimator = "vlm", vlm = "eye", instructions = "own.md", cameras = ["front"], abstention = false }
        small = { estimator = "vlm", vlm = "eye", translator = "none", instructions = false, calibration = "known" }
        [monitors]
        plain = {}
        doubtful = { alpha = 0.1, max_looks_again = 1, guard = false }
        [run]
        home_pose = false
        grasp_noise = 0.004
        max_replans = 9
        max_actions = 40
        max_looks_again = 2
    """
    made = read_campaign(written(tmp_path, text))
    assert (made.about, made.seeds, made.minutes) == ("Two lines", (7, 3), 0.5)
    assert [str(place) for place in made.places] == ["grocery/breakfast", "grocery/one-item"]
    names = [
        "none",
        "oracle, plain",
        "oracle, doubtful",
        "papers, plain",
        "papers, doubtful",
        "small, plain",
        "small, doubtful",
    ]
    assert [str(who) for who in made.configurations] == names
    assert made.size == 2 * 2 * 2 * 7 == len(list(made.episodes()))
    last = list(made.episodes())[-1]
    assert last.key == ("grocery", "one-item", "some", "small", "doubtful", "3")
    assert last.config.eye == EstimatorConfig(
        vlm=str(tmp_path / "eye"), translator="none", instructions=False, calibration=tmp_path / "known"
    )
    assert last.config.monitor == MonitorConfig(alpha=0.1)
    assert (last.config.max_looks_again, last.config.guard) == (1, False), "its own options go first"
    plain = next(episode for episode in made.episodes() if str(episode.configuration) == "small, plain")
    assert (plain.config.max_looks_again, plain.config.guard) == (2, True)
    assert made.configurations[1].monitor_config == PRESETS["plain"]
    options = (last.config.home_pose, last.config.grasp_noise, last.config.max_replans, last.config.max_actions)
    assert options == (False, 0.004, 9, 40)
    own = EstimatorConfig(str(tmp_path / "eye"), instructions="own.md", cameras=("front",), abstention=False)
    assert made.configurations[3].eye == own
    told = made.described()["contenders"]["papers, plain"]
    assert (told["eye"]["cameras"], told["eye"]["abstention"]) == (["front"], False)
    told = made.described()["contenders"]["small, doubtful"]
    assert told["eye"].keys().isdisjoint({"cameras", "abstention"}), "what is as it was before there was a choice"
    assert (told["eye"]["vlm"], told["eye"]["calibration"]) == ("eye", "known"), "no folder of one machine"


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 5), st.integers(1, 3))
def test_episodes_come_seed_by_seed_and_each_once(seeds: int, faults: int) -> None:
    made = campaign(seeds, faults=dict(list(FAULTS.items())[:faults]))
    episodes = list(made.episodes())
    assert len({episode.key for episode in episodes}) == len(episodes) == made.size
    assert [episode.seed for episode in episodes] == sorted(episode.seed for episode in episodes)
    assert all(len(episode.key) == len(KEYS) for episode in episodes)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("title = [", "some.toml: is not TOML"),
        ("seeds = 2", "some.toml: title: is missing"),
        (HEAD + "[fault]\n", "fault: unknown key; did you mean 'faults'?"),
        (HEAD.replace("domain =", "domian ="), "domains.0.domian: unknown key; did you mean 'domain'?"),
        (HEAD.replace("seeds = 2", 'seeds = "two"'), "seeds: should be a valid integer, got 'two'"),
        (HEAD.replace("seeds = 2", "seeds = 0"), "seeds: 0 is not a number of seeds from 1 on"),
        (HEAD.replace("seeds = 2", "seeds = [1, 1]"), "seeds: a list of different seeds from 0 on is expected"),
        (HEAD.replace("seeds = 2", "seeds = []"), "seeds: a list of different seeds"),
        (HEAD.replace("seeds = 2", "seeds = 2\nminutes = 0"), "minutes: should be greater than 0, got 0"),
        (HEAD.replace("seeds = 2", "seeds = 2\nminutes = inf"), "minutes: should be less than or equal to"),
        (HEAD.replace("seeds = 2", "seeds = 2\nminutes = nan"), "minutes: should be "),
        (HEAD.replace("seeds = 2", f"seeds = {'9' * 5_000}"), "is not TOML: a number of more than 4,300 digits"),
        (
            HEAD.replace("seeds = 2", "seeds = [0x7fffffffffffffffff]"),
            "seeds[0]: is not TOML: a number of more",
        ),
        (HEAD.replace(str(TRAY), "a" * 5_000), "no such folder, nor a shipped domain"),
        (HEAD.replace(str(TRAY), "a\\u0000b"), "no such folder, nor a shipped domain"),
        (HEAD + "problems = ['tea']\n", "there is no problem 'tea'"),
        (HEAD + f"[[domains]]\ndomain = '{TRAY}'\n", "domains.1: tray/fill-tray is named twice"),
        (HEAD + "[faults]\n", "faults: is empty; leave it out, or name one"),
        (HEAD + "[faults]\n'' = []\n", "faults: '' is no name of up to 60 characters"),
        (HEAD + "[faults]\nd = ['dropp@3']\n", "faults.d: in tray/fill-tray: fault 'dropp@3': no kind 'dropp'"),
        (HEAD + "[faults]\nd = ['drop@3:item=lemon']\n", "no item 'lemon'"),
        (HEAD + "[faults]\nd = 'drop@3'\n", "faults.d: should be a valid list, got 'drop@3'"),
        (HEAD + "[estimators]\noracel = {}\n", "estimators.oracel: say which estimator it is; did you mean 'oracle'?"),
        (HEAD + "[estimators]\noracle = { vlm = 'x' }\n", "estimators.oracle: 'oracle' asks no model"),
        (
            HEAD + "[estimators]\nvlm = { vlm = 'x', translator = 'lm' }\n",
            "estimators.vlm.translator: no translator 'lm'",
        ),
        (HEAD + "[monitors]\nplane = {}\n", "monitors.plane: say what it does, or name one of Executive's own"),
        (HEAD + "[monitors]\nx = { max_questions = 0 }\n", "monitors.x.max_questions: should be at least 1, got 0"),
        (HEAD + "[monitors]\nx = { alpha = 2.0 }\n", "monitors.x.alpha: should be above 0 and below 1, got 2"),
        (HEAD + "[run]\ngrasp_noise = 2.0\n", "run.grasp_noise: should be at least 0 and at most 1, got 2"),
        (HEAD + "[monitors]\nx = { alhpa = 0.1 }\n", "monitors.x.alhpa: unknown key; did you mean 'alpha'?"),
        (HEAD + "[monitors]\nx = { memory = 'yes' }\n", "monitors.x.memory: should be a valid boolean, got 'yes'"),
        (HEAD + "[run]\nseed = 3\n", "run.seed: unknown key"),
        (HEAD + "[run]\nmax_actions = 0\n", "run.max_actions: should be at least 1, got 0"),
        (HEAD.replace("seeds = 2", "seeds = 1000000") + "[estimators]\nnone = {}\noracle = {}\n", "makes 2,000,000"),
    ],
)
def test_a_mistake_is_one_line_with_its_key(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        read_campaign(written(tmp_path, text))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_model_may_have_any_name_until_it_is_loaded(tmp_path: Path) -> None:
    name = "a" * 300
    made = read_campaign(written(tmp_path, HEAD + f"[estimators]\nvlm = {{ vlm = '{name}' }}\n"))
    assert name in str(made.described())
    with pytest.raises(InputError, match="no such folder"):
        open_estimator(EstimatorConfig(vlm=name), load_subject(TRAY))


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.toml: there is no such file"):
        read_campaign(tmp_path / "nothing.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_campaign(tmp_path / "binary.toml")
    with pytest.raises(DomainError, match="no such folder, nor a shipped domain"):
        read_campaign(written(tmp_path, HEAD.replace(str(TRAY), "grozery")))


def test_a_model_is_asked_for_when_there_is_something_for_it_to_see(tmp_path: Path) -> None:
    made = read_campaign(written(tmp_path, HEAD + "[estimators]\noracle = {}\nvlm = {}\n"))
    episodes = list(made.episodes())
    check([episode for episode in episodes if str(episode.configuration) == "oracle"])
    with pytest.raises(InputError, match="--out tray-eye"):
        check(episodes)


def test_another_model_in_the_same_folder_is_told_apart(tmp_path: Path) -> None:
    assert model_digest(tmp_path / "nowhere") == ""
    (tmp_path / "model.safetensors").write_bytes(b"weights")
    first = model_digest(tmp_path)
    assert first == model_digest(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"Weights")
    assert model_digest(tmp_path) != first


@pytest.mark.parametrize("file", sorted((ROOT / "benchmarks" / "campaigns").glob("*.toml")), ids=lambda file: file.stem)
def test_campaigns_that_come_along_can_be_read(file: Path) -> None:
    made = read_campaign(file)
    assert made.size > 0
