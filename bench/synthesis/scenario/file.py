"""The text of a scenario file; a fault is told with its line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel

from bench.errors import DataError
from bench.recordings.validation import validated

LARGEST_BYTES = 4_000_000
DEEPEST = 40  # brackets in brackets; a scenario needs ten, and thousands would end the process
# libyaml where PyYAML was built with it, ten times as fast; both keep the line of everything.
LOADER: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScenarioText:
    """A scenario file as it was read.

    Attributes:
        path: the file.
        values: what it says.
        tree: the same with the line of everything.
    """

    path: Path
    values: dict[str, Any]
    tree: yaml.Node

    def validated(self, model: type[Model], values: dict[str, Any], *, field: str = "") -> Model:
        """Values from this file, as a model.

        Args:
            model: what they must be.
            values: the values.
            field: where they come from.

        Raises:
            DataError: they are not; the message names file, line and field.
        """
        try:
            return validated(model, values, file=self.path, field=field)
        except DataError as error:
            raise self.fault(error.field or "", expected=error.expected, got=error.got, do=error.do) from None

    def fault(self, field: str, *, expected: str, got: str, do: str = "") -> DataError:
        """An error about a field, with its line."""
        place = f"{self.path}:{_line_of(self.tree, field.split('.'))}"
        return DataError(place, field=field or None, expected=expected, got=got, do=do)


def read_text(path: Path) -> ScenarioText:
    """Read the text of a scenario file.

    Raises:
        DataError: missing, too large, or not YAML with keys and values.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise DataError(path, expected=f"at most {LARGEST_BYTES} bytes", got=f"{path.stat().st_size}")
        text = path.read_text(encoding="utf-8")
        if (line := _too_deep(text)) is not None:
            raise DataError(f"{path}:{line}", expected=f"at most {DEEPEST} levels", got="more")
        loader = LOADER(text)
        tree = loader.get_single_node()
        values = None if tree is None else loader.construct_document(tree)
    except OSError as error:
        raise DataError(path, expected="a readable scenario", got=error.strerror or str(error)) from error
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # ValueError: no UTF-8, impossible days and numbers
        raise DataError(path, expected="YAML", got=" ".join(str(error).split())) from error
    if not isinstance(values, dict) or tree is None:
        raise DataError(path, expected="keys and values", got=type(values).__name__)
    return ScenarioText(path=path, values=values, tree=tree)


def _too_deep(text: str) -> int | None:
    """The first line with too many levels, counted from 1; told from the text's events, which nest nothing."""
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            return 1 if event.start_mark is None else int(event.start_mark.line) + 1
    return None


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
