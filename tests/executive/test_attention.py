"""What a look asks about is bounded and comes in the order of what matters; what tells nothing is not looked at."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.attention import FROZEN, PLAIN, Attention, questions, useless
from executive.types import Atom, Image
from tests.fakes import FREE, WATCHED, at, held, pick, put

ATOMS = tuple(sorted(at(thing, place) for thing in "abcdef" for place in "pqrs"))
groups = st.lists(st.sampled_from(ATOMS), max_size=6)
chances = st.dictionaries(st.sampled_from(ATOMS), st.floats(0, 1))


@given(st.tuples(groups, groups, groups), chances, st.integers(1, 30))
def test_questions_are_bounded_and_none_comes_twice(
    matters: tuple[list[Atom], ...], probability: dict[Atom, float], most: int
) -> None:
    asked = questions(ATOMS, matters, probability, most)
    assert len(asked) == len(set(asked)) <= min(most, len(ATOMS))
    assert set(asked) <= set(ATOMS)
    if most >= len(ATOMS):
        assert asked == ATOMS
    else:
        first = tuple(dict.fromkeys((*matters[0], *matters[1])))[:most]
        assert asked[: len(first)] == first, "what the step changed and what the next one needs come first"


@given(st.tuples(groups, groups, groups), chances, st.integers(1, 22))
def test_what_is_in_doubt_comes_before_the_goal_and_the_most_doubtful_first(
    matters: tuple[list[Atom], ...], probability: dict[Atom, float], most: int
) -> None:
    asked = questions(ATOMS, matters, {**dict.fromkeys(ATOMS, 0.0), **probability}, most)
    rest = [atom for atom in asked if atom not in (*matters[0], *matters[1])]
    doubt = [abs(probability.get(atom, 0.0) - 0.5) for atom in rest]
    doubtful = [value for value in doubt if value < 0.48]
    assert doubt[: len(doubtful)] == sorted(doubtful)


def test_questions_grow_with_the_step_and_the_goal_and_not_with_their_product() -> None:
    for count in (10, 20, 40):
        things, places = [f"t{n}" for n in range(count)], [f"p{n}" for n in range(count)]
        atoms = (*(at(thing, place) for thing in things for place in places), *map(held, things), FREE)
        goal = [at(thing, places[0]) for thing in things]
        matters = (pick("t0", "p1").effects, put("t0", "p0").preconditions, goal)
        asked = questions(atoms, matters, dict.fromkeys(atoms, 0.0), 60)
        assert len(asked) == count + 3


def test_an_atom_is_shown_best_by_the_cameras_of_its_predicate_else_of_its_arguments() -> None:
    attention = Attention(closer={"held": ("hand",), "q": ("left", "top"), "a": ("side",)})
    assert attention.cameras(held("a")) == ("hand",)
    assert attention.cameras(at("a", "q")) == ("side",)
    assert attention.cameras(at("b", "q")) == ("left", "top")
    assert attention.cameras(FREE) == ()
    assert attention.groups([FREE, at("b", "q"), held("b"), at("c", "q")]) == {
        (): [FREE],
        ("left", "top"): [at("b", "q"), at("c", "q")],
        ("hand",): [held("b")],
    }


def test_what_is_carried_is_known_of_the_actions_that_say_so() -> None:
    assert WATCHED.held(pick("a", "p")) == WATCHED.held(put("a", "q")) == held("a")
    assert Attention().held(pick("a", "p")) is None


def test_a_step_is_witnessed_by_the_cameras_of_its_objects_and_by_those_of_none() -> None:
    attention = Attention(closer={"p": ("left",), "q": ("right",), "held": ("hand",)})
    assert attention.witnesses(pick("a", "p"), ["front", "left", "right", "hand"]) == {"front", "left"}


def picture(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (8, 8, 3), dtype=np.uint8)


BLACK = np.zeros((8, 8, 3), dtype=np.uint8)


def test_a_picture_of_one_colour_tells_nothing() -> None:
    grey = np.full((8, 8, 3), 127, dtype=np.uint8)
    dim = grey + np.arange(8, dtype=np.uint8)[:, None, None] * 2
    assert useless({"a": BLACK, "b": grey, "c": dim}, {}, (), False) == {"a": PLAIN, "b": PLAIN}


def test_a_picture_that_ought_to_have_changed_and_did_not_is_frozen() -> None:
    before = {"a": picture(1), "b": picture(2), "c": picture(3)}
    now = {**before, "b": picture(4)}
    assert useless(now, before, {"a", "b"}, False) == {"a": FROZEN}, "c may well have stayed as it was"
    assert useless(now, before, (), False) == {}
    assert useless(now, {}, {"a", "b"}, False) == {}, "nothing to hold it against"


def test_nothing_is_frozen_where_nothing_may_have_happened() -> None:
    before = {"a": picture(1), "b": picture(2)}
    assert useless(before, before, {"a", "b"}, False) == {}
    assert useless(before, before, {"a", "b"}, True) == {"a": FROZEN, "b": FROZEN}, "the arm is elsewhere, unseen"
    assert useless({"a": before["a"], "b": BLACK}, before, {"a"}, False) == {"b": PLAIN}


def test_what_was_frozen_stays_so_until_it_changes() -> None:
    before = {"a": picture(1), "b": picture(2)}
    assert useless(before, before, (), False, frozen=("a",)) == {"a": FROZEN}
    assert useless({**before, "a": picture(5)}, before, (), False, frozen=("a",)) == {}
