"""What a card can say of WoodScape."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from bench.recordings.body_polygons import Polygon
from bench.recordings.validation import FileModel, SidePx

LICENCE = "Valeo WoodScape licence: research, teaching and benchmarking, not commercial"
OUTLINE_M = ((-1.0, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.0, 0.95))
CameraName = Literal["FV", "RV", "MVL", "MVR"]
Index = Annotated[int, Field(ge=0, le=99_999)]


class CarOptions(FileModel):
    """One of the cars that the images were taken from; the data set tells them apart by the index alone.

    Attributes:
        indices: first and last index of its images, both included; null for open.
        body_polygons: per camera, outlines of this car's own body, (u, v) in stored pixels.
        body_masks: per camera, an image below the data set's root that is not 0 on this car's own body.
        vehicle_outline_m: this car seen from above, vehicle frame; null for that of all cars.
    """

    indices: tuple[Index | None, Index | None] = (None, None)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    body_masks: dict[CameraName, str] = Field(default_factory=dict)
    vehicle_outline_m: Annotated[Polygon, Field(min_length=3)] | None = None

    @model_validator(mode="after")
    def _is_ordered(self) -> CarOptions:
        first, last = self.span
        if first > last:
            raise ValueError("the first index not after the last")
        return self

    @property
    def span(self) -> tuple[int, int]:
        """First and last index."""
        first, last = self.indices
        return 0 if first is None else first, 99_999 if last is None else last


class WoodscapeOptions(FileModel):
    """The card's `options`.

    Attributes:
        cameras: front, rear, left mirror and right mirror.
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        field_of_view_deg: per camera, full angle of the lens; absent for as far as the calibration is one-to-one.
        body_polygons: per camera, outlines of the host's own body in the images of every car, (u, v) in stored pixels.
        cars: what differs from car to car; an index that none of them has is of a car without masks of its own.
        vehicle_outline_m: the host seen from above, vehicle frame.
        yaw_rate_positive: to which side the car turns where `ego_yawRate` is positive; the data set does not say.
        licence: of the data.
    """

    cameras: tuple[CameraName, ...] = Field(default=("FV", "RV", "MVL", "MVR"), min_length=1)
    evaluated_size_px: tuple[SidePx, SidePx] | None = None
    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    cars: tuple[CarOptions, ...] = ()
    vehicle_outline_m: Polygon = Field(default=OUTLINE_M, min_length=3)
    yaw_rate_positive: Literal["left", "right"] = "left"
    licence: str = LICENCE

    @model_validator(mode="after")
    def _cars_apart(self) -> WoodscapeOptions:
        spans = sorted(car.span for car in self.cars)
        if any(later[0] <= earlier[1] for earlier, later in pairwise(spans)):
            raise ValueError("cars whose indices do not overlap")
        return self

    def car(self, index: int) -> CarOptions:
        """The car that an image was taken from."""
        return next((car for car in self.cars if car.span[0] <= index <= car.span[1]), CarOptions())

    def outline_m(self, index: int) -> Polygon:
        """The car seen from above."""
        return self.car(index).vehicle_outline_m or self.vehicle_outline_m
