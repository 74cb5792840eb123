"""Vectors on the unit sphere, rigid transforms, poses between poses, and the road plane; imports nothing but `errors`.

Conventions of the whole project, written here once:

- Vehicle and world frames: ISO 8855, x forward, y left, z up, metres. The vehicle's origin is on the ground
  below the middle of the rear axle.
- Camera frame: OpenCV, x right, y down, z along the optical axis.
- Transforms are named `a_from_b` and map points of frame b into frame a; neighbours must match:
  `camera_from_lidar = camera_from_vehicle @ vehicle_from_lidar`.
- Pixels are (u, v), the centre of the first pixel is (0, 0); images are indexed [v, u].
- Quaternions are wxyz. Angles are radians, times int64 nanoseconds, geometry is float64.

Between two poses a vehicle is taken to move with constant twist: the rotation follows the slerp and the position the
arc that belongs to it, so a car on a circle stays on the circle. Without rotation this is the straight line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bench.errors import ShapeError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def dot(a: Floats, b: Floats) -> Floats:
    """Row-wise scalar product.

    Args:
        a: (..., 3) float64.
        b: (..., 3) float64, broadcast against `a`.

    Returns:
        (...) float64.
    """
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def cross(a: Floats, b: Floats) -> Floats:
    """Row-wise vector product.

    Each component of the product is contiguous in memory, and so are those of what is computed from it: on the cells of
    an image that is eight times faster than `np.cross`, whose rows are contiguous.

    Args:
        a: (..., 3) float64.
        b: (..., 3) float64, broadcast against `a`.

    Returns:
        (..., 3) float64.
    """
    product = np.moveaxis(np.empty((3, *np.broadcast_shapes(a.shape, b.shape)[:-1])), 0, -1)
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def normalise(vectors: ArrayLike) -> Floats:
    """Scale rows to unit length.

    Args:
        vectors: (..., 3).

    Returns:
        (..., 3) float64; NaN where the vector is zero.
    """
    rows = np.asarray(vectors, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(rows / np.sqrt(dot(rows, rows))[..., None])


def angle_between(a: Floats, b: Floats) -> Floats:
    """Angle between rows of any length, accurate also near 0 and pi.

    Args:
        a: (..., 3) float64.
        b: (..., 3) float64, broadcast against `a`.

    Returns:
        (...) float64, rad, in [0, pi]; 0 where a vector is zero.
    """
    c = cross(a, b)
    return np.asarray(np.arctan2(np.sqrt(dot(c, c)), dot(a, b)))


ORTHONORMAL_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """Maps points of frame b into frame a: `point_a = rotation @ point_b + translation_m`.

    Attributes:
        rotation: (3, 3) float64, proper and orthonormal to 1e-6.
        translation_m: (3,) float64, m, the origin of b seen in a.

    Raises:
        ShapeError: another shape, a value that is not finite, a reflection or a scaled rotation.
    """

    rotation: Floats
    translation_m: Floats

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, dtype=np.float64)
        translation_m = np.array(self.translation_m, dtype=np.float64)
        if rotation.shape != (3, 3) or translation_m.shape != (3,):
            raise ShapeError(
                f"RigidTransform: expected rotation (3, 3) and translation (3,), "
                f"got {rotation.shape} and {translation_m.shape}"
            )
        _refuse_unfit(rotation[None], translation_m)
        self._hold(rotation, translation_m)

    def _hold(self, rotation: Floats, translation_m: Floats) -> RigidTransform:
        rotation.flags.writeable = translation_m.flags.writeable = False
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation_m", translation_m)
        return self

    @classmethod
    def _unchecked(cls, rotation: Floats, translation_m: Floats) -> RigidTransform:
        """Build from valid transforms without a second check, on the hot path."""
        return cls.__new__(cls)._hold(rotation, translation_m)

    @classmethod
    def each(cls, rotations: Floats, translations_m: Floats) -> list[RigidTransform]:
        """Many transforms, (N, 3, 3) and (N, 3) float64, checked all at once; errors as of one."""
        _refuse_unfit(rotations, translations_m)
        pairs = zip(rotations, translations_m, strict=True)
        return [cls._unchecked(rotation.copy(), translation_m.copy()) for rotation, translation_m in pairs]

    @classmethod
    def identity(cls) -> RigidTransform:
        """The transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> RigidTransform:
        """From a (4, 4) or (3, 4) homogeneous matrix; the rotation is brought to the nearest orthonormal one.

        Calibration files print few digits, so a rotation off by up to 1e-3 is accepted and corrected.

        Raises:
            ShapeError: another shape, or a rotation part that is off by more.
        """
        rows = np.asarray(matrix, dtype=np.float64)
        if rows.shape not in {(4, 4), (3, 4)} or not np.isfinite(rows).all():
            raise ShapeError(f"rigid transform: expected a finite (4, 4) or (3, 4) matrix, got {rows.shape}")
        left, stretch, right = np.linalg.svd(rows[:3, :3])
        if np.abs(stretch - 1.0).max() > 1e-3:
            raise ShapeError(
                f"rigid transform: expected a rotation without scale, got one scaled by {stretch.round(4)}"
            )
        return cls(left @ right, rows[:3, 3])

    @classmethod
    def from_quaternion(cls, quaternion_wxyz: ArrayLike, translation_m: ArrayLike) -> RigidTransform:
        """From a quaternion (w, x, y, z) of any positive length and a translation in metres.

        Raises:
            ShapeError: a zero quaternion or one that has not four numbers.
        """
        wxyz = np.asarray(quaternion_wxyz, dtype=np.float64)
        if wxyz.shape != (4,) or not np.isfinite(wxyz).all() or not np.any(wxyz):
            raise ShapeError(f"quaternion_wxyz: expected four finite numbers, not all zero, got {wxyz.tolist()}")
        rotation = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
        return cls(rotation, np.asarray(translation_m, dtype=np.float64))

    @classmethod
    def from_yaw(cls, yaw_rad: float, translation_m: ArrayLike = (0.0, 0.0, 0.0)) -> RigidTransform:
        """Planar motion: a rotation about z (positive to the left) and a translation in metres."""
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return cls(rotation, np.asarray(translation_m, dtype=np.float64))

    @property
    def quaternion_wxyz(self) -> Floats:
        """(4,) float64, unit quaternion, see `quaternions_wxyz`."""
        return quaternions_wxyz(self.rotation)

    @property
    def matrix(self) -> Floats:
        """(4, 4) float64 homogeneous matrix."""
        rows = np.eye(4)
        rows[:3, :3], rows[:3, 3] = self.rotation, self.translation_m
        return rows

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """Chain: `a_from_c = a_from_b @ b_from_c`."""
        return self._unchecked(self.rotation @ other.rotation, self.rotation @ other.translation_m + self.translation_m)

    def inverse(self) -> RigidTransform:
        """`b_from_a` of this `a_from_b`."""
        return self._unchecked(self.rotation.T.copy(), -self.rotation.T @ self.translation_m)

    def apply(self, points: Floats) -> Floats:
        """Points of frame b in frame a; (..., 3) float64, NaN rows stay NaN; in memory as by `rotate`."""
        return self.rotate(points) + self.translation_m

    def rotate(self, vectors: Floats) -> Floats:
        """Directions of frame b in frame a; (..., 3) float64.

        Each component of the result is contiguous in memory: sums over them run three times faster.
        """
        if vectors.ndim <= 2:  # nearly every call; `moveaxis` would take longer than the product
            return (self.rotation @ vectors.T).T
        components = np.moveaxis(vectors, -1, 0)
        rotated = self.rotation @ components.reshape(3, -1)
        return np.moveaxis(rotated.reshape(components.shape), 0, -1)


