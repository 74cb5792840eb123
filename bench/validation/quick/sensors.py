"""Images and sweeps, read one by one: readable, whole, in order; points, their times, and the road they see."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from hashlib import blake2b

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar.sweep import LidarSweep
from bench.recordings import ImageRef, Recording, read_image, read_truth
from bench.recordings.images import read_moving_mask
from bench.records.recording import Content
from bench.validation.findings import Finding, calibration_file, new_finding, sweep_times, unusable

# ---------------------------------------------------------------- images

BLACK = 3.0  # grey levels
FEW_LEVELS, DARK_LEVEL = 32, 64  # as of 12 bits in files of 16, read as if these were full
MOVING_MPS = 0.5
COMPARED_PX, BLUR_PX = 64, 1.0  # width at which images are compared, and the standard deviation of a blur
LONGEST_STEP_S = 0.25  # between images whose order shows
# In clean drives, rendered and real, by day and night, the first is 1.10 to 2.0 and the second 1.16 to 2.0; of two
# images that were swapped the first is 0.5 to 0.9.
SWAPPED, FOREIGN = 0.85, 0.6
WRONG = {  # images of which a finding tells, and what it says of them
    "black-image": "black ones",
    "same-image": "the same pixels while driving",
    "strange-image": "unlike both neighbours, which are like each other",
    "image-order": "fits better in the place of the next image",
    "same-image: at rest": "the same pixels twice",
}


class ImageOrder:
    """Says which images do not lie between those before and after them; takes them one by one.

    The difference of two images is the mean of that of their small, blurred copies, of mean 0 and deviation 1. While a
    camera moves or watches what moves, it grows with the time between them.
    """

    def __init__(self, interval_ns: float) -> None:
        self._longest_ns = min(LONGEST_STEP_S * 1e9, 1.5 * interval_ns)
        self._last: deque[tuple[int, int, NDArray[np.float32]]] = deque(maxlen=2)
        self._next: dict[int, float] = {}  # difference to the next image, by row
        self._second: dict[int, float] = {}  # and to the one after it

    def add(self, row: int, timestamp_ns: int, pixels: NDArray[np.uint8]) -> None:
        """Compare an image, (H, W), with the two before it; rows increase."""
        height = max(round(pixels.shape[0] * COMPARED_PX / pixels.shape[1]), 1)
        reduced = cv2.resize(pixels, (COMPARED_PX, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        blurred = cv2.GaussianBlur(reduced, (0, 0), BLUR_PX)
        small = np.asarray((blurred - blurred.mean()) / max(float(blurred.std()), 1.0), np.float32)
        for before, before_ns, image in self._last:
            steps = row - before
            if steps <= 2 and timestamp_ns - before_ns < steps * self._longest_ns:
                (self._next if steps == 1 else self._second)[before] = float(np.abs(small - image).mean())
        self._last.append((row, timestamp_ns, small))

    def foreign(self) -> list[int]:
        """Rows of images that differ from both neighbours far more than these from each other."""
        return [
            row + 1
            for row, around in self._second.items()
            if around < FOREIGN * min(self._next.get(row, 0.0), self._next.get(row + 1, 0.0))
        ]

    def swapped(self) -> list[int]:
        """Rows of images that, with the next one in their place, fit their neighbours better; not of foreign ones."""
        foreign, rows = set(self.foreign()), []
        known = {row for row in self._second if row in self._next and row + 1 in self._next}
        for row in self._next:
            before, after = row - 1 in known, row in known  # whether the images around the two were compared
            stated = before * self._next.get(row - 1, 0.0) + after * self._next.get(row + 1, 0.0)
            exchanged = before * self._second.get(row - 1, 0.0) + after * self._second.get(row, 0.0)
            if exchanged < SWAPPED * stated and not {row - 1, row, row + 1, row + 2} & foreign:
                rows.append(row)
        return rows


def check_images(recording: Recording, camera: str, rows: list[int], progress: Callable[[], None]) -> Iterator[Finding]:
    """Read images of a camera, their truth and their masks.

    Args:
        recording: the drive.
        camera: name of the camera.
        rows: indices of the images to read, increasing; neighbours are compared.
        progress: called after every image.
    """
    images, mounted = recording.images[camera], recording.cameras[camera]
    rows_by_digest: dict[bytes, int] = {}
    wrong: dict[str, list[ImageRef]] = {kind: [] for kind in WRONG}
    levels = np.zeros(256, dtype=bool)
    order = ImageOrder(recording.frame_interval_ns)
    for row in rows:
        image = images[row]
        try:
            pixels = read_image(image, mounted)
        except DataError as error:
            yield unusable(error, check="image", timestamp_ns=image.timestamp_ns)
        else:
            seen = pixels if mounted.ego_body is None else pixels[~mounted.ego_body]
            levels[seen] = True
            order.add(row, image.timestamp_ns, pixels)
            digest = blake2b(pixels.tobytes(), digest_size=16).digest()
            earlier = rows_by_digest.get(digest)
            if seen.size and float(seen.mean()) < BLACK and float(seen.std()) < BLACK:
                wrong["black-image"].append(image)
            elif earlier is not None and _moves(recording, images[earlier].timestamp_ns, image.timestamp_ns):
                wrong["same-image"].append(image)
            elif earlier is not None and earlier == row - 1:
                wrong["same-image: at rest"].append(image)
            rows_by_digest[digest] = row
        for check, path, read in (
            ("truth-image", image.truth_path, read_truth),
            ("mask-image", image.moving_path, read_moving_mask),
        ):
            try:
                if path is not None:
                    read(image, mounted)
            except DataError as error:
                yield unusable(error, check=check, timestamp_ns=image.timestamp_ns)
        progress()
    wrong["strange-image"] = [images[row] for row in order.foreign()]
    wrong["image-order"] = [images[row] for row in order.swapped()]
    field, used = f"images of {camera}", np.flatnonzero(levels)
    if len(wrong["black-image"]) < len(rows) and 1 < len(used) <= FEW_LEVELS and used[-1] < DARK_LEVEL:
        got = f"{len(used)} levels up to {used[-1]}"
        yield new_finding("grey-levels", got, file=images[rows[0]].path, field=field)
    for kind, of_kind in wrong.items():
        if of_kind:
            yield new_finding(
                kind,
                f"{WRONG[kind]}, {len(of_kind)} of those read",
                file=of_kind[0].path,
                field=field,
                at_ns=[image.timestamp_ns for image in of_kind],
            )


def _moves(recording: Recording, first_ns: int, last_ns: int) -> bool:
    _, positions_m, valid = recording.trajectory.at(np.array([first_ns, last_ns], dtype=np.int64))
    return (
        bool(valid.all())
        and float(np.linalg.norm(positions_m[1] - positions_m[0])) > MOVING_MPS * (last_ns - first_ns) / 1e9
    )


# ---------------------------------------------------------------- sweeps

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


def seen_road(points_vehicle: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Fit a plane to the lowest points of cells around the vehicle, then one to its lane.

    Args:
        points_vehicle: (N, 3) float64, m, vehicle frame.

    Returns:
        height: m, of the plane of all that is low around the vehicle, below the vehicle's origin, vehicle frame; some
            centimetres off where there are pavements, or where points scatter.
        tilt: rad, of that plane to the vehicle's xy plane.
        lane_height: m, the same for the vehicle's own lane, to about a centimetre; NaN where too little of it is seen,
            or it leads over a kerb.

        None where too little of the road is seen.
    """
    away_m = np.hypot(points_vehicle[:, 0], points_vehicle[:, 1])
    near = points_vehicle[(away_m > RING_M[0]) & (away_m < RING_M[1])]
    if len(near) < LEAST_CELLS:
        return None
    heights_of_cells = pd.Series(near[:, 2]).groupby([*(near[:, :2] // CELL_M).T])
    lowest = near[heights_of_cells.idxmin()[heights_of_cells.size() >= CELL_POINTS]]
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
    return float(plane[2]), float(np.arctan(np.hypot(plane[0], plane[1]))), _lane_height_m(near, plane)


def _lane_height_m(points_vehicle: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    """Fit a plane to the middle point of each cell of the vehicle's lane: half of the scatter lies on either side.

    Args:
        points_vehicle: (N, 3) float64, m, around the vehicle.
        plane: (3,) float64, slopes along x and y and height at the origin, to begin with.
    """
    x, y, z = points_vehicle[(np.abs(points_vehicle[:, :2]) < (LANE_END_M, LANE_M)).all(axis=1)].T
    cell = np.floor(x / LANE_CELL_M).astype(np.int64) * 1000 + np.floor(y / LANE_CELL_M).astype(np.int64)
    points = pd.DataFrame({"x": x, "y": y, "z": z, "cell": cell})
    for slab_m in LANE_SLABS_M:
        on_road = np.abs(z - plane[0] * x - plane[1] * y - plane[2]) < slab_m
        middle = points[on_road].groupby("cell").median().to_numpy()
        if len(middle) < LEAST_CELLS:
            return float("nan")
        plane = np.linalg.lstsq(np.column_stack([middle[:, :2], np.ones(len(middle))]), middle[:, 2], rcond=None)[0]
    return float(plane[2]) if abs(plane[0]) < LANE_SLOPE else float("nan")


FEW = 0.1  # of the middle number of points
UNEVEN = 0.7  # of the points of the sweep before or after it; clean drives, real ones too, have 0.97
MOST_TWICE = 0.01
TURN_CELLS, TURN_SEEN, MIXED = 360, 0.8, 0.1  # of azimuth; share with points; spread of times in one, of the sweep's
LIDAR_REACH_M = 400.0
MOST_AT_ORIGIN, ORIGIN_M = 0.01, 0.05
MOST_BEYOND = 0.5
SMALL_M = 1.0  # a sweep all within this is in another unit
ROAD_OFF_M, ROAD_TILT_RAD = 0.25, float(np.radians(4.0))
LANE_OFF_M = 0.05  # the protocols' ground clearance: a road farther up counts as part of what stands on it
LEAST_ROADS = 2
LONGEST_SWEEPS = 2.5  # of the interval: revolutions overlap, but not that much
MICRO = 1e-3


Faults = dict[str, list[tuple[int, str, str]]]  # by kind of finding: time, file, and what was found


def check_sweeps(
    recording: Recording, rows: list[int], look: Callable[[LidarSweep], object], progress: Callable[[], None]
) -> Iterator[Finding | Content]:
    """Read sweeps; what their points hold comes last.

    Args:
        recording: the drive.
        rows: indices of the sweeps to read, increasing; neighbours are compared.
        look: called with each sweep whose points are where a lidar can see them.
        progress: called after every sweep.
    """
    counts, faults, roads, digests = dict[int, int](), Faults(), list[tuple[float, float, float]](), set[bytes]()
    read, unread, lost = dict.fromkeys("xyz"), dict[str, None](), 0
    for row in rows:
        reference = recording.sweeps[row]
        try:
            sweep = reference.read()
        except DataError as error:
            yield unusable(error, check="sweep", timestamp_ns=reference.timestamp_ns)
        else:
            counts[row] = len(sweep.points_lidar)
            read, unread = read | dict.fromkeys(sweep.read_fields), unread | dict.fromkeys(sweep.unread_fields)
            lost += sweep.rows_stored - counts[row]
            found = dict(_faults_of_points(sweep, counts.get(row - 1, 0), digests)) if counts[row] else {}
            if counts[row] and "sweep-range" not in found:
                found |= dict(_faults_of_times(sweep, recording))
                road = seen_road(recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64)))
                roads += [] if road is None else [road]
                look(sweep)
            for kind, got in found.items():
                faults.setdefault(kind, []).append((sweep.timestamp_ns, str(reference.path), got))
        progress()
    yield from _sweep_findings(_counted(counts, recording) | faults, counts, unread)
    yield from _road(roads, recording)
    if counts:
        yield Content(what=f"fields of points: {', '.join(read)}", read_as="points")
    if unread:
        yield Content(what=f"fields of points: {', '.join(unread)}", why="nothing is made of them")
    if lost:
        yield Content(what="returns without a position", count=lost, why="left out")


def _faults_of_points(sweep: LidarSweep, count_before: int, digests: set[bytes]) -> Iterator[tuple[str, str]]:
    """Kinds of finding, and what was found.

    Args:
        sweep: with points.
        count_before: points of the sweep before it; 0 where it was not read.
        digests: of the points of earlier sweeps; that of this one is added.
    """
    points = sweep.points_lidar
    away_m = np.linalg.norm(points, axis=1)
    digest = blake2b(np.ascontiguousarray(points).tobytes(), digest_size=16).digest()
    if digest in digests:
        yield "same-sweep", "the points of an earlier sweep, to the last digit"
    elif count_before and FEW < min(len(points) / count_before, count_before / len(points)) < UNEVEN:
        yield "uneven-sweeps", f"{len(points)} points after {count_before} in the sweep before it"
    digests.add(digest)
    at_origin = away_m < ORIGIN_M
    twice = float(pd.DataFrame(points[~at_origin]).duplicated().mean())
    if twice > MOST_TWICE:
        yield "points-twice", f"{100 * twice:.0f} % of the points a second time"
    if at_origin.mean() > MOST_AT_ORIGIN:
        yield "lost-returns", f"{100 * at_origin.mean():.0f} % of the points at the lidar itself"
    if (away_m > LIDAR_REACH_M).mean() > MOST_BEYOND or float(away_m.max()) < SMALL_M:
        yield "sweep-range", f"points at a median distance of {np.median(away_m):.3g} m"


def _faults_of_times(sweep: LidarSweep, recording: Recording) -> Iterator[tuple[str, str]]:
    offsets_ns, steps_ns = sweep.time_offset_ns, np.diff(sweep_times(recording))
    if offsets_ns is None:
        yield "point-times-missing", "none"
    if offsets_ns is None or not len(steps_ns) or len(offsets_ns) < 2:
        return
    interval_ns = float(np.median(steps_ns))
    span_ns = int(offsets_ns.max()) - int(offsets_ns.min())
    away_ns = max(int(offsets_ns.min()), -int(offsets_ns.max()), 0)
    if span_ns > LONGEST_SWEEPS * interval_ns:
        yield "point-times", f"points over {span_ns / 1e6:.1f} ms"
    elif 0 < span_ns < 2 * MICRO * interval_ns:
        yield "point-times", f"points over {span_ns} ns, as microseconds would be"
    elif away_ns > interval_ns:
        yield "point-times", f"points {away_ns / 1e6:.1f} ms away from it"
    elif span_ns and _are_mixed(sweep.points_lidar - recording.lidar_from_sensor.translation_m, offsets_ns):
        yield "mixed-times", "times that have nothing to do with the direction"


def _are_mixed(points_sensor: NDArray[np.floating], offsets_ns: NDArray[np.int64]) -> bool:
    """Whether points all around have times that differ within a degree of azimuth as they do in the whole sweep."""
    azimuth_rad = np.arctan2(points_sensor[:, 1], points_sensor[:, 0])
    cell = np.floor((azimuth_rad / (2 * np.pi) + 0.5) * TURN_CELLS).astype(np.int64)
    offsets = pd.Series(offsets_ns, dtype=np.float64).groupby(cell)
    spreads = offsets.quantile(0.75) - offsets.quantile(0.25)
    all_around = len(spreads) >= TURN_SEEN * TURN_CELLS
    return all_around and float(spreads.median()) > 2 * MIXED * float(np.ptp(offsets_ns))


def _counted(counts: dict[int, int], recording: Recording) -> Faults:
    """Sweeps without points, and with far fewer than the others."""
    middle = float(np.median([*counts.values()])) if counts else 0.0
    faults: Faults = {"empty-sweep": [], "thin-sweep": []}
    for row, count in counts.items():
        if count < max(FEW * middle, 1):
            kind, got = ("thin-sweep", str(count)) if count else ("empty-sweep", "none")
            faults[kind].append((recording.sweeps[row].timestamp_ns, str(recording.sweeps[row].path), got))
    return faults


def _sweep_findings(faults: Faults, counts: dict[int, int], unread: dict[str, None]) -> Iterator[Finding]:
    more = f"; fields that are not read: {', '.join(unread)}" if unread else ""
    for kind, sweeps in faults.items():
        if sweeps:
            _, file, got = sweeps[0]
            values = {"middle": np.median([*counts.values()]), "share": 100 * UNEVEN, "reach_m": LIDAR_REACH_M}
            finding = new_finding(kind, got, file=file, at_ns=[time_ns for time_ns, _, _ in sweeps], **values)
            yield replace(finding, hint=finding.hint + more) if kind == "point-times-missing" else finding


def _road(roads: list[tuple[float, float, float]], recording: Recording) -> Iterator[Finding]:
    if len(roads) < LEAST_ROADS:
        return
    heights_m, tilts_rad, lanes_m = np.array(roads).T
    lanes_m = lanes_m[~np.isnan(lanes_m)]
    stated_m, file, field = recording.ground_m, calibration_file(recording), "lidar.vehicle_from_lidar"
    if abs(np.median(heights_m) - stated_m) > ROAD_OFF_M:
        got = f"{np.median(heights_m):+.2f} m, median of {len(heights_m)} sweeps"
        place = f"{field} or the road's height"
        yield new_finding("road-height", got, file=file, field=place, times=len(heights_m), stated_m=stated_m)
    elif len(lanes_m) >= LEAST_ROADS and abs(np.median(lanes_m) - stated_m) > LANE_OFF_M:
        got = f"{np.median(lanes_m):+.2f} m in the vehicle's lane, median of {len(lanes_m)} sweeps"
        place = "the road's height, ground_height_m"
        yield new_finding("road-height: lane", got, file=file, field=place, times=len(lanes_m), stated_m=stated_m)
    if np.median(tilts_rad) > ROAD_TILT_RAD:
        got = f"one tilted by {np.degrees(np.median(tilts_rad)):.1f} degrees, median of {len(tilts_rad)} sweeps"
        yield new_finding("road-tilt", got, file=file, field=field, times=len(tilts_rad))
