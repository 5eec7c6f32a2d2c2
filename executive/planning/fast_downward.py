"""Fast Downward: a task is grounded once, and every call is answered by its search alone
(`executive.planning.sas_task`).

Only tasks with more grounded actions than are worth writing down go through unified-planning, which has Fast Downward's
translator read them each time. This is the only importer of unified_planning, which takes seconds: it is imported when
such a task is at hand. Fast Downward is GPL-3 and is asked for by its engine name alone; it runs in processes of its
own. Three things about the engine shape this file. It writes its intermediate file into the current directory, so that
two planners in one directory would read each other's task: each call gets a directory of its own. After a timeout its
processes may live on (unified-planning #681): they are killed here, the whole group. And it has called solvable tasks
UNSOLVABLE_INCOMPLETELY (up-fast-downward #29, #37): only what it calls proven counts as unsolvable.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any, TypeAlias

from executive.domain.pddl import Action, And, Equality, Literal, Schema, conjuncts, written_out
from executive.errors import MissingError
from executive.planning.goal_order import by_goals, holds, replay
from executive.planning.sas_task import OUT_OF_TIME, SOLVED, UNSOLVABLE, Grounded, find_engine, last_words, size
from executive.types import Atom, Condition, Facts, NoPlan, NoPlanReason, Plan, Step

ENGINE = "fast-downward"
_TICK = 0.02
"""Seconds between two looks at the clock and at the engine."""


@dataclass(frozen=True, slots=True)
class _Search:
    """One way to search, and the share of the remaining time that it may take."""

    name: str
    params: Mapping[str, str]
    options: tuple[str, ...]
    share: float


_FIRST = """let(landmarks, landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=false),
let(relaxed, ff(), lazy_greedy([relaxed, landmarks], preferred=[relaxed, landmarks], reopen_closed=false)))"""

_QUICK = _Search(
    "lazy_greedy(ff())", {}, ("--search", "let(relaxed, ff(), lazy_greedy([relaxed], preferred=[relaxed]))"), 0.2
)
_SEARCHES = (
    _QUICK,
    _Search("astar(lmcut())", {"fast_downward_search_config": "astar(lmcut())"}, ("--search", "astar(lmcut())"), 0.5),
    _Search("lama-first", {"fast_downward_alias": "lama-first"}, ("--search", _FIRST), 1.0),
)
"""The shortest plan; where that takes too long, any plan. All searches are complete and deterministic. What the quick
one finds is only taken where LM-cut says that no plan is shorter: with many items, to search for the shortest takes
much longer (`python -m benchmarks.speed --only growth`)."""

_FEW = 100
"""Grounded actions up to which the search for the shortest plan is as quick."""

MOST_GROUNDED = 20_000
"""Grounded actions that a task may have to be written down."""

_FENCE = 'cd "$1" && ulimit -t "$2" && shift 2 && exec "$@"'
"""Runs the engine in a directory of its own, and with a limit on CPU seconds that ends it even where this process was
killed and can end nothing any more."""


_Goal: TypeAlias = Sequence[tuple[Atom, bool]]
_Asked: TypeAlias = "Callable[[_Search, float], tuple[Step, ...] | NoPlan]"
"""A problem that can be searched in some way for some seconds."""

_Posed: TypeAlias = "Callable[[frozenset[Atom], _Goal, frozenset[Step]], _Asked]"
"""Makes a problem of a state's true atoms, a goal and the steps to do without."""

_PASSED = NoPlan(NoPlanReason.TIMED_OUT)
"""What a search is not for."""


def _too_late(way: _Search, seconds: float) -> NoPlan:
    return _PASSED


_UNREACHABLE = "the goal cannot be reached from this state"


