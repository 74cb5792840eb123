"""Cameras and lidar: mountings, lenses, masks of the ego vehicle's body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from bench.recordings import MountedCamera, Recording
from bench.validation.findings import (
    CAMERA_HEIGHT_M,
    DEGREE,
    LIDAR_HEIGHT_M,
    SENSOR_OUTSIDE_M,
    Finding,
    Severity,
)

UP = np.array([0.0, 0.0, 1.0])
STEEPEST_DEG = 75.0  # a camera that looks down more steeply, or up by half of it, was mounted in other axes
ROLLED_DEG = 60.0
FAR_FROM_CENTRE = 0.15  # of the image's size
LEAST_SEEN = 0.2  # of the pixels of a corner-less lens, the circle of a 180 degree lens in 2:1 fills a third
MOST_BODY = 0.8
LEAST_VIEW_DEG = 5.0
GRID = 24


def check_calibration(recording: Recording) -> Iterator[Finding]:
    """Mountings that no car has, and lenses that do not fit their images."""
    for name, camera in recording.cameras.items():
        field = f"cameras.{name}"
        yield from _mounting(camera, recording, field)
        yield from _lens(camera, field)
        yield from _body_mask(camera, field)
    yield from _lidar(recording)


def _mounting(camera: MountedCamera, recording: Recording, field: str) -> Iterator[Finding]:
    height_m = camera.road.height_m
    if not CAMERA_HEIGHT_M[0] <= height_m <= CAMERA_HEIGHT_M[1]:
        yield Finding(
            check="camera-mounting",
            field=f"{field}.vehicle_from_camera.translation_m",
            expected="a camera {} to {} m above the road".format(*CAMERA_HEIGHT_M),
            got=f"{height_m:.2f} m",
            hint="check the unit and the height of the road in the vehicle frame",
        )
    yield from _outside(camera.vehicle_from_camera.translation_m, recording, f"{field}.vehicle_from_camera")
    axis, down = camera.vehicle_from_camera.rotation[:, 2], camera.vehicle_from_camera.rotation[:, 1]
    pitch_up_deg = float(np.degrees(np.arcsin(np.clip(axis @ UP, -1.0, 1.0))))
    if not -STEEPEST_DEG <= pitch_up_deg <= STEEPEST_DEG / 2:
        yield Finding(
            check="camera-mounting",
            field=f"{field}.vehicle_from_camera.quaternion_wxyz",
            expected="an optical axis (z of the camera frame) towards the road users",
            got=f"one {abs(pitch_up_deg):.0f} degrees {'above' if pitch_up_deg > 0 else 'below'} the horizon",
            hint="camera axes are x right, y down, z forward; quaternions w, x, y, z; camera into vehicle",
        )
        return
    tilt_deg = float(
        np.degrees(np.arccos(np.clip(-down @ UP / max(np.hypot(down @ UP, _side(axis, down)), 1e-9), -1, 1)))
    )
    if tilt_deg > ROLLED_DEG:
        yield Finding(
            check="camera-mounting",
            field=f"{field}.vehicle_from_camera.quaternion_wxyz",
            expected="y of the camera frame towards the road",
            got=f"one turned by {tilt_deg:.0f} degrees about the optical axis",
            hint="turn the images upright, or check the order of the quaternion",
        )


def _side(axis: np.ndarray, down: np.ndarray) -> float:
    """Part of the camera's y that lies along the horizontal, seen along its axis."""
    level = np.cross(axis, UP)
    return float(down @ level / max(np.linalg.norm(level), 1e-9))


def _outside(place_m: np.ndarray, recording: Recording, field: str) -> Iterator[Finding]:
    away_m = shapely.Point(place_m[:2]).distance(shapely.Polygon(recording.vehicle_outline_m))
    if away_m > SENSOR_OUTSIDE_M:
        yield Finding(
            check="sensor-outside",
            severity=Severity.WARNING,
            field=f"{field}.translation_m",
            expected="a sensor on the vehicle",
            got=f"one {away_m:.1f} m outside of its outline",
            hint="check the direction of the transform, its unit, and the vehicle's outline",
        )


