"""Lidar sweeps, read one by one: their points, their times, the road they see, and the boxes they meet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.recordings import Recording
from bench.records.recording import Content
from bench.validation.box_fit import BoxFit
from bench.validation.drive import calibration_file, sweep_times
from bench.validation.findings import LIDAR_REACH_M, Finding, Severity, unusable

RING_M = (2.5, 14.0)  # around the vehicle's origin
CELL_M = 1.0
LEAST_CELLS = 15
CELL_POINTS = 2
FIRST_SLAB_M, SLAB_M = 0.6, 0.12  # half a slab around the plane, at first and at last; kerbs lie beyond
ROUNDS = 6
LEAST_SHARE = 0.3  # of the cells
LANE_M, LANE_END_M, LANE_CELL_M = 1.5, 10.0, 0.5  # half its width, how far it is looked at, side of a cell
LANE_SLOPE = 0.01  # along it; one that climbs by more leads over a kerb
LANE_SLABS_M = (0.3, 0.15, 0.08, 0.06, 0.06)  # half a slab around the plane, in each round


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenRoad:
    """The road of one sweep.

    Attributes:
        height_m: of the plane of all that is low around the vehicle, below the vehicle's origin, vehicle frame; some
            centimetres off where there are pavements, or where points scatter.
        tilt_rad: of that plane to the vehicle's xy plane.
        lane_height_m: the same for the vehicle's own lane, to about a centimetre; NaN where too little of it is seen,
            or it leads over a kerb.
    """

    height_m: float
    tilt_rad: float
    lane_height_m: float


def seen_road(points_vehicle: NDArray[np.float64]) -> SeenRoad | None:
    """Fit a plane to the lowest points of cells around the vehicle, then one to its lane.

    Args:
        points_vehicle: (N, 3) float64, m, vehicle frame.

    Returns:
        None where too little of the road is seen.
    """
    away_m = np.hypot(points_vehicle[:, 0], points_vehicle[:, 1])
    near = points_vehicle[(away_m > RING_M[0]) & (away_m < RING_M[1])]
    if len(near) < LEAST_CELLS:
        return None
    cell = np.floor(near[:, :2] / CELL_M).astype(np.int64)
    _, number, count = np.unique(cell[:, 0] * 100_000 + cell[:, 1], return_inverse=True, return_counts=True)
    lowest = near[np.lexsort((near[:, 2], number))][np.concatenate([[0], np.cumsum(count)[:-1]])]
    lowest = lowest[count >= CELL_POINTS]
    if len(lowest) < LEAST_CELLS:
        return None
    heights = np.sort(lowest[:, 2])
    held = np.searchsorted(heights, heights + FIRST_SLAB_M) - np.arange(len(heights))
    plane = np.array([0.0, 0.0, float(heights[np.argmax(held)]) + FIRST_SLAB_M / 2])
    design = np.column_stack([lowest[:, :2], np.ones(len(lowest))])
    for slab_m in np.linspace(FIRST_SLAB_M, SLAB_M, ROUNDS):
        rows = np.abs(lowest[:, 2] - design @ plane) < slab_m
        if rows.sum() < max(LEAST_CELLS, LEAST_SHARE * len(lowest)):
            return None
        plane = np.linalg.lstsq(design[rows], lowest[rows, 2], rcond=None)[0]
    return SeenRoad(
        height_m=float(plane[2]),
        tilt_rad=float(np.arctan(np.hypot(plane[0], plane[1]))),
        lane_height_m=_lane_height_m(near, plane),
    )


def _lane_height_m(points_vehicle: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    """Fit a plane to the middle point of each cell of the vehicle's lane: half of the scatter lies on either side.

    Args:
        points_vehicle: (N, 3) float64, m, around the vehicle.
        plane: (3,) float64, slopes along x and y and height at the origin, to begin with.
    """
    x, y, z = points_vehicle[(np.abs(points_vehicle[:, :2]) < (LANE_END_M, LANE_M)).all(axis=1)].T
    # As columns: of keys that are arrays pandas writes out every number, to look for columns of that name.
    cells = {"row": np.floor(x / LANE_CELL_M), "column": np.floor(y / LANE_CELL_M)}
    points = pd.DataFrame({"x": x, "y": y, "z": z, **cells})
    for slab_m in LANE_SLABS_M:
        on_road = np.abs(z - plane[0] * x - plane[1] * y - plane[2]) < slab_m
        middle = points[on_road].groupby(list(cells)).median().to_numpy()
        if len(middle) < LEAST_CELLS:
            return float("nan")
        plane = np.linalg.lstsq(np.column_stack([middle[:, :2], np.ones(len(middle))]), middle[:, 2], rcond=None)[0]
    return float(plane[2]) if abs(plane[0]) < LANE_SLOPE else float("nan")


FEW = 0.1  # of the middle number of points
UNEVEN = 0.7  # of the points of the sweep before or after it; clean drives, real ones too, have 0.97
MOST_TWICE = 0.01
TURN_CELLS, TURN_SEEN, MIXED = 360, 0.8, 0.1  # of azimuth; share with points; spread of times in one, of the sweep's
MOST_AT_ORIGIN, ORIGIN_M = 0.01, 0.05
MOST_BEYOND = 0.5
SMALL_M = 1.0  # a sweep all within this is in another unit
ROAD_OFF_M, ROAD_TILT_RAD = 0.25, float(np.radians(4.0))
LANE_OFF_M = 0.05  # the protocols' ground clearance: a road farther up counts as part of what stands on it
LEAST_ROADS = 2
LONGEST_SWEEPS = 2.5  # of the interval: revolutions overlap, but not that much
MICRO = 1e-3


WARNINGS = frozenset({
    "thin-sweep", "uneven-sweeps", "points-twice", "mixed-times", "lost-returns", "point-times-missing",
})  # fmt: skip


class SweepChecks:
    """Takes sweeps one by one, and gives the findings about all of them at the end.

    Args:
        recording: the drive.
        box_fit: finds the boxes that are empty.
    """

    def __init__(self, recording: Recording, box_fit: BoxFit) -> None:
        self._recording, self._box_fit = recording, box_fit
        self._counts: list[tuple[int, int, str]] = []
        self._roads: list[SeenRoad] = []
        self._faults: dict[str, list[tuple[int, str, str]]] = {}
        self._before: tuple[int, int] | None = None  # row and points of the sweep before
        self._digests: set[bytes] = set()
        self._read: dict[str, None] = {}
        self._unread: dict[str, None] = {}
        self._lost = 0
        steps_ns = np.diff(sweep_times(recording))
        self._interval_ns = float(np.median(steps_ns)) if len(steps_ns) else None

    def check(self, rows: list[int], progress: Callable[[], None]) -> Iterator[Finding]:
        """Read the sweeps of these indices.

        Args:
            rows: increasing; neighbours are compared.
            progress: called after every sweep.
        """
        for row in rows:
            reference = self._recording.sweeps[row]
            try:
                sweep = reference.read()
            except DataError as error:
                yield unusable(error, check="sweep", timestamp_ns=reference.timestamp_ns)
            else:
                self._look_at(sweep, row, str(reference.path))
            progress()
        yield from self._findings()

    def contents(self) -> Iterator[Content]:
        """Fields of the points, read and not read, in the sweeps that were looked at."""
        if self._counts:
            yield Content(what=f"fields of points: {', '.join(('x, y, z', *self._read))}", read_as="points")
        if self._unread:
            yield Content(what=f"fields of points: {', '.join(self._unread)}", why="nothing is made of them")
        if self._lost:
            yield Content(what="returns without a position", count=self._lost, why="left out")

    def _look_at(self, sweep: LidarSweep, row: int, file: str) -> None:
        points = sweep.points_lidar
        self._read |= dict.fromkeys(sweep.read_fields)
        self._unread |= dict.fromkeys(sweep.unread_fields)
        self._lost += sweep.rows_stored - len(points)
        self._counts.append((sweep.timestamp_ns, len(points), file))
        if not len(points):
            return
        away_m = np.linalg.norm(points, axis=1)
        digest = blake2b(np.ascontiguousarray(points).tobytes(), digest_size=16).digest()
        if digest in self._digests:
            self._note("same-sweep", sweep, file, "the points of an earlier sweep, to the last digit")
        elif self._before is not None and self._before[0] == row - 1:
            count = self._before[1]
            if FEW < min(len(points) / count, count / len(points)) < UNEVEN:
                self._note("uneven-sweeps", sweep, file, f"{len(points)} points after {count} in the sweep before it")
        self._digests.add(digest)
        self._before = row, len(points)
        twice = float(pd.DataFrame(points[away_m > ORIGIN_M]).duplicated().mean())
        if twice > MOST_TWICE:
            self._note("points-twice", sweep, file, f"{100 * twice:.0f} % of the points a second time")
        if (away_m < ORIGIN_M).mean() > MOST_AT_ORIGIN:
            got = f"{100 * (away_m < ORIGIN_M).mean():.0f} % of the points at the lidar itself"
            self._note("lost-returns", sweep, file, got)
        if (away_m > LIDAR_REACH_M).mean() > MOST_BEYOND or float(away_m.max()) < SMALL_M:
            self._note("sweep-range", sweep, file, f"points at a median distance of {np.median(away_m):.3g} m")
            return
        self._look_at_times(sweep, file)
        points_vehicle = self._recording.vehicle_from_lidar.apply(points.astype(np.float64))
        road = seen_road(points_vehicle)
        if road is not None:
            self._roads.append(road)
        self._box_fit.add(sweep)

    def _look_at_times(self, sweep: LidarSweep, file: str) -> None:
        offsets_ns = sweep.time_offset_ns
        if offsets_ns is None:
            self._note("point-times-missing", sweep, file, "none")
        if offsets_ns is None or self._interval_ns is None or len(offsets_ns) < 2:
            return
        span_ns = int(offsets_ns.max()) - int(offsets_ns.min())
        away_ns = max(int(offsets_ns.min()), -int(offsets_ns.max()), 0)
        if span_ns > LONGEST_SWEEPS * self._interval_ns:
            self._note("point-times", sweep, file, f"points over {span_ns / 1e6:.1f} ms")
        elif 0 < span_ns < 2 * MICRO * self._interval_ns:
            self._note("point-times", sweep, file, f"points over {span_ns} ns, as microseconds would be")
        elif away_ns > self._interval_ns:
            self._note("point-times", sweep, file, f"points {away_ns / 1e6:.1f} ms away from it")
        elif span_ns and self._times_are_mixed(sweep.points_lidar, offsets_ns):
            self._note("mixed-times", sweep, file, "times that have nothing to do with the direction")

    def _times_are_mixed(self, points_lidar: NDArray[np.floating], offsets_ns: NDArray[np.int64]) -> bool:
        """Whether points all around have times that differ within a degree of azimuth as they do in the whole sweep."""
        points = points_lidar - self._recording.lidar_from_sensor.translation_m
        azimuth_rad = np.arctan2(points[:, 1], points[:, 0])
        cell = np.floor((azimuth_rad / (2 * np.pi) + 0.5) * TURN_CELLS).astype(np.int64)
        offsets = pd.Series(offsets_ns, dtype=np.float64).groupby(cell)
        spreads = offsets.quantile(0.75) - offsets.quantile(0.25)
        if len(spreads) < TURN_SEEN * TURN_CELLS:
            return False
        return float(spreads.median()) > 2 * MIXED * float(np.ptp(offsets_ns))

    def _note(self, check: str, sweep: LidarSweep, file: str, got: str) -> None:
        self._faults.setdefault(check, []).append((sweep.timestamp_ns, file, got))

    def _findings(self) -> Iterator[Finding]:
        middle = float(np.median([count for _, count, _ in self._counts])) if self._counts else 0.0
        empty = [(time_ns, file, "none") for time_ns, count, file in self._counts if count == 0]
        few = [(time_ns, file, str(count)) for time_ns, count, file in self._counts if 0 < count < FEW * middle]
        expected = {
            "empty-sweep": ("points", ""),
            "thin-sweep": (f"about {middle:.0f} points, as the others", ""),
            "same-sweep": ("new points in each sweep", ""),
            "uneven-sweeps": (
                f"at least {100 * UNEVEN:.0f} % of the points of its neighbour",
                "packets lost or doubled?",
            ),
            "points-twice": ("each return once", "merged twice, or copied in the place of lost ones? leave them out"),
            "mixed-times": (
                "times that follow the direction, as those of a lidar that turns",
                "shuffled? right where the lidar draws rosettes, or the clouds of several lidars are merged",
            ),
            "lost-returns": ("points with a return", "leave out lost returns"),
            "sweep-range": (f"points within {LIDAR_REACH_M:.0f} m", "check the unit: expected metres"),
            "point-times-missing": ("a time for each point", self._without_times()),
            "point-times": ("points of one revolution around the sweep's time", "check the unit: expected nanoseconds"),
        }
        for check, faults in {"empty-sweep": empty, "thin-sweep": few, **self._faults}.items():
            if not faults:
                continue
            time_ns, file, got = faults[0]
            yield Finding(
                check=check,
                severity=Severity.WARNING if check in WARNINGS else Severity.ERROR,
                file=file,
                expected=expected[check][0],
                got=got,
                hint=expected[check][1],
                times=len(faults),
                timestamp_ns=time_ns,
            )
        yield from self._road()

    def _without_times(self) -> str:
        fields = f"; fields that are not read: {', '.join(self._unread)}" if self._unread else ""
        return f"right if they are motion-compensated; else moving objects are known less exactly{fields}"

    def _road(self) -> Iterator[Finding]:
        if len(self._roads) < LEAST_ROADS:
            return
        height_m = float(np.median([road.height_m for road in self._roads]))
        tilt_rad = float(np.median([road.tilt_rad for road in self._roads]))
        stated_m, file = self._recording.ground_m, calibration_file(self._recording)
        expected = f"the road at {stated_m:+.2f} m in the vehicle frame, as the calibration says"
        lanes_m = np.array([road.lane_height_m for road in self._roads])
        lanes_m = lanes_m[~np.isnan(lanes_m)]
        if abs(height_m - stated_m) > ROAD_OFF_M:
            yield Finding(
                check="road-height",
                file=file,
                field="lidar.vehicle_from_lidar or the road's height",
                expected=expected,
                got=f"{height_m:+.2f} m, median of {len(self._roads)} sweeps",
                hint="check the height of the lidar, and that its mounting is applied once",
                times=len(self._roads),
            )
        elif len(lanes_m) >= LEAST_ROADS and abs(np.median(lanes_m) - stated_m) > LANE_OFF_M:
            yield Finding(
                check="road-height",
                severity=Severity.WARNING,
                file=file,
                field="the road's height, ground_height_m",
                expected=expected,
                got=f"{np.median(lanes_m):+.2f} m in the vehicle's lane, median of {len(lanes_m)} sweeps",
                hint="set ground_height_m to that; points within the ground clearance of it are taken for the road",
                times=len(lanes_m),
            )
        if tilt_rad > ROAD_TILT_RAD:
            yield Finding(
                check="road-tilt",
                severity=Severity.WARNING,
                file=file,
                field="lidar.vehicle_from_lidar",
                expected="a road level in the vehicle frame",
                got=f"one tilted by {np.degrees(tilt_rad):.1f} degrees, median of {len(self._roads)} sweeps",
                hint="check roll and pitch of the lidar, and the order of its quaternion",
                times=len(self._roads),
            )
