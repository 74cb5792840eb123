"""The reference of an image whose data set gives a mask of what moves instead of annotated objects."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from bench.errors import DataError
from bench.recordings.images import read_moving_mask
from bench.records.recording import ImageRef
from bench.records.reference import (
    UNKNOWN_CLASS,
    Category,
    IgnoreReason,
    ReferenceFrame,
    ReferenceObject,
    ReferenceSettings,
    Status,
    pixels_object,
)
from bench.reference.exposure import Exposure

MOST_OBJECTS = 10_000


def mask_reference(
    image: ImageRef, exposure: Exposure, *, recording: str, settings: ReferenceSettings
) -> ReferenceFrame:
    """Take each connected component of the mask (8-neighbours) for an object.

    Things that touch in the image are one object, and a thing that is cut in two by another is two. Nothing is known of
    their range, speed, class and kind of motion: the category is "moving", and protocols without it ignore them all.

    Args:
        image: with a mask.
        exposure: of it.
        recording: name.
        settings: of the protocol.

    Raises:
        DataError: a mask that cannot be read, of another size, or that is noise.
    """
    valid = exposure.valid
    moving = read_moving_mask(image, exposure.camera) & valid
    count, component, stats, _ = cv2.connectedComponentsWithStats(moving.astype(np.uint8), connectivity=8)
    if count - 1 > MOST_OBJECTS:
        expected = f"at most {MOST_OBJECTS} connected components"
        raise DataError(image.moving_path or image.path, expected=expected, got=str(count - 1))
    found = [_Component(component == number, int(stats[number, cv2.CC_STAT_AREA])) for number in range(1, count)]
    found.sort(key=lambda part: -part.area_px)  # stable: equal ones stay in the order of their first rows
    objects = tuple(_object(part, number, settings) for number, part in enumerate(found, start=1))
    labels, ignored = np.zeros(valid.shape, dtype=np.int32), np.zeros(valid.shape, dtype=bool)
    for number, (part, item) in enumerate(zip(found, objects, strict=True), start=1):
        if item.status is Status.EVALUATED:
            labels[part.covered] = number
        else:
            ignored |= part.covered
    return ReferenceFrame(
        recording=recording,
        camera=image.camera,
        timestamp_ns=image.timestamp_ns,
        ego_speed_mps=exposure.ego_speed_mps,
        objects=objects,
        labels=labels,
        ignored=ignored,
        valid=valid,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Component:
    covered: NDArray[np.bool_]
    area_px: int


def _object(part: _Component, number: int, settings: ReferenceSettings) -> ReferenceObject:
    reasons = {
        IgnoreReason.CLASS: UNKNOWN_CLASS not in settings.classes,
        IgnoreReason.CATEGORY: Category.MOVING not in settings.categories,
        IgnoreReason.SMALL_POLYGON: part.area_px < settings.min_polygon_px,
    }
    reason = next((reason for reason, applies in reasons.items() if applies), None)
    return pixels_object(f"component-{number}", part.area_px, reason=reason, polygon=_outline(part.covered))


def _outline(covered: NDArray[np.bool_]) -> Polygon | None:
    """The outer border through the centres of its pixels, to draw; None for what has no area."""
    borders, _ = cv2.findContours(covered.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    corners = borders[0][:, 0, :].astype(np.float64)
    return Polygon(corners) if len(corners) >= 3 else None
