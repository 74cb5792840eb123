"""How poses and the lidar's mounting are misread: readings of poses, road and boxes that returns meet, names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.recordings import Recording
from bench.validation.drive import boxes_near

Array = NDArray[np.float64]
Change = Callable[[Trajectory], Trajectory]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseReading:
    """A mistake, and what undoes it.

    Attributes:
        description: what the poses are if this is the mistake.
        hint: what to change.
        change: undoes it.
    """

    description: str
    hint: str
    change: Change


def _reordered(path: Trajectory) -> Trajectory:
    w, x, y, z = path.rotations.as_quat().T
    return replace(path, rotations=Rotation.from_quat(np.stack([x, y, z, w], axis=1)))


def _inverted(path: Trajectory) -> Trajectory:
    inverse = path.rotations.inv()
    return replace(path, rotations=inverse, positions_m=-inverse.apply(path.positions_m))


def _in_axes(matrix: Array, *, places: bool = True, rotations: bool = True) -> Change:
    """World and vehicle seen in other axes: (3, 3) orthogonal, of determinant -1 for a mirror."""

    def change(path: Trajectory) -> Trajectory:
        turned = Rotation.from_matrix(matrix @ path.rotations.as_matrix() @ matrix.T) if rotations else path.rotations
        return replace(path, rotations=turned, positions_m=path.positions_m @ matrix.T if places else path.positions_m)

    return change


FLIP_Y, TURN_OVER = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0])
VEHICLE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
XYZW = "write quaternions as qx qy qz qw"
RIGHT_HANDED = "y is positive to the left, and the yaw with it"
POSE_READINGS = (
    PoseReading(description="quaternions w, x, y, z read as x, y, z, w", hint=XYZW, change=_reordered),
    PoseReading(description="vehicle_from_world, the inverse", hint="give world_from_vehicle", change=_inverted),
    PoseReading(description="poses of left-handed axes, y to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y)),
    PoseReading(
        description="positions with y to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y, rotations=False)
    ),
    PoseReading(description="rotations to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y, places=False)),
    PoseReading(
        description="poses with y to the right and z down",
        hint="give poses of axes x forward, y left, z up, in a world with z up",
        change=_in_axes(TURN_OVER),
    ),
    PoseReading(
        description="poses of a camera's axes, z forward",
        hint="give poses of axes x forward, y left, z up, in a world with z up",
        change=_in_axes(VEHICLE_FROM_OPTICAL),
    ),
)


def pose_readings(path: Trajectory) -> Iterator[tuple[PoseReading, Trajectory]]:
    """The path in every reading; none of a path of bus signals, which has no poses."""
    x, y, _, _ = path.rotations.as_quat().T
    level = not (x.any() or y.any() or path.positions_m[:, 2].any())
    if not level or Path(path.source).name == "poses.csv":
        yield from ((reading, reading.change(path)) for reading in POSE_READINGS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seeing:
    """Limits of the search for the road and for returns in boxes.

    Attributes:
        sweeps: that are read, spread over the drive.
        near_m: of the returns that count for the road.
        returns: of a sweep that are tried, at random.
        planes: that are tried, each through three returns within `patch_m` of each other.
        patch_m: see there.
        thick_m: of the road: kerbs count, pavements may.
        below: share of the returns that may lie below the road.
        least: share of the returns that lie on it.
        across: cosine of the angle between the plane's normal and the lidar's path, at most.
        box_ns: of an annotated state to a sweep.
        bottom: share of half a box, from its middle down; what lies lower may be the road.
        nearer: share of its angle to the stated mounting that the fitted one is off from the inverse, to be called so.
        named_rad: how far a mounting may be from permuted axes to be called so.
    """

    sweeps: int = 5
    near_m: float = 20.0
    returns: int = 1500
    planes: int = 400
    patch_m: float = 6.0
    thick_m: float = 0.15
    below: float = 0.03
    least: float = 0.15
    across: float = 0.3
    box_ns: int = 60_000_000
    bottom: float = 0.6
    nearer: float = 0.3
    named_rad: float = 0.14


SEEING = Seeing()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenPlane:
    """The road in the frame of the points, as the files give them: unit normal (3,), and m from it to the origin."""

    up: Array
    height_m: float


def some_sweeps(recording: Recording) -> list[LidarSweep]:
    """Sweeps spread over the drive; those that cannot be read are left out."""
    rows = np.unique(np.linspace(0, len(recording.sweeps) - 1, SEEING.sweeps).round().astype(int))
    sweeps = []
    for row in rows:
        try:
            sweeps.append(recording.sweeps[row].read())
        except DataError:
            continue  # reported by the check of the sweeps
    return sweeps


def road_plane(sweeps: Sequence[LidarSweep], path_m: Array) -> SeenPlane | None:
    """The plane along the path that has most returns on it, and hardly any on one side.

    Args:
        sweeps: some.
        path_m: (3,) float64, path of the lidar, axes of the points; zero where it stands.

    Returns:
        The median over the sweeps; None where most see no such plane.
    """
    planes = [plane for sweep in sweeps if (plane := _plane(sweep.points_lidar.astype(np.float64), path_m)) is not None]
    if not planes or 2 * len(planes) < len(sweeps):
        return None
    up = np.median([plane[:3] for plane in planes], axis=0)
    return SeenPlane(up=up / np.linalg.norm(up), height_m=float(np.median([plane[3] for plane in planes])))


def _plane(points: Array, path_m: Array) -> Array | None:
    """(4,) float64, normal and the origin's height above the plane."""
    rng = np.random.default_rng(0)
    points = points[np.linalg.norm(points, axis=1) < SEEING.near_m]
    points = points[rng.permutation(len(points))[: SEEING.returns]]
    if len(points) < SEEING.returns // 5:
        return None
    one, two, three = points[rng.integers(0, len(points), (3, 20 * SEEING.planes))]
    together = np.maximum(np.linalg.norm(two - one, axis=1), np.linalg.norm(three - one, axis=1)) < SEEING.patch_m
    normals = np.cross(two - one, three - one)[together]
    sizes = np.linalg.norm(normals, axis=1)
    wide = sizes > 0.5  # m2: three returns in a line make no plane
    normals, corners = normals[wide] / sizes[wide, None], one[together][wide]
    along = np.abs(normals @ path_m) <= SEEING.across * np.linalg.norm(path_m)
    normals, corners = normals[along][: SEEING.planes], corners[along][: SEEING.planes]
    if not len(normals):
        return None
    heights = normals @ points.T - np.einsum("ni,ni->n", normals, corners)[:, None]
    turned = np.where((heights > SEEING.thick_m).sum(axis=1) < (heights < -SEEING.thick_m).sum(axis=1), -1.0, 1.0)
    normals, heights = normals * turned[:, None], heights * turned[:, None]
    on_plane = np.abs(heights) < SEEING.thick_m
    share = np.where((heights < -SEEING.thick_m).mean(axis=1) < SEEING.below, on_plane.mean(axis=1), 0.0)
    best = int(np.argmax(share))
    if share[best] < SEEING.least:
        return None
    road = points[on_plane[best]]
    middle = road.mean(axis=0)
    normal = np.linalg.svd(road - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal @ normals[best])
    return np.append(normal, -normal @ middle)


