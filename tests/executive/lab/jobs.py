"""Jobs for crews in tests, here so that a process of its own finds them by their names. A job is a word."""

from __future__ import annotations

import os
import signal
import subprocess
import time

from executive.errors import InputError, MissingError
from executive.lab.common.process_pool import ProcessPool, ReportProgress, run_jobs


class OddError(Exception):
    """Cannot be sent to another process: it is made of two things and says one."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} {second}")


def worker() -> Worker:
    return Worker()


class Worker:
    def __init__(self) -> None:
        self.done = 0

    def __call__(self, job: str, tell: ReportProgress) -> str:
        self.done += 1
        kind, _, more = job.partition(":")
        match kind:
            case "input":
                raise InputError("is wrong", file="here.toml", key="a.b")
            case "missing":
                raise MissingError("no GL", command="apt-get install gl")
            case "bug":
                raise ZeroDivisionError("a bug\nin two lines")
            case "odd":
                raise OddError("one", "two")
            case "unsendable":
                return (each for each in job)  # type: ignore[return-value]
            case "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            case "once" if not os.path.exists(more):
                open(more, "w").close()
                os.kill(os.getpid(), signal.SIGKILL)
            case "hangs":
                tell(0.5)
                subprocess.Popen(["sleep", "600"])
                time.sleep(600)
            case "pid":
                return f"{os.getpid()} {self.done}"
        return job.upper()


def refusing() -> Worker:
    raise MissingError("no GL", command="apt-get install gl")


def main() -> None:
    """A parent of two processes that hang; it prints their numbers."""
    waiting = iter(["hangs:1", "hangs:2"])
    with ProcessPool[str, str](worker, 2) as pool:
        for _ in run_jobs(pool, lambda: next(waiting, None), lambda: False):
            if pool.running_progress == 1.0:
                print(*(member.process.pid for member in pool._workers), flush=True)
                time.sleep(600)


if __name__ == "__main__":
    main()
