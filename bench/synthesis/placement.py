"""Whether everybody in a recording has a place: no body inside another, and no camera inside anything."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.synthesis.bodies import make_body
from bench.synthesis.driving.host import OUTLINE_M, own_body
from bench.synthesis.driving.path import Poses
from bench.synthesis.footprints import box_outline, outlines_at, watched_times
from bench.synthesis.scenario import CameraSpec, RecordingSpec, ScenarioHead
from bench.synthesis.seeds import named_rng
from bench.synthesis.ways import find_ways

TOUCH_M2 = 0.01  # boxes that overlap by less only touch


@dataclass(frozen=True, slots=True, kw_only=True)
class Clash:
    """Somebody who stands where somebody else is.

    Attributes:
        actor: row of the actor whose line tells it, in the recording.
        told: who stands in whom, and when.
    """

    actor: int
    told: str


def first_clash(head: ScenarioHead, spec: RecordingSpec) -> Clash | None:
    """The first pair of bodies that overlap at any time of a recording, or a camera inside a body; None if none do.

    Args:
        head: of the scenario: times and cameras.
        spec: the recording.
    """
    ways = find_ways(head, spec)
    times_ns = watched_times(ways)
    host = _Mover(poses=ways.host.at(times_ns), outline_m=OUTLINE_M)
    sizes_m = [box_size(actor.kind) for actor in spec.actors]
    movers = [
        _Mover(poses=way.at(times_ns), outline_m=box_outline(size))
        for way, size in zip(ways.actors, sizes_m, strict=True)
    ]
    for number, actor in enumerate(spec.actors):
        if (at := _first_overlap(movers[number], host)) is not None:
            return Clash(actor=number, told=f"{actor.name!r} inside the host at {_seconds(times_ns[at])}")
        for camera in head.cameras:
            if (at := _first_inside(camera, host, movers[number], sizes_m[number])) is not None:
                told = f"the camera {camera.name!r} inside {actor.name!r} at {_seconds(times_ns[at])}"
                return Clash(actor=number, told=told)
    for one, other in combinations(range(len(movers)), 2):
        if (at := _first_overlap(movers[one], movers[other])) is not None:
            names = f"{spec.actors[other].name!r} inside {spec.actors[one].name!r}"
            return Clash(actor=other, told=f"{names} at {_seconds(times_ns[at])}")
    return None


def camera_fault(camera: CameraSpec) -> str | None:
    """What is wrong with the place of a camera on the host; None if nothing is."""
    if camera.position_m[2] <= 0:
        return f"a camera {abs(camera.position_m[2]):g} m under the road"
    if _winding(own_body().corners_m, np.array(camera.position_m)) > 0.5:
        return "a camera inside the host's own body"
    return None


@cache
def box_size(kind: str) -> NDArray[np.float64]:
    """(3,) float64, m: the box around a body of a kind, good to a centimetre or two, by which its looks differ."""
    return make_body(kind, named_rng(0, "box", kind)).size_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mover:
    """A body at all times that are looked at.

    Attributes:
        poses: of the body, N rows.
        outline_m: (K, 2), m, in its frame.
    """

    poses: Poses
    outline_m: NDArray[np.float64]

    def footprints(self, rows: NDArray[np.intp]) -> NDArray[np.object_]:
        """At some rows."""
        return outlines_at(self.poses.rotations[rows], self.poses.positions_m[rows], self.outline_m)

    def rows_near(self, other: _Mover) -> NDArray[np.intp]:
        """Rows at which the circles around both outlines meet; elsewhere nothing needs a closer look."""
        apart_m = (self.poses.positions_m - other.poses.positions_m)[:, :2]
        reach_m = sum(float(np.linalg.norm(outline, axis=1).max()) for outline in (self.outline_m, other.outline_m))
        return np.flatnonzero(np.hypot(*apart_m.T) <= reach_m)


def _first_overlap(one: _Mover, other: _Mover) -> int | None:
    """Row of the first time at which two footprints overlap by more than a touch."""
    rows = one.rows_near(other)
    if rows.size == 0:
        return None
    shared = shapely.intersection(one.footprints(rows), other.footprints(rows))
    inside = rows[shapely.area(shared) > TOUCH_M2]
    return int(inside[0]) if inside.size else None


def _first_inside(camera: CameraSpec, host: _Mover, other: _Mover, size_m: NDArray[np.float64]) -> int | None:
    """Row of the first time at which a camera is inside the box around an actor."""
    cameras_world = host.poses.rotations @ np.array(camera.position_m) + host.poses.positions_m
    local_m = np.einsum("nji,nj->ni", other.poses.rotations, cameras_world - other.poses.positions_m)
    middle_m = np.array([0.0, 0.0, size_m[2] / 2])
    inside = np.flatnonzero((np.abs(local_m - middle_m) < size_m / 2).all(axis=1))
    return int(inside[0]) if inside.size else None


def _winding(corners_m: NDArray[np.float64], point_m: NDArray[np.float64]) -> float:
    """How often closed surfaces wind around a point: about 0 outside all of them.

    Source:
        Van Oosterom and Strackee 1983, the solid angle of a plane triangle.
    """
    a, b, c = np.moveaxis(corners_m - point_m, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = np.einsum("ni,ni->n", a, np.cross(b, c))
    dots = (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(np.arctan2(triple, la * lb * lc + dots).sum() / (2 * np.pi))


def _seconds(time_ns: np.int64) -> str:
    return f"{time_ns / 1e9:.2f} s"
