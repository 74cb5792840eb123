"""A body and its postures: convex parts, some of them hinged.

Object frame: x forward, y left, z up, origin on the ground below the middle of the box around the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, joined

PHASES = 16  # postures of one cycle that the box around a body has to hold


@dataclass(frozen=True, slots=True, kw_only=True)
class Hinge:
    """A turn about an axis along y, driven by the way that the body has travelled.

    Attributes:
        pivot_xz_m: the axis.
        cycle_m: way of one full cycle.
        swing_rad: amplitude of a swing to and fro; None for a wheel, which turns on.
        phase_rad: where in the cycle the part is at way 0.
    """

    pivot_xz_m: tuple[float, float]
    cycle_m: float
    swing_rad: float | None = None
    phase_rad: float = 0.0

    def angle_rad(self, way_m: float) -> float:
        """Turn about the y axis, positive from z to x."""
        angle = 2 * np.pi * way_m / self.cycle_m + self.phase_rad
        return float(angle if self.swing_rad is None else self.swing_rad * np.sin(angle))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A body in its object frame.

    Attributes:
        object_class: as annotations name it.
        mesh: all parts, in the posture without any turn; its texture serves every posture.
        hinges: (first triangle, last triangle + 1, hinge) of the parts that turn.
        cycle_m: way after which walking repeats.
        size_m: (3,) float64, the box that holds every posture: length, width, height.
    """

    object_class: str
    mesh: Mesh
    hinges: tuple[tuple[int, int, Hinge], ...]
    cycle_m: float
    size_m: NDArray[np.float64]

    def corners_at(self, way_m: float) -> NDArray[np.float64]:
        """(T, 3, 3) float64, m, object frame: the posture after a way."""
        return _posture(self.mesh.corners_m, self.hinges, way_m)


Part = tuple[Mesh, Hinge | None]


def assembled(object_class: str, parts: Sequence[Part], *, cycle_m: float) -> Body:
    """Put parts together and centre them.

    Args:
        object_class: as annotations name it.
        parts: in any frame whose x is forward and whose z is up.
        cycle_m: way after which every posture repeats.
    """
    ends = np.cumsum([len(mesh.corners_m) for mesh, _ in parts]).tolist()
    starts = [0, *ends[:-1]]
    mesh = joined([mesh for mesh, _ in parts])
    hinges = tuple(
        (start, end, hinge) for start, end, (_, hinge) in zip(starts, ends, parts, strict=True) if hinge is not None
    )
    postures = [_posture(mesh.corners_m, hinges, cycle_m * k / PHASES).reshape(-1, 3) for k in range(PHASES)]
    low, high = np.min([p.min(axis=0) for p in postures], axis=0), np.max([p.max(axis=0) for p in postures], axis=0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return Body(
        object_class=object_class,
        mesh=replace(mesh, corners_m=mesh.corners_m - origin),
        hinges=tuple((start, end, _shifted(hinge, origin)) for start, end, hinge in hinges),
        cycle_m=cycle_m,
        size_m=high - low,
    )


def _shifted(hinge: Hinge, origin: NDArray[np.float64]) -> Hinge:
    x, z = hinge.pivot_xz_m
    return replace(hinge, pivot_xz_m=(x - float(origin[0]), z - float(origin[2])))


def _posture(
    corners_m: NDArray[np.float64], hinges: tuple[tuple[int, int, Hinge], ...], way_m: float
) -> NDArray[np.float64]:
    posed = corners_m.copy()
    for start, end, hinge in hinges:
        angle = hinge.angle_rad(way_m)
        cosine, sine = np.cos(angle), np.sin(angle)
        x = corners_m[start:end, :, 0] - hinge.pivot_xz_m[0]
        z = corners_m[start:end, :, 2] - hinge.pivot_xz_m[1]
        posed[start:end, :, 0] = cosine * x + sine * z + hinge.pivot_xz_m[0]
        posed[start:end, :, 2] = cosine * z - sine * x + hinge.pivot_xz_m[1]
    return posed
