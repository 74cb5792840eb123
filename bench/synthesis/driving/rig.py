"""The host's sensors: where their calibration says that they sit, and where they sit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.records import MountedCamera
from bench.synthesis.driving.host import camera_mounting, mounted_camera, vehicle_from_lidar
from bench.synthesis.scenario import CalibrationSpec, RecordingSpec, Scenario
from bench.synthesis.scenario.draws import named_rng


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """The sensors of a recording.

    Attributes:
        cameras: as rendered, by name.
        recorded_cameras: as the recording's calibration has them; masks of the host's own body are those of `cameras`,
            as a user draws them from images.
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
    nominal_lidar = vehicle_from_lidar(scenario.lidar)
    return Rig(
        cameras=cameras,
        recorded_cameras=recorded,
        vehicle_from_lidar=off(nominal_lidar, errors.lidar_angle_deg, errors.lidar_position_m, "lidar"),
        recorded_vehicle_from_lidar=nominal_lidar,
    )
