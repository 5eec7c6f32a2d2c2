"""The configuration of a run, which declares all of its options, and the folder that keeps it."""

from __future__ import annotations

import dataclasses
import os
import re
import time
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

from executive.app.options import Option, as_toml, check, make
from executive.errors import InputError, OptionError, nearest
from executive.util.atomic_write import write_atomic
from executive.util.files import check_writable, reason

if TYPE_CHECKING:
    from executive.core.settings import Settings
    from executive.domain.loader import Domain

CONFIG = "config.toml"
"""The file in a run's folder with its configuration."""

ESTIMATORS = MappingProxyType({"vlm": "a vision-language model", "oracle": "ground truth", "none": "open loop"})

MUJOCO, SYMBOLIC_WORLD = "mujoco", "symbolic"

WORLDS = MappingProxyType(
    {MUJOCO: "the simulator", SYMBOLIC_WORLD: "no simulator; actions have the effects that the PDDL gives them"}
)

EXPECTED, LIKELIEST = "expected", "likeliest"

SEARCHES = MappingProxyType(
    {
        EXPECTED: "where the cost of looking in vain is least in expectation",
        LIKELIEST: "where what is needed most probably is",
    }
)

ORACLE_POSES, DEPTH = "oracle", "depth"

RENDERERS = MappingProxyType(
    {"mujoco": "MuJoCo's OpenGL, fast", "mitsuba": "Mitsuba's path tracer: photorealistic, about a second a picture"}
)

RENDERER = Option(
    "What draws all cameras' pictures: mujoco or mitsuba; as the scene says if not given.", choices=RENDERERS
)

POSES = MappingProxyType({ORACLE_POSES: "the simulator's", DEPTH: "estimated from depth pictures"})

TRANSLATORS = MappingProxyType(
    {"templates": "the domain's own questions", "llm": "a language model words them", "none": "bare predicates"}
)

DOMAIN, PAPER, NONE = "domain", "paper", "none"

INSTRUCTIONS = MappingProxyType(
    {DOMAIN: "the domain's own", PAPER: "the paper's, for its groceries", NONE: "no instructions"}
)

DOMAIN_NAME = Option("A domain's folder, or the name of one that comes with Executive.")
PROBLEM = Option("One of the domain's problems (see: executive domains).")
HOME_POSE = Option("Go home after each action.")


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """The options of a vision-language estimator.

    Attributes:
        vlm: without it, the model that comes with the domain; with `server`, a model's name there (without it, the only
            one there).
        llm: without it, the server's model that also answers the questions.
        instructions: True for the domain's, False for none, "paper" for the paper's (Appendix E.3), or a file.
        calibration: the file with the sensor model, the calibration looks and the correction of probabilities; without
            it, the one in the model's folder, if there is one.
        cameras: in the order in which the model gets their pictures; without any, all.

    Raises:
        OptionError: a value is not valid, or two options exclude each other.
    """

    vlm: Annotated[str | None, Option("The model: a folder, a hub id, or its name at --server.")] = None
    server: Annotated[str | None, Option("Address of an OpenAI-compatible server that has the model.")] = None
    translator: Annotated[str, Option("What words the questions: templates, llm or none.", choices=TRANSLATORS)] = (
        "templates"
    )
    llm: Annotated[str | None, Option("The language model for --translator llm.")] = None
    instructions: Annotated[
        bool | str,
        Option(
            "How things look, for the prompt: domain (the default), paper (for its groceries), none, or a file.",
            offers=INSTRUCTIONS,
        ),
    ] = True
    per_image: Annotated[bool, Option("Ask about each picture on its own, and average.")] = False
    calibration: Annotated[
        Path | None, Option("A file with the error rates of the answers, and the correction of probabilities.")
    ] = None
    cameras: Annotated[
        tuple[str, ...],
        Option("Only the pictures of these cameras, such as front (as in the paper); front,hand for two."),
    ] = ()
    abstention: Annotated[
        bool,
        Option(
            "Unknown where little probability is on yes and no; without, always yes / (yes + no) (as in the paper)."
        ),
    ] = True

    def __post_init__(self) -> None:
        words = {DOMAIN: True, NONE: False}
        object.__setattr__(self, "instructions", words.get(str(self.instructions), self.instructions))
        shown = (name.strip() for names in self.cameras for name in names.split(","))
        object.__setattr__(self, "cameras", tuple(dict.fromkeys(shown)))
        check(self)
        if self.server is not None:
            from executive.s3e.backends.openai_client import base_url

            base_url(self.server)  # refuses addresses with secrets, which would go into a run's record
        if self.llm is not None and self.translator != "llm":
            raise OptionError("goes with `translator` llm", option="llm")
        if self.translator == "llm" and self.llm is None and self.server is None:
            raise OptionError("llm needs `llm` with a language model's folder or id", option="translator")

    def check_cameras(self, there: Collection[str]) -> None:
        """Check that the scene has these cameras.

        Raises:
            OptionError: it lacks one of them.
        """
        for name in self.cameras:
            if name not in there:
                raise OptionError(f"there is no camera {name!r}; {nearest(name, there)}", option="cameras")


