"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from executive.cli import completion
from executive.errors import InputError

if TYPE_CHECKING:
    from executive.app.estimators import EstimatorConfig


def _problems(ctx: typer.Context) -> completion.Offer:
    # While an option still lacks its value, arguments wait to be given their names.
    return completion.problems(ctx.params.get("domain") or next(iter(ctx.args), None))


# What several commands take.
DomainName = Annotated[
    str,
    typer.Argument(
        help="A domain's folder, the name of one that comes with Executive, or a PDDL domain file.",
        autocompletion=completion.domains,
    ),
]
ProblemFile = Annotated[Path | None, typer.Argument(help="The PDDL problem file that goes with a PDDL domain file.")]
ProblemName = Annotated[
    str | None,
    typer.Option(help="One of the domain's problems (see: executive domains).", autocompletion=_problems),
]

RunName = Annotated[str, typer.Argument(help="A run's folder, or its name in runs/.", autocompletion=completion.runs)]

# The options of the estimator, for every command that asks a model.
Model = Annotated[str | None, typer.Option(help="The model: a folder, a hub id, or its name at --server.")]
Server = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server that has the model.")]
TranslatorName = Annotated[
    str,
    typer.Option(help="What words the questions: templates, llm or none.", autocompletion=completion.translators),
]
LanguageModel = Annotated[str | None, typer.Option(help="The language model for --translator llm.")]
Instructions = Annotated[
    str | None,
    typer.Option(
        help="How things look, for the prompt: domain (the default), paper (for its groceries), none, or a file.",
        autocompletion=completion.instructions,
    ),
]
NoInstructions = Annotated[bool, typer.Option("--no-instructions", help="The same as --instructions none.")]
PerImage = Annotated[bool, typer.Option("--per-image", help="Ask about each picture on its own, and average.")]
Cameras = Annotated[
    list[str] | None,
    typer.Option(help="Only the pictures of these cameras, such as front (as in the paper); front,hand for two."),
]
Abstention = Annotated[
    bool,
    typer.Option(
        "--abstention/--no-abstention",
        help="Unknown where little probability is on yes and no; without, always yes / (yes + no) (as in the paper).",
    ),
]
CalibrationFile = Annotated[Path | None, typer.Option(help="A file that corrects the probabilities.")]


def chosen_problem(file: Path | None, name: str | None) -> str | None:
    """Return the problem that these two ways of naming one mean.

    Raises:
        InputError: both are used.
    """
    if file is not None and name is not None:
        raise InputError(f"names the problem a second time, beside {file}", key="--problem")
    return name if file is None else str(file)


def estimator_config(
    vlm: str | None,
    server: str | None,
    translator: str,
    llm: str | None,
    instructions: str | None,
    no_instructions: bool,
    per_image: bool,
    cameras: Sequence[str] | None,
    abstention: bool,
    calibration: Path | None,
) -> EstimatorConfig:
    """Return the estimator's configuration from these options.

    Raises:
        InputError: two of them exclude each other.
    """
    from executive.app.estimators import NONE, EstimatorConfig

    if no_instructions and instructions not in (None, NONE):
        raise InputError(f"does not go with --instructions {instructions}", key="--no-instructions")
    shown = tuple(name.strip() for names in cameras or () for name in names.split(","))
    chosen = NONE if no_instructions else True if instructions is None else instructions
    return EstimatorConfig(vlm, server, translator, llm, chosen, per_image, calibration, shown, abstention)
