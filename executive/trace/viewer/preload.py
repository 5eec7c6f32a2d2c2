"""Imports the viewer's library beside what a run does at its start."""

from __future__ import annotations

from contextlib import suppress
from threading import Thread


def preload() -> None:
    """Begin to import Rerun, in a thread. It takes half a second, and a run waits for other programs meanwhile.
    What fails is raised where it is imported for use; the interpreter's end waits for it."""

    def load() -> None:
        with suppress(Exception):
            import rerun.blueprint  # noqa: F401 (loaded for those who import it later)

    Thread(target=load, name="preload").start()
