"""One process holds a model for others: the same answers to the last bit, and nothing kept that nobody asks about."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.connection import Client
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executive.errors import ExecutiveError, InputError, MissingError
from executive.s3e.backends.interface import TRUE_FALSE, YES_NO, Answer, AnswerWords, Backend, Look
from executive.s3e.backends.own_process import OwnProcess
from executive.s3e.backends.shared_client import ENDED, Address, HostEndedError, SharedBackend, kept
from executive.s3e.backends.shared_host import ModelHost
from executive.s3e.backends.transformers_backend import TransformersBackend
from executive.s3e.estimator import S3E, observe
from executive.types import Atom, Image, Questions
from tests.executive.s3e.looking import QUESTIONS, SYSTEM, Pick, pictures

pytestmark = pytest.mark.usefixtures("one_thread")


@dataclass(frozen=True)
class Moody:
    """A model by whose name it is known what becomes of it; its looks answer with the brightness of their picture."""

    name: str

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> MoodyLook:
        if system == "refuse":
            raise InputError("there is no picture to look at", key=self.name)
        return MoodyLook(float(images[0].mean()) / 255.0)


@dataclass(frozen=True)
class MoodyLook:
    brightness: float

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        if "fail" in questions:
            raise ZeroDivisionError("a bug")
        if "die" in questions:
            os.kill(os.getpid(), signal.SIGKILL)
        if "wait" in questions:
            time.sleep(600.0)
        if "slow" in questions:
            time.sleep(0.3)
        return [Answer(question, self.brightness, 1.0 - self.brightness) for question in questions]


def moody(model: str) -> Backend:
    errors: dict[str, Exception] = {
        "broken": InputError("is cut off", file=Path("folder") / "model.safetensors", key="x"),
        "extra": MissingError("it needs a package", command="pip install package"),
        "odd": ExecutiveError("no luck"),
        "bug": KeyError("a bug"),
    }
    if model in errors:
        raise errors[model]
    return Moody(model)


@pytest.fixture(scope="module")
def address() -> Iterator[Address]:
    """A process with moody models."""
    with ModelHost(moody) as host:
        yield host.address


@pytest.fixture(scope="module")
def real() -> Iterator[Address]:
    """A process with real ones."""
    with ModelHost() as host:
        yield host.address


def assert_same(ours: list[Answer], theirs: list[Answer]) -> None:
    """But for rounding, of 1e-6: where all tests of executive/app came before in this process, sums differ by some 1e-7
    from those of a process that was just started, as they do between one thread and two (8e-7). Neither where weights
    and pictures lie in memory changes a bit, nor one run of each kind, nor that of the symbolic world in tests. Within
    one process, and between clients, they are equal."""
    for one, other in zip(ours, theirs, strict=True):
        assert replace(one, yes_mass=0.0, no_mass=0.0) == replace(other, yes_mass=0.0, no_mass=0.0)
        assert (one.yes_mass, one.no_mass) == pytest.approx((other.yes_mass, other.no_mass), abs=2e-6)


def eventually(address: Address, looks: int) -> bool:
    """Whether so many looks are kept before long: what is not asked to happen at once may take a moment."""
    until = time.monotonic() + 30.0
    while kept(address) != looks and time.monotonic() < until:
        time.sleep(0.01)
    return kept(address) == looks


def gone(pid: int) -> bool:
    """Whether a process comes to its end before long; its parent may not have heard of it yet."""
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except FileNotFoundError:
            return True
        time.sleep(0.01)
    return False


def grey(level: int) -> list[Image]:
    return [np.full((4, 4, 3), level, np.uint8)]


@pytest.mark.parametrize("family", ["fastvlm", "qwen2.5-vl"])
def test_the_answers_are_those_of_the_model_in_this_process(
    real: Address, backend: Pick, checkpoint: Callable[[str], Path], family: str
) -> None:
    here, there = backend(family), SharedBackend(real, checkpoint(family))
    assert isinstance(there, Backend)
    assert there.name == here.name
    for count, words in ((1, YES_NO), (2, TRUE_FALSE)):
        look = there.look(pictures(count), SYSTEM, words)
        assert isinstance(look, Look)
        assert_same(look.ask(QUESTIONS), here.look(pictures(count), SYSTEM, words).ask(QUESTIONS))
        assert look.ask([]) == []


def test_two_clients_at_once_get_what_each_gets_alone(
    real: Address, backend: Pick, checkpoint: Callable[[str], Path]
) -> None:
    """Their looks take turns, and none is mixed with another's."""
    expected = [backend("fastvlm").look(pictures(1, seed), SYSTEM).ask(QUESTIONS) for seed in range(2)]
    start = threading.Barrier(2)

    def client(seed: int) -> list[list[Answer]]:
        model, shown = SharedBackend(real, checkpoint("fastvlm")), pictures(1, seed)
        start.wait()
        return [model.look(shown, SYSTEM).ask(QUESTIONS) for _ in range(4)]

    with ThreadPoolExecutor(2) as both:
        told = list(both.map(client, range(2)))
    for seed, answers in enumerate(told):
        assert answers == [answers[0]] * 4
        assert_same(answers[0], expected[seed])
    with pytest.raises(AssertionError):
        assert_same(told[0][0], told[1][0])


