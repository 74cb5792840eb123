"""Projecting and unprojecting, beside `cv2.fisheye` and a loop over points in plain Python."""

import math
from collections.abc import Callable

import cv2
import numpy as np

from bench.cameras import CameraModel, KannalaBrandtCamera
from benchmarks.turns import best_seconds
from tests.support.lenses import LENSES

POINTS, LOOPED = 120_000, 2_000


def points_in_view(camera: CameraModel) -> np.ndarray:
    """(POINTS, 3) float64, camera frame, before the camera, as far as the lens sees."""
    rng = np.random.default_rng(0)
    pixels = np.column_stack([rng.uniform(0, camera.width - 1, POINTS), rng.uniform(0, camera.height - 1, POINTS)])
    rays, valid = camera.unproject(pixels)
    return np.where(valid[:, None], rays, (0.0, 0.0, 1.0)) * rng.uniform(2.0, 20.0, (POINTS, 1))


def project_in_a_loop(camera: KannalaBrandtCamera, points: np.ndarray) -> list[tuple[float, float]]:
    """The model's formula, a point at a time."""
    found = []
    for x, y, z in points.tolist():
        across = math.hypot(x, y)
        angle = math.atan2(across, z)
        square = angle * angle
        radius = angle * (1 + sum(term * square ** (k + 1) for k, term in enumerate(camera.coefficients)))
        scale = radius / across if across else 0.0
        found.append(
            (
                camera.focal[0] * scale * x + camera.principal_point[0],
                camera.focal[1] * scale * y + camera.principal_point[1],
            )
        )
    return found


def works_of(camera: CameraModel, points: np.ndarray, pixels: np.ndarray) -> dict[str, Callable[[], object]]:
    """Calls to time for a lens."""
    works: dict[str, Callable[[], object]] = {
        "project": lambda: camera.project(points),
        "unproject": lambda: camera.unproject(pixels),
    }
    if isinstance(camera, KannalaBrandtCamera):
        matrix = np.diag([*camera.focal, 1.0])
        matrix[:2, 2] = camera.principal_point
        terms, still = np.array(camera.coefficients), np.zeros((3, 1))
        works |= {
            "cv2 project": lambda: cv2.fisheye.projectPoints(points[:, None], still, still, matrix, terms),
            "cv2 unproject": lambda: cv2.fisheye.undistortPoints(pixels[:, None], matrix, terms),
            "loop": lambda: project_in_a_loop(camera, points[:LOOPED]),
        }
    return works


def microseconds_per_point(*, rounds: int = 7) -> dict[str, tuple[float, float]]:
    """(project, unproject) of each lens, of `cv2.fisheye` and of the loop; NaN where there is none."""
    rows: dict[str, tuple[float, float]] = {}
    for name, camera in LENSES.items():
        points = points_in_view(camera)
        seconds = best_seconds(works_of(camera, points, camera.project(points)[0]), rounds=rounds)
        rows[name] = 1e6 * seconds["project"] / POINTS, 1e6 * seconds["unproject"] / POINTS
        if "loop" in seconds:
            rows["cv2.fisheye"] = 1e6 * seconds["cv2 project"] / POINTS, 1e6 * seconds["cv2 unproject"] / POINTS
            rows["loop in Python"] = 1e6 * seconds["loop"] / LOOPED, float("nan")
    return rows
