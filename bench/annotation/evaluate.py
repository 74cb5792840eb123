"""Proposals against annotations that exist: what was found, what is false, and how well boxes and speeds are known.

An object-frame is an object in a sweep. A proposal finds it where the returns in its box are those of the annotated
one, with an IoU of at least one half; of several proposals for one object one is right. Only what moves is asked for,
by the rule that the benchmark has for annotated objects. A proposal that says itself that its object rests, or one on
an object of few returns or that is unclear, is neither right nor wrong; nor is what is seen when, or where, nobody
annotated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import radians

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from shapely.geometry.base import BaseGeometry

from bench.annotation.settings import MOTION
from bench.errors import UsageError
from bench.records.recording import NOT_ANNOTATED, Cuboid, Recording, Track
from bench.reference.motion import TrackMotion, categorise, track_motion
from bench.reference.silhouette import left_out_ground
from bench.reference.sweeps import PosedSweep, object_cluster, pose_sweep
from bench.times import SECOND_NS

LEAST_IOU = 0.5
LEAST_POINTS = 10  # returns of an object that is asked for, as the protocols ask
NEAR_NS = 60_000_000  # of an annotation to a sweep
CLEARANCE_M = 0.1  # returns lower above the box's bottom are the ground's
BANDS_M = (8.0, 20.0)
SPEEDS_MPS = (2.0, 6.0)
HALF = 0.5
OUTCOMES = FOUND, MISSED, FALSE, NEUTRAL = "found", "missed", "false", "neutral"
COLUMNS = [
    *("recording", "timestamp_ns", "object", "proposal", "outcome", "object_class", "kind", "range_m", "speed_mps"),
    *("iou", "speed_error_mps", "centre_error_m", "size_error_m", "yaw_error_rad", "proposed_class"),
]
SIZE_OFF_M, YAW_OFF_RAD = 1.0, radians(20)  # from which on a box is listed as wrong
ERRORS = {"speed_error": "speed_error_mps", "centre_error": "centre_error_m", "size_error": "size_error_m"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Seen:
    """An annotated object, or a proposal, in a sweep."""

    track: Track
    motion: TrackMotion
    index: int
    rows: NDArray[np.intp]
    range_m: float
    centre: NDArray[np.float64]
    yaw_rad: float
    annotated: bool

    @property
    def size_m(self) -> NDArray[np.float64]:
        """(3,) float64, m; NaN for what has no box."""
        shape = self.track.states[self.index].shape
        return np.asarray(shape.size_m) if isinstance(shape, Cuboid) else np.full(3, np.nan)

    @property
    def speed_mps(self) -> float:
        return float(np.hypot(*self.motion.smooth_world_mps[self.index, :2]))

    @property
    def moving(self) -> bool:
        return bool(self.motion.moving[self.index])

    @property
    def asked(self) -> bool:
        """It moves for sure, enough of it is seen, and somebody annotated there."""
        return self.moving and self.clear

    @property
    def clear(self) -> bool:
        state = self.track.states[self.index]
        known = self.annotated and not state.unclear and bool(np.isfinite(self.speed_mps))
        return len(self.rows) >= LEAST_POINTS and known


def evaluate_proposals(
    recording: Recording,
    proposed: Sequence[Track],
    *,
    progress: Callable[[float], None] = lambda _: None,
) -> pd.DataFrame:
    """Compare proposals with the annotations of a recording.

    Args:
        recording: annotated.
        proposed: tracks of boxes at the times of sweeps; see `bench.annotation.export.to_tracks`.
        progress: called with the share of sweeps that are read.

    Returns:
        One row for each object-frame that is annotated or proposed: `recording`, `timestamp_ns`, `object` and
        `proposal` (names, None for none), `outcome` (one of `OUTCOMES`), `object_class`, `kind` of motion, `range_m`
        from the lidar to the nearest return, `speed_mps`; of those that are found also `iou`, `speed_error_mps`
        (length of the difference of the velocities), `centre_error_m` (seen from above), `size_error_m` (the largest
        difference of length, width and height), `yaw_error_rad` (of the heading, 0 to pi) and `proposed_class`, NaN
        elsewhere and where an annotation has no box.

    Raises:
        UsageError: the recording is not annotated.
        DataError: a sweep that cannot be read.
    """
    if recording.annotated == NOT_ANNOTATED:
        raise UsageError(f"{recording.name}: expected annotations to compare with, got a recording without")
    truths = [_with_motion(track, recording) for track in recording.tracks if track.states]
    others = [_with_motion(track, recording) for track in proposed if track.states]
    left_out = left_out_ground(recording.annotated)
    rows: list[dict[str, object]] = []
    for number, ref in enumerate(recording.sweeps):
        placed = pose_sweep(ref.read(), recording.trajectory, recording.vehicle_from_lidar, recording.lidar_from_sensor)
        if placed is not None:
            seen = [_seen(pair, placed, ref.timestamp_ns, recording, left_out, NEAR_NS) for pair in truths]
            told = [_seen(pair, placed, ref.timestamp_ns, recording, left_out, 0) for pair in others]
            ego_mps = recording.trajectory.velocity_vehicle_mps(ref.timestamp_ns)
            turn = recording.trajectory.world_from_vehicle(ref.timestamp_ns).rotation
            kinds = _Kinds(ego_world_mps=turn @ ego_mps)
            common = {"recording": recording.name, "timestamp_ns": ref.timestamp_ns}
            rows += [{**common, **row} for row in _rows([*filter(None, seen)], [*filter(None, told)], kinds)]
        progress((number + 1) / len(recording.sweeps))
    return pd.DataFrame(rows, columns=COLUMNS)


def proposal_scores(frames: pd.DataFrame, *, minutes: float) -> pd.DataFrame:
    """Sum up object-frames, of one recording or of many.

    Args:
        frames: see `evaluate_proposals`.
        minutes: how long the sweeps took.

    Returns:
        One row for each range (nearer than 8 m, nearer than 20 m, all) and group (all; each class, kind of motion and
        range of speeds): `object_frames`, `recall`, `precision`, `switches` (from one proposal to another on one
        object), `false_tracks_per_minute` (with more false object-frames than others), `class_right` (share of those
        that are found), `speed_error_median`, `speed_error_p90` (m/s), likewise of `centre_error` (m), `size_error`
        (m) and `yaw_error_deg`; NaN for 0/0.
    """
    speeds = [0.0, *SPEEDS_MPS, np.inf]
    bins = [f"{low:g} to {high:g} m/s" for low, high in pairwise(speeds[:-1])] + [f"{speeds[-2]:g} m/s and more"]
    frames = frames.assign(speed=pd.cut(frames["speed_mps"], speeds, right=False, labels=bins).astype(object))
    table = []
    for limit_m in (*BANDS_M, np.inf):
        near = frames[frames["range_m"] < limit_m]
        label = "all" if np.isinf(limit_m) else f"< {limit_m:g} m"
        table.append({"range": label, "group": "all", **_scores(near, minutes)})
        for column in ("object_class", "kind", "speed"):
            names = sorted(set(near.loc[near["outcome"] != NEUTRAL, column].dropna()))
            groups = ((name, near[near[column] == name]) for name in names)
            table += [{"range": label, "group": name, **_scores(rows, minutes)} for name, rows in groups]
    return pd.DataFrame(table)


def _scores(frames: pd.DataFrame, minutes: float) -> dict[str, float]:
    counts = {outcome: int((frames["outcome"] == outcome).sum()) for outcome in OUTCOMES}
    found = frames[frames["outcome"] == FOUND].sort_values("timestamp_ns", kind="stable")
    by_object = found.groupby(["recording", "object"], sort=True)["proposal"]
    told = frames[frames["proposal"].notna()]
    false = (told["outcome"] == FALSE).groupby([told["recording"], told["proposal"]]).mean()
    scores = {
        "object_frames": counts[FOUND] + counts[MISSED],
        "recall": _share(counts[FOUND], counts[FOUND] + counts[MISSED]),
        "precision": _share(counts[FOUND], counts[FOUND] + counts[FALSE]),
        "switches": int(sum((names != names.shift()).sum() - 1 for _, names in by_object)),
        "false_tracks_per_minute": _share(int((false > HALF).sum()), minutes),
        "class_right": float((found["proposed_class"] == found["object_class"]).mean()),
    }
    errors = {name: found[column] for name, column in ERRORS.items()}
    errors["yaw_error_deg"] = found["yaw_error_rad"].astype(float) * 180.0 / np.pi
    for name, values in errors.items():
        for label, level in (("median", 0.5), ("p90", 0.9)):
            scores[f"{name}_{label}"] = float(values.quantile(level))
    return scores


def class_confusion(frames: pd.DataFrame) -> pd.DataFrame:
    """Count object-frames that were found by their class and the proposed one.

    Args:
        frames: see `evaluate_proposals`.

    Returns:
        One row for each annotated class, by name in its index, and one column for each proposed one.
    """
    found = frames[frames["outcome"] == FOUND]
    return pd.crosstab(found["object_class"], found["proposed_class"])


def worst_tracks(frames: pd.DataFrame) -> pd.DataFrame:
    """List what is wrong with each track, most object-frames first.

    Args:
        frames: see `evaluate_proposals`.

    Returns:
        `recording`, `track` (an annotated object; of what is false a proposal), `wrong` (missed, false, another class,
        a side of the box off by more than 1 m, the heading by more than 20 degrees) and `frames`.
    """
    found = frames[frames["outcome"] == FOUND]
    other = found[found["proposed_class"] != found["object_class"]]
    kinds = [
        frames[frames["outcome"] == MISSED].assign(wrong="missed"),
        frames[frames["outcome"] == FALSE].assign(wrong="false", object=frames["proposal"]),
        other.assign(wrong=other["object_class"] + " proposed as " + other["proposed_class"].astype(str)),
        found[found["size_error_m"] > SIZE_OFF_M].assign(wrong=f"a side off by more than {SIZE_OFF_M:g} m"),
        found[found["yaw_error_rad"] > YAW_OFF_RAD].assign(
            wrong=f"heading off by more than {np.degrees(YAW_OFF_RAD):.0f} degrees"
        ),
    ]
    names = ["recording", "object", "wrong"]
    wrong = pd.concat([rows[names] for rows in kinds]).groupby(names).size().reset_index(name="frames")
    return wrong.rename(columns={"object": "track"}).sort_values(
        ["frames", "recording", "track", "wrong"], ascending=[False, True, True, True], ignore_index=True
    )


def _share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Kinds:
    """Names the kind of motion; world axes."""

    ego_world_mps: NDArray[np.float64]

    def of(self, seen: _Seen) -> str | None:
        stated = seen.track.states[seen.index].category
        velocity = seen.motion.smooth_world_mps[seen.index]
        if stated is not None or not np.isfinite(velocity).all():
            return stated
        return str(categorise(velocity, self.ego_world_mps, MOTION))


def _with_motion(track: Track, recording: Recording) -> tuple[Track, TrackMotion, NDArray[np.int64]]:
    times_ns = np.array([state.timestamp_ns for state in track.states], dtype=np.int64)
    return track, track_motion(track, recording.trajectory, MOTION), times_ns


def _seen(
    pair: tuple[Track, TrackMotion, NDArray[np.int64]],
    placed: PosedSweep,
    sweep_ns: int,
    recording: Recording,
    left_out: BaseGeometry,
    near_ns: int,
) -> _Seen | None:
    """None where the track has no state near enough to the sweep, or no returns in it."""
    track, motion, times_ns = pair
    index = int(np.argmin(np.abs(times_ns - sweep_ns)))
    if abs(int(times_ns[index]) - sweep_ns) > near_ns:
        return None
    state = track.states[index]
    world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
    cluster = object_cluster(placed, motion.at(index, world_from_vehicle), sweep_ns, clearance_m=CLEARANCE_M)
    if not len(cluster.rows):
        return None
    range_m = float(np.hypot(*placed.points_sensor(cluster.rows)[:, :2].T).min())
    later_s = (sweep_ns - state.timestamp_ns) / SECOND_NS
    yaw_rad = np.nan
    if isinstance(state.shape, Cuboid):
        ahead = world_from_vehicle.rotate(state.shape.vehicle_from_object.rotation[:, 0])
        yaw_rad = float(np.arctan2(ahead[1], ahead[0]))
        centre = world_from_vehicle.apply(state.shape.vehicle_from_object.translation_m)
        centre = centre + np.nan_to_num(motion.velocity_world_mps[index]) * later_s
    else:
        centre = cluster.points_world.mean(axis=0)
    middle_m = recording.trajectory.world_from_vehicle(sweep_ns).inverse().apply(centre)
    return _Seen(
        track=track,
        motion=motion,
        index=index,
        rows=cluster.rows,
        range_m=range_m,
        centre=centre,
        yaw_rad=yaw_rad,
        annotated=recording.annotated.covers(sweep_ns) and not left_out.covers(shapely.Point(middle_m[:2])),
    )


def _rows(seen: Sequence[_Seen], told: Sequence[_Seen], kinds: _Kinds) -> Iterator[dict[str, object]]:
    """Match the objects of a sweep with proposals, and say what became of each."""
    ious = np.array([[_iou(one.rows, other.rows) for other in told] for one in seen]).reshape(len(seen), len(told))
    pairs = {int(a): int(b) for a, b in zip(*linear_sum_assignment(-ious), strict=True) if ious[a, b] >= LEAST_IOU}
    for a, truth in enumerate(seen):
        match = told[pairs[a]] if a in pairs else None
        row = {"object": truth.track.track_id, "proposal": match.track.track_id if match else None}
        if match is None:
            yield {**row, **_described(truth, kinds), "outcome": MISSED if truth.asked else NEUTRAL}
        elif truth.asked:
            error_mps = truth.motion.velocity_world_mps[truth.index] - match.motion.velocity_world_mps[match.index]
            yield {
                **row,
                **_described(truth, kinds),
                "outcome": FOUND,
                "iou": ious[a, pairs[a]],
                "speed_error_mps": float(np.hypot(*error_mps[:2])),
                "centre_error_m": float(np.hypot(*(truth.centre - match.centre)[:2])),
                "size_error_m": float(np.abs(truth.size_m - match.size_m).max()),
                "yaw_error_rad": abs((truth.yaw_rad - match.yaw_rad + np.pi) % (2 * np.pi) - np.pi),
                "proposed_class": match.track.object_class,
            }
        else:
            wrong = match.moving and truth.clear
            yield {**row, **_described(match, kinds), "outcome": FALSE if wrong else NEUTRAL}
    for b, match in enumerate(told):
        if b not in pairs.values():
            row = {"object": None, "proposal": match.track.track_id}
            wrong = match.moving and match.annotated
            yield {**row, **_described(match, kinds), "outcome": FALSE if wrong else NEUTRAL}


def _described(seen: _Seen, kinds: _Kinds) -> dict[str, object]:
    return {
        "object_class": seen.track.object_class,
        "kind": kinds.of(seen),
        "range_m": seen.range_m,
        "speed_mps": seen.speed_mps,
    }


def _iou(one: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    both = len(np.intersect1d(one, other, assume_unique=True))
    return both / (len(one) + len(other) - both)
