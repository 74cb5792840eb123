"""A command is one function: from Python it returns a record and prints nothing; on the command line `show` prints it.

The function's signature is the command line and its docstring, up to the arguments, is the help. Parameters without an
annotation of typer are for Python alone. What only changes the output is a parameter of `show`.
"""

from __future__ import annotations

import builtins
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer
from typer.models import ParameterInfo

AS_IN_PYTHON = object()


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


Place = str | Path | None  # of a file or folder that may be named
TEXT, PATH = Words(str), Words(Path | None)


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
    run.__doc__ = re.split(r"\n\n(?:Args|Returns|Raises):\n", inspect.getdoc(function) or "")[0]
    return run


def print_nothing(status: int | None) -> int | None:
    """The `show` of a function that prints by itself, and returns the exit status."""
    return status


def _options(function: Callable[..., Any]) -> Iterator[tuple[inspect.Parameter, Words]]:
    """The parameters that the command line gives."""
    names = _Names(function.__globals__)
    for parameter in inspect.signature(function).parameters.values():
        told = parameter.annotation
        annotation = eval(told, {}, names) if isinstance(told, str) else told
        if get_origin(annotation) is Annotated:
            kind, *notes = get_args(annotation)
            words = next((note for note in notes if isinstance(note, Words)), Words(kind))
            yield parameter.replace(annotation=annotation), words


class _Names(dict[str, Any]):
    """Names of a module; those that type checkers alone import, since they load slowly, are any."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)


def _read_by_typer(parameter: inspect.Parameter, words: Words) -> inspect.Parameter:
    info = next(note for note in get_args(parameter.annotation) if isinstance(note, ParameterInfo))
    several = parameter.kind is inspect.Parameter.VAR_POSITIONAL
    return inspect.Parameter(
        parameter.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=parameter.default if words.default is AS_IN_PYTHON else words.default,
        annotation=Annotated[list[words.kind] if several else words.kind, info],  # type: ignore[name-defined]
    )