def _lens(camera: MountedCamera, field: str) -> Iterator[Finding]:
    model = camera.model
    u, v = model.principal_point
    inside = -0.5 <= u < model.width - 0.5 and -0.5 <= v < model.height - 0.5
    off = max(abs(u - (model.width - 1) / 2) / model.width, abs(v - (model.height - 1) / 2) / model.height)
    if not inside or off > FAR_FROM_CENTRE:
        yield Finding(
            check="principal-point",
            severity=Severity.WARNING if inside else Severity.ERROR,
            field=f"{field}.model.principal_point",
            expected=f"a point {'near the middle of' if inside else 'in'} the {model.width} x {model.height} px image",
            got=f"({u:.1f}, {v:.1f})",
            hint="pixels of the stored image, not offsets from its centre",
        )
    grid_u, grid_v = np.meshgrid(np.linspace(0, model.width - 1, GRID), np.linspace(0, model.height - 1, GRID))
    pixels = np.column_stack([grid_u.ravel(), grid_v.ravel()])
    rays, seen = model.unproject(pixels)
    again, back = model.project(rays)
    error_px = np.abs(again[seen & back] - pixels[seen & back]).max(initial=0.0)
    view_deg = 2.0 * float(np.degrees(np.arccos(rays[seen, 2] / np.linalg.norm(rays[seen], axis=1))).max(initial=0.0))
    if seen.mean() < LEAST_SEEN or (seen & ~back).any() or error_px > 0.1 or view_deg < LEAST_VIEW_DEG:
        nearby, _ = model.project(np.array([[0.0, 0.0, 1.0], [np.sin(DEGREE), 0.0, np.cos(DEGREE)]]))
        degree_px = float(np.linalg.norm(nearby[1] - nearby[0]))
        got = f"{100 * seen.mean():.0f} % of them have one, all within {view_deg:.2g} degrees; "
        got += f"a degree beside the axis lies {degree_px:.2g} px from it"
        if error_px > 0.1 or (seen & ~back).any():
            got += f", up to {error_px:.2f} px off on the way back"
        yield Finding(
            check="lens",
            field=f"{field}.model",
            expected=f"a ray for most pixels, over {LEAST_VIEW_DEG:.0f} degrees or more, and the pixel for each ray",
            got=got,
            hint="check the model's name, the order of its parameters, and their unit: px, of angles in radians",
        )


def _body_mask(camera: MountedCamera, field: str) -> Iterator[Finding]:
    mask, size = camera.ego_body, (camera.model.height, camera.model.width)
    if mask is None:
        return
    if mask.shape != size:
        yield Finding(
            check="ego-body",
            field=f"{field}.ego_body_mask",
            expected=f"{size[1]} x {size[0]} px",
            got="{1} x {0}".format(*mask.shape),
        )
    elif mask.mean() > MOST_BODY:
        yield Finding(
            check="ego-body",
            field=f"{field}.ego_body_mask",
            expected="a mask of the ego vehicle's body, not 0 where it is",
            got=f"one that covers {100 * mask.mean():.0f} % of the image",
            hint="it may be inverted",
        )


def _lidar(recording: Recording) -> Iterator[Finding]:
    if not recording.sweeps:
        return
    height_m = float(recording.vehicle_from_lidar.translation_m[2]) - recording.ground_m
    merged = np.array_equal(recording.vehicle_from_lidar.matrix, np.eye(4))  # points come in the vehicle frame
    if not merged and not LIDAR_HEIGHT_M[0] <= height_m <= LIDAR_HEIGHT_M[1]:
        yield Finding(
            check="lidar-mounting",
            field="lidar.vehicle_from_lidar.translation_m",
            expected="a lidar {} to {} m above the road".format(*LIDAR_HEIGHT_M),
            got=f"{height_m:.2f} m",
            hint="check the unit and the direction of the transform",
        )
    yield from _outside(recording.vehicle_from_lidar.translation_m, recording, "lidar.vehicle_from_lidar")
