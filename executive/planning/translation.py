"""A task grounded by Fast Downward's translator, once, and kept: a state and a goal are then a search away.

The translator looks for what can become true from an initial state if nothing is ever made false, and grounds the
actions that this allows. It starts from what the problem file's :init says and from the state that is planned from.
Every state made of what it finds can be written down, whether actions lead there or not; a state with another true atom
has the task grounded once more, from all of these states together.

Invariants are not looked for: each atom is a variable of its own, so that a state that breaks one can be written down,
too, and no time is spent on proofs. Static atoms are what :init says, in this as in everything else.
"""

from __future__ import annotations

import contextlib
import signal
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path

from executive.domain.pddl import Schema
from executive.planning.pddl_text import FINISH, PddlText
from executive.planning.programs import TRANSLATOR, run_program, translator_command
from executive.planning.sas_operators import Operator, Reachability, Rule, relevant
from executive.planning.sas_task import SasTask, scale
from executive.types import Atom, Condition, Step

_OPTIONS = ("--invariant-generation-max-candidates", "0", "--keep-unreachable-facts", "--keep-unimportant-variables")
FILE = ("--sas-file", "task.sas")
"""Options that name the file which the translator writes."""


_OUT_OF_TIME = (21, -signal.SIGXCPU)
"""Exit codes of a translator that has used up its processor time: with and without a last word."""


class TranslatorError(Exception):
    """The translator failed, or was not done in time (`late`)."""

    def __init__(self, message: str, late: bool = False) -> None:
        super().__init__(message)
        self.late = late


def run_translator(
    domain: str,
    problem: str,
    seconds: float,
    options: Sequence[str] = (),
    module: str = TRANSLATOR,
    processor: float | None = None,
) -> str:
    """Have one of the translator's programs look at a task for so many wall seconds, and for so many of the
    processor's: the file that it writes, or else what it prints.

    Raises:
        TranslatorError: it ends with an error, or not in time.
        MissingError: it is not installed.
    """
    command = [*translator_command(module), *options, "domain.pddl", "problem.pddl"]
    if seconds <= 0:
        raise TranslatorError("Fast Downward's translator did not finish in time", late=True)
    with tempfile.TemporaryDirectory(prefix="executive-translate-") as name:
        folder = Path(name)
        (folder / "domain.pddl").write_text(domain, encoding="ascii")
        (folder / "problem.pddl").write_text(problem, encoding="ascii")
        try:
            ended = run_program(command, folder, seconds, None, processor)
            if ended.expired or ended.code in _OUT_OF_TIME:
                raise TranslatorError("Fast Downward's translator did not finish in time", late=True)
            if ended.code:
                raise TranslatorError(f"Fast Downward's translator failed ({ended.last_words})")
            return (folder / "task.sas").read_text(encoding="ascii") if options else ended.said
        except OSError as error:
            raise TranslatorError(
                f"Fast Downward's translator cannot be run ({error.filename}: {error.strerror})"
            ) from None


