"""The breakfast of the paper's Example 1 as a library: what README shows under "In Python".

python -m examples.library
"""

from executive import Decision, DecisionKind, Event, RunConfig, run, why


class Replans:
    """A sink: it sees every event of a run. This one prints why another plan is made."""

    def write(self, event: Event) -> None:
        if isinstance(event.payload, Decision) and event.payload.kind is DecisionKind.REPLAN:
            print(f"{event.time:.1f} s: {why(event.payload)}")

    def close(self) -> None: ...


summary = run(RunConfig("grocery", problem="breakfast", faults=("drop@4",)), sinks=[Replans()])
print(summary["outcome"], summary["replans"], summary["goal_true"])
