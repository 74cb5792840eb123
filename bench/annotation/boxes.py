"""The motion of a track, from registering its points over sweeps, and the box of a track that is believed to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment, ends_without_stray
from bench.records.reference import ObjectClass
from bench.reference.motion import moving_states
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
ROUNDS = 2  # of registration, the second with points moved to one time
UPRIGHT = np.array([1.0, 1.0, 0.7])
MOST_POINTS = 200  # of a sweep that are registered
STEPS, CONVERGED_M, KEPT = 8, 0.005, 0.7  # iterations; the nearest share of pairs counts
REACH_M, LEAST_PAIRS = 1.0, 6
PARABOLA_FROM = 6  # positions; through fewer goes a line
SMOOTH, CENTRED = 3.0, 0.05  # weights of constant speed and of the clusters' means beside registrations
LEAST_STEP_S = 0.03
CUT_M = 0.3  # from the end of an object, where a point at the edge of the sector says that it may go on
HIDDEN_M = 2.0  # that ends of an object differ in their shifts, where one of them is not seen twice
LONG_M = 2.0  # objects whose flat sides say little of their motion
END_POINTS = 5
LEAST_SHIFT_M = 0.05  # that tells a direction

HEADING_MOVE_M = 3.0  # a shorter path gives one heading for all sweeps
HEADING_SPAN_S, CURVED_FROM = 2.5, 10  # headings are smoothed over this time, by a parabola where there are so many
MOST_TURN_RAD = 1.0  # between two sweeps
EDGES = (0.15, 0.85)  # quantiles over the sweeps of where the points end
LEAST_WHOLE = 3  # sweeps that see an end
TOP = 0.9  # likewise of the height
TOPS_APART_M = 0.15  # sweeps that see the top see it as high as this
SAMPLED = 150  # points of a sweep that are looked for in another
FARTHEST = 12  # sweeps apart
CLEARANCE_M = 0.05  # between ground and box
VEHICLE_M = (2.4, 1.3)  # longer or wider than anybody on foot or on a bicycle
LARGEST_VAN_M = (6.2, 2.5, 2.8)  # length, width with mirrors, height
VAN_HEIGHT_M, HEAVY_HEIGHT_M = 2.4, 3.3  # of vans, 2.0 to 2.8 m; of lorries and buses, 3.0 to 4.0 m
FACE_M = 0.5  # of a side of a box, in which returns are on it
CELL_M, FACE_SEEN, FLANK_SEEN = 0.25, 0.5, 0.75  # share that returns cover, in all sweeps, of an end and of a flank
CYCLIST_M, CYCLIST_MPS = 1.15, 2.2  # longer and faster than anybody on foot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Positions and velocities of a track at the times of its observations.

    Attributes:
        times_s: (K,) float64, when the object was seen, from the first sweep's time on.
        offset_s: (K,) float64, that time after the sweep's.
        positions_m: (K, 2) float64, of a point of the object, world frame.
        velocity_mps: (K, 2) float64.
        points: for each observation (N, 3) float64, m, all moved to the time it was seen.
        cut_off: for each observation (N,) bool, points at the edge of the lidar's sector.
    """

    times_s: Floats
    offset_s: Floats
    positions_m: Floats
    velocity_mps: Floats
    points: tuple[Floats, ...]
    cut_off: tuple[NDArray[np.bool_], ...]

    @property
    def speed_mps(self) -> Floats:
        """(K,) float64."""
        return np.asarray(np.hypot(*self.velocity_mps.T))


def track_motion(fragment: Fragment, settings: ProposalSettings) -> Motion:
    """Fit positions to shifts between observations; speed changes smoothly."""
    seen = fragment.observations
    raw = [observation.points for observation in seen]
    later_s = [observation.cloud.offset_s[observation.rows] for observation in seen]
    offset_s = np.array([times.mean() for times in later_s])
    start_ns = seen[0].cloud.timestamp_ns
    times_s = np.array([(observation.cloud.timestamp_ns - start_ns) / SECOND_NS for observation in seen]) + offset_s
    times_s = np.maximum.accumulate(times_s + 1e-4 * np.arange(len(seen)))
    cut_off = tuple(observation.cloud.cut_off[observation.rows] for observation in seen)
    centres = np.array([points[:, :2].mean(axis=0) for points in raw])
    degree = min(2 if len(seen) >= 8 else 1, len(seen) - 1)
    positions_m = _windowed_polynomial(times_s, centres, degree)
    velocity_mps = slopes(times_s, positions_m, settings.fit_s)
    points: list[Floats] = []
    for _ in range(ROUNDS):
        points = [
            np.column_stack([one[:, :2] + np.outer(offset - times, velocity), one[:, 2]])
            for one, times, offset, velocity in zip(raw, later_s, offset_s, velocity_mps, strict=True)
        ]
        positions_m = _fitted(times_s, centres, points, cut_off, positions_m, settings)
        velocity_mps = slopes(times_s, positions_m, settings.fit_s)
    return Motion(
        times_s=times_s, offset_s=offset_s, positions_m=positions_m, velocity_mps=velocity_mps, points=tuple(points),
        cut_off=cut_off,
    )  # fmt: skip


