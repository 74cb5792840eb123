"""Rigid transforms, the unit sphere and the road plane. Imports nothing of `bench` but `errors`.

Conventions of the whole project, written here once:

- Vehicle and world frames: ISO 8855, x forward, y left, z up, metres. The vehicle's origin is on the ground
  below the middle of the rear axle.
- Camera frame: OpenCV, x right, y down, z along the optical axis.
- Transforms are named `a_from_b` and map points of frame b into frame a; neighbours must match:
  `camera_from_lidar = camera_from_vehicle @ vehicle_from_lidar`.
- Pixels are (u, v), the centre of the first pixel is (0, 0); images are indexed [v, u].
- Quaternions are wxyz. Angles are radians, times int64 nanoseconds, geometry is float64.
"""

from bench.geometry.rigid import RigidTransform, RoadPlane, advance_twist, quaternions_wxyz, twist_between
from bench.geometry.sphere import Bools, Floats, angle_between, cross, dot, normalise

__all__ = [
    "Bools",
    "Floats",
    "RigidTransform",
    "RoadPlane",
    "advance_twist",
    "angle_between",
    "cross",
    "dot",
    "normalise",
    "quaternions_wxyz",
    "twist_between",
]
