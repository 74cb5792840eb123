"""The rules of an evaluation as a versioned file; released files are never edited, only superseded."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError, model_validator

from bench.errors import DataError
from bench.plain_yaml import known_rules, read_rules
from bench.records.rules import LARGEST, NotNegative, Positive, ReferenceSettings, Rules, Whole, each_once


def _edges(values: tuple[float, ...]) -> tuple[float, ...]:
    if not values or values[0] != 0 or any(b <= a for a, b in pairwise(values)):
        raise ValueError("bin edges start at 0 and increase")
    return values


MOST_CELLS_A_SIDE = 1000  # of a range map

Level = Annotated[float, Field(gt=0, le=1)]
Edges = Annotated[tuple[NotNegative, ...], AfterValidator(_edges)]


class ScoringRules(Rules):
    """Rules of what counts as detected and as a false alarm.

    Attributes:
        detection_levels: least coverages of an object, beside "any pixel".
        chance_lag_s: how far away in time the other frame is whose mask gives the chance level.
        false_positive_component_px: components with more false-positive pixels than this make a false-positive frame.
    """

    detection_levels: Annotated[tuple[Level, ...], AfterValidator(each_once)]
    chance_lag_s: Positive
    false_positive_component_px: Annotated[int, Field(ge=0, le=LARGEST)]


class Bins(Rules):
    """Edges of the half-open bins `[a, b)` of the breakdowns; the last bin is open to the right.

    Attributes:
        range_m: of the object's nearest point from the camera.
        ego_speed_mps: of the ego vehicle.
        points: lidar points on the object that the camera sees.
        speed_mps: of the object itself. Up to 1.5 m/s people walk, up to 5 they run or vehicles turn and park, up to 10
            people ride and cars are in slow traffic, up to 20 cars are in a town.
    """

    range_m: Edges
    ego_speed_mps: Edges
    points: Edges
    speed_mps: Edges = (0.0, 1.5, 5.0, 10.0, 20.0)


class RangeMapRules(Rules):
    """Cells of the range maps.

    Attributes:
        cell_m: side of a cell.
        min_object_frames: cells with fewer are hatched, not coloured.
    """

    cell_m: Positive
    min_object_frames: Whole


class Protocol(Rules):
    """Everything that decides a score, apart from data and method."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    version: Whole
    reference: ReferenceSettings
    scoring: ScoringRules
    bins: Bins
    range_map: RangeMapRules

    @model_validator(mode="after")
    def _bounded(self) -> Protocol:
        side = 2 * self.reference.range_limit_m / self.range_map.cell_m
        if side > MOST_CELLS_A_SIDE:
            raise ValueError(
                f"range maps of at most {MOST_CELLS_A_SIDE} cells a side (twice reference.range_limit_m over "
                f"range_map.cell_m), not of {side:.0f}"
            )
        return self

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content, in hexadecimal; comments, order of keys and white space do not matter."""
        # What a file leaves to a default stays out, so that a new rule with one changes no digest.
        content = self.model_dump(mode="json", exclude_unset=True)
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


_SHIPPED = Path(__file__).parent / "protocols"


def known_protocols() -> tuple[str, ...]:
    """Names of the protocols in the package."""
    return known_rules(_SHIPPED)


def load_protocol(name_or_path: str | Path) -> Protocol:
    """Read a protocol of the package by name, or any other by the path of its YAML file, which may be `based_on` one.

    Raises:
        UnknownNameError: neither a name nor a file.
        DataError: the file is not a protocol, or bears the name of a released one with other rules; the message names
            the field.
    """
    content, file = read_rules(name_or_path, shipped=_SHIPPED, kind="protocol")
    try:
        protocol = Protocol.model_validate(content)
    except ValidationError:
        from bench.recordings.validation import validated  # else `bench.score` would load what opens data sets

        protocol = validated(Protocol, content, file=Path(file))
    if protocol.name in known_protocols():
        released, _ = read_rules(protocol.name, shipped=_SHIPPED, kind="protocol")
        if Protocol.model_validate(released).digest != protocol.digest:
            expected = f"a name of its own, since {protocol.name} is released with other rules"
            hint = "give the file a name, as name: ours-v1"
            raise DataError(file, field="name", expected=expected, got=repr(protocol.name), hint=hint)
    return protocol
