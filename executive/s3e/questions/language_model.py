"""The paper's translation stage: a language model words the question of every atom (Section 4, Appendix E.1).

Nothing that it writes is taken on trust. What `executive.s3e.questions.checks` refuses is asked for again, another way
each time, and in the end asked from the domain's templates instead, with a warning. All that the model wrote is kept in
a file that a person can read, so that it is asked once for a domain and its objects, whatever the goals."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

from executive.errors import InputError
from executive.s3e.questions import prompts
from executive.s3e.questions.checks import Checker, tidy
from executive.s3e.questions.templates import Templates, generic
from executive.types import Atom, Questions, Task
from executive.util.files import read_json

ATTEMPTS = 3
"""How often the model may word one question."""

_ABOUT = (
    "What a language model wrote when asked for the questions of a domain (executive.s3e), attempt by attempt. "
    "A reply that was changed here is taken as the model's; without this file, the model is asked again."
)
_FORMAT = 1
_LARGEST = 50_000_000
_SHOWN = 80
"""Characters of a refused reply that a warning quotes."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What a language model wrote, or why it wrote nothing."""

    text: str = ""
    error: str = ""


@runtime_checkable
class Writer(Protocol):
    """A language model that writes text: a checkpoint in this process, or a server."""

    @property
    def name(self) -> str:
        """What to call the model in a trace and in the cache: another model has another name."""
        ...

    def write(self, system: str, prompts: Sequence[str], attempt: int) -> list[Reply]:
        """A reply to each prompt on its own, under the same system prompt, in order.

        Attempt 0 is the likeliest reply; each later one is drawn, with a seed of its own, so that it may differ. What
        goes wrong with one prompt is the `error` of its reply.
        """
        ...


@dataclass(frozen=True, slots=True)
class LanguageModel:
    """The translator that asks a language model.

    Args:
        writer: the model.
        domain: the text of the PDDL domain file, which the model is shown.
        templates: what is asked instead where the model's wording is refused; without them, `generic` questions. Their
            names of objects are accepted in a question, beside the PDDL names.
        cache: a folder to keep replies in; without it, they are not kept.
        attempts: how often the model may word one question.
    """

    writer: Writer
    domain: str
    templates: Templates | None = None
    cache: Path | None = None
    attempts: int = ATTEMPTS

    def translate(self, task: Task) -> Questions:
        """Word the questions.

        Raises:
            InputError: the model has no reply to anything.
            DomainError: the templates do not fit the task.
        """
        templates = self.templates or generic(task)
        instead = templates.translate(task)
        system = prompts.translation(self.domain, task.objects)
        memory = _Memory(self.cache, task, self.writer.name, system)
        rounds = _Rounds(Checker(task.objects, templates.names(task)))
        try:
            for attempt in range(self.attempts):
                waiting = [atom for atom in task.atoms if atom not in rounds.taken]
                rounds.judge(self._replies(system, waiting, attempt, memory))
        finally:
            memory.save()
        text = rounds.settle(instead.text)
        refused = [rounds.warning(atom, text[atom]) for atom in task.atoms if atom not in rounds.taken]
        warnings = (*instead.warnings, *memory.warnings, *refused)
        return Questions(text, prompts.QUESTION_ANSWERING, f"llm:{self.writer.name}", warnings=warnings)

    def _replies(self, system: str, atoms: Sequence[Atom], attempt: int, memory: _Memory) -> dict[Atom, Reply]:
        """From memory where it has them; the rest is asked for."""
        known = {atom: reply for atom in atoms if (reply := memory.recall(atom, attempt)) is not None}
        missing = [atom for atom in atoms if atom not in known]
        if missing:
            written = self.writer.write(system, [prompts.query(atom) for atom in missing], attempt)
            if attempt == 0 and not known and all(reply.error for reply in written):
                raise InputError(f"{self.writer.name}: cannot word any question: {written[0].error}")
            for atom, reply in zip(missing, written, strict=True):
                known[atom] = reply
                memory.keep(atom, attempt, reply)
        return known


