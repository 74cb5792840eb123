"""Settings of methods as a line of text has them: `NAME=VALUE`, and `METHOD:NAME=VALUE` in a list of methods."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field

from bench.errors import DataError, UsageError
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
    """Replace settings that were given as mappings by these data classes, changed by what the mappings hold."""
    for name, default in defaults.items():
        if isinstance(given := getattr(method, name), Mapping):
            object.__setattr__(method, name, replace(default, **given))


def _number(value: object) -> object:
    """YAML 1.1 reads `6e-4` as text; users mean the number."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def split_values(name: str, values: str) -> dict[str, str]:
    """Split values of YAML at the commas between them: as they are shown, and as they are written.

    Raises:
        UsageError: they are no YAML.
    """
    try:
        parsed = parse_yaml(f"[{values}]", file=name)
    except DataError as error:
        raise UsageError(f"{name}: expected values of YAML with commas in between, got {values!r}") from error
    written = [json.dumps(value, default=str) for value in parsed]
    return {value if isinstance(value, str) else text: text for value, text in zip(parsed, written, strict=True)}
