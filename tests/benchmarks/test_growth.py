"""How a stage grows is read off its values."""

from __future__ import annotations

import pytest

from benchmarks.budget.growth import STAGES, growths, printed

SIZES = (10, 100, 1_000)


def rows(**powers: float) -> list[dict[str, float]]:
    """Rows in which the stages grow by these powers of the atoms, linearly unless one is told."""
    return [{"atoms": size, **{stage: 1e-3 * size ** powers.get(stage, 1.0) for stage in STAGES}} for size in SIZES]


def test_exponents_are_those_of_the_powers() -> None:
    found = {each.stage: each for each in growths(rows(belief=2.0, search=3.0, event=0.5))}
    assert found.keys() == STAGES.keys()
    assert found["belief"].exponent == pytest.approx(2.0)
    assert found["belief"].last == pytest.approx(2.0)
    assert found["event"].exponent == pytest.approx(0.5)
    assert (found["belief"].kept, found["event"].kept, found["look"].kept) == (False, True, True)
    assert found["search"].kept is None, "it is not ours"


def test_what_is_constant_at_first_is_judged_by_its_last_step() -> None:
    three = rows()
    for row, seconds in zip(three, (1.0, 1.0, 100.0), strict=True):
        row["belief"] = seconds
    belief = next(each for each in growths(three) if each.stage == "belief")
    assert belief.exponent == pytest.approx(1.0)
    assert belief.last == pytest.approx(2.0)
    assert belief.kept is False


def test_what_takes_no_time_is_left_out_and_the_others_are_a_line_each() -> None:
    three = rows(belief=2.0)
    three[0]["look"] = 0.0
    found = growths(three)
    lines = printed(three, found).splitlines()
    assert len(lines) == 2 + len(STAGES) - 1
    (belief,) = (line for line in lines if line.startswith(f"| {STAGES['belief']} |"))
    assert belief.endswith("| 2.00 | 2.00 | no |")
