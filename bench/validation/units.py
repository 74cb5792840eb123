"""Units: times that are not nanoseconds and lengths that are not metres, in every file, with the factor.

Speeds and yaw rates of the ego vehicle are tried against the lidar, in `ego_motion`. What follows from a wrong unit is
told after it, as warnings.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import Recording
from bench.times import FACTORS, other_unit
from bench.validation.drive import annotated_times, annotation_file, boxes_of, calibration_file, sweep_times, times_of
from bench.validation.findings import BODIES, CAMERA_HEIGHT_M, LIDAR_HEIGHT_M, SENSOR_OUTSIDE_M, Finding, Span

UNITS = {0.01: "centimetres", 0.001: "millimetres"}
FARTHEST_M = 100.0  # half of a sweep's points, or of the boxes, are nearer
USUAL_M = 10.0  # of both
VEHICLE_M: Span = (1.0, 26.0)  # the ego vehicle's longer side
SWEEP_NS: Span = (1e7, 1e9)  # how long a sweep lasts


def check_time_units(recording: Recording) -> Iterator[Finding]:
    """Times of images, sweeps, ego-motion and annotations."""
    series: list[tuple[object, str, NDArray[np.int64]]] = [
        (recording.images[camera][0].path.parent, f"names of the images of {camera}", times_of(recording, camera))
        for camera in recording.cameras
        if recording.images[camera]
    ]
    if recording.sweeps:
        series.append((recording.sweeps[0].path.parent, "names of the sweeps", sweep_times(recording)))
    series.append((recording.trajectory.source, "times", recording.trajectory.timestamps_ns))
    series.append((annotation_file(recording), "timestamp", annotated_times(recording)))
    for file, field, times_ns in series:
        if (found := other_unit(times_ns)) is not None:
            unit, factor = found
            yield Finding(
                check="time-unit",
                file=str(file),
                field=field,
                expected="nanoseconds",
                got=f"{unit}: {', '.join(map(str, times_ns[:3]))} ...",
                hint=f"multiply them by {factor}",
                times=len(times_ns),
            )


def check_length_units(recording: Recording) -> Iterator[Finding]:
    """Lengths of the calibration, of points and of boxes."""
    yield from _outline(recording)
    for name, camera in recording.cameras.items():
        field = f"cameras.{name}.vehicle_from_camera"
        yield from _mounting(recording, camera.vehicle_from_camera, camera.ground_m, CAMERA_HEIGHT_M, field)
    if recording.sweeps:
        yield from _mounting(recording, recording.vehicle_from_lidar, 0.0, LIDAR_HEIGHT_M, "lidar.vehicle_from_lidar")
        yield from _points(recording)
    yield from _boxes(recording)


def _finding(file: object, field: str, factor: float, got: str) -> Finding:
    hint = f"these would be {UNITS[factor]}: multiply them by {factor:g}"
    return Finding(check="length-unit", file=str(file), field=field, expected="metres", got=got, hint=hint)


def _outline(recording: Recording) -> Iterator[Finding]:
    side_m = float(np.ptp(recording.vehicle_outline_m, axis=0).max())
    factor = next((one for one in UNITS if _within(side_m * one, VEHICLE_M)), None)
    if side_m > VEHICLE_M[1] and factor is not None:
        yield _finding(calibration_file(recording), "vehicle.outline_m", factor, f"a vehicle {side_m:.0f} m long")


def _mounting(
    recording: Recording, mounting: RigidTransform, ground_m: float, height_m: Span, field: str
) -> Iterator[Finding]:
    place_m = mounting.translation_m
    if _within(float(place_m[2]) - ground_m, height_m) or _on_vehicle(place_m, recording):
        return
    for factor in UNITS:
        if _within(factor * float(place_m[2]) - ground_m, height_m) and _on_vehicle(factor * place_m, recording):
            got = f"{np.round(place_m, 3).tolist()}"
            yield _finding(calibration_file(recording), f"{field}.translation_m", factor, got)
            return


def _on_vehicle(place_m: NDArray[np.float64], recording: Recording) -> bool:
    outline = shapely.Polygon(recording.vehicle_outline_m)
    return bool(shapely.Point(place_m[:2]).distance(outline) <= SENSOR_OUTSIDE_M)


def _points(recording: Recording) -> Iterator[Finding]:
    """By the sweep in the middle; a wrong unit is that of all."""
    sweep = recording.sweeps[len(recording.sweeps) // 2]
    try:
        read = sweep.read()
    except DataError:
        return  # reported by the check of the sweeps
    points, offsets_ns = read.points_lidar, read.time_offset_ns
    lasts_ns = 0.0 if offsets_ns is None or not len(offsets_ns) else float(np.ptp(offsets_ns))
    factor = next((one for one in FACTORS if _within(lasts_ns * one, SWEEP_NS)), None)
    if lasts_ns < SWEEP_NS[0] / 10 and factor is not None:
        yield Finding(
            check="time-unit",
            file=str(sweep.file),
            field="times of the points",
            expected="nanoseconds",
            got=f"{FACTORS[factor]}: {lasts_ns:.0f} from the first to the last",
            hint=f"multiply them by {factor}",
        )
    if len(points):
        yield from _far(sweep.file, "points", np.linalg.norm(points.astype(np.float64), axis=1))


def _boxes(recording: Recording) -> Iterator[Finding]:
    sizes_m: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    away_m = []
    for track in recording.tracks:
        for _, box in boxes_of(track):
            sizes_m[track.object_class].append(box.size_m)
            away_m.append(float(np.hypot(*box.vehicle_from_object.translation_m[:2])))
    if not away_m:
        return
    file = annotation_file(recording)
    yield from _far(file, "places of the boxes", np.array(away_m))
    medians = {name: np.median(sizes, axis=0) for name, sizes in sizes_m.items() if name in BODIES}
    for factor in UNITS:
        if medians and all(_is_body(factor * m, name) and not _is_body(m, name) for name, m in medians.items()):
            name, size_m = next(iter(medians.items()))
            got = f"a {name} of {' x '.join(f'{side:.4g}' for side in size_m)} m in the middle"
            yield _finding(file, "sizes of the boxes", factor, got)
            return


def _far(file: object, field: str, distances_m: NDArray[np.float64]) -> Iterator[Finding]:
    middle_m = float(np.median(distances_m))
    if middle_m > FARTHEST_M:
        factor = min(UNITS, key=lambda one: abs(np.log(one * middle_m / USUAL_M)))
        if _within(factor * middle_m, (0.1 * USUAL_M, FARTHEST_M)):
            yield _finding(file, field, factor, f"{middle_m:.0f} m away, the half of them")


def _is_body(size_m: NDArray[np.float64], name: str) -> bool:
    limits, (short_m, long_m) = BODIES[name], np.sort(size_m[:2]).tolist()
    spans = ((long_m, limits.long_side_m), (short_m, limits.short_side_m), (float(size_m[2]), limits.height_m))
    return all(_within(value, span) for value, span in spans)


def _within(value: float, span: Span) -> bool:
    return span[0] <= value <= span[1]
