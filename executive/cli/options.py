"""Arguments and options that several commands have, worded once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from executive import completion


def _problems(ctx: typer.Context) -> completion.Offer:
    # While an option still lacks its value, arguments wait to be given their names.
    return completion.problems(ctx.params.get("domain") or next(iter(ctx.args), None))


# What several commands ask for in the same way.
DomainName = Annotated[
    str,
    typer.Argument(
        help="A domain's folder, or the name of one that comes with Executive.", autocompletion=completion.domains
    ),
]
ProblemName = Annotated[
    str | None,
    typer.Option(help="One of the domain's problems (see: executive domains).", autocompletion=_problems),
]

RunName = Annotated[str, typer.Argument(help="A run's folder, or its name in runs/.", autocompletion=completion.runs)]

# Which model looks, and how it is asked: the same for every command that looks.
Model = Annotated[str | None, typer.Option(help="The model: a folder, a hub id, or its name at --server.")]
Server = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server that has the model.")]
TranslatorName = Annotated[
    str,
    typer.Option(help="Who words the questions: templates, llm or none.", autocompletion=completion.translators),
]
LanguageModel = Annotated[str | None, typer.Option(help="The language model for --translator llm.")]
Instructions = Annotated[bool, typer.Option("--instructions/--no-instructions", help="Tell it how things look.")]
PerImage = Annotated[bool, typer.Option("--per-image", help="Ask about each picture alone, and average.")]
CalibrationFile = Annotated[Path | None, typer.Option(help="A file that corrects the probabilities.")]
