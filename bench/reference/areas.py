"""Areas on the ground that the annotations leave out, as pixels of a camera: there nobody knows what moves."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.records.recording import Annotated, GroundPolygon, MountedCamera
from bench.reference.silhouette import convex_parts, silhouette

TALLEST_M = 4.5  # road users in such an area reach this high: lorries of 4 m (Directive 96/53/EC) and slack


def left_out_ground(annotated: Annotated) -> BaseGeometry:
    """The areas as one, x and y in the vehicle frame, m; empty without any."""
    return shapely.union_all([shapely.make_valid(shapely.Polygon(outline)) for outline in annotated.left_out_m])


def left_out_pixels(annotated: Annotated, camera: MountedCamera) -> NDArray[np.bool_]:
    """Pixels whose ray meets something that may stand in one of the areas, whatever is in front of it.

    Args:
        annotated: of the recording.
        camera: on the vehicle.

    Returns:
        (H, W) bool.
    """
    covered = np.zeros((camera.model.height, camera.model.width), dtype=bool)
    for outline in annotated.left_out_m:
        body = GroundPolygon(outline_m=np.array(outline), bottom_m=camera.ground_m, top_m=camera.ground_m + TALLEST_M)
        parts_camera = camera.vehicle_from_camera.inverse().apply(convex_parts(body))
        window, inside = silhouette(parts_camera, camera.model)
        covered[window] |= inside
    return covered
