"""Tracks that are believed to be moving objects, and the box of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.annotation.registration import Motion, cut_ends, track_motion
from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment, ends_without_stray
from bench.records.reference import ObjectClass
from bench.reference.motion import moving_states
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
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
CELL_M, FACE_SEEN, FLANK_SEEN = (
    0.25,
    0.5,
    0.75,
)  # of a side that returns cover in all sweeps together: of an end, a flank
CYCLIST_M, CYCLIST_MPS = 1.15, 2.2  # longer and faster than anybody on foot


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
        points = np.concatenate([self._own(i) for i in range(len(self.centres_m))])
        share = np.zeros((2, 2))
        for axis, end in np.ndindex(2, 2):
            on_side = points[(2 * end - 1) * points[:, axis] > half_m[axis] - FACE_M, 1 - axis]
            reach_m = half_m[1 - axis]
            cells = np.histogram(on_side, bins=int(np.ceil(2 * reach_m / CELL_M)), range=(-reach_m, reach_m))[0]
            share[axis, end] = (cells > 0).mean()
        return bool((share[0] >= FACE_SEEN).all() or (share[1] >= FLANK_SEEN).any())

    def _own(self, i: int) -> Floats:
        """(N, 2) float64, m, returns of a sweep along and across the box from its centre."""
        ahead = np.array([np.cos(self.yaw_rad[i]), np.sin(self.yaw_rad[i])])
        centre = self.centres_m[i] + self.motion.velocity_mps[i] * self.motion.offset_s[i]
        left = np.array([-ahead[1], ahead[0]])
        return np.asarray((self.motion.points[i][:, :2] - centre) @ np.stack([ahead, left], axis=1))

    @property
    def likely_height_m(self) -> float:
        """Height, a guess where a vehicle's top was not seen."""
        height_m = float(self.size_m[2])
        if self.top_seen or self.object_class != "vehicle":
            return height_m
        heavy = bool((self.size_m > LARGEST_VAN_M).any())
        return max(height_m, HEAVY_HEIGHT_M if heavy else VAN_HEIGHT_M)


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
        seen = (points[:, :2] - motion.positions_m[i]) @ np.stack([ahead[i], left[i]], axis=1)
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