PLAIN, FUSED = "plain", "fused"
"""The kinds of monitors: each answer thresholded on its own; consistent, and fused with earlier ones."""


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """The options of a monitor.

    Attributes:
        alpha: the requested error rate: the share of looks in which, by predicate, some atom may get the wrong value.
            The thresholds follow from the calibration looks in the file `calibration`. Without an error rate they are
            `executive.belief.bayes_filter.DEFAULT_THRESHOLDS`.
        threshold: thresholds every answer at this probability instead: no unknowns, no consistency, no memory.
        memory: without it, each moment is estimated from its own looks alone.
        trust: the former name of the file `calibration`, until version 0.3.

    Raises:
        OptionError: a value is not valid, or two options exclude each other.
    """

    alpha: Annotated[
        float | None,
        Option("Error rate: the share of looks that may have a wrong value; the rest is unknown.", above=0, below=1),
    ] = None
    threshold: Annotated[
        float | None,
        Option("Threshold each answer on its own, without unknowns; 0.5 as in the paper.", least=0, most=1),
    ] = None
    memory: Annotated[bool, Option("Combine looks with earlier ones.")] = True
    trust: Annotated[Path | None, Option("The former name of --calibration.")] = None

    @property
    def kind(self) -> str:
        """The kind of monitor that these options are for: `PLAIN` or `FUSED`."""
        return FUSED if self.threshold is None else PLAIN

    def __post_init__(self) -> None:
        check(self)
        if self.threshold is not None and self.alpha is not None:
            raise OptionError("sets the thresholds by an error rate, and excludes `threshold`", option="alpha")
        if self.threshold is not None and self.trust is not None:
            raise OptionError("excludes `threshold`, which uses no sensor model", option="trust")
        if self.trust is not None:
            warnings.warn(
                "trust is called calibration now, and the file has the correction of probabilities, too; the former "
                "name works until version 0.3",
                FutureWarning,
                stacklevel=3,
            )


PRESETS: Mapping[str, MonitorConfig] = MappingProxyType(
    {"plain": MonitorConfig(threshold=0.5), "consistent": MonitorConfig(memory=False), "full": MonitorConfig()}
)

MONITORS = MappingProxyType(
    {
        "plain": "each answer thresholded on its own, as in the paper",
        "consistent": "the answers of one moment made consistent",
        "full": "the same with memory",
    }
)
"""What each preset of a monitor does."""


def preset(name: str, option: str = "monitor") -> MonitorConfig:
    """Return the preset of that name.

    Raises:
        OptionError: there is none.
    """
    if name not in PRESETS:
        raise OptionError(f"no monitor {name!r}; {nearest(name, PRESETS)}", option=option)
    return PRESETS[name]


_LIMIT = "Give up after so many."


