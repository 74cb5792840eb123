"""Read a scenario file: check it, draw its series, and make sure that no bodies overlap; errors name the line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel

from bench.errors import DataError
from bench.plain_yaml import parse_yaml_tree
from bench.recordings.files import read_text
from bench.recordings.validation import validated
from bench.synthesis.draws import DrawError
from bench.synthesis.placement import camera_fault, first_clash
from bench.synthesis.scenario import RecordingSpec, Scenario, ScenarioFile, ScenarioHead

LARGEST_BYTES = 4_000_000
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
            raise self.fault(error.field or "", expected=error.expected, got=error.got, hint=error.hint) from None

    def fault(self, field: str, *, expected: str, got: str, hint: str = "") -> DataError:
        """An error about a field, with its line."""
        location = f"{self.path}:{_line_of(self.tree, field.split('.'))}"
        return DataError(location, field=field or None, expected=expected, got=got, hint=hint)


def read_scenario_text(path: Path) -> ScenarioText:
    """Read the text of a scenario file.

    Raises:
        DataError: missing, too large, or not YAML with keys and values.
    """
    text = read_text(path, largest_bytes=LARGEST_BYTES, expected="a readable scenario")
    values, tree = parse_yaml_tree(text, file=path)
    if not isinstance(values, dict) or tree is None:
        raise DataError(path, expected="keys and values", got=type(values).__name__)
    return ScenarioText(path=path, values=values, tree=tree)


def _line_of(node: yaml.Node | None, keys: list[str]) -> int:
    """Line of the deepest node on the path to a field, counted from 1."""
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


ATTEMPTS = 60  # draws of a recording before a series counts as one that leaves no space
EXPECTED_SPACE = "bodies that never overlap"


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file and spell out its series.

    A recording of a series in which bodies would overlap is drawn anew, so that the series need not foresee every
    encounter of what it draws.

    Raises:
        DataError: missing, not YAML, not a scenario, or bodies inside one another; the message names file, line and
            field.
    """
    text = read_scenario_text(path)
    file = text.validated(ScenarioFile, text.values)
    for number, camera in enumerate(file.cameras):
        if (got := camera_fault(camera)) is not None:
            raise text.fault(f"cameras.{number}.position_m", expected="a camera in the open", got=got)
    for number, spec in enumerate(file.recordings):
        if (clash := first_clash(file, spec)) is not None:
            field = f"recordings.{number}.actors.{clash[0]}"
            raise text.fault(field, expected=EXPECTED_SPACE, got=clash[1], hint=f"see {spec.name}")
    drawn = [_drawn(text, file, number, index) for number, one in enumerate(file.series) for index in range(one.count)]
    head = {key: getattr(file, key) for key in ScenarioHead.model_fields}
    return text.validated(Scenario, {**head, "recordings": (*file.recordings, *drawn)})


def _drawn(text: ScenarioText, file: ScenarioFile, number: int, index: int) -> RecordingSpec:
    """One recording of a series, drawn until no bodies overlap."""
    series, field, line, reason = file.series[number], f"series.{number}", "", ""
    for attempt in range(ATTEMPTS):
        try:
            values, origins = series.recording(index, seed=file.seed, attempt=attempt)
        except DrawError as error:
            raise text.fault(f"{field}.{error.path}", expected=error.expected, got=error.got) from None
        spec = _validated(text, values, field, origins)
        if (clash := first_clash(file, spec)) is None:
            return spec
        line, reason = f"{field}.actors.{origins[clash[0]]}", clash[1]
    raise text.fault(
        line,
        expected=f"space for all bodies in recording {index + 1} of {series.count}",
        got=f"bodies inside one another in each of {ATTEMPTS} draws, at last {reason}",
        hint="give them more space, or ask for fewer",
    )


def _validated(text: ScenarioText, values: dict[str, Any], field: str, origins: list[int]) -> RecordingSpec:
    """A drawn recording; a fault is reported with the line of the series that it was drawn from."""
    try:
        return text.validated(RecordingSpec, values, field=field)
    except DataError as error:
        keys = (error.field or "").split(".")
        if len(keys) > 3 and keys[2] == "actors" and keys[3].isdigit():
            keys[3] = str(origins[int(keys[3])])
        raise text.fault(".".join(keys), expected=error.expected, got=error.got, hint=error.hint) from None
