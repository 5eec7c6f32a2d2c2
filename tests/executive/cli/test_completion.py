"""What a TAB offers, asked the way a shell asks."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from executive.cli import completion
from executive.domain import scaffold
from executive.domain.loader import list_domains


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with a domain, a broken one, and two runs in it."""
    monkeypatch.chdir(tmp_path)
    scaffold.create("shelf")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "domain.toml").write_text("nothing = [")
    for moment, name in enumerate(("monday", "tuesday"), start=1):
        (tmp_path / "runs" / name).mkdir(parents=True)
        os.utime(tmp_path / "runs" / name, (moment, moment))
    return tmp_path


def words(offer: completion.Offer) -> list[str]:
    return [word for word, _ in offer]


def test_what_is_there_is_offered(folder: Path) -> None:
    assert words(completion.domains()) == [*list_domains(), "broken", "shelf"]
    assert words(completion.runs()) == ["tuesday", "monday"]
    assert words(completion.problems("shelf")) == ["one-block"]
    assert words(completion.problems("grocery")) == ["breakfast", "one-item"]


@pytest.mark.parametrize("domain", [None, 3, "", "no-such-domain", "broken", "shelf/domain.pddl", "\0"])
def test_what_cannot_be_read_offers_nothing(domain: object, folder: Path) -> None:
    assert completion.problems(domain) == []


def test_where_there_are_no_runs_none_is_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert completion.runs() == []
    (tmp_path / "runs").write_text("no folder")
    assert completion.runs() == []


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("ru", {"run"}),
        ("run ", {"grocery", "shelf", "broken"}),
        ("run grocery --problem ", {"breakfast", "one-item"}),
        ("run grocery --seed 3 --problem b", {"breakfast"}),
        ("run grocery --estimator o", {"oracle"}),
        ("run grocery --translator t", {"templates"}),
        ("eval grocery data --instructions p", {"paper"}),
        ("replay monday --monitor c", {"consistent"}),
        ("collect sh", {"shelf"}),
        ("inspect t", {"tuesday"}),
        ("run grocery --no-home", {"--no-home-pose"}),
        ("run no-such-domain --problem ", set()),
    ],
)
def test_a_shell_is_answered(line: str, offered: set[str], folder: Path) -> None:
    typed = f"executive {line}"
    environment = {
        **os.environ,
        "_EXECUTIVE_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(len(typed.split()) - (not typed.endswith(" "))),
    }
    command = [sys.executable, "-m", "executive"]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=60)
    assert (run.returncode, run.stderr) == (0, "")
    assert offered <= set(run.stdout.split())
    assert offered or not run.stdout.strip()


@pytest.mark.parametrize("said", [{}, {"COMP_WORDS": "executive ru", "COMP_CWORD": "x"}])
def test_a_shell_that_does_not_say_what_is_typed_is_told(said: dict[str, str]) -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("COMP_")}
    run = subprocess.run(
        [sys.executable, "-m", "executive"],
        env={**environment, "_EXECUTIVE_COMPLETE": "complete_bash", **said},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert run.returncode == 2
    assert "_EXECUTIVE_COMPLETE" in run.stderr


@pytest.mark.skipif(shutil.which("bash") is None, reason="asks bash itself")
def test_bash_takes_the_script_and_uses_it(folder: Path) -> None:
    """The script as `--show-completion` prints it, in the shell that it was printed for."""
    executive = Path(sys.executable).parent / "executive"
    script = f"""
        eval "$({shlex.quote(str(executive))} --show-completion)"
        complete -p executive
        COMP_WORDS=(executive run gro) COMP_CWORD=2
        _executive_completion {shlex.quote(str(executive))}
        echo "${{COMPREPLY[@]}}"
    """
    run = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert run.stdout.splitlines() == ["complete -o default -F _executive_completion executive", "grocery"], run.stderr
