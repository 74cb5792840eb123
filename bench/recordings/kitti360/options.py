"""What a card can say of KITTI-360."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bench.recordings.body_polygons import Polygon
from bench.recordings.validation import FileModel, SidePx

LICENCE = "CC BY-NC-SA 3.0"
CameraName = Literal["image_02", "image_03"]


class FrameExclusion(FileModel):
    """Frames of a sequence that are left out, by their number in the data set.

    Attributes:
        sequence: number of the sequence, such as "0004".
        frames: first and last frame, themselves excluded.
        reason: why.
    """

    sequence: str = Field(pattern=r"^\d{4}$")
    frames: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
    reason: str = Field(min_length=1)

    @model_validator(mode="after")
    def _ordered(self) -> FrameExclusion:
        if self.frames[0] > self.frames[1]:
            raise ValueError("the first frame not after the last")
        return self


class Kitti360Options(FileModel):
    """The card's `options`.

    Attributes:
        cameras: fisheye cameras to evaluate, of those that are there.
        boxes: folder of `data_3d_bboxes` that the boxes come from.
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        field_of_view_deg: per camera, full angle of the lens; absent for as far as the calibration is one-to-one.
        body_polygons: per camera, outlines of the host's own body, (u, v) in stored pixels.
        lidar_position_m: the laser scanner in the vehicle frame; the calibration gives only places of sensors to each
            other.
        vehicle_outline_m: the host seen from above, vehicle frame.
        max_pose_gap_s: poses further apart are not interpolated between, unless the car stood.
        standing_m: poses no further apart than this are of a car that stood or crept, whatever the time between.
        static_range_m: objects that stand are kept while they are this near, since they hide what moves.
        static_people: "unclear" ignores people whose box is not marked dynamic, since some of them do walk; "static"
            takes the label at its word.
        excluded_frames: frames that are left out; sequences that are not there are passed over.
        licence: of the data.
    """

    cameras: tuple[CameraName, ...] = Field(default=("image_02", "image_03"), min_length=1)
    boxes: Literal["train", "train_full"] = "train"
    evaluated_size_px: tuple[SidePx, SidePx] | None = None
    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    lidar_position_m: tuple[float, float, float] = (0.76, 0.0, 1.73)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.91), (3.8, -0.91), (3.8, 0.91), (-1.0, 0.91)), min_length=3)
    max_pose_gap_s: float = Field(default=1.0, gt=0)
    standing_m: float = Field(default=0.5, ge=0)
    static_range_m: float = Field(default=25.0, ge=0)
    static_people: Literal["unclear", "static"] = "unclear"
    excluded_frames: tuple[FrameExclusion, ...] = ()
    licence: str = LICENCE