def _refuse_unfit(rotations: Floats, translations_m: Floats) -> None:
    """Refuse what is not finite, and rotations, (N, 3, 3), that are not proper and orthonormal."""
    if not (np.isfinite(rotations).all() and np.isfinite(translations_m).all()):
        raise ShapeError("RigidTransform: expected finite numbers, got NaN or infinity")
    errors, determinants = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)), np.linalg.det(rotations)
    unfit = (errors.max(axis=(1, 2)) > ORTHONORMAL_TOLERANCE) | (determinants < 0)
    if unfit.any():
        first = int(np.argmax(unfit))
        raise ShapeError(
            f"RigidTransform: expected a proper orthonormal rotation, got one off by {errors[first].max():.2g} "
            f"with determinant {determinants[first]:.3f}"
        )


def quaternions_wxyz(rotations: Floats) -> Floats:
    """Unit quaternions of rotations, many in one call, which a single one costs nearly as much as.

    Args:
        rotations: (..., 3, 3) float64, proper and orthonormal.

    Returns:
        (..., 4) float64; the first of the four that is not 0 to twelve digits is positive, so that the sign of half
            a turn, whose w is 0, is no matter of the last bit.
    """
    wxyz = np.asarray(Rotation.from_matrix(rotations).as_quat(scalar_first=True))
    rounded = np.round(wxyz, 12)
    first = (rounded != 0).argmax(axis=-1)[..., None]
    return wxyz * np.sign(np.take_along_axis(rounded, first, axis=-1))


SMALL_ANGLE_RAD = 1e-8