@dataclass(frozen=True, slots=True)
class RunConfig:
    """The options of a run; `config.toml` in the run's folder has the same.

    Attributes:
        problem: without it, the domain's default. Where `domain` is a PDDL file, another one.
        estimator: without it, "vlm", or "oracle" in the symbolic world.
        faults: specifications in the grammar of `executive.faults`.
        max_replans, max_actions, max_cycles, max_looks, max_seconds, max_looks_again, max_questions: without one, what
            `executive.core.settings.Settings` has.
        eye: the options of the estimator "vlm". The estimator "oracle" has one of them: `calibration`, where a fault
            makes it err.
        world: without it, the simulator, or the symbolic world where `domain` is a PDDL file.
        policies: each ACTION=FILE, the action and the file of the policy that carries it out.
        no_effect: how often an action does nothing, without its skill noticing.
        exogenous: how often another agent does something after an action.
        flip: how often an answer is the opposite of what is so.

    Raises:
        OptionError: a value is not valid, or two options exclude each other.
    """

    domain: Annotated[
        str, Option("A domain's folder, the name of one that comes with Executive, or a PDDL domain file.")
    ]
    problem: Annotated[str | None, PROBLEM] = None
    seed: Annotated[int, Option("Fixes the scene and every random number.", least=0)] = 0
    estimator: Annotated[
        str,
        Option(
            "What estimates the state: vlm (a model), oracle (ground truth), or none (open loop).",
            choices=ESTIMATORS,
            default="vlm; oracle in the symbolic world",
        ),
    ] = ""
    faults: Annotated[
        tuple[str, ...],
        Option("Break something: drop@4, shove:p=0.3 (see: executive faults); repeat it for more.", flag="--fault"),
    ] = ()
    home_pose: Annotated[bool, HOME_POSE] = True
    grasp_noise: Annotated[float, Option("Standard deviation of the grasp, in m.", least=0, most=1)] = 0.0
    policies: Annotated[
        tuple[str, ...],
        Option("Have a learned skill carry out an action: pick=FILE.safetensors; repeat it for more.", flag="--policy"),
    ] = ()
    poses: Annotated[
        str, Option("Where skills take poses from: oracle (the simulator), or depth (estimated).", choices=POSES)
    ] = ORACLE_POSES
    renderer: Annotated[str | None, RENDERER] = None
    film: Annotated[
        float,
        Option(
            "With --poses depth: how often a second identical things are followed by the cameras; 0 for never.",
            least=0,
            most=50,
        ),
    ] = 5.0
    marks: Annotated[
        bool,
        Option(
            "With --poses depth: draw tags beside identical things into the pictures, and have the model asked by them."
        ),
    ] = False
    max_replans: Annotated[int | None, Option(_LIMIT, least=0)] = None
    max_actions: Annotated[int | None, Option(_LIMIT, least=1)] = None
    max_cycles: Annotated[int | None, Option(_LIMIT, least=1)] = None
    max_looks: Annotated[int | None, Option(_LIMIT, least=1)] = None
    max_seconds: Annotated[float | None, Option("Give up after so many wall seconds.", least=0)] = None
    patience: Annotated[float, Option("Time limit of a look, a plan or an action, in wall seconds.", above=0)] = 900.0
    max_looks_again: Annotated[int | None, Option("Looks again at uncertain atoms, in a row.", least=0)] = None
    max_questions: Annotated[int | None, Option("Atoms that a look may ask about.", least=1)] = None
    guard: Annotated[bool, Option("Look at what is carried while it is carried.")] = True
    planner: Annotated[str, Option("fast-downward, or any planner that unified-planning has here.")] = "fast-downward"
    search: Annotated[
        str, Option("Where to look first for what cannot be seen: expected or likeliest.", choices=SEARCHES)
    ] = EXPECTED
    places: Annotated[
        Path | None, Option("A file that says where things usually are (see: executive calibrate --places).")
    ] = None
    runs: Annotated[Path, Option("Where the run's folder is made.")] = Path("runs")
    name: Annotated[str | None, Option("The name of the run's folder.")] = None
    viewer: Annotated[bool, Option("Write trace.rrd, too.", flag="--trace-viewer")] = True
    tree: Annotated[bool, Option("Show the search trees of motion planning.")] = False
    eye: EstimatorConfig | None = None
    monitor: MonitorConfig = field(default_factory=MonitorConfig)
    world: Annotated[
        str,
        Option(
            "mujoco (the simulator), or symbolic: no simulator, actions have the effects that the PDDL gives them.",
            choices=WORLDS,
            default="mujoco; symbolic for a PDDL file",
        ),
    ] = ""
    no_effect: Annotated[
        float, Option("With --world symbolic: the share of actions that do nothing.", least=0, most=1)
    ] = 0.0
    exogenous: Annotated[
        float, Option("With --world symbolic: how often another agent acts, too.", least=0, most=1)
    ] = 0.0
    flip: Annotated[
        float, Option("With --world symbolic: the share of answers that are wrong.", least=0, most=0.49)
    ] = 0.0

    def __post_init__(self) -> None:
        from executive.domain.loader import is_pddl

        object.__setattr__(self, "world", self.world or (SYMBOLIC_WORLD if is_pddl(self.domain) else MUJOCO))
        is_symbolic = self.world == SYMBOLIC_WORLD
        object.__setattr__(self, "estimator", self.estimator or ("oracle" if is_symbolic else "vlm"))
        check(self)
        for name in ("no_effect", "exogenous", "flip"):
            if getattr(self, name) and not is_symbolic:
                raise OptionError(f"goes with `world` {SYMBOLIC_WORLD}", option=name)
        for each in self.policies:
            action, sign, file = each.partition("=")
            if not (action and sign and file):
                raise OptionError(f"{each!r} is not ACTION=FILE", option="policies")
        if is_symbolic and self.policies:
            raise OptionError("the symbolic world has no arm for a policy to move", option="policies")
        if is_symbolic and self.poses != ORACLE_POSES:
            raise OptionError("the symbolic world has no poses to estimate", option="poses")
        if self.marks and not (self.poses == DEPTH and self.estimator == "vlm"):
            raise OptionError("goes with `poses` depth and `estimator` vlm", option="marks")
        if is_symbolic and self.renderer is not None:
            raise OptionError("the symbolic world has no pictures to draw", option="renderer")
        if is_symbolic and self.estimator == "vlm":
            raise OptionError("the symbolic world has no pictures for a model", option="estimator")
        if self.eye == EstimatorConfig():
            object.__setattr__(self, "eye", None)
        mistakes = EstimatorConfig(calibration=None if self.eye is None else self.eye.calibration)
        asks_no_model = self.eye in (None, mistakes) if self.estimator == "oracle" else self.eye is None
        if self.estimator != "vlm" and not asks_no_model:
            message = f"{self.estimator!r} asks no model; `vlm` and `server` go with `estimator` vlm"
            raise OptionError(message, option="estimator")
        if self.name is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._\-]*", self.name):
            message = f"{self.name!r} is no folder name of letters, digits, '.', '_' and '-'"
            raise OptionError(message, option="name")

    def settings(self) -> Settings:
        from executive.core.settings import Settings

        names = {each.name for each in dataclasses.fields(Settings)} & {each.name for each in dataclasses.fields(self)}
        chosen = {name: value for name in names if (value := getattr(self, name)) is not None}
        return Settings(**chosen) if self.guard else Settings(**chosen, guard_looks=0)


