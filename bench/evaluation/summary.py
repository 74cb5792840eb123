"""What a run comes to: the figures of the paper's table, as `summary.json` stores them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, model_validator

# 0/0 is NaN in memory and null in JSON.
Ratio = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else value, return_type=float | None, when_used="json"),
]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ProtocolStamp(_Part):
    """Which protocol made the figures; those of different digests are never put in one table."""

    name: str
    version: int
    digest: str


class Figure(_Part):
    """One figure of a table.

    Attributes:
        value: a ratio in [0, 1], or a mean; NaN without cases.
        ci95: 95 % interval by recording (`bench.evaluation.intervals`); None where fewer than six of them hold cases.
        cases: what the figure is taken over: object-frames, image-frames, or pixels for the segmentation figures.
        recordings: that hold cases; None in summaries of older versions, which did not count them. Their intervals
            promised more than they held (percentile bootstrap, from two recordings on) and are not taken over.
    """

    value: Ratio
    ci95: tuple[float, float] | None
    cases: int
    recordings: int | None

    @model_validator(mode="before")
    @classmethod
    def _of_older_versions(cls, content: object) -> object:
        if isinstance(content, dict) and "recordings" not in content:
            return content | {"ci95": None, "recordings": None}
        return content


class ObjectFigures(BaseModel):
    """A row of the table: evaluated object-frames of one kind.

    Beside the declared ones there are, for every detection level of the protocol, `detection_rate_<percent>` and
    `chance_<percent>` (for example `detection_rate_10`); `figure(name)` finds all of them.

    Attributes:
        object_frames: how many.
        tracks: objects that they come from.
        recordings: recordings that they come from.
        detection_rate: share with at least one pixel detected.
        chance: the same against the mask of another frame, over the object-frames that have one.
        tpr: mean coverage of the detected object-frames (the paper's wording).
        tpr_all: mean coverage of all object-frames.
        iou: mean IoU of all object-frames; an undetected one has 0.
        iou_detected: mean IoU of the detected object-frames, which is what the paper's column can be compared with.
    """

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Figure]

    object_frames: int
    tracks: int
    recordings: int
    detection_rate: Figure
    chance: Figure
    tpr: Figure
    tpr_all: Figure
    iou: Figure
    iou_detected: Figure

    def figure(self, name: str) -> Figure:
        """A figure by its name in `figure_names()`."""
        found: Figure = getattr(self, name)
        return found

    def figure_names(self) -> tuple[str, ...]:
        """All figures of the row."""
        declared = [name for name, field in type(self).model_fields.items() if field.annotation is Figure]
        return (*declared, *self.__pydantic_extra__)


class FalsePositiveFigures(_Part):
    """The last row of the table: image-frames of one kind.

    Attributes:
        frames: scored image-frames.
        recordings: that they come from; None in summaries of older versions.
        coverage: mean of FP / (width x height), the paper's "total area of the image".
        coverage_valid: mean of FP / |V|.
        frame_rate: share of frames with a false-positive component larger than the protocol states.
        components_per_frame: mean number of components of the mask with false-positive pixels.
    """

    frames: int
    recordings: int | None = None
    coverage: Figure
    coverage_valid: Figure
    frame_rate: Figure
    components_per_frame: Figure


class SegmentationFigures(_Part):
    """The field's usual figures of the moving class, from summed pixel counts outside I."""

    iou: Figure
    precision: Figure
    recall: Figure
    f1: Figure


class ObjectLedger(_Part):
    """Where every annotated object of every image ended.

    Attributes:
        annotated: all of them; equal to `evaluated + static + sum(ignored.values())`.
        evaluated: scored.
        static: not moving, not evaluated.
        ignored: by reason.
    """

    annotated: int
    evaluated: int
    static: int
    ignored: dict[str, int]


class FrameLedger(_Part):
    """Where every image ended; `problems` counts the failed and skipped ones by their message."""

    images: int
    evaluated: int
    failed: int
    skipped: int
    problems: dict[str, int]


class Summary(_Part):
    """All figures of a run.

    Attributes:
        protocol: that made them.
        categories: by name, in the order of the paper's table.
        all_moving: the categories pooled.
        false_positives: over all scored images.
        segmentation: over all scored images.
        false_positive_causes: share of the false-positive pixels by the cause that a method names.
        breakdowns: "object_class", "range_m", "ego_speed_mps", "camera", "points" -> bin or name -> row; the bins are
            written "[a, b)".
        false_positive_breakdowns: "ego_speed_mps", "camera" -> bin or name -> row.
        objects: ledger of the annotated objects.
        images: ledger of the images.
    """

    protocol: ProtocolStamp
    categories: dict[str, ObjectFigures]
    all_moving: ObjectFigures
    false_positives: FalsePositiveFigures
    segmentation: SegmentationFigures
    false_positive_causes: dict[str, Figure]
    breakdowns: dict[str, dict[str, ObjectFigures]]
    false_positive_breakdowns: dict[str, dict[str, FalsePositiveFigures]]
    objects: ObjectLedger
    images: FrameLedger
