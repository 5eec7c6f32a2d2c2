"""What the viewer's file says of atoms over time: what is made of the answers, against the thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from executive.belief import BayesMonitor, MutexNetwork, ThresholdMonitor, Thresholds
from executive.belief.bayes_filter import DEFAULT_THRESHOLDS
from executive.trace.record.monitor_file import save
from executive.trace.record.thresholds import recorded_thresholds, thresholds
from executive.trace.viewer.beliefs import Beliefs
from executive.trace.viewer.log_panel import log_lines
from executive.trace.viewer.process import TRACE_FILE
from executive.trace.viewer.sink import RerunSink
from executive.types import (
    Atom,
    Belief,
    Blinded,
    Cause,
    Compared,
    Contradiction,
    Decision,
    DecisionKind,
    Event,
    Facts,
    Guarded,
    Judged,
    Looked,
    LookKind,
    Moved,
    Observation,
    Overruled,
    Payload,
    Reason,
    Remembered,
    SkillStatus,
    Verdict,
)
from tests.executive.trace.synthetic import synthetic_events, task
from tests.executive.trace.viewer.test_text_panels import story_of

LEMON = Atom("on-table", ("lemon", "wood-table"))
GONE = Atom("on-table", ("lemon", "white-table"))


def rows(trace: Path, entity: str, component: str) -> list[tuple[int, object]]:
    """The cycles and values of a component over time, in order."""
    found: list[tuple[int, float, object]] = []
    for chunk in RrdReader(trace).stream():
        if str(chunk.entity_path) == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            for name in (name for name in batch.schema.names if name.endswith(component)):
                stamps = batch.column("cycle").cast("int64").to_pylist(), batch.column("wall").cast("int64").to_pylist()
                cells = batch.column(name).to_pylist()
                found += [(*stamp, cell[0]) for *stamp, cell in zip(*stamps, cells, strict=True) if cell]
    return [(cycle, value) for cycle, _, value in sorted(found)]


def written(folder: Path, payloads: list[list[Payload]], limits: Mapping[str, Thresholds] | None = None) -> Path:
    """A trace in which the `n`-th of `payloads` happened in cycle `n`."""
    sink, wall = RerunSink(folder, thresholds=limits), 0.0
    sink.write(synthetic_events()[0])
    for cycle, some in enumerate(payloads):
        for payload in some:
            wall += 0.1
            sink.write(Event(cycle, 0.0, wall, payload))
    sink.close()
    return folder / TRACE_FILE


def look(number: int, answers: dict[Atom, float], kind: LookKind = LookKind.FULL) -> list[Payload]:
    picture = np.full((4, 4, 3), number, np.uint8)
    return [
        Observation(number, 0.0, {"front": picture}, np.zeros(6)),
        Belief(number, answers),
        Looked(number, kind, len(answers), 9, ("front",)),
    ]


def judged(number: int, probability: dict[Atom, float], **more: object) -> Judged:
    seen = Facts({atom: value >= 0.5 for atom, value in probability.items() if not 0.15 <= value < 0.85})
    return Judged(number, probability, seen, **more)  # type: ignore[arg-type]  # for short


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    kept = {LEMON: Remembered(False, 1, 0.1)}
    return written(
        tmp_path_factory.mktemp("run"),
        [
            [*look(0, {LEMON: 0.97}), judged(0, {LEMON: 0.98})],
            [*look(1, {LEMON: 0.01}, LookKind.GUARD)],
            [*look(2, {LEMON: 0.9}), judged(2, {LEMON: 0.05})],
            [*look(3, {GONE: 0.5}), Judged(3, {LEMON: 0.1, GONE: 0.5}, Facts(), remembered=kept)],
        ],
        {"": DEFAULT_THRESHOLDS},
    )


def test_the_curve_is_what_is_made_of_the_answers(trace: Path) -> None:
    curve = rows(trace, "/probability/on-table/lemon/wood-table", ":scalars")
    assert curve == [(0, 0.98), (2, 0.05), (3, 0.1)]


def test_glances_and_answers_that_are_not_believed_are_marked_beside_it(trace: Path) -> None:
    assert rows(trace, "/answers/on-table/lemon/wood-table", ":scalars") == [(1, 0.01), (2, 0.9)]


def test_words_go_by_the_judgement_and_tell_memory_from_sight(trace: Path) -> None:
    words = rows(trace, "/believed/on-table/lemon/wood-table", ":state")
    assert [word for _, word in words] == ["true", "false", "was false"]


def test_the_thresholds_lie_across(trace: Path) -> None:
    assert {value for _, value in rows(trace, "/thresholds/all/high", ":scalars")} == {DEFAULT_THRESHOLDS.high}
    assert {value for _, value in rows(trace, "/thresholds/all/low", ":scalars")} == {DEFAULT_THRESHOLDS.low}


def test_without_a_judgement_the_answers_stand_for_themselves(tmp_path: Path) -> None:
    """Against the thresholds of their own predicate; and what surprises is in play, though it never changed."""
    surprised = Compared("effects", Facts({GONE: True}), Verdict(violated=frozenset({GONE})), 1)
    first, second = look(0, {LEMON: 0.9, GONE: 0.1}), look(1, {LEMON: 0.6, GONE: 0.1})
    trace = written(tmp_path, [[*first, surprised], [*second, surprised]], {"on-table": Thresholds(0.3, 0.7)})
    assert rows(trace, "/believed/on-table/lemon/wood-table", ":state") == [(0, "true"), (1, "unknown")]
    assert rows(trace, "/probability/on-table/lemon/white-table", ":scalars") == [(0, 0.1), (1, 0.1)]
    assert {value for _, value in rows(trace, "/thresholds/on-table/high", ":scalars")} == {0.7}


def test_thresholds_are_those_of_the_monitor_and_of_its_record(tmp_path: Path) -> None:
    some = task()
    plain, strict = ThresholdMonitor(some.atoms, Thresholds(0.2, 0.9)), {"on-table": Thresholds(0.01, 0.99)}
    fused = BayesMonitor(MutexNetwork(some.atoms, ()), thresholds=strict)
    assert thresholds(plain) == {"": Thresholds(0.2, 0.9)}
    assert thresholds(fused) == {"": DEFAULT_THRESHOLDS, **strict}
    assert thresholds(None) == {}
    assert recorded_thresholds(tmp_path, some) == {}, "there is no record"
    save(tmp_path, fused)
    assert recorded_thresholds(tmp_path, some) == {"": DEFAULT_THRESHOLDS, **strict}


@pytest.mark.parametrize(
    ("payload", "level", "says"),
    [
        (look(7, {LEMON: 0.5}, LookKind.CLOSER)[2], "LOOK", "look 7: 1 of 9 atoms, closer, through front"),
        (Blinded("hand", "its lens is wet", 3), "LOOK", "camera hand is left out: its lens is wet"),
        (Guarded(LEMON, None, False, 3), "GUARD", f"guard: {LEMON} cannot be told (look 3)"),
        (
            Guarded(LEMON, False, True, 3),
            "GUARD",
            f"guard: {LEMON} is seen no longer (look 3), again: the skill is told",
        ),
        (Moved("aside", SkillStatus.NO_PATH, "no way", 0.0), "MOVE", "out of the way, aside: no path (no way), 0.0 s"),
        (
            judged(1, {}, overruled=(Overruled(LEMON, True, 0.9, None, 0.4),)),
            "LOOK",
            f"the look says that {LEMON} is true (P 0.90); with what else is known it cannot be told (P 0.40)",
        ),
        (
            judged(1, {}, contradictions=(Contradiction({LEMON: 0.9, GONE: 0.8}, {LEMON: 0.9, GONE: 0.1}),)),
            "LOOK",
            f"answers {LEMON} (0.90) and {GONE} (0.80) cannot all be true: {LEMON} is, 0.90",
        ),
    ],
)
def test_what_looks_and_guards_find_is_in_the_log(payload: Payload, level: str, says: str) -> None:
    (line,) = log_lines(payload, story_of([]))
    assert (line.level, line.text) == (level, says)


def test_what_was_amiss_and_the_goal_are_shown_where_there_is_not_room_for_all(tmp_path: Path) -> None:
    items = [Atom("on-table", (name, "wood-table")) for name in ("bread", "can", "milk", "soup")]
    beliefs = Beliefs(rr.RecordingStream("test"), {})
    for number, chance in enumerate((0.1, 0.9)):
        beliefs.tell(Event(number, float(number), 0.0, Belief(number, dict.fromkeys(items, chance), frozenset(), "it")))
    beliefs.close()
    beliefs.amiss(items[2:3])
    beliefs.amiss(items[2:])
    paths = ["on-table/milk/wood-table", "on-table/can/wood-table"]
    assert beliefs.telling(goal=[items[1]], most_words=2, most_curves=2) == (
        paths,
        [paths[0], "on-table/soup/wood-table"],
    )


def test_what_goes_by_itself_is_not() -> None:
    routine = Decision(DecisionKind.CONTINUE, (Cause(Reason.AS_EXPECTED),))
    for payload in (routine, *look(7, {LEMON: 0.5}), Guarded(LEMON, True, False, 3), judged(1, {LEMON: 0.9})):
        assert log_lines(payload, story_of([])) == []
