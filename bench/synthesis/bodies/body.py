"""A body and its postures.

Object frame: x forward, y left, z up, origin on the ground below the middle of the box around the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies.joints import STEPS, Joint, Linkage
from bench.synthesis.mesh import Mesh, joined

FULL_PACE_MPS = 0.5  # below this speed steps grow smaller, down to standing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A body in its object frame.

    Attributes:
        object_class: as annotations name it.
        mesh: all parts in the build posture, as it is for a vehicle; its texture serves every posture.
        linkage: the joints.
        parts: (first triangle, last triangle + 1, row of the joint) of the parts that turn.
        cycle_m: way after which walking repeats.
        start_m: where in its cycle the body is at way 0, so that two of them do not walk in step.
        size_m: (3,) float64, the box that holds every posture: length, width, height.
    """

    object_class: str
    mesh: Mesh
    linkage: Linkage
    parts: tuple[tuple[int, int, int], ...]
    cycle_m: float
    start_m: float
    size_m: NDArray[np.float64]

    def corners_at(self, way_m: float, *, speed_mps: float = FULL_PACE_MPS) -> NDArray[np.float64]:
        """The posture after a way.

        Args:
            way_m: travelled so far, negative in reverse.
            speed_mps: who does not go stands on both feet; steps are full from `FULL_PACE_MPS` on.

        Returns:
            (T, 3, 3) float64, m, object frame.
        """
        going = min(abs(speed_mps) / FULL_PACE_MPS, 1.0)
        posed = _posture(self.mesh.corners_m, self.linkage, self.parts, self.start_m + way_m, going)
        if 0.0 < going < 1.0:  # half a step: straighter legs than either foot was placed for
            posed[..., 2] -= min(float(posed[..., 2].min()), 0.0)
        return posed


Part = tuple[Mesh, str | None]  # a solid in the build posture, and the joint that it hangs on


def assembled(
    object_class: str, parts: Sequence[Part], joints: Sequence[Joint], *, cycle_m: float, start_m: float
) -> Body:
    """Put parts together and centre them.

    Args:
        object_class: as annotations name it.
        parts: in any frame whose x is forward and whose z is up from the ground.
        joints: in the same frame, parents before their children.
        cycle_m: way after which every posture repeats.
        start_m: where in its cycle the body starts.
    """
    rows = {joint.name: row for row, joint in enumerate(joints)}
    sorted_parts = sorted(parts, key=lambda part: -1 if part[1] is None else rows[part[1]])
    hangs_on = np.concatenate([np.full(len(m.corners_m), -1 if n is None else rows[n]) for m, n in sorted_parts])
    turned = tuple(
        (int(np.searchsorted(hangs_on, row)), int(np.searchsorted(hangs_on, row, side="right")), row)
        for row in range(len(joints))
        if (hangs_on == row).any()
    )
    mesh, linkage = joined([mesh for mesh, _ in sorted_parts]), Linkage(joints)
    low, high = _extent(mesh.corners_m, linkage, turned, cycle_m=cycle_m, start_m=start_m)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0])
    return Body(
        object_class=object_class,
        mesh=replace(mesh, corners_m=mesh.corners_m - origin),
        linkage=linkage.moved(-origin),
        parts=turned,
        cycle_m=cycle_m,
        start_m=start_m,
        size_m=np.array([high[0] - low[0], high[1] - low[1], high[2]]),
    )


def _extent(
    corners_m: NDArray[np.float64],
    linkage: Linkage,
    parts: tuple[tuple[int, int, int], ...],
    *,
    cycle_m: float,
    start_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest x, y, z over all postures of a cycle and the standing one."""
    first = parts[0][0] if parts else len(corners_m)  # what hangs on no joint comes before what does
    still_m = corners_m[:first].reshape(-1, 3)
    lows, highs = ([still_m.min(axis=0)], [still_m.max(axis=0)]) if first else ([], [])
    if parts:
        going = linkage.transforms(np.arange(STEPS, dtype=np.float64) * (cycle_m / STEPS), 1.0)
        standing = linkage.transforms(np.array([start_m]), 0.0)
        rotations, translations_m = (np.concatenate(both) for both in zip(going, standing, strict=True))
        for start, end, row in parts:
            turns = rotations[:, row].reshape(-1, 3)  # every axis of every posture
            along_m = (turns @ _distinct(corners_m[start:end].reshape(-1, 3)).T).reshape(len(rotations), 3, -1)
            lows.append((along_m.min(axis=2) + translations_m[:, row]).min(axis=0))
            highs.append((along_m.max(axis=2) + translations_m[:, row]).max(axis=0))
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _distinct(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each point (N, 3) once; triangles that share nothing repeat a corner some six times."""
    ordered = points_m[np.lexsort(points_m.T)]
    return np.asarray(ordered[np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))])


def _posture(
    corners_m: NDArray[np.float64],
    linkage: Linkage,
    parts: tuple[tuple[int, int, int], ...],
    way_m: float,
    going: float,
) -> NDArray[np.float64]:
    posed = corners_m.copy()
    if parts:
        rotations, translations_m = linkage.transforms(way_m, going)
        for start, end, row in parts:
            flat = corners_m[start:end].reshape(-1, 3)
            posed[start:end] = (flat @ rotations[row].T + translations_m[row]).reshape(-1, 3, 3)
    return posed