def twist_between(
    rotations_from: Rotation,
    positions_from_m: Floats,
    rotations_to: Rotation,
    positions_to_m: Floats,
) -> tuple[Floats, Floats]:
    """The constant twist that leads from one pose to the other, one row each.

    Args:
        rotations_from: N rotations, world from body.
        positions_from_m: (N, 3) float64, m.
        rotations_to: N rotations, world from body.
        positions_to_m: (N, 3) float64, m.

    Returns:
        turn_rad: (N, 3) float64, rotation vector of the whole step, body axes.
        path_m: (N, 3) float64, path of the body in its own axes over the whole step, m.
    """
    turn_rad = (rotations_from.inv() * rotations_to).as_rotvec()
    return turn_rad, _inverse_jacobian(turn_rad, rotations_from.inv().apply(positions_to_m - positions_from_m))


def advance_twist(turn_rad: Floats, path_m: Floats, fraction: Floats) -> tuple[Rotation, Floats]:
    """Move along a constant twist.

    Args:
        turn_rad: (N, 3) float64, rotation vector of the whole step, body axes.
        path_m: (N, 3) float64, path of the body in its own axes over the whole step, m.
        fraction: (N,) float64, part of the step; outside [0, 1] it extrapolates.

    Returns:
        rotations: N rotations of the part of the step.
        advances_m: (N, 3) float64, m, in the axes at the start of the step.
    """
    part_rad, part_m = turn_rad * fraction[..., None], path_m * fraction[..., None]
    angle = np.sqrt(dot(part_rad, part_rad))
    small = angle < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)[..., None]
    second = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)[..., None]
    once = cross(part_rad, part_m)
    return Rotation.from_rotvec(part_rad), part_m + first * once + second * cross(part_rad, once)


def _inverse_jacobian(turn_rad: Floats, advance_m: Floats) -> Floats:
    """Path in body axes whose constant twist ends at `advance_m`: the inverse of SO(3)'s left Jacobian."""
    angle = np.sqrt(dot(turn_rad, turn_rad))
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)[..., None]
    once = cross(turn_rad, advance_m)
    return np.asarray(advance_m - 0.5 * once + factor * cross(turn_rad, once))


@dataclass(frozen=True, slots=True, eq=False)
class RoadPlane:
    """A plane below the camera, in the camera's own frame.

    Attributes:
        down: (3,) float64, unit vector from the camera to the road: the paper's h.
        height_m: height of the camera above the road: the paper's eta_C.

    Raises:
        ShapeError: `down` is not a finite vector of three, or the camera is not above the road.

    Source:
        Mariotti and Eising 2020, section III-D, equations 11 and 13.
    """

    down: Floats
    height_m: float

    def __post_init__(self) -> None:
        down = np.array(self.down, dtype=np.float64)
        length = float(np.linalg.norm(down)) if down.shape == (3,) else float("nan")
        if not (np.isfinite(length) and length > 0):
            raise ShapeError(f"RoadPlane: expected `down` as three finite numbers, not all zero, got {down.tolist()}")
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise ShapeError(f"RoadPlane: expected a camera above the road, got a height of {self.height_m} m")
        down /= length
        down.flags.writeable = False
        object.__setattr__(self, "down", down)
        object.__setattr__(self, "height_m", float(self.height_m))

    @classmethod
    def below(cls, vehicle_from_camera: RigidTransform, *, ground_height_m: float = 0.0) -> RoadPlane:
        """The road below a mounted camera.

        Args:
            vehicle_from_camera: the camera's mounting.
            ground_height_m: height of the road in the vehicle frame; 0 by the project's convention,
                other where a data set puts its origin elsewhere.

        Raises:
            ShapeError: the camera is not above the road; with a hint if that of the inverse mounting would be.

        Source:
            Mariotti and Eising 2020, equation 11: h = R [0, 0, -1].
        """
        camera_from_vehicle = vehicle_from_camera.inverse()
        height_m = float(vehicle_from_camera.translation_m[2]) - ground_height_m
        if not height_m > 0.0:
            problem = f"expected a camera above the road, got a height of {height_m:.2f} m"
            inverse_m = float(camera_from_vehicle.translation_m[2]) - ground_height_m
            if inverse_m > 0.0:
                hint = "give vehicle_from_camera, not camera_from_vehicle"
                problem += f"; the inverse of the mounting stands {inverse_m:.2f} m above it: {hint}"
            raise ShapeError(problem)
        return cls(camera_from_vehicle.rotate(np.array([0.0, 0.0, -1.0])), height_m)

    def distance_m(self, rays_camera: Floats) -> Floats:
        """Length along each unit ray to the road, equation 13.

        Args:
            rays_camera: (..., 3) float64, unit rays.

        Returns:
            (...) float64, m; infinite for rays at or above the horizon.
        """
        fall = dot(rays_camera, self.down)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.where(fall > 0, self.height_m / fall, np.inf)
