"""Rules by which a reference is built: the part `reference` of a protocol's file, in the units of the file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from bench.records.reference import Category, ObjectClass, RegionKindName

LARGEST = 1e6  # of any number: beyond all that is measured here, and its squares and nanoseconds still are numbers
FURTHEST_M = 1000.0  # that a lidar sees


def each_once(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Refuse a value that is there twice."""
    if len(set(values)) < len(values):
        raise ValueError("each value once")
    return values


Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Whole = Annotated[int, Field(ge=1, le=LARGEST)]


class Rules(BaseModel):
    """A part of a protocol."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class MotionSettings(Rules):
    """Rules by which an object counts as moving, and in which way.

    Attributes:
        object_static_mps: objects slower than this over the ground are static.
        hysteresis_low_mps: a moving object becomes static below this.
        hysteresis_high_mps: a static object becomes moving at or above this.
        min_run_s: shorter runs of either state are taken as noise.
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
    def _ordered(self) -> MotionSettings:
        if not self.hysteresis_low_mps <= self.object_static_mps <= self.hysteresis_high_mps:
            raise ValueError("expected hysteresis_low_mps <= object_static_mps <= hysteresis_high_mps")
        if self.crossing_from_deg >= self.crossing_to_deg:
            raise ValueError("expected crossing_from_deg < crossing_to_deg")
        return self


class Limb(Rules):
    """A limb swings about its joint along the direction of travel, as a sine: its speed grows from joint to end.

    Attributes:
        joint: height, over that of the object.
        end: the same, lower than `joint`.
        speed: peak speed of the end relative to the body, over the speed of the object.
    """

    joint: Annotated[float, Field(gt=0, le=1)]
    end: Annotated[float, Field(ge=0, lt=1)]
    speed: NotNegative

    @model_validator(mode="after")
    def _hanging(self) -> Limb:
        if self.end >= self.joint:
            raise ValueError("expected end < joint, since limbs hang from their joints")
        return self


class OutlineErrors(Rules):
    """Causes of uncertain outlines, as standard deviations.

    Attributes:
        range_noise_m: of the lidar.
        angle_deg: between lidar and camera, about each axis.
        position_m: between lidar and camera, along each axis.
        limbs: class -> its kinds of limbs; none for a rigid body.
    """

    range_noise_m: NotNegative
    angle_deg: NotNegative
    position_m: NotNegative
    limbs: dict[ObjectClass, tuple[Limb, ...]]


class ReferenceSettings(Rules):
    """Rules of which objects are evaluated and how their regions are built.

    Attributes:
        range_limit_m: objects whose nearest point is further from the camera are ignored.
        ground_clearance_m: points lower than this above the road are the road's, not an object's.
        min_points: objects with fewer visible lidar points are ignored.
        min_polygon_px: objects of which fewer pixels in V are certain, before occlusion, are ignored.
        polygon_kind: kind of the regions.
        concave_ratio: tightness of the concave hull, 0 the tightest, 1 the convex hull.
        classes: object classes that are evaluated.
        categories: kinds of motion that are evaluated.
        max_sweep_gap_ms: a sweep further from the exposure than this is not used.
        max_annotation_gap_ms: an annotation further from the exposure than this is not used.
        motion: thresholds on velocities.
        shape_margin_m: points this far outside of an annotated shape, but for its bottom, are still the object's.
        ground_clearance_above: the road alone, or also the bottom of the annotated shape; surface patches always do.
        unknown_band: causes of uncertain outlines; null for regions without an unknown band.
    """

    range_limit_m: Annotated[float, Field(gt=0, le=FURTHEST_M)]
    ground_clearance_m: NotNegative
    min_points: Whole
    min_polygon_px: Whole
    polygon_kind: RegionKindName
    concave_ratio: Annotated[float, Field(ge=0, le=1)]
    classes: Annotated[tuple[ObjectClass | Literal["unknown"], ...], Field(min_length=1), AfterValidator(each_once)]
    categories: Annotated[tuple[Category, ...], Field(min_length=1), AfterValidator(each_once)]
    max_sweep_gap_ms: NotNegative
    max_annotation_gap_ms: NotNegative
    motion: MotionSettings
    shape_margin_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    ground_clearance_above: Literal["road", "shape"] = "road"
    unknown_band: OutlineErrors | None = None
