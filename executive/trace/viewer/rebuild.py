"""The viewer's file of a run that has none, made from its durable record."""

from __future__ import annotations

import shlex
import tempfile
from pathlib import Path

from executive.errors import InputError
from executive.trace.record.log import EVENTS_FILE, read_events
from executive.trace.record.thresholds import recorded_thresholds
from executive.trace.viewer.process import TRACE_FILE
from executive.types import Ended, Started


def ensure_trace(run: Path) -> None:
    """Have `trace.rrd` in a run's folder. Where it is missing, the events give all of it but the moving scene, which
    they do not hold; a folder without a record is left as it is.

    Raises:
        InputError: the record cannot be read or has no end yet, or the file cannot be written.
    """
    if (run / TRACE_FILE).exists() or not (run / EVENTS_FILE).is_file():
        return
    payloads = [event.payload for event in read_events(run, images=False)]
    if not any(isinstance(payload, Ended) for payload in payloads):
        told = f"executive explain {shlex.quote(str(run))}"
        raise InputError(f"the run goes on, or was killed before it could leave {TRACE_FILE}; see: {told}", file=run)
    from executive.trace.viewer.sink import RerunSink

    started = next((payload for payload in payloads if isinstance(payload, Started)), None)
    limits = {} if started is None else recorded_thresholds(run, started.task)
    try:
        # Whole or not at all, and the recording goes by the run's name.
        with tempfile.TemporaryDirectory(dir=run, prefix=".trace-") as draft:
            sink = RerunSink(Path(draft) / run.resolve().name, thresholds=limits)
            for event in read_events(run):
                sink.write(event)
            sink.close()
            (Path(draft) / run.resolve().name / TRACE_FILE).replace(run / TRACE_FILE)
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", file=run / TRACE_FILE) from None
