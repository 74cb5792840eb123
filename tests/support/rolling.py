"""Where a camera with a rolling shutter sees points, found by bisection of the time instead of by steps."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, RollingShutter
from bench.geometry import RigidTransform


def seen_by_rows(
    points_world: Callable[[float], NDArray[np.float64]],
    world_from_camera: Callable[[float], RigidTransform],
    *,
    camera: CameraModel,
    shutter: RollingShutter,
    image_s: float = 0.0,
) -> NDArray[np.float64]:
    """(N, 2), px; NaN where no row sees a point. `points_world` gives (N, 3), m, at a time, s."""

    def pixels_at(offset_s: float) -> NDArray[np.float64]:
        time_s = image_s + offset_s
        return camera.project(world_from_camera(time_s).inverse().apply(points_world(time_s)))[0]

    found = np.empty((len(points_world(image_s)), 2))
    for k in range(len(found)):
        early_s, late_s = -shutter.readout_s / 2, shutter.readout_s / 2
        for _ in range(40):
            middle_s = (early_s + late_s) / 2
            seen = pixels_at(middle_s)[k]
            row_is_later = shutter.row_time_offset_s(seen, camera) > middle_s
            early_s, late_s = (middle_s, late_s) if row_is_later else (early_s, middle_s)
        found[k] = seen if camera.contains(seen[None])[0] else np.nan
    return found