class FastDownwardPlanner:
    """Plans for one task from any of its states: the fewest steps where they can be found within half of the time
    limit, put into the order in which the problem file names the goals (`executive.planning.goal_order`).

    The same state and goal give the same plan, as long as the time limit does not come in between. Not to be called
    from two threads at once.
    """

    def __init__(self, schema: Schema, *, timeout: float = 30.0) -> None:
        """`timeout` is the wall time in seconds that one call of `plan` may take."""
        if not timeout > 0:
            raise ValueError(f"timeout: expected seconds above zero, got {timeout}")
        self._schema, self._timeout = schema, timeout
        self._atoms, self._is_strips = frozenset(schema.task.atoms), _is_strips(schema)
        self._lock = threading.Lock()
        self._asked = False
        self._built: _Translation | None = None
        self._grounded: tuple[Grounded, Path] | None = None

    def warm_up(self) -> None:
        """Do in the background what the first call of `plan` needs; that call goes on with it."""

        def prepare() -> None:
            with contextlib.suppress(Exception):  # the same error is raised by `plan`, where somebody can see it
                self._prepared(lambda: self._asked, math.inf)

        threading.Thread(target=prepare, name="planner-warm-up", daemon=True).start()

    def plan(
        self, state: Facts, goal: Condition, avoid: frozenset[Step] = frozenset(), seconds: float = math.inf
    ) -> Plan | NoPlan:
        """A plan from `state` to `goal`, or why there is none; see `executive.protocols.Planner`.

        Raises:
            ValueError: an atom that the task does not have.
            MissingError: Fast Downward is not installed.
        """
        wanted = goal.literals
        if wanted is None or not self._is_strips:
            return NoPlan(NoPlanReason.CRASHED, "only conjunctions of literals can be planned with", ENGINE)
        return self._plan(state, wanted, avoid, seconds)

    def _plan(self, state: Facts, goal: Facts, avoid: frozenset[Step], seconds: float) -> Plan | NoPlan:
        unknown = (state.keys() | goal.keys()) - self._atoms
        if unknown:
            raise ValueError(f"the task has no atom {', '.join(map(str, sorted(unknown)))}")
        started = time.perf_counter()
        if holds(state.true, goal):
            return Plan((), 0.0, ENGINE, time.perf_counter() - started)
        order = [atom for atom in self._schema.goals if atom in goal]
        order += [atom for atom in goal if atom not in self._schema.goals]
        limit = min(self._timeout, seconds)
        until, failure, self._asked = started + limit, NoPlan(NoPlanReason.TIMED_OUT), True
        problem = self._prepared(lambda: time.perf_counter() >= until, limit)
        search = _too_late if problem is None else problem(state.true, [(atom, goal[atom]) for atom in order], avoid)
        for way in _SEARCHES:
            left = until - time.perf_counter()
            if left <= 0:
                break
            answer = search(way, left * way.share)
            if not isinstance(answer, NoPlan):
                steps = by_goals(state, answer, goal, order, lambda: time.perf_counter() >= until)
                end = replay(state.true, steps)
                if end is not None and holds(end, goal):
                    seconds = time.perf_counter() - started
                    return Plan(steps, float(len(steps)), f"{ENGINE} {way.name}", seconds)
                answer = NoPlan(NoPlanReason.CRASHED, "the engine's plan does not reach the goal")
            failure = answer
            if failure.reason is NoPlanReason.UNSOLVABLE:
                break
        detail = failure.detail
        if failure.reason is NoPlanReason.TIMED_OUT:
            detail = f"neither a plan nor a proof that there is none within {round(limit, 2):g} s"
        return NoPlan(failure.reason, detail, ENGINE, time.perf_counter() - started)

    def _prepared(self, stop: Callable[[], bool], seconds: float) -> _Posed | None:
        """What makes a problem of a state, a goal and steps to avoid, ready to be searched. None where it is to `stop`
        before it is ready, or is not its turn within so many `seconds`; the next call goes on from there."""
        if not self._lock.acquire(timeout=min(seconds, threading.TIMEOUT_MAX)):
            return None
        try:
            if size(self._schema) > MOST_GROUNDED:
                if self._built is None:
                    self._built = _Translation(self._schema)
                return self._translated
            if self._grounded is None:
                self._grounded = Grounded(self._schema), find_engine()
            return self._written if self._grounded[0].ground(stop) else None
        except BaseException:  # what was interrupted in the middle of an action cannot go on
            self._grounded = None
            raise
        finally:
            self._lock.release()

    def _written(self, true: frozenset[Atom], goal: _Goal, avoid: frozenset[Step]) -> _Asked:
        assert self._grounded is not None
        grounded, engine = self._grounded
        task = grounded.task(true, goal, avoid)

        def ask(way: _Search, seconds: float) -> tuple[Step, ...] | NoPlan:
            if way is _QUICK and len(grounded) <= _FEW:
                return _PASSED
            try:
                answer = grounded.search(engine, task, way.options, seconds)
                if way is _QUICK and answer.code == SOLVED:
                    least = grounded.least(engine, task, seconds)
                    return answer.steps if least is not None and len(answer.steps) <= least else _PASSED
            except (OSError, ValueError) as error:
                return NoPlan(NoPlanReason.CRASHED, f"{type(error).__name__}: {error}")
            if answer.code == SOLVED:
                return answer.steps
            if answer.code == UNSOLVABLE:
                return NoPlan(NoPlanReason.UNSOLVABLE, _UNREACHABLE)
            if answer.expired or answer.code == OUT_OF_TIME:
                return NoPlan(NoPlanReason.TIMED_OUT)
            return NoPlan(NoPlanReason.CRASHED, f"the engine ended with exit code {answer.code}: {answer.last_words}")

        return ask

    def _translated(self, true: frozenset[Atom], goal: _Goal, avoid: frozenset[Step]) -> _Asked:
        assert self._built is not None
        translation = self._built
        problem = translation.problem(true, goal, avoid)

        def ask(way: _Search, seconds: float) -> tuple[Step, ...] | NoPlan:
            """What the engine's answer means. Whatever goes wrong inside it is a crash, never an exception."""
            if way is _QUICK:  # asking takes as long as searching
                return _PASSED
            try:
                result, expired = _solve(translation.environment, problem, way, seconds)
                status = result.status.name
                if status.startswith("SOLVED"):
                    return tuple(self._schema.ground(*translation.names(instance)) for instance in result.plan.actions)
            except Exception as error:
                return NoPlan(NoPlanReason.CRASHED, f"{type(error).__name__}: {error}")
            if expired or status == "TIMEOUT":
                return NoPlan(NoPlanReason.TIMED_OUT)
            if status == "UNSOLVABLE_PROVEN":
                return NoPlan(NoPlanReason.UNSOLVABLE, _UNREACHABLE)
            return NoPlan(NoPlanReason.CRASHED, f"the engine ended with {status}: {_last_words(result)}")

        return ask


