"""Random problems: legal, different from their starts, the same for the same seed, within a subset's bounds."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

from executive.domain.loader import Domain, load_domain
from executive.errors import DomainError, InputError, OptionError
from executive.lab.config import CollectConfig
from executive.lab.problems import ProblemMaker, write
from executive.types import Atom


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[Domain]:
    out = tmp_path_factory.mktemp("made")
    files = write(list(ProblemMaker("blocksworld", 2, 10, seed=7).problems(15)), out)
    return [load_domain("blocksworld", str(file)) for file in files]


def above(atoms: frozenset[Atom]) -> dict[str, str]:
    return {atom.args[1]: atom.args[0] for atom in atoms if atom.predicate == "on"}


def test_starts_and_goals_are_legal_states_that_differ(made: list[Domain]) -> None:
    sizes = set()
    for domain in made:
        task = domain.task
        sizes.add(len(task.objects))
        goal = task.goal.literals
        assert goal is not None
        assert not goal.true <= task.declared
        for state in (task.declared, goal.true):
            standing = [atom.args[0] for atom in state if atom.predicate in ("on", "on-table")]
            assert sorted(standing) == sorted(task.objects), "each block stands on one thing"
            upon = above(state)
            assert len(upon) == sum(atom.predicate == "on" for atom in state), "and carries one at most"
            for base in (atom.args[0] for atom in state if atom.predicate == "on-table"):
                tower = [base]
                while tower[-1] in upon:
                    tower.append(upon[tower[-1]])
                assert len(tower) <= 5
                assert not any(block.endswith("sphere") for block in tower[:-1])
    assert min(sizes) >= 2
    assert max(sizes) > 6


def test_a_problem_depends_on_seed_and_number_alone() -> None:
    first = list(ProblemMaker("blocksworld", 4, 4, seed=1).problems(3))
    assert list(ProblemMaker("blocksworld", 4, 4, seed=1).problems(2)) == first[:2]
    assert next(ProblemMaker("blocksworld", 4, 4, seed=2).problems(1)) != first[0]


@pytest.mark.parametrize(
    ("subset", "alike"),
    [("no-colour-conflict", (1,)), ("no-colour-size-conflict", (0, 1)), ("no-colour-shape-conflict", (1, 3))],
)
def test_subsets_leave_conflicts_out(subset: str, alike: tuple[int, ...]) -> None:
    for problem in ProblemMaker("blocksworld", 8, 10, seed=3, subset=subset).problems(3):
        words = [name.split("-") for name in problem.objects]
        assert not any(all(one[i] == other[i] for i in alike) for one, other in combinations(words, 2))


def test_a_subset_of_one_material_has_no_other() -> None:
    problems = ProblemMaker("blocksworld", 6, 6, seed=3, subset="metal-only").problems(3)
    assert all("-metal-" in name for problem in problems for name in problem.objects)


def test_what_is_held_out_is_in_no_problem_or_in_each() -> None:
    def odd(name: str) -> bool:
        _, colour, _, shape = name.split("-")
        return (colour, shape) in HELD_OUT

    seen, held_out = (
        ProblemMaker("blocksworld", 3, 5, 3, combinations=each).problems(6) for each in ("seen", "held-out")
    )
    assert not any(odd(name) for problem in seen for name in problem.objects)
    assert all(any(odd(name) for name in problem.objects) for problem in held_out)
    with pytest.raises(OptionError, match="combinations"):
        CollectConfig("blocksworld", Path("out"), combinations="seen")
    with pytest.raises(OptionError, match="did you mean 'seen'"):
        CollectConfig("blocksworld", Path("out"), objects="3", combinations="sean")


HELD_OUT = {
    ("brown", "cube"),
    ("cyan", "cube"),
    ("gray", "cylinder"),
    ("red", "cylinder"),
    ("yellow", "sphere"),
    ("blue", "sphere"),
}


def test_what_cannot_be_made_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="did you mean 'rubber-only'"):
        ProblemMaker("blocksworld", 2, 3, 0, "rubber-olny")
    with pytest.raises(OptionError, match="there are only 10"):
        ProblemMaker("blocksworld", 2, 11, 0, "no-colour-conflict")
    with pytest.raises(DomainError, match=r"problems\.toml: there is no such file"):
        ProblemMaker("grocery", 2, 3, 0)
    problems = list(ProblemMaker("blocksworld", 2, 2, 0).problems(1))
    write(problems, tmp_path)
    with pytest.raises(InputError, match="is there already"):
        write(problems, tmp_path)
