"""What a card can say of an aiMotive data set."""

from __future__ import annotations

from pydantic import Field

from bench.recordings.body_polygons import Polygon
from bench.recordings.validation import FileModel, SidePx

LICENCE = "CC BY-NC-SA 4.0"

FRAME_INTERVAL_NS = 66_666_667


class EgoMotionOptions(FileModel):
    """Where ego-motion comes from.

    Attributes:
        file: CSV file, relative to the data set's root; `{sequence}` stands for the sequence's name.
        columns: as `bench.egomotion.read_bus_signals` takes them.
    """

    file: str
    columns: dict[str, str | float | tuple[str, ...]] = Field(default_factory=dict)


class AimotiveOptions(FileModel):
    """The card's `options`.

    Attributes:
        cameras: those to evaluate; null for every camera that has images.
        ego_motion: where ego-motion comes from; null for the data set's own `egomotion.json`.
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        field_of_view_deg: per camera, full angle of the lens, beyond which the image is dark; absent for as far as the
            calibration holds.
        body_polygons: per camera, outlines of the host's own body, (u, v) in stored pixels.
        ground_height_m: height of the road in the body frame.
        vehicle_outline_m: the host seen from above, body frame, where the size of the host is known.
        licence: of the data.
    """

    cameras: tuple[str, ...] | None = None
    ego_motion: EgoMotionOptions | None = None
    evaluated_size_px: tuple[SidePx, SidePx] | None = None
    field_of_view_deg: dict[str, float] = Field(default_factory=dict)
    body_polygons: dict[str, tuple[Polygon, ...]] = Field(default_factory=dict)
    ground_height_m: float = 0.0
    vehicle_outline_m: Polygon = Field(default=((-1.1, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.1, 0.95)), min_length=3)
    licence: str = LICENCE
