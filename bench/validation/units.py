"""Units of times and lengths, and the limits of ego-motion that no road vehicle exceeds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError
from bench.geometry import RigidTransform, twist_between
from bench.recordings import Recording
from bench.times import FACTORS, SECOND_NS, other_unit
from bench.validation.drive import (
    annotated_times,
    annotation_file,
    boxes_of,
    calibration_file,
    sweep_times,
    times_of,
)
from bench.validation.findings import (
    BODIES,
    CAMERA_HEIGHT_M,
    EGO_SIDEWAYS_MPS2,
    EGO_TOP_SPEED_MPS,
    EGO_TOP_TURN_RADPS,
    LIDAR_HEIGHT_M,
    SENSOR_OUTSIDE_M,
    Finding,
    Span,
    occurrences,
)

SPEED_WINDOW_NS = 200_000_000  # single steps of measured poses jitter
JUMP_MPS2 = 40.0  # a crash; also what a pose that jumps by half a metre between two 10 Hz poses gives


def check_ego_limits(recording: Recording) -> Iterator[Finding]:
    """Speed, turn, cornering and jumps of the path, from poses a fifth of a second apart."""
    path = recording.trajectory
    times_ns = path.timestamps_ns
    after = np.minimum(np.searchsorted(times_ns, times_ns + SPEED_WINDOW_NS), len(times_ns) - 1)
    before = np.flatnonzero(times_ns[after] > times_ns)
    after = after[before]
    turns, paths_m = twist_between(
        path.rotations[before], path.positions_m[before], path.rotations[after], path.positions_m[after]
    )
    seconds = (times_ns[after] - times_ns[before]) / SECOND_NS
    near = seconds <= 1.0
    if not near.any():
        return
    before, seconds = before[near], seconds[near]
    speed = np.linalg.norm(paths_m[near], axis=1) / seconds
    turn = np.linalg.norm(turns[near], axis=1) / seconds
    tests = (
        ("ego-speed", "speed", speed, EGO_TOP_SPEED_MPS, "m/s", "km/h instead of m/s?"),
        ("ego-turn", "yaw rate", turn, EGO_TOP_TURN_RADPS, "rad/s", "degrees per second instead of rad/s?"),
        ("ego-cornering", "speed times yaw rate", speed * turn, EGO_SIDEWAYS_MPS2, "m/s2",
         "km/h instead of m/s, or degrees instead of radians?"),
    )  # fmt: skip
    for check, what, values, limit, unit, hint in tests:
        beyond = values > limit
        if beyond.any():
            yield Finding(
                check=check,
                field=what,
                expected=f"at most {limit:.3g} {unit}",
                got=f"up to {values.max():.3g} {unit}",
                hint=hint,
                **occurrences(beyond, times_ns[before]),
            )
            return  # consequences of a wrong unit are not reported again
    yield from _jumps(recording)


def _jumps(recording: Recording) -> Iterator[Finding]:
    """Poses that leave the line of their neighbours."""
    path = recording.trajectory
    if len(path.timestamps_ns) < 4:
        return
    seconds = np.diff(path.timestamps_ns) / SECOND_NS
    velocity = np.diff(path.positions_m, axis=0) / seconds[:, None]
    change_mps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    span_s = (seconds[1:] + seconds[:-1]) / 2
    away_m = change_mps * np.minimum(seconds[1:], seconds[:-1])
    jumps = (change_mps / span_s > JUMP_MPS2) & (away_m > 0.3)
    if jumps.any():
        yield Finding(
            check="ego-jump",
            field="position",
            expected="a path without jumps",
            got=f"{int(jumps.sum())} places where it leaves its line, by up to {away_m[jumps].max():.2f} m",
            **occurrences(jumps, path.timestamps_ns[1:-1]),
        )


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
        if (meant := other_unit(times_ns)) is not None:
            unit, factor = meant
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
