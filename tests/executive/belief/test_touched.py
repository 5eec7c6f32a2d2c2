"""What was seen in a drawer is remembered while it is closed, and doubted once the drawer was seen to have moved
without the robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from executive.belief.bayes_filter import TOUCHED, BayesMonitor, BeliefState
from executive.belief.mutex_inference import Group, MutexNetwork
from executive.belief.sensor_model import EXACT
from executive.belief.state_space import StateSpace
from executive.types import Atom, Belief, Condition, Step, Visibility

LEFT, RIGHT = Atom("in", ("lemon", "left")), Atom("in", ("lemon", "right"))
OPEN_LEFT, OPEN_RIGHT = Atom("open", ("left",)), Atom("open", ("right",))
ATOMS = (LEFT, RIGHT, OPEN_LEFT, OPEN_RIGHT)
NETWORK = MutexNetwork(ATOMS, (Group((LEFT, RIGHT), True),))
SEEN = Visibility({LEFT: Condition.of({OPEN_LEFT: True}), RIGHT: Condition.of({OPEN_RIGHT: True})})
MONITOR = BayesMonitor(NETWORK, EXACT, visibility=SEEN)
LISTED = replace(
    MONITOR,
    space=StateSpace.of(
        ATOMS,
        [{place, *opened} for place in (LEFT, RIGHT) for opened in ((), [OPEN_LEFT], [OPEN_RIGHT], ATOMS[2:])],
    ),
)
SHUT_LEFT = Step.strips("shut", ("left",), {OPEN_LEFT: True}, {OPEN_LEFT: False})
ELSEWHERE = Step.strips("wave", ())


def told(
    memory: BeliefState, cycle: int, monitor: BayesMonitor = MONITOR, **answers: bool
) -> tuple[BeliefState, dict[Atom, float]]:
    """A look at drawers and at what is in the open ones, and what is believed after it."""
    names = {"left": LEFT, "right": RIGHT, "open_left": OPEN_LEFT, "open_right": OPEN_RIGHT}
    belief = Belief(cycle, {names[name]: float(value) for name, value in answers.items()})
    memory, judgement = monitor.looked(memory, belief, cycle)
    return memory, dict(judgement.probability)


def with_the_lemon_seen_left(monitor: BayesMonitor = MONITOR) -> BeliefState:
    memory = monitor.begin()
    for cycle in range(3):
        memory, found = told(
            monitor.acted(memory, ELSEWHERE), cycle, monitor, left=True, open_left=True, open_right=False
        )
    assert found[LEFT] > 0.98
    return memory


def shut(step: Step, monitor: BayesMonitor) -> dict[Atom, float]:
    """What is believed one more action after the left drawer was seen to be closed after `step`."""
    memory = with_the_lemon_seen_left(monitor)
    memory, _ = told(monitor.acted(memory, step), 3, monitor, open_left=False, open_right=False)
    return told(monitor.acted(memory, ELSEWHERE), 4, monitor, open_left=False, open_right=False)[1]


def test_what_is_in_a_drawer_is_doubted_where_somebody_else_shut_it() -> None:
    own, others = (shut(step, MONITOR) for step in (SHUT_LEFT, ELSEWHERE))
    assert own[LEFT] > 0.95
    assert own[LEFT] - others[LEFT] == pytest.approx(0.5 * TOUCHED, abs=0.03)  # half of the doubt is that it is there
    assert others[RIGHT] == pytest.approx(1.0 - others[LEFT], abs=0.01)
    assert others[LEFT] > 0.8  # it is still the first place to look


def test_over_listed_states_it_is_doubted_too() -> None:
    own, others = (shut(step, LISTED) for step in (SHUT_LEFT, ELSEWHERE))
    assert own[LEFT] > 0.9
    assert others[LEFT] < own[LEFT] - 0.5 * TOUCHED


def test_what_is_in_view_elsewhere_is_not_doubted() -> None:
    memory = MONITOR.begin()
    for cycle in range(3):
        state = MONITOR.acted(memory, ELSEWHERE)
        memory, _ = told(state, cycle, left=False, right=True, open_left=True, open_right=True)
    memory, _ = told(MONITOR.acted(memory, ELSEWHERE), 3, open_left=False, open_right=True, right=True)
    _, found = told(MONITOR.acted(memory, ELSEWHERE), 4, open_left=False, open_right=True)
    assert found[RIGHT] > 0.95


def test_a_doubt_comes_once_and_not_again_at_each_action() -> None:
    memory, _ = told(MONITOR.acted(with_the_lemon_seen_left(), ELSEWHERE), 3, open_left=False, open_right=False)
    found = []
    for cycle in (4, 5, 6):
        memory, probability = told(MONITOR.acted(memory, ELSEWHERE), cycle, open_left=False, open_right=False)
        found.append(probability[LEFT])
    assert found[0] - found[2] < 0.03
