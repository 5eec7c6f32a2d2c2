"""A monitor comes back as it was kept."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.belief import (
    ActionModel,
    BayesMonitor,
    Chances,
    ErrorModel,
    Monitor,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
)
from executive.errors import InputError
from executive.trace.record import monitor_file
from executive.types import SkillStatus
from tests.executive.belief.hands import ATOMS, GROUPS

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
    assert (again.eye, again.thresholds) == (monitor.eye, monitor.thresholds)
    assert (again.actions, again.carried) == (monitor.actions, monitor.carried)


def test_a_monitor_of_ones_own_is_not_kept(tmp_path: Path) -> None:
    class Own:
        """Hands on to another one."""

        def __init__(self) -> None:
            inner = ThresholdMonitor(ATOMS)
            self.begin, self.acted, self.looked = inner.begin, inner.acted, inner.looked
            self.otherwise, self.supposing = inner.otherwise, inner.supposing

    assert monitor_file.save(tmp_path, Own()) is None
    assert monitor_file.described(Own()) == "Own"
    with pytest.raises(InputError, match="is missing"):
        monitor_file.load(tmp_path, ATOMS)
