"""The learned pick: the loop gets a policy to its goal that fails now and then, and another one can be trained."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from examples.learned_pick import train
from executive import RunConfig, run
from executive.errors import OptionError
from executive.lab.collection.demonstrations import Demonstration, Located, Sample
from executive.skills.policy import NetworkPolicy
from executive.trace.record.log import read_events
from executive.types import Phase, SkillResult
from tests.conftest import ROOT

POLICY = ROOT / "examples" / "learned_pick" / "pick.safetensors"


@pytest.mark.parametrize("seed", [3, 12])
def test_a_run_with_the_policy_reaches_its_goal(seed: int, tmp_path: Path) -> None:
    config = RunConfig(
        "grocery",
        problem="one-item",
        seed=seed,
        estimator="oracle",
        policies=(f"pick={POLICY}",),
        grasp_noise=0.005,
        runs=tmp_path,
        name="learned",
        viewer=False,
    )
    assert run(config)["goal_true"]
    payloads = [event.payload for event in read_events(tmp_path / "learned", images=False)]
    assert any(isinstance(each, Phase) and "policy" in each.detail for each in payloads)
    assert {each.step.action for each in payloads if isinstance(each, SkillResult)} == {"pick", "place"}


@pytest.mark.parametrize("said", ["push={file}", "pick", "={file}", "pick={file}.none"])
def test_what_is_no_policy_of_an_action_is_refused_before_anything_is_made(said: str, tmp_path: Path) -> None:
    from executive import InputError
    from executive.app.run import Run

    with pytest.raises((OptionError, InputError)):
        Run(
            RunConfig(
                "grocery",
                estimator="oracle",
                policies=(said.format(file=POLICY),),
                runs=tmp_path / "runs",
                viewer=False,
            )
        )
    assert not list(tmp_path.rglob("config.toml"))


def test_the_file_is_small_and_says_how_it_was_made() -> None:
    about = NetworkPolicy(POLICY).about
    assert POLICY.stat().st_size < 1_000_000
    assert about["action"] == "pick"
    assert about["collected"].startswith("executive collect ")


def demonstration() -> Demonstration:
    """A straight way down to an item, a grip and a lift, made up."""
    down = np.array([1.0, 0.0, 0.0, 0.0])[[1, 0, 2, 3]]  # half a turn about x: the hand looks down
    heights = [0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.1]
    phases = ["approach"] * 4 + ["grip"] * 3 + ["lift"]
    samples = tuple(
        Sample(
            0.1 * at,
            np.zeros(6),
            0.085 if at < 5 else 0.05,
            np.array([0.5, 0.0, height, *down]),
            np.array([0, 0, 0, 0, 0, 0, float(at > 4)]),
            phase,
            np.zeros(7),
        )
        for at, (height, phase) in enumerate(zip(heights, phases, strict=True))
    )
    item = np.array([0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    located = (Located(0.0, "thing", item, np.zeros(3), np.full(3, 0.03)),)
    return Demonstration(0, 1, "pick(thing,table)", (), samples, located)


def test_moments_say_where_the_hand_goes_next_from_where_it_was_and_from_beside() -> None:
    taken = list(train.moments(demonstration(), np.random.default_rng(0)))
    assert len(taken) == 7 * (train.COPIES + 1)
    as_it_was = taken[:: train.COPIES + 1]
    assert as_it_was[0].features[:3] == pytest.approx([0, 0, 0.3])  # the item, in the frame of a hand that looks down
    assert as_it_was[0].motion == pytest.approx([0, 0, 0.1, 0, 0, 0])
    assert as_it_was[-1].motion == pytest.approx([0, 0, -0.1, 0, 0, 0])
    assert [each.closes for each in as_it_was] == [False, False, True, True, True, True, True]
    for copy in taken[1 : train.COPIES + 1]:  # from beside, on to the same place
        there = copy.features[:3] - copy.motion[:3]
        assert np.linalg.norm(there) == pytest.approx(0.2, abs=0.02)
        assert copy.motion[:3] != pytest.approx([0, 0, 0.1])


def test_another_grip_in_it_is_no_demonstration() -> None:
    one = demonstration()
    twice = Demonstration(0, 1, one.action, (), one.samples * 2, one.located)
    assert list(train.moments(twice, np.random.default_rng(0))) == []


def test_what_is_trained_is_a_policy_that_imitates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from safetensors.torch import save_file

    monkeypatch.setattr(train, "EPOCHS", 150)
    taken = list(train.moments(demonstration(), np.random.default_rng(0)))
    tensors = train.fit(taken, 0)
    tensors["motion.noise"] *= 0.0
    file = tmp_path / "policy.safetensors"
    save_file(tensors, file, {"executive": '{"format": "executive-policy-1", "action": "pick", "period": 0.1}'})
    policy = NetworkPolicy(file)
    for each in taken[: 4 * (train.COPIES + 1) : train.COPIES + 1]:  # later ones, with the fingers closed, look alike
        motion, closes = policy.act(each.features, np.random.default_rng(0))
        assert motion[:3] == pytest.approx(each.motion[:3], abs=0.02)
        assert closes is each.closes
