"""What a monitor is worth: on looks whose truth is known, and in the closed loop.

    python -m benchmarks.monitor                # made-up looks, the symbolic world, the simulator with its oracle
    python -m benchmarks.monitor --data home    # with the shipped model, too, and what becomes of it on bad pictures
    python -m benchmarks.monitor --data home --only looks --only symbolic       # without the long part

`home` is a collection: `executive collect grocery --points 2000 --seed 9001 --out home` makes it. Half of its episodes
say how far an estimator can be trusted, the others are judged. Bad pictures are blurred, noisy or dark, each as much as
it takes to be right about the whole state in half of the looks. The settings build on each other: the plain
threshold of the paper; consistency by mutex groups; memory; looking again. In the closed loop all configurations meet
the same faults. What is found is kept in a folder (`--out`): the same command goes on where it was left.

- `state`: looks after which the whole state that would be planned from is right; `wrong`, `unknown`: looks after which
  something decided is wrong, or something is unknown; `looks`: how many at a moment, while something is unknown.
- coverage: looks in which the truth of every atom of a predicate is in its conformal set, for the share that is asked.
- `success`: the goal holds in truth and the run says so; `false`: it says so and it does not hold.
- `missed`: of the actions after which not all is as expected, the share in whose cycle nothing of that is noticed;
  `alarms`: of the actions after which all is as expected, the share whose cycle ends with a surprise.
- `needless`: decisions a run to plan anew when what was left of the plan led to the goal from the true state.
- `delay`: simulated seconds from a fault to the first sign of it that is true.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.monitored import configurations, figures, looks, spoiling
from benchmarks.monitored.courses import Ask, RunState, courses, flipping, graded, recorded
from benchmarks.played import StoppedError, play
from executive.app.sensor_fit import load_outcomes
from executive.belief import EXACT, ActionModel, ErrorModel, MutexNetwork, SensorModel
from executive.cli.app import INTERRUPTED
from executive.domain.loader import Domain, load_domain
from executive.errors import ExecutiveError
from executive.lab.campaign.design import Campaign
from executive.lab.campaign.episode import FAILED
from executive.planning.mutex_groups import find_mutexes
from executive.util import requirements
from executive.util.threads import cores

PARTS = ("looks", "symbolic", "simulator")


class Looks:
    """The part about looks, and the estimators that it finds for the closed loop."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.estimators: list[configurations.Looking] = []
        self.lines: list[looks.Line] = []
        self.covered: list[looks.Coverage] = []
        self.asked: list[spoiling.Asked] = []
        domain = load_domain("grocery")
        network = MutexNetwork(domain.task.atoms, find_mutexes(domain.parsed).groups)
        counts = {} if domain.outcomes is None else load_outcomes(domain.outcomes, domain.parsed.actions)
        trusts: Path = arguments.out / "calibration"
        if arguments.data is None:  # skills in made-up courses are not those that were measured
            self._made_up(domain, network, arguments.courses)
            return
        self.asked = spoiling.asked(arguments.data, arguments.looks, arguments.out / "looks", arguments.jobs)
        for spoiled, evaluation in self.asked:
            taken = recorded(domain, evaluation, arguments.data)
            if not spoiled:
                self._oracles(domain, network, ActionModel(counts), taken[1::2])
                self.estimators.append(configurations.Looking(configurations.SHIPPED, "vlm"))
            trust = looks.trusted(network, taken[::2])
            if spoiled:
                self.estimators.append(configurations.spoiled(spoiled, trust, trusts))
            name = self.estimators[-1].name
            for setting, monitor in looks.settings(domain, network, trust.sensor_model, ActionModel(counts)):
                self.lines.append(looks.Line(name, setting, looks.judged(monitor, taken[1::2]), None))
            self.covered += looks.coverage(name, network, taken)

    def _made_up(self, domain: Domain, network: MutexNetwork, number: int) -> None:
        taken = courses(domain, number, 20, 0)
        self._oracles(domain, network, ActionModel(), taken)
        name = "graded, often unclear"
        sensor = looks.trusted(network, courses(domain, 200, 20, 1), graded(0)).sensor_model
        self._line(domain, network, ActionModel(), taken, name, sensor, graded(2))
        self.covered += looks.coverage(name, network, courses(domain, 300, 20, 3), graded(4))

    def _oracles(self, domain: Domain, network: MutexNetwork, actions: ActionModel, taken: Sequence[RunState]) -> None:
        for flips in (0.0, *configurations.FLIPS):
            name = configurations.flipped(flips) if flips else configurations.ORACLE
            sensor = SensorModel(other=ErrorModel(flips, flips), correlation_within=0.0) if flips else EXACT
            self._line(domain, network, actions, taken, name, sensor, flipping(flips, 0))

    def _line(
        self,
        domain: Domain,
        network: MutexNetwork,
        actions: ActionModel,
        taken: Sequence[RunState],
        name: str,
        sensor: SensorModel,
        ask: Ask,
    ) -> None:
        for setting, monitor in looks.settings(domain, network, sensor, actions):
            once, again = (looks.judged(monitor, taken, ask, most) for most in (1, looks.MOST_LOOKS))
            self.lines.append(looks.Line(name, setting, once, again))

    def part(self) -> Part:
        """All of it."""
        rates = {spoiled or "as they are": spoiling.exact(evaluation) for spoiled, evaluation in self.asked}
        share = ", ".join(f"{name} {rate:.1%}" for name, rate in rates.items())
        text = [
            *([f"whole state right at the threshold 0.5, by how the pictures are: {share}"] if rates else []),
            looks.head(),
            *map(looks.told, self.lines),
            "conformal coverage, asked and measured",
            looks.told_coverage(self.covered),
        ]
        lines = [
            {"estimator": line.estimator, "setting": line.setting, "once": line.once._asdict(),
             "again": line.again._asdict() if line.again else None}
            for line in self.lines
        ]  # fmt: skip
        document = {"exact_state": rates, "looks": lines, "coverage": [each._asdict() for each in self.covered]}
        return Part("\n".join(text), document, figures.of_looks(self.lines, self.covered))


