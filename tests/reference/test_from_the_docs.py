"""docs/metrics.md suffices: core and band of `surface-v1`, written from its steps in plain loops, are the builder's.

What has a test of its own against other means is taken from the package: the beams of a sweep, the pixels of patches,
a ray's way through a shape, and pixels per radian.
"""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from bench.evaluation.protocol import load_protocol
from bench.recordings import load_card, open_dataset
from bench.reference.bands import pixels_per_radian
from bench.reference.build import ReferenceBuilder
from bench.reference.grid import Envelope, find_envelope
from bench.reference.motion import AnnotationIndex
from bench.reference.patches import MARGIN_PX, draw
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import Prism, silhouette

RULES = load_protocol("surface-v1").reference
LEFT, RIGHT, ABOVE, BELOW = range(4)
OPPOSITE = [RIGHT, LEFT, BELOW, ABOVE]
Array = NDArray[Any]


def from_beams(points: Array, beams: Envelope) -> Array:
    """Returns as seen from where their beams start."""
    return points - np.outer(beams.starts_m(points), [0, 0, 1])


def neighbours(points: Array, apart: float) -> SimpleNamespace:
    """Of each return: neighbours or -1, links, certain links, (4, N); steps, (4, N, 3); row steps; the column step."""
    x, y, z = points.T
    flat, ranges = np.hypot(x, y), np.linalg.norm(points, axis=1)
    azimuth = (np.arctan2(y, x) - np.arctan2(y.mean(), x.mean()) + np.pi) % (2 * np.pi) - np.pi
    elevation = np.arctan2(z, flat)
    column = column_step(azimuth, elevation)
    found, turns = np.full((4, len(points)), -1), np.full((2, len(points)), np.inf)
    lifts = np.full((2, len(points)), np.inf)
    bins = np.floor(azimuth / (1.5 * column))
    for k in range(len(points)):
        for row, sign in enumerate((1, -1)):
            others = np.flatnonzero((bins == bins[k]) & (sign * (elevation - elevation[k]) >= 0.35 * column))
            if len(others):
                away = np.abs(elevation[others] - elevation[k])
                found[2 + row, k], lifts[row, k] = others[np.argmin(away)], away.min()
    usual = usual_row_steps(elevation, lifts.min(axis=0), otherwise=column)
    found[2:][lifts > 2.5 * usual + apart / ranges] = -1
    bins = np.floor(azimuth / column)
    for k in range(len(points)):
        for side, sign in enumerate((1, -1)):
            for columns in (1, 2):
                others = np.flatnonzero(bins == bins[k] + sign * columns)
                higher = elevation[others] >= elevation[k]
                lower, upper = sorted(others[~higher], key=elevation.item), sorted(others[higher], key=elevation.item)
                near = [
                    (abs(elevation[j] - elevation[k]), j)
                    for j in (*lower[-1:], *upper[:1])
                    if column / 4 < sign * (azimuth[j] - azimuth[k]) <= 2.5 * column
                ]
                near = [(lift, j) for lift, j in near if lift < usual[k] / 2]
                if near:
                    found[side, k] = min(near, key=lambda one: one[0])[1]
                    turns[side, k] = sign * (azimuth[found[side, k]] - azimuth[k])
                    break
    nearest = np.where(found[2:] >= 0, lifts, np.inf).min(axis=0)
    row_step = np.where(np.isfinite(nearest), np.minimum(nearest, 1.5 * usual), usual)
    depth = np.abs(ranges[found] - ranges) / np.repeat([flat * column, ranges * row_step], 2, axis=0)
    close = np.concatenate([turns <= 1.5 * column, lifts <= 1.5 * usual])
    left = np.column_stack([-y, x, 0 * x]) * column
    above = np.cross(points / flat[:, None], np.column_stack([-y, x, 0 * x])) * row_step[:, None]
    return SimpleNamespace(
        neighbours=found,
        linked=(found >= 0) & (depth <= 2.5 * np.tan(np.radians(80))),
        certain=(found >= 0) & close & (depth <= np.sqrt(2.5**2 - 1)),
        steps=np.stack([left, -left, above, -above]),
        row_step=row_step,
        column_rad=column,
    )


