"""The rules of an evaluation as a versioned file; released files are never edited, only superseded."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import fields
from functools import cached_property
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from bench.errors import DataError
from bench.plain_yaml import known_rules, read_rules
from bench.records.reference import (
    Category,
    Limb,
    MotionSettings,
    ObjectClass,
    OutlineErrors,
    ReferenceSettings,
    RegionKindName,
)


def _edges(values: tuple[float, ...]) -> tuple[float, ...]:
    if not values or values[0] != 0 or any(b <= a for a, b in pairwise(values)):
        raise ValueError("bin edges start at 0 and increase")
    return values


def _each_once(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(values)) < len(values):
        raise ValueError("each value once")
    return values


MOST_CELLS_A_SIDE = 1000  # of a range map

LARGEST = 1e6  # of any number: beyond all that is measured here, and its squares and nanoseconds still are numbers
FURTHEST_M = 1000.0  # that a lidar sees

Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Whole = Annotated[int, Field(ge=1, le=LARGEST)]
Level = Annotated[float, Field(gt=0, le=1)]
Edges = Annotated[tuple[NotNegative, ...], AfterValidator(_edges)]


class _ProtocolModel(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MotionRules(_ProtocolModel):
    """Rules by which an annotated object moves, and in which way; see `MotionSettings`.

    Attributes:
        object_static_mps: objects slower than this over the ground are static.
        min_run_s: shorter runs of moving or static are taken as noise.
        smoothing_s: width of the window over which velocities of a track are averaged.
        ego_static_mps: the ego vehicle counts as stationary below this.
        crossing_from_deg: angle between object velocity and ego direction of travel from which it is crossing.
        crossing_to_deg: angle above which it is approaching.
    """

    object_static_mps: NotNegative
    hysteresis_low_mps: NotNegative
    hysteresis_high_mps: NotNegative
    min_run_s: NotNegative
    smoothing_s: NotNegative
    ego_static_mps: NotNegative
    crossing_from_deg: Annotated[float, Field(gt=0, lt=180)]
    crossing_to_deg: Annotated[float, Field(gt=0, lt=180)]

    @model_validator(mode="after")
    def _ordered(self) -> MotionRules:
        if not self.hysteresis_low_mps <= self.object_static_mps <= self.hysteresis_high_mps:
            raise ValueError("expected hysteresis_low_mps <= object_static_mps <= hysteresis_high_mps")
        if self.crossing_from_deg >= self.crossing_to_deg:
            raise ValueError("expected crossing_from_deg < crossing_to_deg")
        return self


class LimbRules(_ProtocolModel):
    """Motion of a limb; see `Limb`."""

    joint: Annotated[float, Field(gt=0, le=1)]
    end: Annotated[float, Field(ge=0, lt=1)]
    speed: NotNegative

    @model_validator(mode="after")
    def _hanging(self) -> LimbRules:
        if self.end >= self.joint:
            raise ValueError("expected end < joint, since limbs hang from their joints")
        return self


class UnknownBandRules(_ProtocolModel):
    """Causes of uncertain outlines; see `OutlineErrors`.

    Attributes:
        angle_deg: between lidar and camera, about each axis.
    """

    range_noise_m: NotNegative
    angle_deg: NotNegative
    position_m: NotNegative
    limbs: dict[ObjectClass, tuple[LimbRules, ...]]


class ReferenceRules(_ProtocolModel):
    """Rules of which objects are evaluated and how their polygons are built; see `ReferenceSettings`.

    Attributes:
        polygon_kind: kind of the regions.
        max_sweep_gap_ms: a sweep further from the exposure than this is not used.
        max_annotation_gap_ms: an annotation further from the exposure than this is not used.
        shape_margin_m: points this far outside of an annotated shape, but for its bottom, are still the object's.
        ground_clearance_above: the road alone, or also the bottom of the annotated shape; surface patches always do.
        unknown_band: null for regions without one.
    """

    range_limit_m: Annotated[float, Field(gt=0, le=FURTHEST_M)]
    ground_clearance_m: NotNegative
    min_points: Whole
    min_polygon_px: Whole
    polygon_kind: RegionKindName
    concave_ratio: Annotated[float, Field(ge=0, le=1)]
    classes: Annotated[tuple[ObjectClass | Literal["unknown"], ...], Field(min_length=1), AfterValidator(_each_once)]
    categories: Annotated[tuple[Category, ...], Field(min_length=1), AfterValidator(_each_once)]
    max_sweep_gap_ms: NotNegative
    max_annotation_gap_ms: NotNegative
    motion: MotionRules
    shape_margin_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    ground_clearance_above: Literal["road", "shape"] = "road"
    unknown_band: UnknownBandRules | None = None


class ScoringRules(_ProtocolModel):
    """Rules of what counts as detected and as a false alarm.

    Attributes:
        detection_levels: least coverages of an object, beside "any pixel".
        chance_lag_s: how far away in time the other frame is whose mask gives the chance level.
        false_positive_component_px: components with more false-positive pixels than this make a false-positive frame.
    """

    detection_levels: Annotated[tuple[Level, ...], AfterValidator(_each_once)]
    chance_lag_s: Positive
    false_positive_component_px: Annotated[int, Field(ge=0, le=LARGEST)]


class Bins(_ProtocolModel):
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


class RangeMapRules(_ProtocolModel):
    """Cells of the range maps.

    Attributes:
        cell_m: side of a cell.
        min_object_frames: cells with fewer are hatched, not coloured.
    """

    cell_m: Positive
    min_object_frames: Whole


class Protocol(_ProtocolModel):
    """Everything that decides a score, apart from data and method."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    version: Whole
    reference: ReferenceRules
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

    def reference_settings(self) -> ReferenceSettings:
        """Return the settings of the reference builder, in its units."""
        rules, motion, band = self.reference, self.reference.motion, self.reference.unknown_band
        settings: ReferenceSettings = _in_units(
            ReferenceSettings,
            rules,
            max_sweep_gap_ns=round(rules.max_sweep_gap_ms * 1e6),
            max_annotation_gap_ns=round(rules.max_annotation_gap_ms * 1e6),
            clearance_above_shape=rules.ground_clearance_above == "shape",
            motion=_in_units(
                MotionSettings,
                motion,
                static_below_mps=motion.object_static_mps,
                ego_static_below_mps=motion.ego_static_mps,
                min_run_ns=round(motion.min_run_s * 1e9),
                smoothing_ns=round(motion.smoothing_s * 1e9),
                crossing_from_rad=math.radians(motion.crossing_from_deg),
                crossing_to_rad=math.radians(motion.crossing_to_deg),
            ),
            outline=None
            if band is None
            else _in_units(
                OutlineErrors,
                band,
                angle_rad=math.radians(band.angle_deg),
                limbs={name: tuple(_in_units(Limb, limb) for limb in limbs) for name, limbs in band.limbs.items()},
            ),
        )
        return settings

    @property
    def chance_lag_ns(self) -> int:
        """`chance_lag_s` in nanoseconds."""
        return round(self.scoring.chance_lag_s * 1e9)


_SHIPPED = resources.files("bench.evaluation") / "protocols"


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


def _in_units(settings: Any, rules: _ProtocolModel, **converted: object) -> Any:
    """Settings of the fields of the same names as rules, and of those that are of another name or unit."""
    names = [field.name for field in fields(settings) if field.name not in converted]
    return settings(**{name: getattr(rules, name) for name in names}, **converted)
