"""Plug-ins by name: a part of this package, or one that an installed package adds by an entry point."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir, contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import UsageError

SHOWN_CALLS = 5  # of the traceback of foreign code, innermost last


@contextmanager
def undisturbed() -> Iterator[None]:
    """Around foreign code: afterwards the working folder and NumPy's handling of errors are as before."""
    with chdir(Path.cwd()), np.errstate():
        yield


@cache
def installed_points(group: str) -> EntryPoints:
    """Entry points of installed packages, whose metadata are read once a process."""
    return entry_points(group=group)


def known_targets(group: str, own: Mapping[str, str]) -> dict[str, str]:
    """Name -> "module:attribute" of what there is; a name of the package's own cannot be taken by another.

    Args:
        group: of entry points, where installed packages add theirs.
        own: the package's.
    """
    added = {point.name: point.value for point in installed_points(group)}
    return added | dict(own)


def imported(target: str, *, expected: str) -> Any:
    """Import what lies at "module:attribute".

    Args:
        target: "module:attribute".
        expected: start of the error message: for whom, and what kind of object.

    Raises:
        UsageError: nothing to import there, or its import raised.
    """
    module, _, attribute = target.partition(":")
    if not all(part.isidentifier() for part in [*module.split("."), *attribute.split(".")]):
        raise UsageError(
            f"{expected} at MODULE:NAME, as my_method:MyMethod, got {target!r}; name a module, not its path"
        )
    try:
        with undisturbed():
            return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        hint = f"; name the module without .py: {module[:-3]}:{attribute}" if module.endswith(".py") else ""
        raise UsageError(f"{expected} that can be imported; {error}{hint}") from error
    except (Exception, SystemExit) as error:
        raise UsageError(f"{expected} that can be imported; {describe_error(error)}") from error


def described(targets: Mapping[str, str], describe: Callable[[str, str], str]) -> list[tuple[str, str]]:
    """Names, and each with what it is; where it is of another package, that too, and why it cannot be used.

    Args:
        targets: name -> "module:attribute", as of `known_targets`.
        describe: from name and target to one line; it may raise UsageError.
    """
    rows = []
    for name, target in targets.items():
        try:
            text = describe(name, target)
        except UsageError as error:  # the list of the others is still wanted
            text = str(error)
        rows.append((name, text if target.startswith("bench.") else f"{text} ({target})"))
    return rows


def describe_error(error: BaseException) -> str:
    """Kind and message of what foreign code raised, and the lines of that code that led there, in one line."""
    calls = [
        f"{Path(call.filename).name}:{call.lineno} in {call.name}: {call.line}"
        for call in traceback.extract_tb(error.__traceback__)[1:]
        if not call.filename.startswith("<frozen ")
    ]
    try:
        message = str(error)
    except Exception:  # noqa: BLE001 - of a class of foreign code
        message = "its message cannot be read"
    told = " ".join(f"{type(error).__name__}: {message}".split())
    return f"{told} ({' > '.join(calls[-SHOWN_CALLS:])})" if calls else told
