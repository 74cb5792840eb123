"""A drive whose truth is exact: a host, a spinning lidar with per-point times, and one moving box."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from bench.cameras.angular import RadialPolynomialCamera
from bench.egomotion.trajectory import Trajectory
from bench.evaluation.protocol import load_protocol
from bench.geometry import RigidTransform, RoadPlane, advance_twist
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, ImageRef, MountedCamera, ObjectState, Recording, SweepRef, Track
from bench.records.recording import COMPLETELY
from bench.records.reference import (
    OBJECT_CLASSES,
    Category,
    IgnoreReason,
    ReferenceFrame,
    ReferenceObject,
    Status,
    pixels_object,
)
from bench.records.rules import Limb, OutlineErrors, ReferenceSettings
from bench.reference.build import ReferenceBuilder
from bench.reference.raster import Raster, rasterise
from bench.reference.regions import Region
from tests.support.worlds import beams

MS = 1_000_000
PAPER = load_protocol("paper-v1").reference
MOTION = PAPER.motion.model_copy(update={"min_run_s": 0.2, "smoothing_s": 0.3})
SETTINGS = PAPER.model_copy(update={"classes": OBJECT_CLASSES, "categories": tuple(Category), "motion": MOTION})

LEGS = (Limb(joint=0.53, end=0.0, speed=2.0),)
ERRORS = OutlineErrors(range_noise_m=0.02, angle_deg=np.degrees(0.002), position_m=0.007, limbs={"pedestrian": LEGS})
LENS = RadialPolynomialCamera(
    width=640, height=480, coefficients=(170.0, -16.0, 24.0, -3.6), principal_point=(319.5, 239.5), max_angle_rad=1.7
)
PITCH = np.deg2rad(20)
# x right, y down, z forward in vehicle axes: a camera that looks ahead and 20 degrees down.
LOOK = np.array([[0, -1, 0], [-np.sin(PITCH), 0, -np.cos(PITCH)], [np.cos(PITCH), 0, -np.sin(PITCH)]]).T
MOUNT = RigidTransform(LOOK, np.array([3.7, 0.0, 0.66]))
LIDAR = RigidTransform.from_yaw(0.1, (1.0, 0.0, 1.8))


def camera(ego_body=None) -> MountedCamera:
    return MountedCamera(
        name="front",
        model=LENS,
        vehicle_from_camera=MOUNT,
        road=RoadPlane.below(MOUNT),
        stored_size_px=(640, 480),
        ego_body=ego_body,
    )


def circle(speed_mps: float, yaw_rate_radps: float, until_ns: int = 2000 * MS) -> Trajectory:
    """A host that drives on a circle, sampled at 100 Hz."""
    times_ns = np.arange(-200 * MS, until_ns + 1, 10 * MS)
    seconds = times_ns / 1e9
    turn = np.tile([0.0, 0.0, yaw_rate_radps], (len(times_ns), 1))
    ahead = np.tile([speed_mps, 0.0, 0.0], (len(times_ns), 1))
    rotations, positions_m = advance_twist(turn, ahead, seconds)
    return Trajectory(source="circle", timestamps_ns=times_ns, rotations=rotations, positions_m=positions_m)


class Box:
    """A box that moves with constant velocity and yaw rate in the world."""

    def __init__(self, place_m, size_m, velocity_mps, yaw_rate_radps=0.0, yaw_rad=0.0):
        self.place_m, self.size_m, self.velocity_mps = (np.asarray(v, float) for v in (place_m, size_m, velocity_mps))
        self.yaw_rate_radps, self.yaw_rad = yaw_rate_radps, yaw_rad

    def world_from_box(self, time_ns: int) -> RigidTransform:
        seconds = time_ns / 1e9
        place = self.place_m + self.velocity_mps * seconds
        return RigidTransform.from_yaw(self.yaw_rad + self.yaw_rate_radps * seconds, place)

    def points_world(self, points: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
        """Points of the box, (N, 3), each where it is at its own time."""
        yaw_rad = self.yaw_rad + self.yaw_rate_radps * times_ns / 1e9
        cosine, sine, (x, y, z) = np.cos(yaw_rad), np.sin(yaw_rad), points.T
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
        return turned + self.place_m + self.velocity_mps * (times_ns / 1e9)[:, None]

    def skin(self, count: int, seed: int = 0) -> np.ndarray:
        """Points on the box's sides, object frame, just inside of the annotated box."""
        rng = np.random.default_rng(seed)
        points = rng.uniform(-0.495, 0.495, (count, 3))
        face, side = rng.integers(0, 3, count), rng.choice([-0.495, 0.495], count)
        points[np.arange(count), face] = side
        return points * self.size_m

    def state(self, time_ns: int, trajectory: Trajectory, **words) -> ObjectState:
        vehicle_from_world = trajectory.world_from_vehicle(time_ns).inverse()
        return ObjectState(
            timestamp_ns=time_ns,
            shape=Cuboid(vehicle_from_object=vehicle_from_world @ self.world_from_box(time_ns), size_m=self.size_m),
            velocity_mps=vehicle_from_world.rotate(self.velocity_mps),
            yaw_rate_radps=self.yaw_rate_radps,
            **words,
        )


