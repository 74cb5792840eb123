"""What a card can say of WoodScape."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bench.recordings.body_polygons import Polygon
from bench.recordings.validation import FileModel

LICENCE = "Valeo WoodScape licence: research, teaching and benchmarking, not commercial"
CameraName = Literal["FV", "RV", "MVL", "MVR"]


class WoodscapeOptions(FileModel):
    """The card's `options`.

    Attributes:
        cameras: front, rear, left mirror and right mirror.
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        field_of_view_deg: per camera, full angle of the lens; absent for as far as the calibration is one-to-one.
        body_polygons: per camera, outlines of the host's own body, (u, v) in stored pixels.
        vehicle_outline_m: the host seen from above, vehicle frame.
        yaw_rate_positive: to which side the car turns where `ego_yawRate` is positive; the data set does not say.
        licence: of the data.
    """

    cameras: tuple[CameraName, ...] = Field(default=("FV", "RV", "MVL", "MVR"), min_length=1)
    evaluated_size_px: tuple[int, int] | None = None
    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.0, 0.95)), min_length=3)
    yaw_rate_positive: Literal["left", "right"] = "left"
    licence: str = LICENCE