def cut_ends(along_m: Floats, cut_off: NDArray[np.bool_]) -> tuple[bool, bool]:
    """Say whether an object may go on beyond its lowest and its highest point along an axis, (N,)."""
    at_edge = along_m[cut_off]
    return bool((at_edge < along_m.min() + CUT_M).any()), bool((at_edge > along_m.max() - CUT_M).any())


def _visible_shift(
    points: tuple[Floats, Floats], cut_off: tuple[NDArray[np.bool_], NDArray[np.bool_]], guess_m: Floats
) -> Floats:
    """(2,) float64, m, the guess corrected by the ends of the object that both sweeps see.

    The flat side of a long object lies as well on itself a metre further on, and while an object comes into the lidar's
    sector, the mean of its points moves at half its speed.
    """
    length_m = float(np.hypot(*guess_m))
    if length_m < LEAST_SHIFT_M:
        return guess_m
    along = [one[:, :2] @ (guess_m / length_m) for one in points]
    cut = [cut_ends(one, flags) for one, flags in zip(along, cut_off, strict=True)]
    if min(np.ptp(one) for one in along) < LONG_M and not (cut_off[0].any() or cut_off[1].any()):
        return guess_m
    ends = [(one[-END_POINTS:].mean(), one[:END_POINTS].mean()) for one in map(np.sort, along)]
    shifts = np.array([ends[1][end] - ends[0][end] for end in (0, 1) if not (cut[0][1 - end] or cut[1][1 - end])])
    if not len(shifts):
        return guess_m
    if np.ptp(shifts) > HIDDEN_M:  # one end was hidden in one of the sweeps
        shifts = shifts[[np.argmin(np.abs(shifts - length_m))]]
    return np.asarray(guess_m / length_m * shifts.mean())


def slopes(times_s: Floats, positions_m: Floats, within_s: float) -> Floats:
    """(K, 2) float64, m/s, slope of a parabola through the positions within a time; at least five if there are."""
    out = np.zeros_like(positions_m)
    for i, time_s in enumerate(times_s):
        near = np.flatnonzero(np.abs(times_s - time_s) <= within_s / 2)
        if len(near) < 3 or np.ptp(times_s[near]) < 0.1:
            near = np.argsort(np.abs(times_s - time_s), kind="stable")[:5]
        degree = 2 if len(near) >= PARABOLA_FROM else min(1, len(near) - 1)
        out[i] = np.polyfit(times_s[near] - time_s, positions_m[near], degree)[-2] if degree else 0.0
    return out


def _windowed_polynomial(times_s: Floats, values: Floats, degree: int) -> Floats:
    """First guess: a polynomial through the means of the clusters; of long tracks piece by piece."""
    out = np.empty_like(values)
    pieces = max(1, round(float(times_s[-1] - times_s[0]) / 2.5))
    for part in np.array_split(np.arange(len(times_s)), pieces):
        fits = min(degree, len(part) - 1)
        out[part] = np.stack(
            [np.polyval(np.polyfit(times_s[part] - times_s[part[0]], v[part], fits), times_s[part] - times_s[part[0]])
             for v in values.T], axis=1,
        )  # fmt: skip
    return out