def sweep_of(boxes, trajectory: Trajectory, reference_ns: int, points_each=400, *, timed=True) -> LidarSweep:
    """What the lidar would see: every point is taken at its own time within +-50 ms."""
    rng = np.random.default_rng(reference_ns % 1000 + 1)
    rows, offsets = [], []
    for box in boxes:
        offset_ns = np.linspace(-50 * MS, 50 * MS, points_each).astype(np.int64) * timed
        rotations, positions_m, _ = trajectory.at(reference_ns + offset_ns)
        points_world = box.points_world(box.skin(points_each), reference_ns + offset_ns)
        rows.append(LIDAR.inverse().apply(np.einsum("nji,nj->ni", rotations, points_world - positions_m)))
        offsets.append(offset_ns)
    road = np.column_stack([rng.uniform(-20, 20, (200, 2)), np.full(200, -1.8)])  # z = 0 in the vehicle
    points = np.vstack([*rows, road]) if rows else road
    times = np.concatenate([*offsets, np.zeros(200, np.int64)])
    return LidarSweep(timestamp_ns=reference_ns, points_lidar=points, time_offset_ns=times if timed else None)


def drive(
    boxes, trajectory, *, sweep_ns=(0,), state_ns=(0,), exposures_ns=(0,), classes=None, annotated=COMPLETELY, **words
) -> Recording:
    """A recording of boxes, with sweeps and states at the given times."""
    tracks = [
        Track(
            track_id=f"object-{i}",
            object_class=(classes or ["vehicle"] * len(boxes))[i],
            states=tuple(box.state(t, trajectory, **words) for t in state_ns),
        )
        for i, box in enumerate(boxes)
    ]
    recording = Recording(
        name="drive",
        root=Path("drive"),
        frame_interval_ns=66_666_667,
        cameras={"front": camera()},
        images={"front": tuple(ImageRef(camera="front", timestamp_ns=t, path=Path(f"{t}.png")) for t in exposures_ns)},
        trajectory=trajectory,
        vehicle_from_lidar=LIDAR,
        sweeps=(),
        tracks=tuple(tracks),
        annotated=annotated,
    )
    return with_sweep(recording, *(sweep_of(boxes, trajectory, t) for t in sweep_ns))


def with_sweep(recording: Recording, *sweeps: LidarSweep) -> Recording:
    """The recording with these sweeps instead of its own."""
    refs = (SweepRef(timestamp_ns=s.timestamp_ns, path=Path("0.npz"), reader=lambda *_, s=s: s) for s in sweeps)
    return replace(recording, sweeps=tuple(refs))


def with_points(recording: Recording, points_lidar: np.ndarray) -> Recording:
    """The recording with other points in its only sweep."""
    return with_sweep(recording, replace(recording.sweeps[0].read(), points_lidar=points_lidar))


def with_class(recording: Recording, object_class: str) -> Recording:
    """The recording with its only object of another class."""
    return replace(recording, tracks=(replace(recording.tracks[0], object_class=object_class),))


def with_state(recording: Recording, **changes) -> Recording:
    """The recording with its only object's only annotation changed."""
    (track,) = recording.tracks
    return replace(recording, tracks=(replace(track, states=(replace(track.states[0], **changes),)),))


def reference_of(recording: Recording, settings: ReferenceSettings = SETTINGS) -> ReferenceFrame:
    """The reference of its first image."""
    return ReferenceBuilder(recording, "front", settings).build(recording.images["front"][0])


def pixels_of(polygon, *, width=LENS.width, height=LENS.height) -> np.ndarray:
    """The pixels of an image whose centre a polygon covers."""
    pixels = np.zeros((height, width), dtype=bool)
    window, covered = rasterise(polygon, width=width, height=height)
    pixels[window] = covered
    return pixels


def with_settings(**changes) -> ReferenceSettings:
    return SETTINGS.model_copy(update=changes)


def an_object(status: Status) -> ReferenceObject:
    item = pixels_object("a", 0, reason=IgnoreReason.RANGE if status is Status.IGNORED else None)
    return replace(item, status=status)


def wall_recording(width_m=1.0, height_m=1.7, away_m=8.0, steps_deg=(0.1728, 0.42)):
    """A standing host before a thin wall that slides sideways, scanned by a regular grid of beams."""
    trajectory = circle(0.0, 0.0)
    wall = Box((away_m, 0.4, height_m / 2), (0.02, width_m, height_m), (0.0, 1.0, 0.0))
    rays = beams(np.arange(-40, 40, steps_deg[0]), np.arange(-24.8, 2.0, steps_deg[1]))
    rays_vehicle = LIDAR.rotate(rays)
    points = rays * ((away_m - LIDAR.translation_m[0]) / rays_vehicle[:, 0])[:, None]
    y, z = LIDAR.apply(points)[:, 1:].T
    on_wall = (np.abs(y - 0.4) <= width_m / 2) & (z >= 0) & (z <= height_m)
    sweep = LidarSweep(timestamp_ns=0, points_lidar=points[on_wall | (z < -0.01)])
    truth = upright_polygon(shapely.box(0.4 - width_m / 2, 0.0, 0.4 + width_m / 2, height_m), away_m)
    return with_sweep(drive([wall], trajectory), sweep), truth


def upright_polygon(area_yz, away_m: float) -> shapely.Polygon:
    """The image of an upright area that faces the camera, (y, z) m in the vehicle frame."""
    ring = np.asarray(shapely.segmentize(area_yz, 0.02).exterior.coords)
    return shapely.Polygon(LENS.project(MOUNT.inverse().apply(np.insert(ring, 0, away_m, axis=1)))[0])


def a_region(window: tuple[slice, slice], covered: np.ndarray) -> Region:
    """Of these pixels; its polygon does not matter here."""
    return Region.of(shapely.box(0, 0, 1, 1), Raster(window, covered))
