"""A folder is one process's at a time; one that was killed holds nobody up, and leaves nothing in the way."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from executive.errors import InputError
from executive.lab.common.folder_lock import LOCK, lock, remove_partial

HOLDER = """
import sys, time
from pathlib import Path
from executive.lab.common.folder_lock import lock
held = lock(Path(sys.argv[1]), "growing", "executive grow it")
print("held", flush=True)
time.sleep(600)
"""


def test_the_holder_is_named_and_one_that_is_dead_holds_nothing(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", HOLDER, tmp_path], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        told = (
            rf"growing since \d+-\d+-\d+ .*: process {holder.pid} on {re.escape(os.uname().nodename)}, executive grow"
        )
        with pytest.raises(InputError, match=rf"^{re.escape(str(tmp_path))}: another process is working in .*{told}"):
            lock(tmp_path, "growing", "executive grow it")
        holder.kill()
    assert (tmp_path / LOCK).read_text() != ""
    lock(tmp_path, "growing", "executive grow it").release()


def test_what_is_released_can_be_held_again(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "one"
    for _ in range(2):
        held = lock(folder, "growing", "x")
        with pytest.raises(InputError, match=f"process {os.getpid()} on"):
            lock(folder, "growing", "x")
        held.release()
        held.release()


def test_a_holder_that_says_nothing_of_itself_is_a_holder(tmp_path: Path) -> None:
    held = lock(tmp_path, "growing", "x")
    for said in (b"", b"\xff{", b"[]", b'{"pid": "seven"}'):
        (tmp_path / LOCK).write_bytes(said)
        with pytest.raises(InputError, match=r"another process is working in this folder$"):
            lock(tmp_path, "growing", "x")
    held.release()


def test_where_nothing_can_be_written_that_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written to"):
        lock(tmp_path / "file" / "folder", "growing", "x")


def test_what_was_half_written_goes_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / ".model.pt.123").write_bytes(b"half")
    (tmp_path / ".shard-0001.77").mkdir()
    (tmp_path / ".shard-0001.77" / "pictures.npy").write_bytes(b"half")
    kept = {".lock", ".hidden", "model.pt", "notes.1", ".git.d"}
    for name in kept:
        (tmp_path / name).touch()
    remove_partial(tmp_path, tmp_path / "not there")
    assert {each.name for each in tmp_path.iterdir()} == kept
