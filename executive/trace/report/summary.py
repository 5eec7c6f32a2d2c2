"""The summary of a run: `summary.json`, and the same for a person to read."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, TypedDict

from executive.trace.phrases import counts, plural, why
from executive.trace.record.log import picture_name
from executive.trace.story.costs import STAGES
from executive.trace.story.story import Story
from executive.trace.terminal.view import outcome_style
from executive.types import DecisionKind, Event, OutcomeKind
from executive.util.atomic_write import write_atomic

if TYPE_CHECKING:
    from rich.text import Text

SUMMARY_FILE = "summary.json"
_LABEL = 10


class Fault(TypedDict):
    """A fault that was injected; `action` is the run's action that it struck, `time` the world's clock in s."""

    kind: str
    spec: str
    action: int
    time: float
    detail: str


class Looks(TypedDict):
    """What was spent on looking: looks that decisions were made on, how many of them were a second look or more at the
    same moment, questions asked in them, how often and how long (world seconds) the arm was brought out of the way, and
    the guard's glances at what was carried, each a question."""

    total: int
    again: int
    questions: int
    moves: int
    moving_seconds: float
    glances: int


class GivenUp(TypedDict):
    """A literal of the goal that was given up, why, and the pictures in the run's folder of the last look at it."""

    goal: str
    why: str
    pictures: list[str]


class Summary(TypedDict):
    """`summary.json`. Times are in seconds; `wall_seconds` has the key `total` and one for each of `STAGES`.

    `goal_seen` is the executive's own claim, `goal_true` the scorer's verdict (None when nobody scored).
    """

    run: str
    domain: str
    problem: str
    seed: int
    estimator: str
    outcome: str
    goal_seen: bool
    goal_true: bool | None
    unreached: list[str]
    given_up: list[GivenUp]
    cycles: int
    actions: int
    replans: int
    looks: int
    looking: Looks
    faults: list[Fault]
    sim_seconds: float
    wall_seconds: dict[str, float]


class Collector:
    """A sink that keeps what the summary needs, so that nothing has to be read back."""

    def __init__(self) -> None:
        self._story = Story()

    def write(self, event: Event) -> None:
        self._story.tell(event)

    def recall(self, event: Event) -> None:
        """Take in what an earlier process of this run recorded."""
        self.write(event)

    def close(self) -> None:
        pass

    def summary(self, goal_true: bool | None = None) -> Summary:
        """Return what the events so far come to. A run whose end is not among them has crashed.

        Args:
            goal_true: the scorer's verdict; nothing in the events may know it.

        Raises:
            ValueError: the run's start is not among them either.
        """
        story = self._story
        started, ended, began, latest, costs = story.started, story.ended, story.began, story.latest, story.costs
        if started is None or began is None or latest is None:
            raise ValueError("these events are no run: none of them starts it")
        unreached = ended.unreached if ended else story.unreached()
        return Summary(
            run=started.run,
            domain=started.domain,
            problem=started.task.problem,
            seed=started.seed,
            estimator=started.estimator,
            outcome=str(ended.outcome if ended else OutcomeKind.CRASHED),
            goal_seen=ended.goal_seen if ended else False,
            goal_true=goal_true,
            unreached=list(unreached),
            given_up=list(_given_up(story, unreached)),
            cycles=ended.cycles if ended else story.cycle,
            actions=ended.actions if ended else story.actions,
            replans=ended.replans if ended else story.replans,
            looks=ended.looks if ended else story.looks,
            looking=Looks(
                total=costs.looks,
                again=costs.again,
                questions=costs.questions,
                moves=costs.moves,
                moving_seconds=round(costs.moving_seconds, 3),
                glances=costs.glances,
            ),
            faults=[
                Fault(kind=fault.kind, spec=fault.spec, action=fault.action, time=event.time, detail=fault.detail)
                for event, fault in story.faults
            ],
            sim_seconds=round(latest.time - began.time, 3),
            wall_seconds=costs.wall_seconds(latest.wall),
        )


def _given_up(story: Story, unreached: Sequence[str]) -> Iterator[GivenUp]:
    """Yield what was given up and not reached after all: why, and as it was seen last."""
    ends = (DecisionKind.GIVE_UP_GOAL, DecisionKind.STOP)
    for literal in unreached:
        name = literal.removeprefix("not ")
        decisions = [
            decision for _, decision in story.decisions if decision.kind in ends and name in map(str, decision.evidence)
        ]
        if decisions:
            grounds = [ground for ground in decisions[-1].grounds if str(ground.atom) == name]
            pictures = [picture_name(g.observation_id, camera) for g in grounds for camera in g.cameras]
            yield GivenUp(goal=literal, why=why(decisions[0]), pictures=pictures)