class TranslatedTask(SasTask):
    """A task as the translator grounds it."""

    def __init__(self, schema: Schema) -> None:
        super().__init__()
        self._schema = schema
        self._text = PddlText(schema)
        self._operators: list[Operator] = []
        self._rules: list[Rule] = []
        self._reachability = Reachability(0, (), ())
        self._from: frozenset[Atom] | None = None
        self._asked: frozenset[Atom] = frozenset()

    def __len__(self) -> int:
        return len(self._operators)

    def covers(self, true: frozenset[Atom], goal: Condition) -> bool:
        """Whether a state in which exactly the atoms in `true` are true, and the goal, can be written down."""
        if self._from is None or any(atom not in self.number for atom in true):
            return False
        return not (goal.atoms & self._schema.task.derived.rules.keys()) - self._asked

    def ground(self, true: frozenset[Atom], goal: Condition, seconds: float) -> None:
        """Have the task grounded so that a state and a goal can be written down, with all before them.

        Raises:
            TranslatorError: the translator fails, or is not done within so many seconds of wall time.
            MissingError: it is not installed.
        """
        derived = self._schema.task.derived.rules.keys()
        asked = self._asked | (goal.atoms & derived) | (self._schema.task.goal.atoms & derived)
        start = true | self._schema.task.declared | (self._from or frozenset())
        # An axiom that no action needs is left out of the file unless something asks for its atom.
        more = [self._text.asker(number, atom) for number, atom in enumerate(sorted(asked))]
        # What no action changes and is looked at all the same may turn out to be otherwise than :init says.
        changed = {each.literal.predicate for action in self._schema.actions.values() for each in action.effects}
        looked_at = {atom.predicate for atom in self._schema.task.atoms} - changed
        more += [self._text.maker(predicate) for predicate in sorted(looked_at)]
        sas = run_translator(self._text.domain(FINISH, *more), self._text.problem(start), seconds, (*_OPTIONS, *FILE))
        self._read(sas)
        self._from, self._asked = start, asked

    def relevant(
        self, true: frozenset[Atom], goal: Condition, avoid: Collection[Step] = frozenset()
    ) -> tuple[list[str], list[str]]:
        left_out = {self._text.call(step) for step in avoid}
        operators = [operator for operator in self._operators if operator.name not in left_out]
        rules = self._rules
        state = [1] * len(self.variables)
        for number in (*(self.number[atom] for atom in true), *self.others):
            state[number] = 0
        if not self._reachability.open(state):
            reached = self._reachability.reached(state)
            operators = [left for each in operators if (left := each.simplified(reached)) is not None]
            rules = [left_ for rule in rules if (left_ := rule.simplified(reached)) is not None]
        wanted = (self.number[atom] for atom in goal.atoms if atom in self.number)
        operators, rules = relevant(wanted, operators, rules)
        return [operator.text for operator in operators], [rule.text for rule in rules]

    def step(self, name: str) -> Step:
        call = self._text.action(name)
        if call is None:
            raise ValueError(f"there is no action {name}")
        return self._schema.ground(*call)

    def _read(self, sas: str) -> None:
        """Take over what the translator wrote (version 3 of its format)."""
        front, _, tail = sas.partition("\nbegin_state\n")
        self.variables, self.number, self.highest_layer = [], {}, -1
        derived, others = set(), set()
        values = sas.partition("\nbegin_state\n")[2].partition("\nend_state")[0].split()
        for text in _blocks(front, "variable"):
            _begin, _name, layer, _size, value, *_ = text.split("\n")
            atom = self._text.atom(value)
            if atom is not None:
                self.number[atom] = len(self.variables)
                if layer != "-1":
                    derived.add(atom)
            elif layer == "-1" and values[len(self.variables)] == "0":
                others.add(len(self.variables))
            self.highest_layer = max(self.highest_layer, int(layer))
            self.variables.append(text)
        self.derived, self.others = frozenset(derived), frozenset(others)
        _state, _, tail = tail.partition("\nend_goal\n")
        shared, costs = list(range(2 * len(self.variables))), list[float]()
        self._operators = []
        for text in _blocks(tail, "operator"):
            operator = Operator.read(text, shared)
            call = self._text.action(operator.name)
            with contextlib.suppress(ValueError):  # without a value for its cost it can never be carried out
                if call is not None:
                    costs.append(self._schema.cost(*call))
                    self._operators.append(operator)
        self.costs = self._schema.has_costs
        if self.costs:
            self.scale = scale(costs)
            pairs = zip(self._operators, costs, strict=True)
            self._operators = [operator.costing(round(cost * self.scale)) for operator, cost in pairs]
        self._rules = [Rule.read(text) for text in _blocks(tail, "rule")]
        self.conditional = any(operator.conditional for operator in self._operators)
        self.axioms = bool(self._rules)
        self._reachability = Reachability(len(self.variables), self._operators, self._rules)


def _blocks(text: str, kind: str) -> list[str]:
    """The parts of a file that begin with `begin_<kind>`."""
    begin, end = f"begin_{kind}\n", f"end_{kind}"
    return [f"{begin}{block.partition(end)[0]}{end}" for block in text.split(begin)[1:]]
