"""What Rerun would keep for as long as the process lives, given back: a program may make hundreds of recordings.

Both are matters of its bindings, which have no public face for them (rerun-sdk is held to one minor version).
"""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings


def sweep() -> None:
    """Free the recordings that nobody refers to any more, with their threads; of itself Rerun does so in `rr.init`."""
    rerun_bindings.flush_and_cleanup_orphaned_recordings()


def send_blueprint(record: rr.RecordingStream, application: str, blueprint: rrb.Blueprint) -> None:
    """What `record.send_blueprint` does, but for the recording in memory that the layout is written to first: that one
    and its memory refer to each other, and only who has it in hand can part them."""
    stream = rr.RecordingStream._from_native(
        rerun_bindings.new_blueprint(
            application_id=application, make_default=False, make_thread_default=False, default_enabled=True
        )
    )
    stream.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(stream)
    memory = stream.memory_recording()
    rerun_bindings.send_blueprint(memory.storage, True, True, recording=record.to_native())
    stream.disconnect()
