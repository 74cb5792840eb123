"""A street in six sweeps, each point known: the ego vehicle turns slowly, a car passes, another is parked.

And whether labels of it say the same.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.annotation.formats.conversion import store_labels
from bench.egomotion.trajectory import Trajectory, planar_trajectory
from bench.geometry import RigidTransform
from bench.lidar.files import read_sweep, write_sweep
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, GroundPolygon, ObjectState, PointIndices, Recording, SweepRef, Track
from bench.records.recording import NOT_ANNOTATED

SWEEPS = 6
STEP_NS = 100_000_000
FIRST_NS = 1_700_000_000_000_000_000
TIMES_NS = tuple(FIRST_NS + i * STEP_NS for i in range(SWEEPS))
VEHICLE_FROM_LIDAR = RigidTransform(
    Rotation.from_euler("xyz", [0.01, -0.02, 0.3]).as_matrix(), np.array([1.2, 0.1, 1.8])
)
EGO_MPS, EGO_RADPS = 4.0, 0.2
SIZES_M = {"car": (4.4, 1.8, 1.5), "walker": (0.6, 0.7, 1.8), "parked": (4.0, 1.7, 1.4)}
CLASSES = {"car": "vehicle", "walker": "pedestrian", "parked": "vehicle"}
PLACES_M = {"car": (6.0, 3.5, 0.75), "walker": (9.0, -2.0, 0.9), "parked": (12.0, -4.5, 0.7)}  # at first, world frame
SPEEDS_MPS = {"car": np.array([7.0, 1.0, 0.0]), "walker": np.array([0.0, -1.2, 0.0]), "parked": np.zeros(3)}
HEADINGS_RAD = {"car": 0.2, "walker": -1.5, "parked": 0.1}
TURNS_RADPS = {"car": 0.3, "walker": 0.0, "parked": 0.0}
POINTS = 40  # on each object
GROUND = 60


def about_axes(*angles_rad: float) -> list[np.ndarray]:
    """Rotations about x, y and z alone."""
    return [Rotation.from_euler(axis, angle).as_matrix() for axis, angle in zip("xyz", angles_rad, strict=True)]


def box_tracks() -> tuple[Track, ...]:
    """All objects as boxes at every sweep."""
    return tuple(map(box_track, SIZES_M))


@cache
def trajectory() -> Trajectory:
    times_ns = FIRST_NS + np.arange(-20, 80, dtype=np.int64) * 10_000_000
    speed, turn = np.full(len(times_ns), EGO_MPS), np.full(len(times_ns), EGO_RADPS)
    return planar_trajectory(source="poses.csv", timestamps_ns=times_ns, speed_mps=speed, yaw_rate_radps=turn)


def world_from_object(name: str, time_ns: float) -> RigidTransform:
    seconds = (time_ns - FIRST_NS) / 1e9
    heading_rad = HEADINGS_RAD[name] + TURNS_RADPS[name] * seconds
    return RigidTransform.from_yaw(heading_rad, np.array(PLACES_M[name]) + SPEEDS_MPS[name] * seconds)


@cache
def sweep(index: int) -> tuple[LidarSweep, dict[str, np.ndarray]]:
    """The sweep, and the rows of each object's points; the rest lies on the ground around."""
    rng = np.random.default_rng(index)
    ego = trajectory()
    names = [name for name in SIZES_M for _ in range(POINTS)] + ["ground"] * GROUND
    order = rng.permutation(len(names))
    offsets_ns = rng.integers(-50_000_000, 50_000_000, len(names))
    points, rows = [], {name: [] for name in SIZES_M}
    for row, which in enumerate(order):
        name, time_ns = names[which], TIMES_NS[index] + int(offsets_ns[row])
        if name == "ground":
            world = np.array([*rng.uniform(-20, -3, 2), 0.0])
        else:
            rows[name].append(row)
            inside = rng.uniform(-0.45, 0.45, 3)
            inside[2] = rng.uniform(-0.4, 0.45)
            world = world_from_object(name, time_ns).apply(inside * SIZES_M[name])
        lidar_from_world = (ego.world_from_vehicle(time_ns) @ VEHICLE_FROM_LIDAR).inverse()
        points.append(lidar_from_world.apply(world))
    made = LidarSweep(timestamp_ns=TIMES_NS[index], points_lidar=np.array(points), time_offset_ns=offsets_ns)
    return made, {name: np.array(found) for name, found in rows.items()}


