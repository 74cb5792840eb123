"""The ego vehicle: its body as its own cameras see it, and the mounting of its sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from bench.cameras import camera_from_parameters, ray_grid
from bench.geometry import RigidTransform, RoadPlane
from bench.records.recording import MountedCamera
from bench.synthesis.draws import named_rng
from bench.synthesis.mesh import Mesh, Surface, box, convex, joined, slab, tube
from bench.synthesis.rays import RayScene
from bench.synthesis.scenario import CalibrationSpec, CameraSpec, RecordingSpec, Scenario

# Seen from above, x forward: a compact car of 4.7 m by 1.8 m with its origin below the rear axle.
OUTLINE_M = np.array([
    [-0.95, -0.8], [3.2, -0.9], [3.55, -0.6], [3.68, -0.3], [3.73, 0.0], [3.68, 0.3], [3.55, 0.6], [3.2, 0.9],
    [-0.95, 0.8],
])  # fmt: skip
PLASTIC = Surface(albedo=0.10, contrast=0.20)
PAINT = Surface(albedo=0.34, contrast=0.05)
WINDOWS = Surface(albedo=0.08, contrast=0.10, mirror=0.04)
RUBBER = Surface(albedo=0.08, contrast=0.30)
BUMPER_M = (0.30, 0.44)  # lowest and highest edge of the front bumper, above the road
WHEELBASE_M, WHEEL_RADIUS_M = 2.7, 0.31

# Camera axes (x right, y down, z ahead) in a frame with x ahead, y left, z up.
AHEAD_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def own_body() -> Mesh:
    """The ego vehicle as its own cameras see it, vehicle frame.

    Bumpers lie below the cameras at the ends, flanks below those in the mirrors.
    """
    front = OUTLINE_M[OUTLINE_M[:, 0] > 3.0]
    bumper = convex(np.concatenate([np.column_stack([front, np.full(len(front), z)]) for z in BUMPER_M]), PLASTIC)
    nose = slab([(3.1, 0.3), (3.1, 0.78), (3.45, 0.7), (3.45, 0.3)], [0.84, 0.8, 0.62, 0.7], PAINT)
    flanks = slab(
        [(-0.93, 0.45), (-0.93, 0.82), (2.9, 0.82), (3.2, 0.7), (3.2, 0.4), (2.9, 0.3), (-0.7, 0.3)], 0.85, PAINT
    )
    waist = slab(
        [(-0.93, 0.82), (-0.9, 0.95), (2.2, 0.95), (3.2, 0.72), (3.2, 0.7)], [0.85, 0.78, 0.78, 0.8, 0.85], PAINT
    )
    cabin = slab([(-0.8, 0.95), (-0.3, 1.4), (1.3, 1.4), (2.2, 0.95)], [0.78, 0.62, 0.62, 0.78], WINDOWS)
    roof = slab([(-0.35, 1.4), (0.0, 1.45), (1.1, 1.45), (1.35, 1.4)], [0.62, 0.56, 0.56, 0.62], PAINT)
    tail = box([0.12, 1.5, 0.25], [-0.94, 0.0, 0.5], PLASTIC)
    sides = [part for side in (-1.0, 1.0) for part in _side(side)]
    return joined([bumper, nose, flanks, waist, cabin, roof, tail, *sides])


def _side(side: float) -> list[Mesh]:
    """Wheels and mirror of the left (1) or the right (-1) side."""
    wheels = [
        tube([x, side * 0.68, WHEEL_RADIUS_M], [x, side * 0.87, WHEEL_RADIUS_M], WHEEL_RADIUS_M, RUBBER, sides=16)
        for x in (0.0, WHEELBASE_M)
    ]
    return [*wheels, box([0.16, 0.24, 0.12], [1.95, side * 0.98, 1.1], PLASTIC)]


def camera_mounting(spec: CameraSpec) -> RigidTransform:
    """vehicle_from_camera as the scenario has it."""
    turns = Rotation.from_euler("ZYX", [spec.yaw_deg, spec.pitch_down_deg, spec.roll_deg], degrees=True)
    return RigidTransform(turns.as_matrix() @ AHEAD_FROM_CAMERA, np.array(spec.position_m))


def mounted_camera(spec: CameraSpec, *, vehicle_from_camera: RigidTransform | None = None) -> MountedCamera:
    """The camera of a scenario, with the mask of where it sees the ego vehicle.

    Args:
        spec: the camera.
        vehicle_from_camera: where it sits; None for where the scenario has it.
    """
    model = camera_from_parameters(spec.model, width=spec.width, height=spec.height, **spec.parameters)
    mounting = vehicle_from_camera or camera_mounting(spec)
    grid = ray_grid(model)
    own = RayScene(own_body().moved(mounting.inverse()).corners_m)
    ego_body = np.zeros(grid.valid.shape, dtype=bool)
    ego_body[grid.valid] = np.isfinite(own.cast(grid.rays_camera[grid.valid]).distances_m)
    return MountedCamera(
        name=spec.name,
        model=model,
        vehicle_from_camera=mounting,
        road=RoadPlane.below(mounting),
        stored_size_px=(spec.width, spec.height),
        ego_body=ego_body if ego_body.any() else None,
        rolling_shutter=None if spec.rolling_shutter is None else spec.rolling_shutter.shutter,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """The sensors of a recording.

    Attributes:
        cameras: as rendered, by name.
        recorded_cameras: as the recording's calibration has them; masks of the ego vehicle's body are those of
            `cameras`, as a user draws them from images.
        vehicle_from_lidar: as scanned.
        recorded_vehicle_from_lidar: as the recording's calibration has it.
    """

    cameras: Mapping[str, MountedCamera]
    recorded_cameras: Mapping[str, MountedCamera]
    vehicle_from_lidar: RigidTransform
    recorded_vehicle_from_lidar: RigidTransform


def mounted_rig(scenario: Scenario, spec: RecordingSpec) -> Rig:
    """Mount every sensor, off by the errors that are drawn for this recording."""
    errors = scenario.vehicle.calibration or CalibrationSpec(
        camera_angle_deg=0, camera_position_m=0, lidar_angle_deg=0, lidar_position_m=0
    )

    def off(nominal: RigidTransform, angle_deg: float, position_m: float, *names: str) -> RigidTransform:
        rng = named_rng(scenario.seed, spec.name, "calibration", *names)
        turn = Rotation.from_rotvec(np.radians(angle_deg) * rng.normal(size=3)).as_matrix()
        shift_m = position_m * rng.normal(size=3)
        return RigidTransform(nominal.rotation @ turn, nominal.translation_m + shift_m)

    cameras: dict[str, MountedCamera] = {}
    recorded: dict[str, MountedCamera] = {}
    for entry in scenario.cameras:
        nominal = camera_mounting(entry)
        true = off(nominal, errors.camera_angle_deg, errors.camera_position_m, "camera", entry.name)
        cameras[entry.name] = mounted_camera(entry, vehicle_from_camera=true)
        road = RoadPlane.below(nominal)
        recorded[entry.name] = replace(cameras[entry.name], vehicle_from_camera=nominal, road=road)
    nominal_lidar = RigidTransform.from_yaw(0.0, scenario.lidar.position_m)  # its axes along the vehicle's
    return Rig(
        cameras=cameras,
        recorded_cameras=recorded,
        vehicle_from_lidar=off(nominal_lidar, errors.lidar_angle_deg, errors.lidar_position_m, "lidar"),
        recorded_vehicle_from_lidar=nominal_lidar,
    )