def summarise(events: Iterable[Event], goal_true: bool | None = None) -> Summary:
    """The summary of recorded events (see `executive.trace.record.log.read_events`); raises as `Collector.summary`
    does."""
    collector = Collector()
    for event in events:
        collector.write(event)
    return collector.summary(goal_true)


def write_summary(run: Path | str, summary: Summary) -> Path:
    """Put `summary.json` into the run's folder: the whole file or, if that fails, none of it."""
    return write_atomic(Path(run) / SUMMARY_FILE, (json.dumps(summary, indent=2) + "\n").encode())


def print_summary(summary: Summary, run: Path | str, stream: TextIO) -> None:
    """For a person: the outcome, the numbers, and the command that inspects the run in folder `run`."""
    from rich.text import Text

    from executive.trace.terminal.console import console_for

    console = console_for(stream)
    rows: list[tuple[str, Text]] = [("outcome", _outcome(summary))]
    if summary["unreached"]:
        rows.append(("unreached", Text(", ".join(summary["unreached"]), "yellow")))
    for lost in summary["given_up"]:
        pictures = f" (see {', '.join(lost['pictures'])})" if lost["pictures"] else ""
        rows.append(("given up", Text(f"{lost['goal']}: {lost['why']}{pictures}", "yellow")))
    rows.append(("actions", Text(_counts(summary))))
    if summary["looking"]["questions"]:
        rows.append(("looking", Text(_looking(summary["looking"]))))
    rows += [("fault", Text(_fault(fault), "magenta")) for fault in summary["faults"]]
    rows.append(("time", Text(_times(summary))))
    rows.append(("inspect", Text(f"executive inspect {shlex.quote(str(run))}", "bold")))
    for label, text in rows:
        # A command that is to be copied must not be broken, and in a pipe nothing must.
        whole = label == "inspect" or not console.is_terminal
        width = console.width - _LABEL
        for index, line in enumerate([text] if whole else text.wrap(console, max(20, width))):
            console.print(Text(f"{label if index == 0 else '':<{_LABEL}}", "dim") + line, soft_wrap=True)


def _outcome(summary: Summary) -> Text:
    from rich.text import Text

    outcome, true = OutcomeKind(summary["outcome"]), summary["goal_true"]
    claimed = outcome.claims_goal
    text = Text(outcome, "bold red" if claimed and true is False else outcome_style(outcome))
    text.append(f"; goal seen: {_said(summary['goal_seen'])}, goal true: {_said(true)}", "")
    if true is not None and true is not claimed:
        text.append(" - the robot is mistaken" if claimed else " - the robot does not know", "bold yellow")
    return text


def _said(value: bool | None) -> str:
    return {True: "yes", False: "no", None: "not scored"}[value]


def _counts(summary: Summary) -> str:
    counted = counts(action=summary["actions"], replan=summary["replans"], look=summary["looks"])
    return f"{counted} in {plural(summary['cycles'], 'cycle')}"


def _looking(looks: Looks) -> str:
    parts = [f"{looks['questions'] / looks['total']:.0f} questions a look"]
    if looks["again"]:
        parts.append(f"{plural(looks['again'], 'look')} again at what was in doubt")
    if looks["moves"]:
        parts.append(f"{looks['moving_seconds']:.1f} s to clear the view")
    if looks["glances"]:
        parts.append(f"{plural(looks['glances'], 'glance')} at what was carried")
    return ", ".join(parts)


def _fault(fault: Fault) -> str:
    detail = f": {fault['detail']}" if fault["detail"] else ""
    return f"{fault['spec']} in action {fault['action']} at {fault['time']:.1f} s{detail}"


def _times(summary: Summary) -> str:
    wall: Mapping[str, float] = summary["wall_seconds"]
    stages = ", ".join(f"{stage} {wall[stage]:.1f}" for stage in STAGES if wall[stage] >= 0.05)
    return f"{summary['sim_seconds']:.1f} s simulated in {wall['total']:.1f} s{f' ({stages})' if stages else ''}"
