"""The polygons of an image laid over each other, nearest first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.reference.polygons import Raster
from bench.reference.records import IgnoreReason, ReferenceObject, Status


def compose(
    objects: Sequence[tuple[ReferenceObject, Raster | None]], valid: NDArray[np.bool_]
) -> tuple[tuple[ReferenceObject, ...], NDArray[np.int32], NDArray[np.bool_]]:
    """Give every pixel to the nearest annotated object that covers it.

    Static and ignored objects occlude as well: behind a parked car nothing can be detected. An evaluated object
    of which nothing remains becomes ignored as occluded.

    Args:
        objects: nearest first, each with the pixels of its polygon inside V; None where it has no polygon.
        valid: (H, W) bool, the region V.

    Returns:
        objects: with `region_px` filled in.
        labels: (H, W) int32, k + 1 for pixels of G of object k, else 0.
        ignored: (H, W) bool, the region I: polygons of ignored objects minus every G.
    """
    labels, taken = np.zeros(valid.shape, dtype=np.int32), np.zeros(valid.shape, dtype=bool)
    ignored = np.zeros(valid.shape, dtype=bool)
    settled = []
    for number, (found, raster) in enumerate(objects, start=1):
        if raster is None:
            settled.append(found)
            continue
        window, covered = raster
        region = covered & ~taken[window]
        taken[window] |= covered
        region_px = int(np.count_nonzero(region))
        result = found
        if found.status is Status.EVALUATED and not region_px:
            result = replace(found, status=Status.IGNORED, reason=IgnoreReason.OCCLUDED)
        elif found.status is Status.EVALUATED:
            np.copyto(labels[window], number, where=region)
            result = replace(found, region_px=region_px)
        if result.status is Status.IGNORED:
            ignored[window] |= covered & (labels[window] == 0)  # later G begin where this polygon ends
        settled.append(result)
    return tuple(settled), labels, ignored