class Part(NamedTuple):
    """What was found in a part of the benchmark: as text, as JSON, and held against what was to be reached."""

    text: str
    document: dict[str, Any]
    targets: list[figures.Target]


def parts(arguments: argparse.Namespace) -> Iterator[tuple[str, Part]]:
    """Each part that is asked for, by its name, as it is found.

    Raises:
        InputError: the collection is none, or a folder holds something else.
        StoppedError: somebody pressed Ctrl-C.
    """
    only = arguments.only or PARTS
    estimators = configurations.oracles(arguments.out / "calibration")
    if "looks" in only or (arguments.data is not None and "simulator" in only):
        found = Looks(arguments)
        estimators_there = [*estimators, *found.estimators]
        if "looks" in only:
            yield "looks", found.part()
    else:
        estimators_there = estimators
    if "symbolic" in only:
        places = configurations.grocery([None])
        campaign = configurations.campaign("symbolic", places, estimators, arguments.symbolic_seeds)
        yield "symbolic", _loop("symbolic", campaign, arguments)
    if "simulator" in only:
        places = configurations.grocery(arguments.problem or ["breakfast"])
        campaign = configurations.campaign("mujoco", places, estimators_there, arguments.seeds, arguments.fault)
        yield "simulator", _loop("simulator", campaign, arguments)


def _loop(part: str, campaign: Campaign, arguments: argparse.Namespace) -> Part:
    """A campaign, all of it played."""
    played = play(campaign, arguments.out / part, arguments.jobs, f"{part} episodes")
    scores = figures.scores(played)
    failed = [row for row in played if row.outcome == FAILED]
    minutes = sum(row.wall_seconds for row in played) / 60
    lines = [
        f"{', '.join(map(str, campaign.places))}; faults: {', '.join(campaign.faults['faults'])}",
        figures.table(scores),
        f"{len(played)} episodes took {minutes:.0f} minutes, one after the other",
        *(f"could not be played: {row.command}: {row.error}" for row in failed),
    ]
    document = {"episodes": figures.document(scores), "failed": len(failed), "minutes": round(minutes, 1)}
    return Part("\n".join(lines), document, figures.of_loop(part, scores))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a collection of the grocery domain; made by executive collect")
    parser.add_argument("--only", action="append", choices=PARTS, help="this part; repeat it for more")
    parser.add_argument("--looks", type=int, help="only the first so many of the collection")
    parser.add_argument("--courses", type=int, default=30, help="made-up courses of 20 actions, without --data")
    parser.add_argument("--seeds", type=int, default=10, help="in the simulator, of each configuration")
    parser.add_argument("--symbolic-seeds", type=int, default=50, help="in the symbolic world")
    parser.add_argument("--problem", action="append", help="of the grocery domain: breakfast if not given; repeat it")
    parser.add_argument("--fault", action="append", help="in the simulator; repeat it for more")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--out", type=Path, default=Path("campaigns/monitor"), help="what is found is kept here")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    documents: dict[str, Any] = {}
    targets: list[figures.Target] = []
    try:
        requirements.require()
        for name, part in parts(arguments):
            documents[name] = part.document
            targets += part.targets
            if not arguments.json:
                print(f"== {name}\n{part.text}\n", flush=True)
    except StoppedError:
        print("interrupted; what was found is kept, the same command goes on", file=sys.stderr)
        return INTERRUPTED
    except ExecutiveError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    if arguments.json:
        print(json.dumps({**documents, "targets": [target._asdict() for target in targets]}, indent=2))
        return 0
    print(f"== to be reached\n{figures.told(targets)}")
    if arguments.data is None:
        print("the shipped model takes part with --data")
    return 0


if __name__ == "__main__":
    sys.exit(main())
