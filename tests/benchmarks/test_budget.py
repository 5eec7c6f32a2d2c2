"""What the table of budgets says of a measurement, and what watching a program's processes finds out."""

from __future__ import annotations

import os
import sys

import pytest

from benchmarks.budget.cycles import _Clock
from benchmarks.budget.figures import Figure, Measured, printed, watched
from benchmarks.budget.tree import run_watched

linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are watched in /proc")


@pytest.mark.parametrize(
    ("value", "more", "reached"), [(1.0, False, True), (3.0, False, False), (1.0, True, False), (None, True, None)]
)
def test_a_budget_is_kept_from_its_side(value: float | None, more: bool, reached: bool | None) -> None:
    assert Figure("a", "b", 2.0, value, more=more).reached is reached


def test_each_figure_is_a_line_with_its_note_below() -> None:
    rows = [Measured(Figure("one", "9 s", 2.0, 1.0, note="why"), 0.0), Measured(Figure("other", "", 2.0, None), 0.9)]
    text = printed(rows, {"date": "today"})
    lines = text.splitlines()
    assert "| one | 9 s | at most 2 s | 1 s |  | yes | quiet |" in lines
    assert "| other |  | at most 2 s | not measured |  |  | busy, others took 90% |" in lines
    assert "- one: why" in lines


@linux
def test_figures_come_with_what_others_took() -> None:
    def measure() -> list[Figure]:
        return [Figure("a", "b", 2.0, 1.0)]

    (row,) = watched(measure)
    assert row.figure.reached
    assert row.others >= 0.0


@linux
def test_a_program_is_watched_with_the_processes_that_it_starts() -> None:
    inner = "import time; kept = b'x' * (60 << 20); time.sleep(1.0)"
    outer = f"import subprocess, sys; print('begun', flush=True); subprocess.run([sys.executable, '-c', {inner!r}])"
    spent = run_watched([sys.executable, "-c", outer])
    assert spent.said == "begun\n"
    assert spent.mebibytes > 60.0
    assert spent.cpu > 0.0


@linux
def test_it_is_ended_with_them_once_it_has_said_what_was_waited_for() -> None:
    inner = "import time; time.sleep(600)"
    outer = f"""
import subprocess, sys
inner = subprocess.Popen([sys.executable, '-c', {inner!r}])
print('noise')
print(f'READY {{inner.pid}}', flush=True)
inner.wait()
"""
    spent = run_watched([sys.executable, "-c", outer], until="READY")
    pid = int(spent.said.split()[-1])
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@linux
def test_a_program_that_fails_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="3"):
        run_watched([sys.executable, "-c", "raise SystemExit(3)"])


def test_parts_within_each_other_add_up() -> None:
    class Work:
        def inner(self) -> None:
            sum(range(200_000))

        def outer(self) -> None:
            sum(range(200_000))
            self.inner()

    clock = _Clock()
    clock.wrap(Work, "inner", "belief")
    clock.wrap(Work, "outer", "plan")
    for _ in range(20):
        Work().outer()
    clock.switch()
    assert 0.2 < clock.spent["belief"] / clock.spent["plan"] < 5.0
