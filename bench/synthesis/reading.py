"""Read a scenario file: draw its series, and see that everybody has a place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.errors import DataError
from bench.synthesis.placement import camera_fault, first_clash
from bench.synthesis.scenario import (
    DrawError,
    RecordingSpec,
    Scenario,
    ScenarioFile,
    ScenarioHead,
    ScenarioText,
    read_text,
)

ATTEMPTS = 60  # draws of a recording before a series counts as one that leaves no room
WANTED_ROOM = "a place of its own for everybody at all times"


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file and spell out its series.

    A recording of a series in which bodies would overlap is drawn anew, so that the series need not foresee every
    encounter of what it draws.

    Raises:
        DataError: missing, not YAML, not a scenario, or bodies inside one another; the message names file, line and
            field.
    """
    text = read_text(path)
    file = text.validated(ScenarioFile, text.values)
    for number, camera in enumerate(file.cameras):
        if (got := camera_fault(camera)) is not None:
            raise text.fault(f"cameras.{number}.position_m", expected="a camera in the open", got=got)
    for number, spec in enumerate(file.recordings):
        if (clash := first_clash(file, spec)) is not None:
            field = f"recordings.{number}.actors.{clash.actor}"
            raise text.fault(field, expected=WANTED_ROOM, got=clash.told, do=f"see {spec.name}")
    drawn = [_drawn(text, file, number, index) for number, one in enumerate(file.series) for index in range(one.count)]
    head = {key: getattr(file, key) for key in ScenarioHead.model_fields}
    return text.validated(Scenario, {**head, "recordings": (*file.recordings, *drawn)})


def _drawn(text: ScenarioText, file: ScenarioFile, number: int, index: int) -> RecordingSpec:
    """One recording of a series, drawn until everybody has a place."""
    series, field, line, told = file.series[number], f"series.{number}", "", ""
    for attempt in range(ATTEMPTS):
        try:
            values, origins = series.recording(index, seed=file.seed, attempt=attempt)
        except DrawError as error:
            raise text.fault(f"{field}.{error.path}", expected=error.expected, got=error.got) from None
        spec = _validated(text, values, field, origins)
        if (clash := first_clash(file, spec)) is None:
            return spec
        line, told = f"{field}.actors.{origins[clash.actor]}", clash.told
    raise text.fault(
        line,
        expected=f"room for everybody in recording {index + 1} of {series.count}",
        got=f"bodies inside one another in each of {ATTEMPTS} draws, at last {told}",
        do="give them more room, or ask for fewer",
    )


def _validated(text: ScenarioText, values: dict[str, Any], field: str, origins: list[int]) -> RecordingSpec:
    """A drawn recording; a fault is told with the line of the series that it was drawn from."""
    try:
        return text.validated(RecordingSpec, values, field=field)
    except DataError as error:
        keys = (error.field or "").split(".")
        if len(keys) > 3 and keys[2] == "actors" and keys[3].isdigit():
            keys[3] = str(origins[int(keys[3])])
        raise text.fault(".".join(keys), expected=error.expected, got=error.got, do=error.do) from None