def column_step(azimuth: Array, elevation: Array) -> float:
    plane, steps = np.column_stack([azimuth * np.cos(elevation), elevation]), []
    for k in range(0, len(plane), max(1, len(plane) // 64)):
        near = np.argsort(((plane - plane[k]) ** 2).sum(axis=1), kind="stable")[1:9]
        turn, lift = azimuth[near] - azimuth[k], np.abs(elevation[near] - elevation[k])
        steps += [min(turn[turn > 2 * lift])] if (turn > 2 * lift).any() else []
    return float(np.median(steps))


def usual_row_steps(elevation: Array, lifts: Array, *, otherwise: float) -> Array:
    order, usual, known = np.argsort(elevation, kind="stable"), np.empty(len(lifts)), lifts[np.isfinite(lifts)]
    for first in range(0, len(order), 100):
        group = order[first : first + 100]
        values = np.sort(lifts[group][np.isfinite(lifts[group])])
        whole = np.median(known) if len(known) else otherwise
        usual[group] = values[(len(values) - 1) // 2] if len(values) else whole
    return usual


def painted(patches_world: Array, scanned: ScannedObject) -> Array:
    """The pixels inside of quadrilaterals, (N, 4, 3)."""
    covered, (left, top) = draw(patches_world.T, scanned.exposure)
    around = np.zeros(np.add(scanned.exposure.valid.shape, 2 * MARGIN_PX), dtype=bool)
    (rows, columns), (top, left) = covered.shape, (top + MARGIN_PX, left + MARGIN_PX)
    around[top : top + rows, left : left + columns] = covered
    return around[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]


def closed(covered: Array, *, solid: bool) -> Array:
    found = cv2.morphologyEx(covered.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    if solid:
        outlines, _ = cv2.findContours(found, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(found, outlines, -1, 1, cv2.FILLED)
    return found > 0


def distance(mask: Array) -> Array:
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def core_and_possible(scanned: ScannedObject) -> tuple[Array, Array]:
    placed, valid = scanned.placed, scanned.exposure.valid
    solid = scanned.annotated.track.object_class == "vehicle"
    shape, points = scanned.parts_world, scanned.cluster.points_world
    sensor_from_lidar = placed.lidar_from_sensor.inverse()
    times_ns, sweep = placed.times_ns[scanned.cluster.rows], sensor_from_lidar.apply(placed.sweep.points_lidar)
    beams = find_envelope(sweep)
    sensed = from_beams(sweep[scanned.cluster.rows], beams)
    pose = int(np.searchsorted(placed.interpolation_ns, np.median(times_ns)))
    rotation = placed.rotations[pose] @ placed.lidar_from_sensor.rotation
    sensor = placed.rotations[pose] @ placed.lidar_from_sensor.translation_m + placed.positions_m[pose]

    # Patches.
    grid = neighbours(sensed, beams.starts_apart_m)
    step = grid.steps @ rotation.T
    reach = np.where(grid.linked[..., None], points[grid.neighbours] - points, step / 2)
    bottom, top, own = shape[..., 2].min(), shape[..., 2].max(), sensed[:, 2] / np.hypot(sensed[:, 0], sensed[:, 1])
    lowest, highest = own < beams[0][1] + grid.row_step / 2, own > beams[1][1] - grid.row_step / 2

    def corners(reach: Array, *, extended: bool = True) -> Array:
        sides = [(ABOVE, LEFT), (ABOVE, RIGHT), (BELOW, RIGHT), (BELOW, LEFT)]
        found = np.stack([points + reach[a] + reach[b] for a, b in sides], axis=1)
        if extended:
            lower, upper = found[:, 2:, 2], found[:, :2, 2]
            down = lowest[:, None] | (lower < bottom + RULES.ground_clearance_m)
            found[:, 2:, 2] = np.where(down, np.minimum(lower, bottom), lower)
            found[:, :2, 2] = np.where(highest[:, None], np.maximum(upper, top), upper)
        return found

    patches = corners(reach)
    region = closed(painted(patches, scanned), solid=solid)

    # Free ends.
    error_m, length_m = outline_error(scanned, sensor, times_ns, bottom, top), np.linalg.norm(step, axis=2)
    spread = (np.sqrt(error_m**2 + length_m**2 / 12) - error_m) / length_m
    change = np.where(grid.linked, 0, spread)[..., None] * step
    outer = corners(reach + change)
    moved = (outer != patches).any(axis=(1, 2))
    least = closed(painted(corners(reach - change), scanned), solid=solid) & valid
    most = (closed(painted(outer[moved], scanned), solid=solid) | region) & valid
    whole = grid.certain.all(axis=0) & (corners(reach, extended=False) == patches).all(axis=(1, 2))
    partly = np.where(grid.certain[..., None], reach, step / 2 * grid.certain[OPPOSITE][..., None])
    certain = painted(np.where(whole[:, None, None], patches, corners(partly, extended=False)), scanned)

    # Core and band.
    width_px = nearest_width(scanned, error_m)
    core = least & (distance(least | ~valid) - 0.5 > width_px) & (solid | certain)
    unseen = below_and_above(scanned, sensor, rotation, beams)
    lines = (patches + np.roll(patches, -1, axis=1)) / 2
    rays = sensed @ rotation.T / np.linalg.norm(sensed, axis=1)[:, None]
    leave = Prism.around(shape).ways_m(points, rays)[1]
    swept = [
        np.array([one, other, other + way, one + way])
        for k in np.flatnonzero(~grid.linked.all(axis=0))
        for way in [max(leave[k], 0.0) * rays[k]]
        for one, other in (lines[k][[3, 1]], lines[k][[0, 2]])
    ]
    shadow = closed(painted(np.array(swept).reshape(-1, 4, 3), scanned), solid=False)
    core &= ~unseen
    possible = valid & ((distance(~most) - 0.5 <= width_px) | unseen | shadow)
    if solid:
        possible |= valid & silence(scanned, sensor, rotation, beams, sweep, grid)
    return (core if core.any() else region & valid), possible


def outline_error(scanned: ScannedObject, sensor: Array, times_ns: Array, bottom: float, top: float) -> Array:
    camera_from_world, errors = scanned.exposure.camera_from_world, RULES.unknown_band
    rays, lidar = camera_from_world.apply(scanned.cluster.points_world), camera_from_world.apply(sensor)
    away_m, beams = np.linalg.norm(rays, axis=1), rays - lidar
    parallax = np.linalg.norm(np.cross(rays, beams), axis=1) / (away_m * np.linalg.norm(beams, axis=1))
    velocity = scanned.annotated.velocity_world_mps
    speed_mps, heights = np.hypot(*velocity[:2]), (scanned.cluster.points_world[:, 2] - bottom) / (top - bottom)
    peak = np.zeros(len(rays))
    for limb in errors.limbs.get(scanned.annotated.track.object_class, ()):
        share = limb.speed * (limb.joint - heights) / (limb.joint - limb.end)
        peak = np.maximum(peak, np.where(heights >= limb.end, share, 0))
    late_s = np.abs(times_ns - scanned.exposure.timestamp_ns) / 1e9
    along = camera_from_world.rotate(velocity / speed_mps) if speed_mps else np.zeros(3)
    across = np.linalg.norm(np.cross(rays / away_m[:, None], along), axis=1)
    limbs_m = peak * speed_mps * late_s / np.sqrt(2) * across
    parts = (np.radians(errors.angle_deg) * away_m, errors.position_m, errors.range_noise_m * parallax, limbs_m)
    return np.sqrt(sum(np.square(part) for part in parts))


def nearest_width(scanned: ScannedObject, error_m: Array) -> Array:
    per_radian = pixels_per_radian(scanned.exposure.camera.model)
    u, v = np.rint(scanned.pixels[scanned.inside]).astype(int).T
    away_m = np.linalg.norm(scanned.exposure.camera_from_world.apply(scanned.cluster.points_world), axis=1)
    squares, number = np.zeros(per_radian.shape), np.zeros(per_radian.shape)
    np.add.at(squares, (v, u), ((error_m / away_m)[scanned.inside] * per_radian[v, u]) ** 2)
    np.add.at(number, (v, u), 1)
    empty = (number == 0).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    values = np.zeros(label.max() + 1)
    values[label[v, u]] = np.sqrt(squares[v, u] / number[v, u])
    return values[label]


def below_and_above(scanned: ScannedObject, sensor: Array, rotation: Array, beams: Envelope) -> Array:
    bodies, found = [], np.zeros(scanned.exposure.valid.shape, dtype=bool)
    for corners in (scanned.parts_world - sensor) @ rotation:
        ends, ring = (corners[:, 2].min(), corners[:, 2].max()), shapely.MultiPoint(corners[:, :2]).convex_hull.exterior
        outline = []
        for start, end in pairwise(shapely.get_coordinates(ring)):
            pieces = int(np.ceil(np.hypot(*(end - start)) / 0.25))
            outline += [start + (end - start) * piece / pieces for piece in range(pieces)]
        for (offset, slope), last in zip(beams, ends, strict=True):
            heights = [(x, y, np.clip(offset + slope * np.hypot(x, y), *ends)) for x, y in outline]
            cut = [[x, y, z] for x, y, limit in heights if limit != last for z in (limit, last)]
            bodies += [np.array(cut)] if cut else []
    for body in bodies:
        corners_camera = scanned.exposure.camera_from_world.apply(body @ rotation.T + sensor)
        seen = silhouette([corners_camera], scanned.exposure.camera.model)
        found[seen.window] |= seen.covered
    return found


def silence(
    scanned: ScannedObject,
    sensor: Array,
    rotation: Array,
    beams: Envelope,
    sweep: Array,
    grid: SimpleNamespace,
) -> Array:
    points, shape = scanned.cluster.points_world, scanned.parts_world
    own = sweep[scanned.cluster.rows]
    moved, middle = points - (own @ rotation.T + sensor), np.arctan2(own[:, 1].mean(), own[:, 0].mean())
    (low, low_slope), (high, high_slope) = beams

    def directions(seen: Array) -> tuple[Array, Array]:
        azimuth = (np.arctan2(seen[:, 1], seen[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi
        return azimuth, np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))

    own_azimuth, own_elevation = directions(from_beams(own, beams))

    def ray(azimuth: float, elevation: float) -> tuple[Array, Array]:
        turned = azimuth + middle
        along = np.array([np.cos(elevation) * np.cos(turned), np.cos(elevation) * np.sin(turned), np.sin(elevation)])
        start = np.array([0, 0, beams.starts_m(1000 * along[None])[0]])
        return rotation @ start + sensor + moved[np.argmin(np.abs(own_azimuth - azimuth))], rotation @ along

    prism = Prism.around(shape, clearance_m=RULES.ground_clearance_m)

    def ways_of(azimuth: float, elevation: float) -> tuple[float, float]:
        (enter,), (leave,) = prism.ways_m(*(vector[None] for vector in ray(azimuth, elevation)))
        return enter, leave

    corners = (shape.reshape(-1, 3) - moved.mean(axis=0) - sensor) @ rotation - [0, 0, (low + high) / 2]
    (least_azimuth, most_azimuth), (least, most) = ((angle.min(), angle.max()) for angle in directions(corners))
    least, most = max(least, np.arctan(low_slope)), min(most, np.arctan(high_slope))
    column, row = grid.column_rad, np.median(grid.row_step)
    seen = from_beams(sweep, beams)
    azimuth, elevation = directions(seen)
    own_rows = set(scanned.cluster.rows.tolist())
    near = (azimuth > least_azimuth - 2 * column) & (azimuth < most_azimuth + 2 * column)
    away = np.linalg.norm(seen, axis=1)
    for k in np.flatnonzero(near):
        enter, leave = ways_of(azimuth[k], elevation[k])
        near[k] = k in own_rows or not (enter < leave and away[k] < enter)
    azimuth, elevation, away, order = azimuth[near], elevation[near], away[near], np.argsort(own_elevation)
    reach = 1.25 * np.interp(elevation, own_elevation[order], grid.row_step[order]) + abs(high - low) / away / 2
    faces: list[list[Array]] = []
    for left in np.arange(np.ceil((most_azimuth - least_azimuth) / column)) * column + least_azimuth:
        for lower in np.arange(np.ceil((most - least) / row)) * row + least:
            middle_of = left + column / 2, lower + row / 2
            if ((np.abs(azimuth - middle_of[0]) <= 1.25 * column) & (np.abs(elevation - middle_of[1]) <= reach)).any():
                continue
            enter, leave = ways_of(*middle_of)
            if not (enter < leave and leave > 0):
                continue
            ring = [ray(left + a * column, lower + b * row) for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]
            front, back = ([start + along * way for start, along in ring] for way in (max(enter, 0), leave))
            sides = [[front[k], front[k - 1], back[k - 1], back[k]] for k in range(4)]
            faces += [front, back, *sides]
    return closed(painted(np.array(faces).reshape(-1, 4, 3), scanned), solid=False)


@pytest.mark.parametrize("name", ["crossing", "overtaking"])
def test_core_and_band_are_those_of_the_docs(tiny_card, name: str):
    recording = next(handle for handle in open_dataset(load_card(str(tiny_card))) if handle.name == name).open()
    builder = ReferenceBuilder(recording, "front", RULES)
    image = recording.images["front"][2]
    annotated = AnnotationIndex(recording, RULES).at(image.timestamp_ns)
    scanned = [builder._scanned(one, builder._exposure(image)) for one in annotated]
    scanned = [one for one in scanned if one.has_enough_returns]
    assert scanned
    for one in scanned:
        region, shape = builder._region(one), builder.valid.shape
        core, possible = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        core[region.window], possible[region.window] = region.core, region.possible
        expected_core, expected_possible = core_and_possible(one)
        # Patches that share an edge may leave a pixel on it to either, and OpenCV's distances are of float32.
        assert np.count_nonzero(core != expected_core) <= 2 + 0.002 * core.sum()
        assert np.count_nonzero(possible != expected_possible) <= 2 + 0.002 * possible.sum()
