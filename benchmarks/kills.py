"""Kill a run with SIGKILL at random moments, and go on with it: `python -m benchmarks.kills --kills 50`.

Each is `executive run` on the real stack, killed once its record has grown to a random length or a little later, and
then `executive resume`. Every second one has items dropped by chance. Right is that all that was told is in the record,
that no step that was done is dispatched again (unless something undid it), and that the run comes to an end that is
true: the goal is reached, or what was given up lies where nobody can reach it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from executive.trace.record.log import EVENTS_FILE, read_events
from executive.types import Dispatched, Ended, Event, FaultInjected, SkillResult, SkillStatus, Step

PATIENCE = 600.0
"""Wall seconds that a run may take; on a busy machine it takes its time."""

DROPS = ("--fault", "drop:p=0.2")
EYE = ("--estimator", "oracle")
"""What a model sees costs time, and has nothing to do with what is asked here."""


class Trial(NamedTuple):
    """One run, killed and resumed."""

    events: int
    actions: int
    lost: int
    repeated: int
    summary: dict[str, Any]
    complaint: str

    @property
    def is_right(self) -> bool:
        reached = self.summary.get("outcome") == "goal-reached" and self.summary.get("goal_true") is True
        dropped = [fault for fault in self.summary.get("faults", ()) if fault["kind"] == "drop"]
        given_up = self.summary.get("outcome") == "partial" and self.summary.get("goal_true") is False and dropped
        return not self.lost and not self.repeated and not self.complaint and bool(reached or given_up)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--problem", default="breakfast")
    arguments = parser.parse_args()
    right = 0
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        runs = Path(scratch)
        length = uninterrupted(runs, arguments.problem)
        print(f"grocery {arguments.problem}: a whole record has {length:,} bytes; killing {arguments.kills} runs")
        for number in range(arguments.kills):
            dice = random.Random(f"{arguments.seed} {number}")
            extra = DROPS if number % 2 else ()
            trial = killed_and_resumed(runs, f"kill-{number}", arguments.problem, number, extra, length, dice)
            right += trial.is_right
            told = trial.complaint or f"{trial.summary['outcome']}, goal true: {trial.summary['goal_true']}"
            print(
                f"{number:>4}  killed after {trial.events:>3} events, in action {trial.actions}; lost {trial.lost}, "
                f"repeated {trial.repeated}; {told}{'' if trial.is_right else '   WRONG'}",
                flush=True,
            )
    print(f"{right} of {arguments.kills} ended right; {time.perf_counter() - began:.0f} s")
    sys.exit(right != arguments.kills)


def uninterrupted(runs: Path, problem: str) -> int:
    """How many bytes the record of a run has that nobody kills."""
    command = [
        *executive("run", "grocery", "--problem", problem, *EYE, "--runs", str(runs), "--name", "whole"),
        "--quiet",
    ]
    subprocess.run(command, check=True, timeout=PATIENCE)
    return (runs / "whole" / EVENTS_FILE).stat().st_size


def killed_and_resumed(
    runs: Path, name: str, problem: str, seed: int, extra: Sequence[str], length: int, dice: random.Random
) -> Trial:
    """One trial. It is killed at once when its record is as long as the dice have it, or up to 0.1 s later."""
    folder, said = runs / name, runs / f"{name}.txt"
    options = ("--problem", problem, "--seed", str(seed), "--runs", str(runs), "--name", name, *EYE, *extra)
    target, delay = dice.uniform(0, length), dice.choice((0.0, dice.uniform(0.0, 0.1)))
    with said.open("w") as output:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}  # what it told is in the file, killed or not
        command = executive("run", "grocery", *options)
        process = subprocess.Popen(command, stdout=output, start_new_session=True, env=environment)
        try:
            wait_for(process, folder / EVENTS_FILE, target)
            time.sleep(delay)
        finally:
            process.kill()
            process.wait()
            end_group(process.pid)
    before = list(read_events(folder, images=True))  # whoever reads it now does not choke on it, nor on a picture
    told = max(map(int, re.findall(r"^ *[\d.]+ s  action (\d+):", said.read_text(), flags=re.MULTILINE)), default=0)
    actions = max((event.payload.action for event in before if isinstance(event.payload, Dispatched)), default=0)
    going_on = executive("resume", str(folder), "--quiet", "--json")
    resumed = subprocess.run(going_on, capture_output=True, text=True, check=False, timeout=PATIENCE)
    over = any(isinstance(event.payload, Ended) for event in before) and "has ended" in resumed.stderr
    after = list(read_events(folder, images=True))
    lost = max(0, told - actions) + (len(before) > len(after))
    repeated = len(again(after))
    if resumed.returncode not in (0, 1) and not over:
        return Trial(len(before), actions, lost, repeated, {}, resumed.stderr.strip())
    summary = json.loads((folder / "summary.json").read_text() if over else resumed.stdout)
    return Trial(len(before), actions, lost, repeated, summary, "")


def wait_for(process: subprocess.Popen[bytes], record: Path, size: float) -> None:
    """Until the record has that size, or the process has ended."""
    deadline = time.monotonic() + PATIENCE
    while process.poll() is None and time.monotonic() < deadline:
        if record.exists() and record.stat().st_size > max(0.0, size):
            return
        time.sleep(0.002)


def again(events: Sequence[Event]) -> list[Step]:
    """The steps that were dispatched though they were done already, and nothing had been dropped since."""
    done: set[Step] = set()
    repeated = []
    for event in events:
        match event.payload:
            case FaultInjected():
                done.clear()
            case SkillResult(status=SkillStatus.DONE, step=step):
                done.add(step)
            case Dispatched(step=step) if step in done:
                repeated.append(step)
    return repeated


def executive(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "executive", *arguments]


def end_group(leader: int) -> None:
    """End what a killed process has left running: the planner's own processes."""
    try:
        os.killpg(leader, signal.SIGKILL)
    except ProcessLookupError:
        return


if __name__ == "__main__":
    main()
