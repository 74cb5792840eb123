"""The reference of an image with exact masks in place of lidar polygons, everything else being equal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.reference import IgnoreReason, ReferenceFrame, ReferenceObject, Status


def instance_ids(tracks: Mapping[str, int | None]) -> dict[str, int]:
    """Instance id by track, -1 (which no pixel has) for a track that truth images do not know."""
    return {track: -1 if number is None else number for track, number in tracks.items()}


def paired_references(
    lidar: ReferenceFrame, ids: NDArray[np.uint16], instance_of: Mapping[str, int]
) -> tuple[ReferenceFrame, ReferenceFrame]:
    """Two references that differ in their regions alone.

    Status, reason and category of every object are the lidar's. An object of which the camera sees no pixel cannot be
    scored by a mask: it is ignored as occluded in both, so that both are over the same object-frames.

    Args:
        lidar: the reference of the protocol.
        ids: (H, W) uint16, the image's true instance ids.
        instance_of: instance id by track.

    Returns:
        The lidar's reference, and the one whose regions G and I are the exact masks in V.
    """
    shown = ids.astype(np.int32)
    masks = [(shown == instance_of[item.track_id]) & lidar.valid for item in lidar.objects]
    unseen = [
        item.status is Status.EVALUATED and not mask.any() for item, mask in zip(lidar.objects, masks, strict=True)
    ]
    by_lidar = _with_ignored(lidar, unseen)
    labels, ignored = np.zeros_like(lidar.labels), np.zeros_like(lidar.ignored)
    objects: list[ReferenceObject] = []
    for number, (item, mask) in enumerate(zip(by_lidar.objects, masks, strict=True), start=1):
        if item.status is Status.EVALUATED:
            labels[mask] = number
            item = replace(item, region_px=int(np.count_nonzero(mask)))
        elif item.status is Status.IGNORED:
            ignored |= mask
        objects.append(item)
    return by_lidar, replace(lidar, objects=tuple(objects), labels=labels, ignored=ignored)


def _with_ignored(reference: ReferenceFrame, which: list[bool]) -> ReferenceFrame:
    """The reference with some of its evaluated objects ignored, their regions among the ignored ones."""
    if not any(which):
        return reference
    labels, ignored = reference.labels.copy(), reference.ignored.copy()
    objects = list(reference.objects)
    for index in np.flatnonzero(which).tolist():
        objects[index] = replace(objects[index], status=Status.IGNORED, reason=IgnoreReason.OCCLUDED, region_px=0)
        ignored |= labels == index + 1
        labels[labels == index + 1] = 0
    return replace(reference, objects=tuple(objects), labels=labels, ignored=ignored)