@dataclass(slots=True)
class _Rounds:
    """Which replies are taken. Judged round by round, so that the order of the atoms makes no difference."""

    checker: Checker
    taken: dict[Atom, str] = field(default_factory=dict)
    faults: dict[Atom, tuple[str, str]] = field(default_factory=dict)
    """The last reply that was refused, and why."""

    def judge(self, replies: Mapping[Atom, Reply]) -> None:
        """Take the replies that are questions for their atoms and for no other."""
        texts = {atom: tidy(reply.text) for atom, reply in replies.items()}
        asked = Counter(_folded(text) for text in (*texts.values(), *self.taken.values()))
        for atom, reply in replies.items():
            fault = reply.error or self.checker.fault(atom, texts[atom])
            if not fault and asked[_folded(texts[atom])] > 1:
                fault = "is asked for another atom, too"
            if fault:
                self.faults[atom] = reply.text, fault
            else:
                self.taken[atom] = texts[atom]

    def settle(self, instead: Mapping[Atom, str]) -> dict[Atom, str]:
        """A question for every atom, no two the same: the model's where it was taken, else the other one."""
        while True:
            text = {atom: self.taken.get(atom, other) for atom, other in instead.items()}
            asked = Counter(map(_folded, text.values()))
            same = [atom for atom in self.taken if asked[_folded(text[atom])] > 1]
            if not same:
                return text
            for atom in same:
                self.faults[atom] = self.taken.pop(atom), "is asked for another atom, too"

    def warning(self, atom: Atom, question: str) -> str:
        said, fault = self.faults[atom]
        line = " ".join(said.split())
        quoted = repr(line if len(line) <= _SHOWN else line[:_SHOWN] + "...")
        cause = f"the model wrote {quoted}, which {fault}" if said else f"the model wrote nothing: {fault}"
        return f"{atom}: {cause}; asked instead: {question}"


class _Memory:
    """What the model wrote, kept in a file that is named by domain, objects, model and prompt."""

    def __init__(self, folder: Path | None, task: Task, model: str, system: str) -> None:
        self._head = {
            "about": _ABOUT,
            "format": _FORMAT,
            "domain": task.name,
            "objects": dict(task.objects),
            "model": model,
            "system_prompt": system.splitlines(),
        }
        self._replies: dict[str, list[str | None]] = {}
        self._changed = False
        self.warnings: list[str] = []
        key = hashlib.sha256(json.dumps([_FORMAT, model, system]).encode()).hexdigest()[:16]
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in task.name[:60])
        self._file = None if folder is None else folder / f"{name}-{key}.json"
        if self._file is not None and self._file.exists():
            self._load(self._file)

    def recall(self, atom: Atom, attempt: int) -> Reply | None:
        replies = self._replies.get(str(atom), [])
        text = replies[attempt] if attempt < len(replies) else None
        return None if text is None else Reply(text)

    def keep(self, atom: Atom, attempt: int, reply: Reply) -> None:
        """Keep a reply; that there was none is not worth keeping."""
        replies = self._replies.setdefault(str(atom), [])
        replies += [None] * (attempt + 1 - len(replies))
        replies[attempt] = None if reply.error else reply.text
        self._changed = self._changed or not reply.error

    def save(self) -> None:
        """Write the file, whole or not at all. What cannot be written is a warning: the questions are there."""
        if self._file is None or not self._changed:
            return
        text = json.dumps({**self._head, "replies": dict(sorted(self._replies.items()))}, indent=2, ensure_ascii=False)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self._file.parent, prefix=f"{self._file.name}.")
            try:
                with open(handle, "w", encoding="utf-8") as stream:
                    stream.write(text + "\n")
                os.replace(name, self._file)
            except BaseException:
                with contextlib.suppress(OSError):
                    os.unlink(name)
                raise
        except (OSError, UnicodeError) as error:
            self.warnings.append(_line(f"{self._file}: the model's replies cannot be kept ({error})"))

    def _load(self, file: Path) -> None:
        try:
            replies = read_json(file, largest=_LARGEST)["replies"]
            for atom, texts in replies.items():
                Atom.parse(atom)
                if not isinstance(texts, list) or not all(text is None or isinstance(text, str) for text in texts):
                    raise ValueError(f"{atom}: expected a list of replies")
        except (InputError, ValueError, LookupError, TypeError, AttributeError) as error:
            why = error.message if isinstance(error, InputError) else error
            self.warnings.append(
                _line(f"{file}: no replies of a model can be read from it ({why}); the model is asked again")
            )
        else:
            self._replies = replies


def _folded(text: str) -> str:
    return " ".join(text.casefold().split())


def _line(text: str) -> str:
    return str(InputError(text))
