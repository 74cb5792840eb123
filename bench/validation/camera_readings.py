"""Readings of a camera's calibration as people confuse it: axes, inverse, order of the quaternion, lens, images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.cameras import CameraModel, KannalaBrandtCamera, PinholeCamera
from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.recordings import MountedCamera
from bench.validation.mounting import signed_axes
from bench.validation.static_flow import SeenFlow

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # vehicle axes from camera axes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """A calibration that may have been meant.

    Attributes:
        field: of the camera in the calibration, or "images".
        description: what was confused, as in "with ..."
        camera: so.
        mirrored: the images are.
    """

    field: str
    description: str
    camera: MountedCamera
    mirrored: bool = False

    def flows(self, flows: Sequence[SeenFlow]) -> list[SeenFlow]:
        """Flow as this reading sees it."""
        if not self.mirrored:
            return list(flows)
        mirror = np.array([-1, 1])
        return [
            replace(
                one,
                flow=one.flow[:, ::-1] * mirror.astype(np.float32),
                edges=replace(one.edges, offsets=one.edges.offsets[[0, 3, 2, 1], :, ::-1] * mirror.astype(np.int16)),
            )
            for one in flows
        ]


def readings(camera: MountedCamera, others: Sequence[MountedCamera]) -> Iterator[Reading]:
    """All that are tried.

    Args:
        camera: as stated.
        others: cameras whose images may be taken for those of this one, all at one size.
    """
    model, mounting = camera.model, camera.vehicle_from_camera
    rotation, place_m = mounting.rotation, mounting.translation_m

    def lens_of(description: str, model: CameraModel) -> Reading:
        return Reading(field="model", description=description, camera=replace(camera, model=model))

    def mounted(field: str, description: str, vehicle_from_camera: RigidTransform) -> Reading:
        there = replace(camera, vehicle_from_camera=vehicle_from_camera)
        return Reading(field=field, description=description, camera=there)

    def turned(description: str, matrix: np.ndarray) -> Reading:
        return mounted("vehicle_from_camera.quaternion_wxyz", description, RigidTransform(matrix, place_m))

    for factor in (0.5, 2.0):
        yield lens_of(f"the focal length times {factor:g}", zoomed(model, factor))
    for name, other_lens in _other_lenses(model):
        yield lens_of(name, other_lens)
    yield mounted("vehicle_from_camera", "the inverse of the mounting", mounting.inverse())
    w, x, y, z = mounting.quaternion_wxyz
    for order, numbers in (("x, y, z, w", (z, w, x, y)), ("w, x, y, z, given as x, y, z, w,", (x, y, z, w))):
        yield turned(f"the quaternion read as {order}", RigidTransform.from_quaternion(numbers, place_m).rotation)
    yield turned("the inverse of the rotation", rotation.T)
    yield turned("the camera frame read as x forward, y left, z up", rotation @ OPTICAL)
    yield turned("the camera frame read as x right, y down, z forward twice", rotation @ OPTICAL.T)
    yield turned("the images upside down", rotation @ HALF_TURN)
    yield Reading(field="images", description="the images mirrored", camera=camera, mirrored=True)
    for other in others:
        yield Reading(field="images", description=f"the images of {other.name}", camera=other)
    for matrix in signed_axes():
        if np.linalg.det(matrix) < 0 or np.array_equal(matrix, np.eye(3)):
            continue
        axes = ", ".join("{}{}".format("-" if row.sum() < 0 else "", "xyz"[int(np.abs(row).argmax())])
                         for row in matrix)  # fmt: skip
        yield turned(f"the camera's axes as {axes}", rotation @ matrix)


def zoomed(model: CameraModel, factor: float) -> CameraModel:
    """The lens with another focal length, in an image of the same size."""
    size = round(model.width * factor), round(model.height * factor)
    return replace(model.scaled(*size), width=model.width, height=model.height, principal_point=model.principal_point)


def _other_lenses(model: CameraModel) -> Iterator[tuple[str, CameraModel]]:
    """A pinhole for what is no pinhole and a fisheye for what is none, of the same focal length at the middle."""
    ray = np.array([[1e-4, 0.0, 1.0]])
    try:
        focal = float(np.abs(model.project(ray)[0][0, 0] - model.principal_point[0]) / 1e-4)
        if not isinstance(model, PinholeCamera):
            yield (
                "a pinhole lens",
                PinholeCamera(
                    width=model.width, height=model.height, principal_point=model.principal_point, focal=(focal, focal)
                ),
            )
        if not isinstance(model, KannalaBrandtCamera):
            yield "a fisheye lens", KannalaBrandtCamera(
                width=model.width, height=model.height, principal_point=model.principal_point,
                focal=(focal, focal), coefficients=(),
            )  # fmt: skip
    except ShapeError:
        return