def recording(root: Path) -> Recording:
    """The street on disk; sweeps are called 000000.npz and on."""
    (root / "lidar").mkdir(parents=True, exist_ok=True)
    refs = []
    for i, time_ns in enumerate(TIMES_NS):
        path = root / "lidar" / f"{i:06d}.npz"
        write_sweep(path, sweep(i)[0])
        refs.append(SweepRef(timestamp_ns=time_ns, path=path, reader=read_sweep))
    return Recording(
        name="street",
        root=root,
        frame_interval_ns=STEP_NS,
        cameras={},
        images={},
        trajectory=trajectory(),
        vehicle_from_lidar=VEHICLE_FROM_LIDAR,
        sweeps=tuple(refs),
        tracks=(),
        annotated=NOT_ANNOTATED,
    )


def box_track(name: str, *, told: bool = True) -> Track:
    """An object as a box at each sweep, with its velocity where `told`."""
    ego = trajectory()
    states = []
    for time_ns in TIMES_NS:
        vehicle_from_world = ego.world_from_vehicle(time_ns).inverse()
        shape = Cuboid(
            vehicle_from_object=vehicle_from_world @ world_from_object(name, time_ns), size_m=np.array(SIZES_M[name])
        )
        velocity = vehicle_from_world.rotate(SPEEDS_MPS[name]) if told else np.full(3, np.nan)
        turn = TURNS_RADPS[name] if told else 0.0
        states.append(ObjectState(timestamp_ns=time_ns, shape=shape, velocity_mps=velocity, yaw_rate_radps=turn))
    return Track(track_id=name, object_class=CLASSES[name], states=tuple(states))


def full_tracks() -> tuple[Track, Track]:
    """Everything that annotations can say."""
    car = box_track("car")
    first = replace(car.states[0], category="crossing", unclear=True)
    outline = GroundPolygon(outline_m=np.array([[4.0, 1.0], [5.0, 1.0], [5.0, 2.0]]), bottom_m=0.1, top_m=1.7)
    indexed = PointIndices(indices=np.array([3, 1, 4]), sweep_timestamp_ns=TIMES_NS[1])
    walker = (
        ObjectState(timestamp_ns=TIMES_NS[1], shape=outline, velocity_mps=np.array([0.0, 1.0, 0.0])),
        ObjectState(timestamp_ns=TIMES_NS[1] + 33_000_000, shape=indexed, velocity_mps=np.full(3, np.nan)),
    )
    return (
        replace(car, states=(first, *car.states[1:]), instance_id=9),
        Track(track_id="the walker", object_class="pedestrian", states=walker),
    )


def assert_same_boxes(found, expected):
    """Same objects, times, places, sizes and headings; velocities and the rest are compared elsewhere."""
    told = [
        [(track.track_id, track.object_class, [state.timestamp_ns for state in track.states]) for track in tracks]
        for tracks in (found, expected)
    ]
    assert told[0] == told[1]
    for one, other in zip(found, expected, strict=True):
        for state, true in zip(one.states, other.states, strict=True):
            assert isinstance(state.shape, Cuboid)
            matrix = true.shape.vehicle_from_object.matrix
            assert state.shape.vehicle_from_object.matrix == pytest.approx(matrix, abs=1e-9)
            assert state.shape.size_m == pytest.approx(true.shape.size_m, abs=1e-9)


def written(format_, tracks, recording, folder):
    """Write tracks into a folder; what the format cannot hold."""
    files, lost = format_.write(replace(recording, tracks=tuple(tracks)))
    store_labels(folder, files)
    return lost
