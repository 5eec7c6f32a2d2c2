"""What a look asks about is bounded and comes in the order of what matters; what tells nothing is not looked at."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.core.attention import Attention, questions, same_view, uninformative
from executive.types import Atom, Image, PictureFault
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
        matters = (pick("t0", "p1").unconditional, put("t0", "p0").precondition.facts, goal)
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


@given(st.sets(st.sampled_from(["hand", "left", "top", "side", "front"]), min_size=1))
def test_through_some_cameras_alone_nothing_is_shown_by_others(shown: set[str]) -> None:
    attention = Attention(closer={"held": ("hand",), "q": ("left", "top"), "a": ("side",)}, guard=("front", "hand"))
    only = attention.only(sorted(shown))
    assert set(only.shown) == shown
    assert {camera for best in only.closer.values() for camera in best} | set(only.guard) <= shown
    assert only.closer == {
        name: tuple(each for each in best if each in shown)
        for name, best in attention.closer.items()
        if shown & set(best) and not shown <= set(best)
    }, "what all of them show is shown best by none"


def test_what_is_carried_is_known_of_the_actions_that_say_so() -> None:
    assert WATCHED.held(pick("a", "p")) == WATCHED.held(put("a", "q")) == held("a")
    assert Attention().held(pick("a", "p")) is None


def picture(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (8, 8, 3), dtype=np.uint8)


BLACK = np.zeros((8, 8, 3), dtype=np.uint8)


def test_a_picture_of_one_colour_tells_nothing() -> None:
    grey = np.full((8, 8, 3), 127, dtype=np.uint8)
    dim = grey + np.arange(8, dtype=np.uint8)[:, None, None] * 2
    assert uninformative({"a": BLACK, "b": grey, "c": dim}, {}) == {"a": PictureFault.PLAIN, "b": PictureFault.PLAIN}


def test_the_same_picture_once_more_is_frozen_until_it_changes() -> None:
    before = {"a": picture(1), "b": picture(2)}
    now = {"a": before["a"].copy(), "b": before["b"] ^ np.uint8(1), "c": picture(3)}
    assert uninformative(now, before) == {"a": PictureFault.FROZEN}
    assert uninformative(now, {}) == {}, "nothing to hold it against"
    assert uninformative({"a": picture(5)}, before) == {}
    assert uninformative({"a": BLACK}, {"a": BLACK}) == {"a": PictureFault.PLAIN}


@given(st.integers(0, 99), st.integers(1, 40), st.integers(1, 40))
def test_noise_makes_no_other_picture_and_what_is_moved_does(seed: int, height: int, width: int) -> None:
    chance = np.random.default_rng(seed)
    one = np.full((height, width, 3), 100, dtype=np.uint8)
    noisy = one ^ chance.integers(0, 2, one.shape, dtype=np.uint8)
    assert same_view({"a": one}, {"a": noisy})
    assert not same_view({"a": one}, {"b": one})
    assert not same_view({"a": one}, {"a": one, "b": one})
    assert not same_view({"a": one}, {"a": one[1:]})
    moved = one.copy()
    row, column = int(chance.integers(height)), int(chance.integers(width))
    moved[row : row + 3, column : column + 3] = 0
    assert same_view({"a": one}, {"a": moved}) == (one.size > 0 and np.array_equal(one, moved))
