"""A command is one function: from Python it returns a record and prints nothing; on the command line `show` prints it.

The function's signature is the command line. Its docstring is the help: up to the arguments that of the command, with
the examples at its end, and what it says of an argument that of the option, unless the annotation has one. Parameters
without an annotation of typer are for Python alone. What only changes the output is a parameter of `show`.
"""

from __future__ import annotations

import builtins
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer
from typer.core import TyperGroup
from typer.models import ParameterInfo

AS_IN_PYTHON = object()
SECTIONS = re.compile(r"\n\n(?:Args|Returns|Raises|Examples):\n")
ARGUMENT = re.compile(r"^    (\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)  # of a docstring


@dataclass(frozen=True, slots=True)
class Words:
    """How the command line gives what Python may give as an object; stands beside an annotation of typer.

    Attributes:
        kind: type that typer reads.
        convert: from what was read to what the function takes.
        default: where it is not that of Python.
    """

    kind: Any
    convert: Callable[[Any], Any] = lambda value: value
    default: object = AS_IN_PYTHON


def command_line(function: Callable[..., Any], show: Callable[..., int | None]) -> Callable[..., None]:
    """The command of a function, for typer.

    Args:
        function: called by keywords; of `*values`, the command line gives them one behind the other.
        show: prints what the function returned, and returns the exit status; None for 0. Its own options are keywords.
    """
    options = [*_options(function), *_options(show)]
    of_show = {parameter.name for parameter, _ in _options(show)}
    several = [parameter.name for parameter, _ in options if parameter.kind is inspect.Parameter.VAR_POSITIONAL]

    @functools.wraps(function)
    def run(**given: Any) -> None:
        values = {parameter.name: words.convert(given[parameter.name]) for parameter, words in options}
        shown = {name: values.pop(name) for name in of_show}
        first = [value for name in several for value in values.pop(name)]
        if status := show(function(*first, **values), **shown):
            raise typer.Exit(status)

    parameters = [_read_by_typer(parameter, words) for parameter, words in options]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = SECTIONS.split(inspect.getdoc(function) or "")[0]
    return run


def print_nothing(status: int | None) -> int | None:
    """The `show` of a function that prints by itself, and returns the exit status."""
    return status


def add_command(
    app: typer.Typer,
    name: str,
    function: Callable[..., Any],
    show: Callable[..., int | None] = print_nothing,
    *,
    panel: str | None = None,
) -> None:
    """Add the command of a function to a program, the examples of its docstring below its help."""
    examples = inspect.cleandoc((inspect.getdoc(function) or "").partition("Examples:\n")[2])
    epilog = f"Examples:\n\n\b\n{examples}"
    app.command(name, epilog=epilog, rich_help_panel=panel)(command_line(function, show))


def _options(function: Callable[..., Any]) -> Iterator[tuple[inspect.Parameter, Words]]:
    """The parameters that the command line gives, each with its help."""
    names, texts = _Names(function.__globals__), dict(ARGUMENT.findall(inspect.getdoc(function) or ""))
    for parameter in inspect.signature(function).parameters.values():
        told = parameter.annotation
        annotation = eval(told, {}, names) if isinstance(told, str) else told
        if get_origin(annotation) is Annotated:
            kind, *notes = get_args(annotation)
            words = next((note for note in notes if isinstance(note, Words)), Words(kind))
            info = copy(next(note for note in notes if isinstance(note, ParameterInfo)))
            text = " ".join(texts.get(parameter.name, "").split())
            info.help = info.help or text[:1].upper() + text[1:]
            yield parameter.replace(annotation=info), words


class _Names(dict[str, Any]):
    """Names of a module; those that type checkers alone import, since they load slowly, are any."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)


def _read_by_typer(parameter: inspect.Parameter, words: Words) -> inspect.Parameter:
    info, default = parameter.annotation, parameter.default if words.default is AS_IN_PYTHON else words.default
    if default is False and info.default is ...:  # without a name of its own there would be a flag for True and False
        info.param_decls = (f"--{parameter.name.replace('_', '-')}",)
    kind = list[words.kind] if parameter.kind is inspect.Parameter.VAR_POSITIONAL else words.kind  # type: ignore[name-defined]
    return inspect.Parameter(
        parameter.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info]
    )


class Commands(TyperGroup):
    """A group whose help says in whole sentences what each command does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands by panels, each with the first paragraph of its help."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            text = " ".join((command.help or "").split("\n\n")[0].split())
            panels.setdefault(command.rich_help_panel or "Commands", []).append((name, text))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


def group(help_text: str) -> typer.Typer:
    """A group of commands, without commands."""
    return typer.Typer(cls=Commands, help=help_text, no_args_is_help=True, rich_markup_mode=None)


# Annotations of options that many commands have.
TEXT, PATH = Words(str), Words(Path | None)
Place = Annotated[str | Path | None, typer.Option(), PATH]  # of a file or folder that may be named
Flag = Annotated[bool, typer.Option()]