def _fitted(
    times_s: Floats,
    centres: Floats,
    points: Sequence[Floats],
    cut_off: Sequence[NDArray[np.bool_]],
    guess_m: Floats,
    settings: ProposalSettings,
) -> Floats:
    """Least squares of shifts, of constant velocity and, weakly, of the means, as normal equations."""
    n = len(times_s)
    trees = [KDTree(sampled * UPRIGHT) for sampled in (one[:: -(-len(one) // MOST_POINTS)] for one in points)]
    normal, right = CENTRED**2 * np.eye(n), CENTRED**2 * centres
    for gap in settings.shifts:
        for i in range(n - gap):
            j = i + gap
            begin_m = _visible_shift((points[i], points[j]), (cut_off[i], cut_off[j]), guess_m[j] - guess_m[i])
            found = register(trees[i], trees[j], begin_m)
            if found is not None:
                shift_m, residual_m = found
                weight = (0.05 + residual_m) ** -2
                normal[[i, j], [i, j]] += weight
                normal[[i, j], [j, i]] -= weight
                right[i] -= weight * shift_m
                right[j] += weight * shift_m
    for i in range(n - 2):
        before, after = np.maximum(np.diff(times_s[i : i + 3]), LEAST_STEP_S)
        change = np.array([1 / before, -1 / before - 1 / after, 1 / after])
        normal[i : i + 3, i : i + 3] += SMOOTH**2 * np.outer(change, change)
    return np.asarray(np.linalg.solve(normal, right))


def register(start: KDTree, end: KDTree, guess_m: Floats) -> tuple[Floats, float] | None:
    """Shift that lays points on others, by trimmed nearest neighbours in both directions.

    Args:
        start: points, (N, 3), heights shrunk by `UPRIGHT`.
        end: points to lay them on, likewise.
        guess_m: (2,) float64, where to begin.

    Returns:
        (2,) float64, m, and the median distance that is left; None where too few have a neighbour.
    """
    shift, distances = np.array([*guess_m, 0.0]), np.zeros(0)
    here, there = np.asarray(start.data), np.asarray(end.data)
    for _ in range(STEPS):
        ahead_m, nearest = map(np.asarray, end.query(here + shift, distance_upper_bound=REACH_M))
        back_m, opposite = map(np.asarray, start.query(there - shift, distance_upper_bound=REACH_M))
        ahead, back = np.isfinite(ahead_m), np.isfinite(back_m)
        left = np.concatenate(
            [there[nearest[ahead]] - (here[ahead] + shift), there[back] - shift - here[opposite[back]]]
        )
        if len(left) < LEAST_PAIRS:
            return None
        distances = np.concatenate([ahead_m[ahead], back_m[back]])
        step = left[np.argsort(distances, kind="stable")[: max(1, round(KEPT * len(distances)))]].mean(axis=0)
        shift[:2] += step[:2]
        if np.hypot(step[0], step[1]) < CONVERGED_M:
            break
    return shift[:2], float(np.median(distances))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """A believed track with a box of one size.

    Attributes:
        fragment: the observations.
        motion: of the observations.
        moving: (K,) bool, False where the object rests.
        centres_m: (K, 2) float64, x and y of the world at the time of each sweep.
        bottom_m: (K,) float64, height above the road.
        yaw_rad: (K,) float64, heading in the world.
        size_m: (3,) float64, length, width, height, as far as returns tell.
        top_seen: False where the lidar's highest beam cuts the object.
    """

    fragment: Fragment
    motion: Motion
    moving: NDArray[np.bool_]
    centres_m: Floats
    bottom_m: Floats
    yaw_rad: Floats
    size_m: Floats
    top_seen: bool

    @property
    def velocity_mps(self) -> Floats:
        """(K, 2) float64, world axes; 0 at rest."""
        return np.asarray(self.motion.velocity_mps * self.moving[:, None])

    @property
    def speed_mps(self) -> float:
        """Median while it moves."""
        return float(np.median(self.motion.speed_mps[self.moving]))

    @property
    def object_class(self) -> ObjectClass:
        """A guess by size and speed."""
        return guess_class(self.size_m, self.speed_mps)

    @property
    def ends_seen(self) -> bool:
        """Returns lie all over both ends, or all along one flank; those at mirrors cover neither."""
        half_m = self.size_m[:2] / 2
        centres_m = self.centres_m + self.motion.velocity_mps * self.motion.offset_s[:, None]
        seen = zip(self.motion.points, centres_m, self.yaw_rad, strict=True)
        points = np.concatenate([(one[:, :2] - centre) @ axes(yaw_rad) for one, centre, yaw_rad in seen])
        share = np.zeros((2, 2))
        for axis, end in np.ndindex(2, 2):
            on_side = points[(2 * end - 1) * points[:, axis] > half_m[axis] - FACE_M, 1 - axis]
            reach_m = half_m[1 - axis]
            cells = np.histogram(on_side, bins=int(np.ceil(2 * reach_m / CELL_M)), range=(-reach_m, reach_m))[0]
            share[axis, end] = (cells > 0).mean()
        return bool((share[0] >= FACE_SEEN).all() or (share[1] >= FLANK_SEEN).any())

    @property
    def likely_height_m(self) -> float:
        """Height, a guess where a vehicle's top was not seen."""
        height_m = float(self.size_m[2])
        if self.top_seen or self.object_class != "vehicle":
            return height_m
        heavy = bool((self.size_m > LARGEST_VAN_M).any())
        return max(height_m, HEAVY_HEIGHT_M if heavy else VAN_HEIGHT_M)


def axes(yaw_rad: float) -> Floats:
    """(2, 2) float64, whose columns are the unit vectors ahead and to the left of a heading."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def guess_class(size_m: Floats, speed_mps: float) -> ObjectClass:
    """Guess the class of an object.

    Args:
        size_m: (3,) float64, length, width, height.
        speed_mps: median while it moves.
    """
    length, width, _ = size_m
    if length > VEHICLE_M[0] or width > VEHICLE_M[1]:
        return "vehicle"
    return "cyclist" if length > CYCLIST_M and speed_mps > CYCLIST_MPS else "pedestrian"


def fit_box(fragment: Fragment, settings: ProposalSettings) -> Box | None:
    """The box of a track; None where it is not believed that something moves."""
    numbers = fragment.numbers
    if len(numbers) < max(settings.least_sweeps, settings.seen_share * (numbers[-1] - numbers[0] + 1)):
        return None
    motion = track_motion(fragment, settings)
    moving = moving_states(np.round(motion.times_s * SECOND_NS).astype(np.int64), motion.speed_mps, settings.motion)
    if moving.sum() < settings.least_sweeps or not _moves(motion, moving, settings):
        return None
    box = _box(fragment, motion, moving, settings)
    gain_share = settings.gain_share
    if fragment.seen_through(settings.least_through) < settings.object_through:
        if box.speed_mps * settings.window_s > settings.slow_lengths * box.size_m[0]:
            return None
        gain_share = settings.sure_share
    if not _found_again(fragment, motion, np.flatnonzero(moving), gain_share, settings):
        return None
    too_long = box.size_m[0] > settings.longest_m + 2 or box.size_m[1] > settings.widest_m
    too_low = box.size_m[2] + CLEARANCE_M < settings.least_top_m
    return None if too_long or too_low else box


def _moves(motion: Motion, moving: NDArray[np.bool_], settings: ProposalSettings) -> bool:
    places = motion.positions_m[moving]
    net_m, path_m = np.hypot(*(places[-1] - places[0])), np.hypot(*np.diff(places, axis=0).T).sum()
    speed_mps = float(np.median(motion.speed_mps[moving]))
    far = net_m >= settings.least_move_m and net_m >= settings.straight * min(path_m, HEADING_MOVE_M)
    return bool(far and speed_mps >= settings.least_speed_mps)


def _found_again(
    fragment: Fragment, motion: Motion, which: NDArray[np.intp], gain_share: float, settings: ProposalSettings
) -> bool:
    """Points are found where the motion predicts them, and few where it says that the object has left.

    Of a long side most points lie on others a metre further on: they say nothing of rest.
    """
    moved, left, still = list[float](), 0, 0
    places = motion.positions_m
    for i in which:
        points = motion.points[i]
        wanted_m = min(max(0.6, 0.5 * float(np.ptp(points[:, :2], axis=0).max())), 2.5)
        away_m = np.hypot(*(places[which] - places[i]).T)
        far = which[away_m >= min(wanted_m, 0.9 * away_m.max())]
        nearest = far[np.argmin(np.abs(far - i))]
        sampled = points[:: max(len(points) // SAMPLED, 1)]
        own = KDTree(points)
        for j in {nearest, far[-1] if abs(far[-1] - i) < FARTHEST else nearest}:
            tree = fragment.observations[j].cloud.tree
            shift = np.array([*(places[j] - places[i]), 0.0])
            moved.append(float(_near(tree, sampled + shift, settings.found_m).mean()))
            vacated = sampled[~_near(own, sampled - shift, settings.found_m)]
            left += len(vacated)
            still += int(_near(tree, vacated, settings.found_m).sum())
    found = float(np.mean(moved))
    return found >= settings.found_share and left > 0 and found - still / left >= gain_share


def _near(tree: KDTree, points: Floats, within_m: float) -> NDArray[np.bool_]:
    """(N,) bool, points that have a neighbour in the tree."""
    return np.isfinite(tree.query(points, distance_upper_bound=within_m)[0])


def _headings(motion: Motion, moving: NDArray[np.bool_]) -> Floats:
    """(K,) float64, rad, smooth along the track; while it rests those of the nearest time it moves."""
    places, times_s = motion.positions_m[moving], motion.times_s[moving]
    net = places[-1] - places[0]
    mean_rad = np.arctan2(net[1], net[0])
    velocity = motion.velocity_mps[moving]
    raw_rad = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    if np.hypot(*net) < HEADING_MOVE_M or np.abs(np.diff(raw_rad)).max() > MOST_TURN_RAD:
        return np.full(len(moving), mean_rad)
    smooth = np.empty(len(moving))
    for i, time_s in enumerate(np.clip(motion.times_s, times_s[0], times_s[-1])):
        near = np.abs(times_s - time_s) <= HEADING_SPAN_S / 2
        near = near if near.sum() > 2 else np.argsort(np.abs(times_s - time_s), kind="stable")[:3]
        after_s, angles = times_s[near] - time_s, raw_rad[near]
        smooth[i] = np.polyfit(after_s, angles, 2 if len(angles) >= CURVED_FROM else 1)[-1]
    return smooth


def _box(fragment: Fragment, motion: Motion, moving: NDArray[np.bool_], settings: ProposalSettings) -> Box:
    yaw_rad = _headings(motion, moving)
    ahead = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    ends, cut = [], []
    for i, points in enumerate(motion.points):
        seen = (points[:, :2] - motion.positions_m[i]) @ axes(yaw_rad[i])
        ends.append(np.column_stack([[seen[:, 0].min(), seen[:, 0].max()], ends_without_stray(seen[:, 1])]))
        cut.append(np.transpose([cut_ends(axis, motion.cut_off[i]) for axis in seen.T]))
    (rear, right), (front, leftmost) = _outermost(np.array(ends), np.array(cut))
    centres = motion.positions_m + ahead * (front + rear) / 2 + left * (leftmost + right) / 2
    centres -= motion.velocity_mps * motion.offset_s[:, None]
    seen_at = zip(fragment.observations, centres, strict=True)
    bottom = np.array([float(one.cloud.ground.at(place[None])[0]) for one, place in seen_at]) + CLEARANCE_M
    top, top_seen = _top(fragment)
    size_m = np.array([front - rear, leftmost - right, 0.0]) + 2 * settings.margin_m
    size_m[2] = max(top + settings.margin_m - float(np.median(bottom)), 0.5)
    return Box(
        fragment=fragment, motion=motion, moving=moving, centres_m=centres, bottom_m=bottom, yaw_rad=yaw_rad,
        size_m=size_m, top_seen=top_seen,
    )  # fmt: skip


def _top(fragment: Fragment) -> tuple[float, bool]:
    """Height of an object above the road, m, and whether beams passed above it.

    Where the highest beam cuts it in all sweeps that see high, it is at least as high as the furthest of them sees.
    """
    tops, cut = np.empty(len(fragment.observations)), np.empty(len(fragment.observations), dtype=bool)
    for i, observation in enumerate(fragment.observations):
        heights_m = observation.points[:, 2]
        tops[i] = heights_m.max()
        cut[i] = cut_ends(heights_m, observation.cloud.cut_above[observation.rows])[1]
    whole = tops[~cut & (tops > np.quantile(tops, TOP) - TOPS_APART_M)]
    if cut.any() and len(whole) < LEAST_WHOLE:
        return float(tops.max()), False
    return float(np.quantile(tops[~cut], TOP)), True


def _outermost(ends_m: Floats, cut: NDArray[np.bool_]) -> Floats:
    """(2, 2) float64, m, lowest and highest ends of an object along and across it.

    Args:
        ends_m: (K, 2, 2) float64, m, of its points in each sweep.
        cut: (K, 2, 2) bool, where it may go on beyond.
    """
    found = np.empty((2, 2))
    for end, axis in np.ndindex(2, 2):
        whole = ends_m[~cut[:, end, axis], end, axis]
        if len(whole) >= LEAST_WHOLE:
            found[end, axis] = np.quantile(whole, EDGES[end])
        else:  # never seen: as far as it was
            found[end, axis] = (ends_m[:, end, axis].min(), ends_m[:, end, axis].max())[end]
    return found