def test_a_model_is_loaded_once(real: Address, checkpoint: Callable[[str], Path]) -> None:
    """The second client finds it open, though its folder is empty by then."""
    folder = checkpoint("smolvlm")
    SharedBackend(real, folder)
    names = {file: file.with_suffix(".away") for file in folder.glob("*.safetensors")}
    for file, away in names.items():
        file.rename(away)
    try:
        SharedBackend(real, folder).look(pictures(1), SYSTEM).ask(QUESTIONS)
        with pytest.raises(InputError, match="has no weights"):
            TransformersBackend(folder)
    finally:
        for file, away in names.items():
            away.rename(file)


def test_what_is_wrong_with_a_checkpoint_is_said_as_it_is_here(real: Address, tmp_path: Path) -> None:
    for wrong in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError) as here:
            TransformersBackend(wrong)
        with pytest.raises(InputError) as there:
            SharedBackend(real, wrong)
        assert (str(there.value), vars(there.value)) == (str(here.value), vars(here.value))


@pytest.mark.parametrize("name", ["broken", "extra", "odd"])
def test_errors_come_through_as_themselves(address: Address, name: str) -> None:
    with pytest.raises(ExecutiveError) as here:
        moody(name)
    with pytest.raises(ExecutiveError) as there:
        SharedBackend(address, name)
    assert type(there.value) is type(here.value)
    assert (str(there.value), vars(there.value)) == (str(here.value), vars(here.value))
    assert there.value.exit_code == here.value.exit_code


def test_after_an_error_the_next_look_is_as_good_as_any(address: Address) -> None:
    with pytest.raises(RuntimeError, match="KeyError: 'a bug'"):
        SharedBackend(address, "bug")
    model = SharedBackend(address, "fine")
    with pytest.raises(InputError, match="fine: there is no picture to look at"):
        model.look(grey(51), "refuse")
    look = model.look(grey(51), SYSTEM)
    with pytest.raises(RuntimeError, match="ZeroDivisionError: a bug"):
        look.ask(["fail"])
    with pytest.raises(TypeError, match="pickle"):
        model.look([threading.Lock()], SYSTEM)  # type: ignore[list-item]
    assert [answer.probability() for answer in look.ask(["well?"])] == [0.2]
    del look
    assert eventually(address, 0)


def test_looks_are_freed_with_whoever_has_them(address: Address) -> None:
    one, another = SharedBackend(address, "one"), SharedBackend(address, "another")
    looks = [one.look(grey(level), SYSTEM) for level in (0, 255)] + [another.look(grey(102), SYSTEM)]
    assert kept(address) == 3
    assert [look.ask(["?"])[0].probability() for look in looks] == [0.0, 1.0, 0.4]
    looks[0].close()
    looks[0].close()
    assert eventually(address, 2)
    with pytest.raises(ValueError, match="closed"):
        looks[0].ask(["?"])
    del looks[0]
    assert kept(address) == 2
    del looks[0]
    assert eventually(address, 1), "the second, collected"
    circle: list[Any] = [looks.pop()]
    circle.append(circle)
    del another
    assert kept(address) == 1, "a look outlives its backend"
    del circle
    gc.collect()
    assert eventually(address, 0)


