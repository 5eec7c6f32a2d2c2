"""From configurations to arguments and options of commands, and what several commands share beside these."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import typer

from executive.app.config import DOMAIN_NAME, PROBLEM
from executive.app.options import Configuration, Declared, Option, flag_of, held, make, options
from executive.cli import completion
from executive.errors import InputError, OptionError


def _problems(ctx: typer.Context) -> completion.Offer:
    # While an option still lacks its value, arguments wait to be given their names.
    return completion.problems(ctx.params.get("domain") or next(iter(ctx.args), None))


_OFFERED: Mapping[str, Callable[..., completion.Offer]] = {"domain": completion.domains, "problem": _problems}
"""What the shell offers for options whose valid values depend on what there is."""

ProblemFile = Annotated[Path | None, typer.Argument(help="The PDDL problem file that goes with a PDDL domain file.")]
DomainName = Annotated[str, typer.Argument(help=DOMAIN_NAME.help, autocompletion=completion.domains)]
ProblemName = Annotated[str | None, typer.Option(help=PROBLEM.help, autocompletion=_problems)]
RunName = Annotated[str, typer.Argument(help="A run's folder, or its name in runs/.", autocompletion=completion.runs)]

_FILE = Annotated[
    Path | None,
    typer.Option("--config", help="A TOML file with options, such as the config.toml of a run; flags override it."),
]

_FLAGS: dict[str, str] = {}
"""The flags that are not named like their options."""


def with_options(*, file: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a command of a function with configurations among its parameters: each of their options becomes an argument
    or an option of the command line, and the function receives the configurations.

    Args:
        file: whether `--config FILE` may have options, too.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        hints = get_type_hints(function, include_extras=True)
        models: dict[str, type[Configuration]] = {}
        parameters = [_parameter("context", typer.Context)]
        for each in inspect.signature(function).parameters.values():
            if (model := held(hints[each.name])) is None:
                parameters.append(_parameter(each.name, hints[each.name], each.default))
                continue
            models[each.name] = model
            for declared in options(model).values():
                _FLAGS[declared.name] = declared.flag
                parameters += _parameters(declared, required=not file)
        if file:
            parameters.append(_parameter("config_file", _FILE, None))

        def command(context: typer.Context, config_file: Path | None = None, **values: Any) -> Any:
            given = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in values.items()
                if getattr(context.get_parameter_source(name), "name", "DEFAULT") != "DEFAULT"
            }
            if values.pop("no_instructions", False):
                if given.get("instructions", "none") != "none":
                    raise InputError(
                        f"does not go with --instructions {given['instructions']}", key="--no-instructions"
                    )
                given["instructions"] = False
            if file and config_file is None and "domain" not in given:
                message = "is missing, and there is no --config that has one; see: executive run --help"
                raise InputError(message, key="domain")
            for name, model in models.items():
                chosen = {option: given[option] for option in options(model) if option in given}
                values[name] = make(model, chosen, config_file)
            return function(**{name: values[name] for name in hints if name != "return"})

        command.__name__, command.__doc__ = function.__name__, function.__doc__
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {each.name: each.annotation for each in parameters}
        return command

    return decorate


def chosen_problem(file: Path | None, name: str | None) -> str | None:
    """Return the problem that these two ways of naming one mean.

    Raises:
        InputError: both are used.
    """
    if file is not None and name is not None:
        raise InputError(f"names the problem a second time, beside {file}", key="--problem")
    return name if file is None else str(file)


def with_flags(error: OptionError) -> InputError:
    """Return the error with flags where it names options."""
    message = re.sub(r"`(\w+)`", lambda found: _flag(found[1]), error.message)
    return InputError(message, file=error.file, key=_flag(error.option))


def _flag(name: str) -> str:
    return _FLAGS.get(name, flag_of(name)) or name


def _parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _parameters(declared: Declared, required: bool) -> Iterator[inspect.Parameter]:
    """Yield the parameters that typer makes an argument or options of."""
    option, kind, default = declared.option, declared.kind, declared.default
    told: dict[str, Any] = {"help": option.help, "autocompletion": _OFFERED.get(declared.name, _offers(option))}
    if not declared.flag:
        yield _parameter(
            declared.name,
            Annotated[kind if required else kind | None, typer.Argument(**told)],
            inspect.Parameter.empty if required else None,
        )
        return
    flags = declared.flag
    if get_origin(kind) is tuple:
        kind, default = list[str] | None, None
    elif kind is bool:
        flags = f"{declared.flag}/{declared.off}" if default else declared.flag
    elif bool in get_args(kind):  # a text, or no
        kind, default = str | None, None
    elif kind in (int, float):
        told |= {"min": option.least, "max": option.most}
    if option.default:
        default, told["show_default"] = None, option.default
    if default is None:
        kind = Union[kind, None]  # noqa: UP007  (of any type)
    yield _parameter(
        declared.name,
        Annotated[kind, typer.Option(flags, **told)],
        inspect.Parameter.empty if default is MISSING else default,
    )
    if bool in get_args(declared.kind):
        same = f"The same as {declared.flag} none."
        yield _parameter(f"no_{declared.name}", Annotated[bool, typer.Option(declared.off, help=same)], False)


def _offers(option: Option) -> Callable[[], completion.Offer] | None:
    """Return what offers an option's words to the shell; None where it has none."""
    words = {**option.choices, **option.offers}
    return (lambda: list(words.items())) if words else None
