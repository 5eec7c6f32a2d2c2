"""The grammar of faults, when they strike, and that their chance depends on nothing but seed, place and action."""

from __future__ import annotations

import re
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.errors import InputError
from executive.faults import KINDS, Fault, FaultInjector, parse_fault
from executive.types import FaultInjected, Phase
from tests.fakes import FakeWorld, pick, put

kinds = st.sampled_from(sorted(KINDS))
items = st.none() | st.from_regex(r"[A-Za-z][A-Za-z0-9_\-]{0,8}", fullmatch=True)
faults = st.builds(Fault, kinds, st.integers(1, 10**6), st.none(), items) | st.builds(
    Fault, kinds, st.none(), st.floats(0.0, 1.0), items
)


@given(faults)
def test_a_fault_is_read_back_as_it_was_printed(fault: Fault) -> None:
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize(
    ("spec", "fault"),
    [
        ("drop@4", Fault("drop", 4)),
        (" drop:p=0.3 ", Fault("drop", chance=0.3)),
        ("drop: p = .3 , item = lemon", Fault("drop", chance=0.3, item="lemon")),
        ("miss@2", Fault("miss", 2)),
        ("shove@3:item=lemon", Fault("shove", 3, item="lemon")),
        ("miss:p=1", Fault("miss", chance=1.0)),
        ("miss:p=5e-2", Fault("miss", chance=0.05)),
    ],
)
def test_what_the_command_line_takes(spec: str, fault: Fault) -> None:
    assert parse_fault(spec) == fault


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "it names no kind"),
        ("drp@4", "no kind 'drp', did you mean 'drop'?"),
        ("drop", "say when: drop@4"),
        ("drop@", "the number of an action"),
        ("drop@0", "counted from 1, not '0'"),
        ("drop@-1", "not '-1'"),
        ("drop@4.5", "not '4.5'"),
        ("drop@٣", "the number of an action"),
        ("drop@4@5", "not '4@5'"),
        ("drop@9999999999", "the number of an action"),
        ("drop:", "nothing after it"),
        ("drop:p=0.3,", "nothing after it"),
        ("drop:p", "p has no value"),
        ("drop:p=", "p has no value"),
        ("drop:p=0.3,p=0.4", "p is given twice"),
        ("drop:p=1.01", "from 0 to 1, not '1.01'"),
        ("drop:p=-0.1", "from 0 to 1"),
        ("drop:p=nan", "from 0 to 1"),
        ("drop:p=1e9", "from 0 to 1"),
        ("drop:p=e-3", "from 0 to 1"),
        ("drop:p=.", "from 0 to 1"),
        ("drop:p=1_0e-2", "from 0 to 1"),
        ("drop:q=0.3", "no argument 'q', valid: item, p"),
        ("drop:itm=lemon,p=0.1", "did you mean 'item'?"),
        ("drop@4:item=a b", "'a b' is no name of an item"),
        ("drop@4:p=0.3", "and not both"),
        ("shove@3:item=lemmon", "no item 'lemmon', did you mean 'lemon'?"),
    ],
)
def test_a_mistake_is_answered_in_one_line_with_what_would_be_right(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        parse_fault(spec, items=["lemon", "milk"])
    line = str(caught.value)
    assert repr(spec) in line
    assert "drop@4" in line
    assert "\n" not in line


@given(st.text(max_size=40) | st.from_regex(r"(drop|miss)[@:,=.0-9pitem]{0,12}", fullmatch=True))
def test_any_text_is_a_fault_or_bad_input(text: str) -> None:
    try:
        fault = parse_fault(text)
    except InputError:
        return
    assert parse_fault(str(fault)) == fault


STEPS = (pick("lemon", "p"), put("lemon", "q"), pick("milk", "p"), put("milk", "q"))


class Play:
    """Actions as the loop would announce them, on a world whose clock is moved by hand."""

    def __init__(self, *specs: str, seed: int = 0) -> None:
        self.world = FakeWorld({"lemon": "hand", "milk": "p"}, ["p", "q", "r"])
        self.injector = FaultInjector([parse_fault(spec) for spec in specs], self.world, seed)
        self.reports: list[tuple[float, FaultInjected]] = []

    def report(self, fault: FaultInjected) -> None:
        self.reports.append((self.world.time, fault))

    def act(self, action: int, transfer: float = 10.0, passes: float = 10.0) -> list[tuple[float, FaultInjected]]:
        """One action, of which `passes` seconds of its transfer happen; the faults with the time into the transfer."""
        step, before = STEPS[(action - 1) % 4], len(self.reports)
        self.injector.before_action(action, step, self.report)
        self.world.advance(5.0)
        start = self.world.time
        for name, seconds in (("approach", 5.0), ("transfer", transfer), ("transfer", transfer)):
            self.injector.on_phase(action, step, Phase(name, seconds=seconds), self.report)
        self.world.advance(passes)
        self.injector.after_action(action, step, self.report)
        return [(time - start, fault) for time, fault in self.reports[before:]]


def test_a_drop_happens_once_in_mid_transfer_of_its_action() -> None:
    play = Play("drop@2")
    assert play.act(1) == []
    ((time, fault),) = play.act(2)
    assert 2.5 <= time <= 7.5
    assert (fault.kind, fault.spec, fault.action) == ("drop", "drop@2", 2)
    assert fault.detail.startswith("lemon went to ")
    assert play.act(3) == []


def test_a_drop_never_outlives_its_action() -> None:
    play = Play("drop@1")
    assert play.act(1, passes=1.0) == []
    assert play.act(2, passes=100.0) == []
    assert play.world.held == "lemon"


def test_a_miss_is_prepared_before_the_action_and_a_shove_follows_it() -> None:
    play = Play("miss@1", "shove@2:item=milk")
    ((time, miss),) = play.act(1)
    assert (time, miss.kind, play.world.missing) == (-5.0, "miss", True)
    ((time, shove),) = play.act(2)
    assert (time, shove.kind, shove.detail) == (10.0, "shove", f"milk went to {play.world.where['milk']}")
    assert play.world.where["milk"] != "p"


def test_an_item_picks_the_actions_that_have_to_do_with_it() -> None:
    play = Play("miss:p=1,item=milk")
    assert [len(play.act(action)) for action in range(1, 9)] == [0, 0, 1, 1, 0, 0, 1, 1]
    assert len(Play("miss@1:item=milk").act(1)) == 0


@given(st.integers(0, 2**63), st.lists(st.sampled_from(["drop:p=0.4", "miss:p=0.4", "shove:p=0.4"]), max_size=3))
def test_the_same_seed_breaks_the_same_actions_whatever_happened_before(seed: int, specs: list[str]) -> None:
    def struck(play: Play, actions: list[int]) -> set[tuple[int, str]]:
        return {(action, fault.spec) for action in actions for _, fault in play.act(action)}

    whole, part = Play(*specs, seed=seed), Play(*specs, seed=seed)
    part.world.advance(3.0)
    assert struck(part, [5, 6, 8]) == {hit for hit in struck(whole, list(range(1, 9))) if hit[0] in (5, 6, 8)}


def test_chance_comes_as_often_as_it_should_and_differs_from_fault_to_fault() -> None:
    play = Play("miss:p=0.3", "miss:p=0.3", seed=5)
    hits: Counter[int] = Counter()
    both = 0
    for action in range(1, 1001):
        count = len(play.act(action))
        hits[count] += 1
        both += count == 2
    struck = hits[1] + 2 * hits[2]
    assert 520 <= struck <= 680, "600 expected, standard deviation 20"
    assert 60 <= both <= 120, "independent faults coincide in 9 % of actions"
    assert sum(len(Play("miss:p=0", seed=1).act(action)) for action in range(1, 100)) == 0


def test_an_argument_that_the_world_does_not_know_is_bad_input() -> None:
    with pytest.raises(InputError, match="no thing 'pear'"):
        Play("shove@1:item=pear").act(1)