def test_an_estimator_keeps_the_look_that_it_is_at(address: Address) -> None:
    atom = Atom("there", ())
    eye = S3E(SharedBackend(address, "eye"), Questions({atom: "Is it there?"}, "nobody", SYSTEM))
    for level in (255, 0, 255):
        assert eye.estimate(observe({"front": grey(level)[0]}), [atom]).probability[atom] == level / 255
        assert eventually(address, 1)
    del eye
    assert eventually(address, 0)


CLIENT = """
import pickle, sys, time
from executive.s3e.backends.shared_client import SharedBackend
import numpy as np
address = pickle.loads(bytes.fromhex(sys.argv[1]))
look = SharedBackend(address, "far").look([np.zeros((4, 4, 3), np.uint8)], "")
print("taken", flush=True)
if "ask" in sys.argv:
    print(look.ask(["slow"]), flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("asking", [False, True])
def test_a_client_that_is_killed_leaves_nothing(address: Address, asking: bool) -> None:
    words = [sys.executable, "-c", CLIENT, pickle.dumps(address).hex(), *(["ask"] if asking else [])]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as client:
        assert client.stdout is not None
        assert client.stdout.readline() == "taken\n"
        assert kept(address) == 1
        client.kill()
    assert eventually(address, 0)
    assert SharedBackend(address, "near").look(grey(0), SYSTEM).ask(["?"]) == [Answer("?", 0.0, 1.0)]


def test_who_has_not_the_key_gets_nothing(address: Address) -> None:
    with pytest.raises(HostEndedError):
        SharedBackend(Address(address.path, b"another"), "fine")
    Client(address.path, "AF_UNIX").close()  # says nothing and is gone
    assert SharedBackend(address, "fine").name == "fine"
    assert os.stat(Path(address.path).parent).st_mode & 0o077 == 0, "a folder for nobody else"
    assert repr(address.key) not in repr(address)


def test_who_gives_up_leaves_the_others_and_the_next_look_whole(address: Address) -> None:
    """As a look that takes too long is (`executive.util.timeout`)."""
    from executive.util.timeout import TimeLimitError, within

    model = SharedBackend(address, "slow")
    look = model.look(grey(255), SYSTEM)
    with pytest.raises(TimeLimitError):
        within(0.1, lambda: look.ask(["slow"]))
    assert look.ask(["?"]) == [Answer("?", 1.0, 0.0)]
    assert model.look(grey(0), SYSTEM).ask(["?"]) == [Answer("?", 0.0, 1.0)]


def test_a_process_that_was_killed_is_named_and_nobody_waits_for_it() -> None:
    with ModelHost(moody) as host:
        model = SharedBackend(host.address, "fine")
        look, another = model.look(grey(255), SYSTEM), model.look(grey(0), SYSTEM)
        with ThreadPoolExecutor(1) as waiting:
            waits = waiting.submit(look.ask, ["wait", "?"])
            time.sleep(0.2)
            assert host.pid is not None
            os.kill(host.pid, signal.SIGKILL)
            assert waits.result(60.0) == [Answer("", 0.0, 0.0, ENDED)] * 2
        assert another.ask(["?"]) == [Answer("", 0.0, 0.0, ENDED)]
        for late in (lambda: model.look(grey(0), SYSTEM), model.check, lambda: SharedBackend(host.address, "fine")):
            with pytest.raises(HostEndedError, match="the process that holds the model has ended"):
                late()
        host.revive()
        with pytest.raises(HostEndedError):
            model.check()
        again = SharedBackend(host.address, "fine")
        assert again.look(grey(255), SYSTEM).ask(["?"]) == [Answer("?", 1.0, 0.0)]
        pid = host.pid
        host.revive()
        assert host.pid == pid, "one that is alive is left alone"


def test_a_model_of_ones_own_is_ended_in_the_middle_of_a_look_and_there_for_the_next() -> None:
    model = OwnProcess("fine", moody)
    assert isinstance(model, Backend)
    assert model.name == "fine"
    look = model.look(grey(255), SYSTEM)
    with ThreadPoolExecutor(1) as waiting:
        waits = waiting.submit(look.ask, ["wait"])
        time.sleep(0.2)
        model.end()
        assert waits.result(60.0) == [Answer("", 0.0, 0.0, ENDED)]
    assert model.look(grey(0), SYSTEM).ask(["?"]) == [Answer("?", 0.0, 1.0)]
    model.close()
    model.close()


def test_a_model_of_ones_own_that_has_died_is_replaced() -> None:
    model = OwnProcess("fine", moody)
    assert model.look(grey(255), SYSTEM).ask(["die"]) == [Answer("", 0.0, 0.0, ENDED)]
    assert model.look(grey(255), SYSTEM).ask(["?"]) == [Answer("?", 1.0, 0.0)]
    model.close()


def test_a_model_of_ones_own_that_cannot_be_loaded_says_why() -> None:
    model = OwnProcess("broken", moody)
    with pytest.raises(InputError, match="is cut off"):
        model.ready()
    model.close()


SCRIPT = """
from executive.s3e.backends.own_process import OwnProcess
from tests.executive.s3e.backends.test_shared_client import moody
print("once", flush=True)
print(OwnProcess("fine", moody).name)
"""


def test_a_program_of_one_needs_no_guard(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout) == (0, "once\nfine\n")


def test_one_that_dies_of_a_question_says_so() -> None:
    with ModelHost(moody) as host:
        look = SharedBackend(host.address, "fine").look(grey(255), SYSTEM)
        assert look.ask(["die"]) == [Answer("", 0.0, 0.0, ENDED)]


def test_nothing_is_left_behind() -> None:
    with ModelHost(moody) as host:
        folder, pid = Path(host.address.path).parent, host.pid
        model = SharedBackend(host.address, "fine")
        model.look(grey(255), SYSTEM)
        assert folder.is_dir()
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert not folder.exists()
    with pytest.raises(HostEndedError):
        model.look(grey(255), SYSTEM)


def test_a_long_name_for_temporary_files_is_no_trouble(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with ModelHost(moody) as host:
        assert SharedBackend(host.address, "fine").name == "fine"


class Ending:
    """Opens no model: the process that it is sent to ends as it arrives."""

    def __call__(self, model: str) -> Backend:
        raise AssertionError(model)

    def __reduce__(self) -> tuple[Callable[[int], object], tuple[int]]:
        return os._exit, (3,)


def test_one_that_cannot_start_is_a_line_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "only"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "mkdtemp", lambda **_: str(folder))
    with pytest.raises(ExecutiveError, match="the process that is to hold the model did not start"):
        ModelHost(Ending()).__enter__()
    assert not folder.exists()


PARENT = """
import signal, sys, time
from executive.s3e.backends.shared_host import ModelHost
from executive.s3e.backends.shared_client import SharedBackend
from tests.executive.s3e.backends.test_shared_client import moody
if __name__ == "__main__":
    with ModelHost(moody) as host:
        SharedBackend(host.address, "fine")
        print(host.pid, host.address.path, flush=True)
        time.sleep(600)
"""


def test_it_leaves_with_its_parent_and_hears_no_ctrl_c(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    with subprocess.Popen([sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, env=environment) as parent:
        assert parent.stdout is not None
        pid, socket = parent.stdout.readline().decode().split()
        os.kill(int(pid), signal.SIGINT)
        time.sleep(0.2)
        os.kill(int(pid), 0)
        parent.kill()
    assert gone(int(pid))
    assert not Path(socket).parent.exists()