class _Translation:
    """The task as unified-planning has it, built once.

    Names get a letter in front, so that a type and an object may share one and no word of PDDL's own is hit. What is
    quantified is written out, because Fast Downward would otherwise compile it to axioms, which its best heuristics
    do not take. A constant inside an action becomes a parameter of a type with that one member: unified-planning
    keeps constants in sets, whose order changes from process to process, and with it the plan.
    """

    def __init__(self, schema: Schema) -> None:
        try:
            from unified_planning.environment import Environment
            from unified_planning.model import Fluent, Object, Problem
        except ImportError as error:
            raise MissingError(f"unified-planning: {error}", command="pip install unified-planning") from error
        self.environment: Any = Environment()
        self.environment.credits_stream = None
        if ENGINE not in self.environment.factory.engines:
            raise MissingError("Fast Downward is not installed", command="pip install up-fast-downward")
        self._expressions = self.environment.expression_manager
        kinds = self.environment.type_manager
        types: dict[str | None, Any] = {None: None}
        while len(types) <= len(schema.typing.supertypes):
            for name, parents in schema.typing.supertypes.items():
                if name not in types and (not parents or parents[0] in types):
                    types[name] = kinds.UserType(f"t_{name}", types[parents[0] if parents else None])
        bodies = {name: body for name, action in schema.actions.items() if (body := _body(schema, action)).effects}
        constants = sorted({term for body in bodies.values() for term in _constants(body)})
        only = {name: kinds.UserType(f"c_{name}", types[schema.typing.objects[name]]) for name in constants}
        self._problem: Any = Problem("task", self.environment, initial_defaults={kinds.BoolType(): False})
        self._objects = {
            name: Object(f"o_{name}", only.get(name, types[kind]), self.environment)
            for name, kind in schema.typing.objects.items()
        }
        self._problem.add_objects(self._objects.values())
        self._fluents = {}
        for name, parameters in schema.predicates.items():
            signature = OrderedDict((f"v_{index}", types[kind]) for index, kind in enumerate(parameters))
            self._fluents[name] = Fluent(f"p_{name}", kinds.BoolType(), signature, self.environment)
        for fluent in self._fluents.values():
            self._problem.add_fluent(fluent)
        for atom in sorted(schema.task.static):
            self._problem.set_initial_value(self._atom(atom), True)
        self._arity = {name: len(schema.actions[name].parameters) for name in bodies}
        for name in bodies:
            action = schema.actions[name]
            terms = [(variable, types[kind]) for variable, kind in action.parameters]
            terms += [(constant, only[constant]) for constant in _constants(bodies[name])]
            self._problem.add_action(self._action(name, terms, bodies[name]))

    def problem(self, true: Iterable[Atom], goals: Sequence[tuple[Atom, bool]], avoid: Iterable[Step] = ()) -> Any:
        """The planning problem that starts where exactly the atoms in `true` are true, without the steps in `avoid`:
        each action of which there are some needs that its arguments are not among theirs."""
        problem = self._problem.clone()
        for name, steps in groupby(sorted(avoid, key=str), key=lambda step: step.action):
            self._leave_out(problem, name, [step.args for step in steps])
        for atom in sorted(true):
            problem.set_initial_value(self._atom(atom), True)
        for atom, value in goals:
            problem.add_goal(self._atom(atom) if value else self._expressions.Not(self._atom(atom)))
        return problem

    def _leave_out(self, problem: Any, name: str, arguments: Iterable[tuple[str, ...]]) -> None:
        from unified_planning.model import Fluent

        action = problem.action(f"a_{name}")
        own = action.parameters[: self._arity[name]]
        signature = OrderedDict((parameter.name, parameter.type) for parameter in own)
        barred = Fluent(f"n_{name}", self.environment.type_manager.BoolType(), signature, self.environment)
        problem.add_fluent(barred)
        terms = [self._expressions.ParameterExp(parameter) for parameter in own]
        action.add_precondition(self._expressions.Not(self._expressions.FluentExp(barred, terms)))
        for args in arguments:
            instance = self._expressions.FluentExp(barred, [self._objects[arg] for arg in args])
            problem.set_initial_value(instance, True)

    def names(self, instance: Any) -> tuple[str, tuple[str, ...]]:
        """The action and its arguments, as the PDDL files call them."""
        name = instance.action.name.removeprefix("a_")
        arguments = (str(parameter.object().name) for parameter in instance.actual_parameters)
        return name, tuple(argument.removeprefix("o_") for argument in islice(arguments, self._arity[name]))

    def _atom(self, atom: Atom) -> Any:
        return self._expressions.FluentExp(self._fluents[atom.predicate], [self._objects[arg] for arg in atom.args])

    def _action(self, name: str, parameters: Sequence[tuple[str, Any]], body: _Body) -> Any:
        from unified_planning.model import InstantaneousAction

        renamed = {term: f"v_{index}" for index, (term, _) in enumerate(parameters)}
        action = InstantaneousAction(
            f"a_{name}", OrderedDict((renamed[term], kind) for term, kind in parameters), self.environment
        )

        def term(word: str) -> Any:
            return self._expressions.ParameterExp(action.parameter(renamed[word]))

        for condition in body.preconditions:
            if isinstance(condition, Equality):
                expression = self._expressions.Equals(term(condition.left), term(condition.right))
            else:
                fluent = self._fluents[condition.predicate]
                expression = self._expressions.FluentExp(fluent, [term(word) for word in condition.terms])
            action.add_precondition(expression if condition.positive else self._expressions.Not(expression))
        for effect in body.effects:
            fluent = self._fluents[effect.predicate]
            expression = self._expressions.FluentExp(fluent, [term(word) for word in effect.terms])
            action.add_effect(expression, effect.positive)
        return action