def check_folder(config: RunConfig) -> None:
    """Check, before anything is loaded, that the run's folder can be made.

    Raises:
        InputError: nothing can be written there, or there is a run of that name.
    """
    check_writable(config.runs, "runs")
    if config.name is not None and os.path.lexists(config.runs / config.name):
        raise _taken(config.runs / config.name)


def _taken(folder: Path) -> InputError:
    return OptionError("there is a run of this name already; choose another with `name`", file=folder, option="name")


def make_folder(config: RunConfig, domain: Domain) -> Path:
    """Make the run's folder, with its configuration in it, and return it."""
    if config.name is not None:
        names = [config.name]
    else:
        stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{domain.name}-{domain.task.problem}-{config.seed}"
        names = [stem, *(f"{stem}-{index}" for index in range(2, 100))]
    for name in names:
        folder = config.runs / name
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except (OSError, ValueError) as error:
            raise OptionError(f"cannot be made: {reason(error)}", file=folder, option="runs") from error
        write_atomic(folder / CONFIG, f"# All that decides how this run went.\n{as_toml(config)}".encode())
        return folder
    raise _taken(config.runs / names[0])


def read_config(run: Path) -> RunConfig:
    """Read the configuration of a run from its folder.

    Raises:
        InputError: there is none in it, or a damaged one.
    """
    file = run / CONFIG
    if not os.path.exists(file):
        raise InputError("is missing: the run's configuration is not known", file=file)
    return make(RunConfig, {}, file)