def returns_in_boxes(recording: Recording, sweeps: Iterable[LidarSweep], vehicle_from_points: Array) -> int:
    """Returns in annotated boxes, above their bottoms, if the lidar were mounted so.

    Args:
        recording: the drive.
        sweeps: some of its sweeps.
        vehicle_from_points: (3, 3) float64, orthogonal, of any determinant.
    """
    count = 0
    for sweep in sweeps:
        placed = sweep.points_lidar @ vehicle_from_points.T + recording.vehicle_from_lidar.translation_m
        for box in boxes_near(recording, sweep.timestamp_ns, within_ns=SEEING.box_ns):
            local = box.vehicle_from_object.inverse().apply(placed) / (box.size_m / 2)
            count += int(((np.abs(local) < 1.0).all(axis=1) & (local[:, 2] > -SEEING.bottom)).sum())
    return count


def mounting_name(stated: Array, fitted: Array) -> str:
    """Name of what is wrong with a mounting.

    Args:
        stated: (3, 3) float64, rotation of the lidar as the calibration says.
        fitted: (3, 3) float64, orthogonal: what the motion asks for.
    """
    if _angle_rad(stated.T, fitted) < min(SEEING.named_rad, SEEING.nearer * _angle_rad(stated, fitted)):
        return "the inverse of vehicle_from_lidar"
    change = stated.T @ fitted
    nearest = min(signed_axes(), key=lambda axes: float(np.linalg.norm(axes - change)))
    if not np.array_equal(nearest, np.eye(3)) and _angle_rad(nearest, change) < SEEING.named_rad:
        return _axes_name(nearest)
    turned = fitted @ stated.T
    yaw_deg = np.degrees(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    mirror = "the points mirrored and " if np.linalg.det(change) < 0 else ""
    return f"{mirror}the lidar turned by {yaw_deg:+.1f} degrees about the vehicle's z"


def _angle_rad(one: Array, other: Array) -> float:
    """Angle of the rotation between two orthogonal matrices; pi where one of them mirrors."""
    between = one.T @ other
    if np.linalg.det(between) < 0:
        return float(np.pi)
    return float(np.arccos(np.clip((np.trace(between) - 1) / 2, -1, 1)))


def signed_axes() -> list[Array]:
    """All 48 permutations of axes with signs; 24 of them mirror."""
    return [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]


def _axes_name(axes: Array) -> str:
    off_diagonal = np.flatnonzero(np.diag(axes) == 0)
    reversed_axes = " and ".join("xyz"[i] for i in range(3) if axes[i, i] < 0)
    if not len(off_diagonal):
        mirror = ": the points are mirrored" if np.linalg.det(axes) < 0 else ": the lidar turned by 180 degrees"
        return f"{reversed_axes} reversed{mirror}"
    if len(off_diagonal) == 2 and not reversed_axes and (axes >= 0).all():
        one, other = off_diagonal
        return f"{'xyz'[one]} and {'xyz'[other]} swapped: the points are mirrored"
    columns = ["xyz"[int(np.argmax(np.abs(row)))] for row in axes]
    signs = ["-" if row.sum() < 0 else "" for row in axes]
    return "the points' axes permuted: x, y, z are the file's " + ", ".join(
        map("".join, zip(signs, columns, strict=True))
    )
