"""The host vehicle: where its sensors sit and what of itself its cameras see."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bench.cameras import camera_from_parameters, ray_grid
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.records import MountedCamera
from bench.synthesis.mesh import Mesh, Surface, convex, joined, slab
from bench.synthesis.ray_scene import RayScene
from bench.synthesis.scenario import CameraSpec, LidarSpec

# Seen from above, x forward: a compact car of 4.7 m by 1.8 m with its origin below the rear axle.
OUTLINE_M = np.array(
    [
        [-0.95, -0.8],
        [3.2, -0.9],
        [3.55, -0.6],
        [3.68, -0.3],
        [3.73, 0.0],
        [3.68, 0.3],
        [3.55, 0.6],
        [3.2, 0.9],
        [-0.95, 0.8],
    ]
)
PLASTIC = Surface(albedo=0.10, contrast=0.20)
BUMPER_M = (0.30, 0.44)  # lowest and highest edge of the bumper, above the road

# Camera axes (x right, y down, z ahead) in a frame with x ahead, y left, z up.
AHEAD_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def own_body() -> Mesh:
    """The host, vehicle frame: the bumper below the front camera, and the body behind it for its shadow."""
    front = OUTLINE_M[OUTLINE_M[:, 0] > 3.0]
    bumper = convex(np.concatenate([np.column_stack([front, np.full(len(front), z)]) for z in BUMPER_M]), PLASTIC)
    hull = slab([(-0.95, 0.3), (-0.9, 0.95), (2.2, 0.95), (3.2, 0.75), (3.2, 0.3)], 0.85, PLASTIC)
    cabin = slab([(-0.8, 0.95), (-0.3, 1.45), (1.3, 1.45), (2.2, 0.95)], 0.7, PLASTIC)
    return joined([bumper, hull, cabin])


def mounted_camera(spec: CameraSpec) -> MountedCamera:
    """The camera of a scenario, with the mask of where it sees the host."""
    model = camera_from_parameters(spec.model, width=spec.width, height=spec.height, **spec.parameters)
    turns = Rotation.from_euler("ZYX", [spec.yaw_deg, spec.pitch_down_deg, spec.roll_deg], degrees=True)
    vehicle_from_camera = RigidTransform(turns.as_matrix() @ AHEAD_FROM_CAMERA, np.array(spec.position_m))
    grid = ray_grid(model)
    own = RayScene(own_body().moved(vehicle_from_camera.inverse()).corners_m)
    ego_body = np.zeros(grid.valid.shape, dtype=bool)
    ego_body[grid.valid] = np.isfinite(own.cast(grid.rays_camera[grid.valid]).distances_m)
    return MountedCamera(
        name=spec.name,
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=RoadPlane.below(vehicle_from_camera),
        stored_size_px=(spec.width, spec.height),
        ego_body=ego_body if ego_body.any() else None,
    )


def vehicle_from_lidar(spec: LidarSpec) -> RigidTransform:
    """The mounting of the lidar, its axes along the vehicle's."""
    return RigidTransform(np.eye(3), np.array(spec.position_m))
