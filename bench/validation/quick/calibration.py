"""Cameras and lidar: lengths in other units, mountings, lenses, masks of the ego vehicle's body."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import MountedCamera, Recording
from bench.times import FACTORS
from bench.validation.findings import Finding, Severity, annotation_file, boxes_of, calibration_file, new_finding
from bench.validation.quick.boxes import BODIES, Span

CAMERA_HEIGHT_M: Span = (0.1, 4.5)
LIDAR_HEIGHT_M: Span = (0.1, 5.0)
SENSOR_OUTSIDE_M = 2.5  # beyond the ego vehicle's outline
UNITS = {0.01: "centimetres", 0.001: "millimetres"}
FARTHEST_M = 100.0  # half of a sweep's points, or of the boxes, are nearer
USUAL_M = 10.0  # of both
VEHICLE_M: Span = (1.0, 26.0)  # the ego vehicle's longer side
SWEEP_NS: Span = (1e7, 1e9)  # how long a sweep lasts


def check_length_units(recording: Recording) -> Iterator[Finding]:
    """Lengths of the calibration, of points and of boxes."""
    side_m = float(np.ptp(recording.vehicle_outline_m, axis=0).max())
    factor = next((factor for factor in UNITS if _within(side_m * factor, VEHICLE_M)), None)
    if side_m > VEHICLE_M[1] and factor is not None:
        yield _in_unit(factor, f"a vehicle {side_m:.0f} m long", calibration_file(recording), "vehicle.outline_m")
    for name, camera in recording.cameras.items():
        field = f"cameras.{name}.vehicle_from_camera"
        yield from _mounting_unit(recording, camera.vehicle_from_camera, camera.ground_m, CAMERA_HEIGHT_M, field)
    if recording.sweeps:
        field = "lidar.vehicle_from_lidar"
        yield from _mounting_unit(recording, recording.vehicle_from_lidar, 0.0, LIDAR_HEIGHT_M, field)
        yield from _units_of_points(recording)
    yield from _units_of_boxes(recording)


def _in_unit(factor: float, got: str, file: object, field: str) -> Finding:
    hint = f"these would be {UNITS[factor]}: multiply them by {factor:g}"
    return new_finding("length-unit", got, file=file, field=field, hint=hint)


def _mounting_unit(
    recording: Recording, mounting: RigidTransform, ground_m: float, height_m: Span, field: str
) -> Iterator[Finding]:
    place_m = mounting.translation_m

    def fits(factor: float) -> bool:
        on_vehicle = _outside_m(factor * place_m, recording) <= SENSOR_OUTSIDE_M
        return on_vehicle and _within(factor * float(place_m[2]) - ground_m, height_m)

    if _within(float(place_m[2]) - ground_m, height_m) or _outside_m(place_m, recording) <= SENSOR_OUTSIDE_M:
        return
    for factor in filter(fits, UNITS):
        got = str(np.round(place_m, 3).tolist())
        yield _in_unit(factor, got, calibration_file(recording), f"{field}.translation_m")
        return


def _units_of_points(recording: Recording) -> Iterator[Finding]:
    """By the sweep in the middle; a wrong unit is that of all."""
    sweep = recording.sweeps[len(recording.sweeps) // 2]
    try:
        read = sweep.read()
    except DataError:
        return  # reported by the check of the sweeps
    points, offsets_ns = read.points_lidar, read.time_offset_ns
    lasts_ns = 0.0 if offsets_ns is None or not len(offsets_ns) else float(np.ptp(offsets_ns))
    factor = next((factor for factor in FACTORS if _within(lasts_ns * factor, SWEEP_NS)), None)
    if lasts_ns < SWEEP_NS[0] / 10 and factor is not None:
        got, hint = f"{FACTORS[factor]}: {lasts_ns:.0f} from the first to the last", f"multiply them by {factor}"
        yield new_finding("time-unit", got, file=sweep.file, field="times of the points", hint=hint)
    if len(points):
        yield from _far(sweep.file, "points", np.linalg.norm(points.astype(np.float64), axis=1))


def _units_of_boxes(recording: Recording) -> Iterator[Finding]:
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
            yield _in_unit(factor, got, file, "sizes of the boxes")
            return


def _far(file: object, field: str, distances_m: NDArray[np.float64]) -> Iterator[Finding]:
    middle_m = float(np.median(distances_m))
    if middle_m > FARTHEST_M:
        factor = min(UNITS, key=lambda unit: abs(np.log(unit * middle_m / USUAL_M)))
        if _within(factor * middle_m, (0.1 * USUAL_M, FARTHEST_M)):
            yield _in_unit(factor, f"{middle_m:.0f} m away, the half of them", file, field)


def _is_body(size_m: NDArray[np.float64], name: str) -> bool:
    return all(_within(value, span) for _, value, span in BODIES[name].sides(size_m))


def _within(value: float, span: Span) -> bool:
    return span[0] <= value <= span[1]


def _outside_m(place_m: NDArray[np.float64], recording: Recording) -> float:
    return float(shapely.Point(place_m[:2]).distance(shapely.Polygon(recording.vehicle_outline_m)))


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
        yield from _mounting(camera, recording, f"{field}.vehicle_from_camera")
        yield from _lens(camera, f"{field}.model")
        if camera.ego_body is not None and camera.ego_body.mean() > MOST_BODY:
            got = f"one that covers {100 * camera.ego_body.mean():.0f} % of the image"
            yield new_finding("ego-body", got, field=f"{field}.ego_body_mask")
    if recording.sweeps:
        yield from _lidar(recording, "lidar.vehicle_from_lidar")


def _mounting(camera: MountedCamera, recording: Recording, field: str) -> Iterator[Finding]:
    height_m = camera.road.height_m
    if not _within(height_m, CAMERA_HEIGHT_M):
        yield new_finding(
            "camera-mounting: height", f"{height_m:.2f} m", field=f"{field}.translation_m", span=CAMERA_HEIGHT_M
        )
    yield from _outside(camera.vehicle_from_camera, recording, field)
    axis, down = camera.vehicle_from_camera.rotation[:, 2], camera.vehicle_from_camera.rotation[:, 1]
    pitch_up_deg = float(np.degrees(np.arcsin(np.clip(axis @ UP, -1.0, 1.0))))
    if not -STEEPEST_DEG <= pitch_up_deg <= STEEPEST_DEG / 2:
        got = f"one {abs(pitch_up_deg):.0f} degrees {'above' if pitch_up_deg > 0 else 'below'} the horizon"
        yield new_finding("camera-mounting: axis", got, field=f"{field}.quaternion_wxyz")
        return
    level = np.cross(axis, UP)
    tilt_deg = abs(float(np.degrees(np.arctan2(down @ level / np.linalg.norm(level), -down @ UP))))
    if tilt_deg > ROLLED_DEG:
        got = f"one turned by {tilt_deg:.0f} degrees about the optical axis"
        yield new_finding("camera-mounting: rolled", got, field=f"{field}.quaternion_wxyz")


def _outside(mounting: RigidTransform, recording: Recording, field: str) -> Iterator[Finding]:
    away_m = _outside_m(mounting.translation_m, recording)
    if away_m > SENSOR_OUTSIDE_M:
        yield new_finding(
            "sensor-outside", f"one {away_m:.1f} m outside of its outline", field=f"{field}.translation_m"
        )


def _lens(camera: MountedCamera, field: str) -> Iterator[Finding]:
    model = camera.model
    u, v = model.principal_point
    inside = -0.5 <= u < model.width - 0.5 and -0.5 <= v < model.height - 0.5
    off = max(abs(u - (model.width - 1) / 2) / model.width, abs(v - (model.height - 1) / 2) / model.height)
    if not inside or off > FAR_FROM_CENTRE:
        yield new_finding(
            "principal-point",
            f"({u:.1f}, {v:.1f})",
            field=f"{field}.principal_point",
            severity=Severity.WARNING if inside else Severity.ERROR,
            where="near the middle of" if inside else "in",
            size=f"{model.width} x {model.height}",
        )
    grid_u, grid_v = np.meshgrid(np.linspace(0, model.width - 1, GRID), np.linspace(0, model.height - 1, GRID))
    pixels = np.column_stack([grid_u.ravel(), grid_v.ravel()])
    rays, seen = model.unproject(pixels)
    again, back = model.project(rays)
    error_px = np.abs(again[seen & back] - pixels[seen & back]).max(initial=0.0)
    view_deg = 2.0 * float(np.degrees(np.arccos(rays[seen, 2] / np.linalg.norm(rays[seen], axis=1))).max(initial=0.0))
    returns = error_px <= 0.1 and not (seen & ~back).any()
    if seen.mean() < LEAST_SEEN or view_deg < LEAST_VIEW_DEG or not returns:
        nearby, _ = model.project(np.array([[0.0, 0.0, 1.0], [np.sin(np.radians(1)), 0.0, np.cos(np.radians(1))]]))
        got = f"{100 * seen.mean():.0f} % of them have one, all within {view_deg:.2g} degrees; "
        got += f"a degree beside the axis lies {float(np.linalg.norm(nearby[1] - nearby[0])):.2g} px from it"
        got += "" if returns else f", up to {error_px:.2f} px off on the way back"
        yield new_finding("lens", got, field=field, view_deg=LEAST_VIEW_DEG)


def _lidar(recording: Recording, field: str) -> Iterator[Finding]:
    mounting = recording.vehicle_from_lidar
    height_m = float(mounting.translation_m[2]) - recording.ground_m
    merged = np.array_equal(mounting.matrix, np.eye(4))  # points come in the vehicle frame
    if not merged and not _within(height_m, LIDAR_HEIGHT_M):
        yield new_finding("lidar-mounting", f"{height_m:.2f} m", field=f"{field}.translation_m", span=LIDAR_HEIGHT_M)
    yield from _outside(mounting, recording, field)
