"""A monitor comes back as it was kept."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.belief import (
    ActionModel,
    BayesMonitor,
    Chances,
    ConstrainedNetwork,
    ErrorModel,
    Monitor,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
)
from executive.errors import InputError
from executive.trace.record import monitor_file
from executive.types import Atom, Condition, DerivedRules, SkillStatus
from tests.executive.belief import piles
from tests.executive.belief.hands import ATOMS, GROUPS
from tests.fakes import at

shares = st.floats(0.01, 0.49)
error_models = st.builds(ErrorModel, shares, shares, st.floats(0, 5), st.floats(-5, 5))
thresholds = st.tuples(st.floats(0, 0.5), st.floats(0.5, 2)).map(lambda pair: Thresholds(*pair))
actions = st.builds(
    ActionModel,
    st.dictionaries(
        st.tuples(st.sampled_from(["pick", "place"]), st.sampled_from(SkillStatus)),
        st.tuples(*[st.integers(0, 99)] * 3).map(lambda counts: Chances(*counts)),
        max_size=3,
    ),
    shares,
)
fused = st.builds(
    BayesMonitor,
    st.sampled_from([MutexNetwork(ATOMS, GROUPS), MutexNetwork(ATOMS)]),
    st.builds(
        SensorModel,
        st.dictionaries(st.sampled_from(["at", "held"]), error_models),
        error_models,
        shares,
        shares,
        st.dictionaries(st.sampled_from(ATOMS), error_models, max_size=2),
        st.dictionaries(st.sampled_from(["at", "held"]), shares),
    ),
    st.none() | actions,
    st.dictionaries(st.sampled_from(["at", "held", "free"]), thresholds),
    st.dictionaries(st.sampled_from(["pick", "place"]), st.just(("held", (0,)))),
)
plain = st.builds(ThresholdMonitor, st.just(ATOMS), thresholds)


@settings(max_examples=40, deadline=None)
@given(monitor=plain | fused)
def test_a_monitor_comes_back_as_it_was(tmp_path_factory: pytest.TempPathFactory, monitor: Monitor) -> None:
    folder = tmp_path_factory.mktemp("run")
    monitor_file.save(folder, monitor)
    again = monitor_file.load(folder, ATOMS)
    assert monitor_file.described(again) == monitor_file.described(monitor)
    if isinstance(monitor, ThresholdMonitor):
        assert again == monitor
        return
    assert isinstance(monitor, BayesMonitor)
    assert isinstance(again, BayesMonitor)
    assert (again.network.atoms, again.network.groups) == (monitor.network.atoms, monitor.network.groups)
    assert (again.sensor_model, again.thresholds) == (monitor.sensor_model, monitor.thresholds)
    assert (again.actions, again.carried) == (monitor.actions, monitor.carried)


def test_listed_states_come_back_with_what_follows_from_them(tmp_path: Path) -> None:
    network = MutexNetwork(piles.ATOMS)
    rules = DerivedRules({Atom("any"): Condition.literal(piles.top("a")) | Condition.literal(piles.top("b"))})
    space = replace(piles.listed(), rules=rules)
    monitor_file.save(tmp_path, BayesMonitor(network, space=space))
    again = monitor_file.load(tmp_path, piles.ATOMS)
    assert isinstance(again, BayesMonitor)
    assert again.space is not None
    assert np.array_equal(again.space.packed, space.packed)
    assert (again.space.atoms, again.space.rules) == (space.atoms, rules)
    kept = json.loads((tmp_path / monitor_file.FILE).read_text())
    for states in ("not base64!", kept["states"][:20], base64.b64encode(b"plain").decode(), _bomb(), _rows(b"\1\0")):
        (tmp_path / monitor_file.FILE).write_text(json.dumps({**kept, "states": states}))
        with pytest.raises(InputError, match="is damaged"):
            monitor_file.load(tmp_path, piles.ATOMS)


def test_what_every_state_keeps_and_what_accidents_break_come_back(tmp_path: Path) -> None:
    hard = Condition.literal(piles.top("a")) | Condition.literal(piles.top("b"))
    costly = Condition.literal(piles.top("c"), False) | Condition.literal(piles.at("c", "s"))
    network = ConstrainedNetwork(piles.ATOMS, (), (hard,), (costly,))
    monitor_file.save(tmp_path, BayesMonitor(network))
    again = monitor_file.load(tmp_path, piles.ATOMS)
    assert isinstance(again, BayesMonitor)
    assert isinstance(again.network, ConstrainedNetwork)
    assert (again.network.constraints, again.network.costly) == ((hard,), (costly,))
    assert again.network.solve({}) == network.solve({})


def _bomb() -> str:
    return base64.b64encode(zlib.compress(bytes(300_000_000), 9)).decode()


def _rows(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data)).decode()


def test_a_monitor_of_ones_own_is_not_kept(tmp_path: Path) -> None:
    class Own:
        """Hands on to another one."""

        def __init__(self) -> None:
            inner = ThresholdMonitor(ATOMS)
            self.begin, self.acted, self.looked = inner.begin, inner.acted, inner.looked
            self.state_without, self.state_with = inner.state_without, inner.state_with
            self.supposing = inner.supposing

    assert monitor_file.save(tmp_path, Own()) is None
    assert monitor_file.described(Own()) == "Own"
    with pytest.raises(InputError, match="is missing"):
        monitor_file.load(tmp_path, ATOMS)


def test_a_monitor_of_a_former_version_is_read(tmp_path: Path) -> None:
    """The keys in the file stay, whatever the fields are called in the program."""
    kept = {"false_alarms": 0.1, "misses": 0.2, "slope": 1.5, "bias": 0.5}
    eye = {"readings": {"at": kept}, "other": kept, "alike": 0.3, "lasting": 0.7, "atoms": {"at(cup,desk)": kept}}
    former = {"format": 1, "kind": "fused", "groups": [], "eye": eye, "thresholds": {}, "unrest": 0.06, "counts": {}}
    (tmp_path / monitor_file.FILE).write_text(json.dumps(former))
    monitor = monitor_file.load(tmp_path, ATOMS)
    assert isinstance(monitor, BayesMonitor)
    model = ErrorModel(**kept)
    assert monitor.sensor_model == SensorModel({"at": model}, model, 0.3, 0.7, {at("cup", "desk"): model})
    assert monitor.actions is not None
    assert monitor.actions.process_noise == 0.06
