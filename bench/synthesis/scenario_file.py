"""Read a scenario file; a fault is told with its line."""

from __future__ import annotations

from pathlib import Path

import yaml

from bench.errors import DataError
from bench.recordings.validation import validated
from bench.synthesis.scenario import Scenario

LARGEST_BYTES = 4_000_000


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        DataError: missing, not YAML, or not a scenario; the message names file, line and field.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise DataError(path, wanted=f"at most {LARGEST_BYTES} bytes", came=f"{path.stat().st_size}")
        text = path.read_text(encoding="utf-8")
        values = yaml.safe_load(text)
    except OSError as error:
        raise DataError(path, wanted="a readable scenario", came=error.strerror or str(error)) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(path, wanted="YAML", came=" ".join(str(error).split())) from error
    if not isinstance(values, dict):
        raise DataError(path, wanted="keys and values", came=type(values).__name__)
    try:
        return validated(Scenario, values, file=path)
    except DataError as error:
        line = _line_of(yaml.compose(text, Loader=yaml.SafeLoader), (error.field or "").split("."))
        place = f"{path}:{line}"
        raise DataError(place, field=error.field, wanted=error.wanted, came=error.came, do=error.do) from None


def _line_of(node: yaml.Node | None, keys: list[str]) -> int:
    """Line of the deepest node on the way to a field, counted from 1."""
    line = 1
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            found = next(((k, v) for k, v in node.value if k.value == key), None)
            if found is None:
                return line
            line, node = found[0].start_mark.line + 1, found[1]
        elif isinstance(node, yaml.SequenceNode) and key.isdigit() and int(key) < len(node.value):
            node = node.value[int(key)]
            line = node.start_mark.line + 1
    return line
