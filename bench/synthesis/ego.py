"""The ego vehicle: its body as its own cameras see it, the mounting of its sensors, and what its bus reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.model import ray_grid
from bench.cameras.stored import camera_from_parameters
from bench.geometry import RigidTransform, RoadPlane
from bench.records.recording import MountedCamera
from bench.synthesis.mesh import Mesh, Surface, box, convex, joined, slab, tube
from bench.synthesis.motion import WHEELBASE_M, Path
from bench.synthesis.rays import RayScene
from bench.synthesis.scenario import BusSpec, CalibrationSpec, CameraSpec, RecordingSpec, Scenario, named_rng
from bench.times import SECOND_NS

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
WHEEL_RADIUS_M = 0.31

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
    return joined(bumper, nose, flanks, waist, cabin, roof, tail, *sides)


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
class SensorRig:
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


def mounted_rig(scenario: Scenario, spec: RecordingSpec) -> SensorRig:
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
    for entry in scenario.cameras_of(spec):
        nominal = camera_mounting(entry)
        true = off(nominal, errors.camera_angle_deg, errors.camera_position_m, "camera", entry.name)
        cameras[entry.name] = mounted_camera(entry, vehicle_from_camera=true)
        road = RoadPlane.below(nominal)
        recorded[entry.name] = replace(cameras[entry.name], vehicle_from_camera=nominal, road=road)
    nominal_lidar = RigidTransform.from_yaw(0.0, scenario.lidar.position_m)  # its axes along the vehicle's
    return SensorRig(
        cameras=cameras,
        recorded_cameras=recorded,
        vehicle_from_lidar=off(nominal_lidar, errors.lidar_angle_deg, errors.lidar_position_m, "lidar"),
        recorded_vehicle_from_lidar=nominal_lidar,
    )


IDEAL_INTERVAL_NS, INTERVAL_NS = 10_000_000, 20_000_000  # between messages
TICK_M = 2 * np.pi * WHEEL_RADIUS_M / 96  # an ABS wheel sensor counts both edges of 48 teeth
# Without a tick for so long the reported speed is 0: one tick in that time, 0.1 m/s, is the slowest that registers.
STANDSTILL_NS = 200_000_000
LEAD_IN_NS = SECOND_NS  # wheels rotate before the path begins, at its first speed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BusReport:
    """Messages of the bus.

    Attributes:
        times_ns: (N,) int64, scene clock.
        speeds_mps: (N,) float64, >= 0; the gear gives the direction.
        yaw_rates_radps: (N,) float64, positive to the left.
    """

    times_ns: NDArray[np.int64]
    speeds_mps: NDArray[np.float64]
    yaw_rates_radps: NDArray[np.float64]


def bus_report(path: Path, spec: BusSpec | None, rng: np.random.Generator) -> BusReport:
    """Every message between the first and the last node of a path.

    Args:
        path: of the rear axle's middle.
        spec: None for exact signals.
        rng: phase of the ticks, and the sensors' errors.
    """
    interval_ns = IDEAL_INTERVAL_NS if spec is None else INTERVAL_NS
    first, last = -(-int(path.nodes_ns[0]) // interval_ns), int(path.nodes_ns[-1]) // interval_ns
    times_ns = np.arange(first, last + 1, dtype=np.int64) * interval_ns
    speeds_mps, yaw_rates_radps = path.signals(times_ns)
    speeds_mps = np.abs(speeds_mps)
    if spec is None:
        return BusReport(times_ns=times_ns, speeds_mps=speeds_mps, yaw_rates_radps=yaw_rates_radps)
    scale, phase, bias = 1.0 + rng.normal(0.0, spec.speed_scale_sigma), rng.uniform(), rng.normal()
    speeds_mps = _counted(times_ns, _tick_times_ns(path, TICK_M / scale, phase))
    errors = np.radians(bias * spec.yaw_rate_bias_degps + rng.normal(size=len(times_ns)) * spec.yaw_rate_noise_degps)
    return BusReport(
        times_ns=times_ns,
        speeds_mps=_stepped(speeds_mps, spec.speed_step_kmh / 3.6),
        yaw_rates_radps=_stepped(yaw_rates_radps + errors, float(np.radians(spec.yaw_rate_step_degps))),
    )


def _tick_times_ns(path: Path, tick_m: float, phase: float) -> NDArray[np.float64]:
    """Times at which the wheel passes each tick, (M,) float64, scene clock."""
    distances_m = np.abs(path.distances_m - path.distances_m[0])
    lead_in_m = abs(float(path.speeds_mps[0])) * LEAD_IN_NS / SECOND_NS
    distances_m = np.concatenate([[-lead_in_m], distances_m])
    nodes_ns = np.concatenate([[path.nodes_ns[0] - LEAD_IN_NS], path.nodes_ns]).astype(np.float64)
    ticks_m = (np.arange(np.ceil(-lead_in_m / tick_m), np.ceil(distances_m[-1] / tick_m)) + phase) * tick_m
    ticks_m = ticks_m[(ticks_m > distances_m[0]) & (ticks_m < distances_m[-1])]
    after = np.searchsorted(distances_m, ticks_m)  # the distance grows from the node before, so the step below is not 0
    part = (ticks_m - distances_m[after - 1]) / (distances_m[after] - distances_m[after - 1])
    return np.asarray(nodes_ns[after - 1] + part * (nodes_ns[after] - nodes_ns[after - 1]))


def _counted(times_ns: NDArray[np.int64], ticks_ns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speed from ticks, as control units count: distance between the last ticks of two messages over their time.

    A message without a new tick repeats the speed before it, or what one tick up to now would make if that is less;
    after `STANDSTILL_NS` without any it is 0, and the first tick from standstill only starts the clock.
    """
    counts = np.searchsorted(ticks_ns, times_ns, side="right").tolist()
    before = np.searchsorted(ticks_ns, times_ns - INTERVAL_NS, side="right").tolist()
    speeds_mps, speed = np.zeros(len(times_ns)), 0.0
    for row, (count, start) in enumerate(zip(counts, before, strict=True)):
        if count > start:
            fresh = start == 0 or ticks_ns[start] - ticks_ns[start - 1] > STANDSTILL_NS
            first = start if fresh else start - 1
            seconds = (ticks_ns[count - 1] - ticks_ns[first]) / SECOND_NS
            speed = (count - 1 - first) * TICK_M / seconds if count - 1 > first else 0.0
        elif count:
            since_tick_ns = times_ns[row] - ticks_ns[count - 1]
            speed = 0.0 if since_tick_ns > STANDSTILL_NS else min(speed, TICK_M * SECOND_NS / max(since_tick_ns, 1.0))
        speeds_mps[row] = speed
    return speeds_mps


def _stepped(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    return values if step == 0.0 else np.asarray(np.rint(values / step) * step)