def _is_strips(schema: Schema) -> bool:
    """Whether all that the actions ask for are literals, and their effects come about whatever else holds."""
    plain = all(effect.condition == And() for action in schema.actions.values() for effect in action.effects)
    written = (written_out(action.precondition, schema.typing) for action in schema.actions.values())
    asked = all(isinstance(each, Literal | Equality) for formula in written for each in conjuncts(formula))
    return plain and asked and not schema.axioms and not schema.has_costs


@dataclass(frozen=True, slots=True)
class _Body:
    """An action's conditions with its parameters left open and its quantifiers written out."""

    preconditions: tuple[Literal | Equality, ...]
    effects: tuple[Literal, ...]


def _body(schema: Schema, action: Action) -> _Body:
    effects: dict[Literal, None] = {}
    for effect in action.effects:
        names = [name for name, _ in effect.variables]
        for row in schema.typing.tuples([kind for _, kind in effect.variables]):
            written = written_out(effect.literal, schema.typing, dict(zip(names, row, strict=True)))
            effects.update({written: None} if isinstance(written, Literal) else {})
    parts = conjuncts(written_out(action.precondition, schema.typing))
    adds = {(effect.predicate, effect.terms) for effect in effects if effect.positive}
    return _Body(
        tuple(dict.fromkeys(each for each in parts if isinstance(each, Literal | Equality))),
        tuple(effect for effect in effects if effect.positive or (effect.predicate, effect.terms) not in adds),
    )


