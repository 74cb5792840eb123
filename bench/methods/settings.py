"""Settings of methods as a line of text has them: `NAME=VALUE`, and `METHOD:NAME=VALUE` in a list of methods."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass, replace
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import Field

from bench.errors import DataError, UnknownNameError, UsageError
from bench.methods.contract import unlike
from bench.plain_yaml import parse_yaml

Positive = Annotated[float, Field(gt=0)]


def parse_settings(pairs: Sequence[str] | None, *, option: str = "--set") -> dict[str, Any]:
    """Parse assignments; none for None: `weights.anti_parallel=0` becomes `{"weights": {"anti_parallel": 0}}`.

    Raises:
        UsageError: no `=`, a value that is no YAML, or a name that is both a value and a group.
    """
    flat: dict[str, object] = {}
    for pair in pairs or ():
        name, equals, text = pair.partition("=")
        if not (equals and name):
            raise UsageError(f"{option}: expected NAME=VALUE, got {pair!r}")
        try:
            value = parse_yaml(text, file=f"{option} {name}")
        except DataError as error:
            raise UsageError(f"{option} {name}: expected a YAML value, got {text!r}") from error
        flat[name] = _number(value)
    return nested_settings(flat, option=option)


def nested_settings(flat: Mapping[str, object], *, option: str = "--set") -> dict[str, Any]:
    """Settings by dotted name as groups: "weights.epipolar" as part of "weights".

    Raises:
        UsageError: a name that is both a value and a group.
    """
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        group = nested
        *parents, leaf = name.split(".")
        for parent in parents:
            group = group.setdefault(parent, {})
            if not isinstance(group, dict):
                raise UsageError(f"{option} {name}: {parent!r} already has the value {group!r}")
        group[leaf] = value
    return nested


def flat_settings(settings: Mapping[str, object], parent: str = "") -> dict[str, object]:
    """A method's settings with dots for what lies deeper, for example "weights.epipolar", as `--set` takes them."""
    flat: dict[str, object] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= flat_settings(value, f"{parent}{name}.")
        else:
            flat[f"{parent}{name}"] = value
    return flat


def set_groups(method: object, **defaults: Any) -> None:
    """Replace settings that were given as mappings by these data classes, changed by what the mappings hold.

    Raises:
        UsageError: a value that is neither, and as `refuse_settings`.
    """
    for name, default in defaults.items():
        given, kind = getattr(method, name), type(default)
        if isinstance(given, Mapping):
            refuse_settings(name, kind, given)
            object.__setattr__(method, name, replace(default, **given))
        elif not isinstance(given, kind):
            names = ", ".join(f"{name}.{part}" for part in inspect.signature(kind).parameters)
            raise UsageError(f"{name}: expected values of {names}, got {given!r}")


def refuse_settings(owner: str, kind: type, given: Mapping[str, object]) -> None:
    """Refuse settings that a class does not have, and values that its annotations exclude.

    Annotations count where they are plain types, or limits of such.

    Args:
        owner: for messages.
        kind: the class that is built with them.
        given: by name.

    Raises:
        UnknownNameError: no such setting.
        UsageError: for example text for a number: many a class would take it, and fail by it on the first image.
    """
    parameters = inspect.signature(kind).parameters
    takes_any = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters.values())
    for name in () if takes_any else given:
        if name not in parameters:
            raise UnknownNameError(f"setting of {owner}", name, parameters)
    try:
        hints = get_type_hints(kind if is_dataclass(kind) else kind.__init__, include_extras=True)  # type: ignore[misc]
    except (NameError, TypeError):  # of names that only type checkers import
        return
    for name in given.keys() & {known for known, hint in hints.items() if _is_plain(hint)}:
        if expected := unlike(hints[name], given[name]):
            raise UsageError(f"{owner}: expected {expected} for {name}, got {given[name]!r}")


def _is_plain(hint: object) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return all(map(_is_plain, get_args(hint)))
    if get_origin(hint) is Annotated:
        return _is_plain(get_args(hint)[0])
    return hint in (bool, int, float, str, NoneType, dict[str, object]) or get_origin(hint) is Literal


def _number(value: object) -> object:
    """YAML 1.1 reads `6e-4` as text; users mean the number."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def parse_values(name: str, values: str) -> list[Any]:
    """Parse values of YAML with commas in between.

    Raises:
        UsageError: they are no YAML.
    """
    try:
        return [_number(value) for value in parse_yaml(f"[{values}]", file=name)]
    except DataError as error:
        raise UsageError(f"{name}: expected values of YAML with commas in between, got {values!r}") from error
