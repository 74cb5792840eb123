"""`--set name=value`, with dots for what lies deeper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.errors import DataError, UsageError
from bench.plain_yaml import parse_yaml

LONGEST = 1000  # characters of one setting


def parse_settings(pairs: Sequence[str]) -> dict[str, Any]:
    """Parse assignments: `weights.anti_parallel=0` becomes `{"weights": {"anti_parallel": 0}}`.

    Raises:
        UsageError: no `=`, a value that is no YAML, or a name that is both a value and a group.
    """
    parsed: dict[str, Any] = {}
    for pair in pairs:
        if len(pair) > LONGEST:
            raise UsageError(f"--set: expected at most {LONGEST} characters, got {len(pair)}")
        name, equals, text = pair.partition("=")
        if not (equals and name):
            raise UsageError(f"--set: expected NAME=VALUE, got {pair!r}")
        try:
            value = parse_yaml(text, file=f"--set {name}")
        except DataError as error:
            raise UsageError(f"--set {name}: expected a YAML value, got {text!r}") from error
        group = parsed
        *parents, leaf = name.split(".")
        for parent in parents:
            group = group.setdefault(parent, {})
            if not isinstance(group, dict):
                raise UsageError(f"--set {name}: {parent!r} already has the value {group!r}")
        group[leaf] = _number(value)
    return parsed


def _number(value: object) -> object:
    """YAML 1.1 reads `6e-4` as text; users mean the number."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