def _constants(body: _Body) -> list[str]:
    """The objects that an action's body names, each once, in order."""
    words: dict[str, None] = {}
    for condition in (*body.preconditions, *body.effects):
        terms = (condition.left, condition.right) if isinstance(condition, Equality) else condition.terms
        words.update(dict.fromkeys(term for term in terms if not term.startswith("?")))
    return list(words)


def _solve(environment: Any, problem: Any, search: _Search, seconds: float) -> tuple[Any, bool]:
    """Run the engine: its result, and whether it was ended because its time was up."""
    with tempfile.TemporaryDirectory(prefix="executive-plan-") as folder:
        engine = environment.factory.OneshotPlanner(name=ENGINE, params=dict(search.params))
        command = engine._get_cmd
        limit = str(math.ceil(seconds) + 1)
        engine._get_cmd = lambda *files: ["sh", "-c", _FENCE, "sh", folder, limit, *map(str, command(*files))]
        over, expired = threading.Event(), threading.Event()
        guard = threading.Thread(target=_guard, args=(engine, seconds, over, expired), name="planner-guard")
        guard.start()
        try:
            result = engine.solve(problem)
        finally:
            over.set()
            guard.join()
            if engine._process is not None:  # an exception, such as Ctrl-C, came in between
                _end(engine._process)
                engine._process.wait()
        return result, expired.is_set()


def _guard(engine: Any, seconds: float, over: threading.Event, expired: threading.Event) -> None:
    """End the engine's processes when the time is up, and those that a dead engine left behind."""
    deadline = time.monotonic() + seconds
    while not over.wait(_TICK):
        process = engine._process
        if time.monotonic() >= deadline:
            expired.set()
            _end(process)
        elif process is not None and process.poll() is not None:
            _end(process)


def _end(process: subprocess.Popen[bytes] | None) -> None:
    """Kill a process and the group that it leads. There is nothing in it worth a farewell."""
    if process is not None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _last_words(result: Any) -> str:
    """The line of the engine's output that says most about how it ended; what it printed on stderr goes first."""
    messages = [(message.level.name == "ERROR", message.message.splitlines()) for message in result.log_messages or ()]
    errors, others = (
        [line for is_error, lines in messages if is_error is wanted for line in lines] for wanted in (True, False)
    )
    return last_words([line for line in errors if line.strip()] or others)
