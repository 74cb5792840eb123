"""Proposals against annotations that exist: what was found, what is false, and how well boxes and speeds are known.

An object-frame is an object in a sweep. A proposal finds it where the returns in its box are those of the annotated
one, with an IoU of at least one half; of several proposals for one object one is right. Only what moves is asked for,
by the rule that the benchmark has for annotated objects. A proposal that says itself that its object rests, or one on
an object of few returns or that is unclear, is neither right nor wrong; nor is what is seen when, or where, nobody
annotated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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

Floats = NDArray[np.float64]

LEAST_IOU = 0.5
LEAST_POINTS = 10  # returns of an object that is asked for, as the protocols ask
NEAR_NS = 60_000_000  # of an annotation to a sweep
CLEARANCE_M = 0.1  # returns lower above the box's bottom are the ground's
BANDS_M = (8.0, 20.0)
HALF = 0.5
OUTCOMES = FOUND, MISSED, FALSE, NEUTRAL = "found", "missed", "false", "neutral"
COLUMNS = [
    *("recording", "timestamp_ns", "object", "proposal", "outcome", "object_class", "kind", "range_m"),
    *("iou", "speed_error_mps", "centre_error_m", "size_error_m", "yaw_error_rad", "proposed_class"),
]
SIZE_OFF_M, YAW_OFF_RAD = 1.0, radians(20)  # from which on a box is listed as wrong
ERRORS = {"speed_error": "speed_error_mps", "centre_error": "centre_error_m", "size_error": "size_error_m"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Seen:
    """An annotated object, or a proposal, in a sweep.

    Attributes:
        name: of its track.
        described: class, kind of motion and range, by column.
        rows: (N,) intp, its returns in the sweep.
        centre: (3,) float64, m, world frame, at the time of the sweep.
        yaw_rad: heading in the world; NaN for what has no box.
        size_m: (3,) float64; likewise.
        velocity_mps: (3,) float64, world axes.
        moving: by the rule of the benchmark.
        annotated: somebody annotated then and there.
        clear: enough of it is seen to ask for it, and its speed is known.
    """

    name: str
    described: dict[str, object]
    rows: NDArray[np.intp]
    centre: Floats
    yaw_rad: float
    size_m: Floats
    velocity_mps: Floats
    moving: bool
    annotated: bool
    clear: bool


def evaluate_proposals(recording: Recording, proposed: Sequence[Track]) -> pd.DataFrame:
    """Compare proposals with the annotations of a recording.

    Args:
        recording: annotated.
        proposed: tracks of boxes at the times of sweeps; see `bench.annotation.decisions.to_tracks`.

    Returns:
        One row for each object-frame that is annotated or proposed: `recording`, `timestamp_ns`, `object` and
        `proposal` (names, None for none), `outcome` (one of `OUTCOMES`), `object_class`, `kind` of motion, `range_m`
        from the lidar to the nearest return; of those that are found also `iou`, `speed_error_mps`
        (length of the difference of the velocities), `centre_error_m` (seen from above), `size_error_m` (the largest
        difference of length, width and height), `yaw_error_rad` (of the heading, 0 to pi) and `proposed_class`, NaN
        elsewhere and where an annotation has no box.

    Raises:
        UsageError: the recording is not annotated.
        DataError: a sweep that cannot be read.
    """
    if recording.annotated == NOT_ANNOTATED:
        raise UsageError(f"{recording.name}: expected annotations to compare with, got a recording without")
    truths, others = (
        [(track, track_motion(track, recording.trajectory, MOTION)) for track in tracks if track.states]
        for tracks in (recording.tracks, proposed)
    )
    left_out = left_out_ground(recording.annotated)
    rows: list[dict[str, object]] = []
    for ref in recording.sweeps:
        placed = pose_sweep(ref.read(), recording.trajectory, recording.vehicle_from_lidar, recording.lidar_from_sensor)
        if placed is not None:
            seen = [_seen(track, motion, placed, recording, left_out, NEAR_NS) for track, motion in truths]
            told = [_seen(track, motion, placed, recording, left_out, 0) for track, motion in others]
            common = {"recording": recording.name, "timestamp_ns": ref.timestamp_ns}
            rows += [common | row for row in _rows([*filter(None, seen)], [*filter(None, told)])]
    return pd.DataFrame(rows, columns=COLUMNS)


def proposal_scores(frames: pd.DataFrame, *, minutes: float) -> pd.DataFrame:
    """Sum up object-frames, of one recording or of many.

    Args:
        frames: see `evaluate_proposals`.
        minutes: how long the sweeps took.

    Returns:
        One row for each range (nearer than 8 m, nearer than 20 m, all) and group (all; each class and kind of
        motion): `object_frames`, `recall`, `precision`, `switches` (from one proposal to another on one object),
        `false_tracks_per_minute` (with more false object-frames than others), `class_right` (share of those that are
        found), `speed_error_median`, `speed_error_p90` (m/s), likewise of `centre_error` (m), `size_error`
        (m) and `yaw_error_deg`; NaN for 0/0.
    """
    table = []
    for limit_m in (*BANDS_M, np.inf):
        near = frames[frames["range_m"] < limit_m]
        label = "all" if np.isinf(limit_m) else f"< {limit_m:g} m"
        table.append({"range": label, "group": "all", **_scores(near, minutes)})
        for column in ("object_class", "kind"):
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


def _seen(
    track: Track, motion: TrackMotion, placed: PosedSweep, recording: Recording, left_out: BaseGeometry, near_ns: int
) -> _Seen | None:
    """None where the track has no state near enough to the sweep, or no returns in it."""
    sweep_ns = placed.sweep.timestamp_ns
    state = track.state_near(sweep_ns, within_ns=near_ns)
    if state is None:
        return None
    index = track.states.index(state)
    velocity_mps, smooth_mps = motion.velocity_world_mps[index], motion.smooth_world_mps[index]
    world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
    cluster = object_cluster(placed, motion.at(index, world_from_vehicle), sweep_ns, clearance_m=CLEARANCE_M)
    if not len(cluster.rows):
        return None
    yaw_rad, size_m, centre = np.nan, np.full(3, np.nan), cluster.points_world.mean(axis=0)
    if isinstance(state.shape, Cuboid):
        box, size_m = world_from_vehicle @ state.shape.vehicle_from_object, np.asarray(state.shape.size_m)
        yaw_rad = float(np.arctan2(box.rotation[1, 0], box.rotation[0, 0]))
        centre = box.translation_m + np.nan_to_num(velocity_mps) * (sweep_ns - state.timestamp_ns) / SECOND_NS
    world_from_vehicle = recording.trajectory.world_from_vehicle(sweep_ns)
    middle_m = world_from_vehicle.inverse().apply(centre)
    annotated = recording.annotated.covers(sweep_ns) and not left_out.covers(shapely.Point(middle_m[:2]))
    kind, speed_known = state.category, bool(np.isfinite(smooth_mps[:2]).all())
    if kind is None and np.isfinite(smooth_mps).all():
        ego_mps = world_from_vehicle.rotation @ recording.trajectory.velocity_vehicle_mps(sweep_ns)
        kind = str(categorise(smooth_mps, ego_mps, MOTION))
    return _Seen(
        name=track.track_id,
        described={
            "object_class": track.object_class,
            "kind": kind,
            "range_m": float(np.hypot(*placed.points_sensor(cluster.rows)[:, :2].T).min()),
        },
        rows=cluster.rows,
        centre=centre,
        yaw_rad=yaw_rad,
        size_m=size_m,
        velocity_mps=velocity_mps,
        moving=bool(motion.moving[index]),
        annotated=annotated,
        clear=annotated and not state.unclear and speed_known and len(cluster.rows) >= LEAST_POINTS,
    )


def _rows(seen: Sequence[_Seen], told: Sequence[_Seen]) -> Iterator[dict[str, object]]:
    """Match the objects of a sweep with proposals, and say what became of each."""
    ious = np.array([[_iou(truth.rows, match.rows) for match in told] for truth in seen]).reshape(len(seen), len(told))
    pairs = {int(a): int(b) for a, b in zip(*linear_sum_assignment(-ious), strict=True) if ious[a, b] >= LEAST_IOU}
    for a, truth in enumerate(seen):
        match = told[pairs[a]] if a in pairs else None
        row = {"object": truth.name, "proposal": match.name if match else None, **truth.described}
        if match is None:
            yield {**row, "outcome": MISSED if truth.moving and truth.clear else NEUTRAL}
        elif truth.moving and truth.clear:
            yield {
                **row,
                "outcome": FOUND,
                "iou": ious[a, pairs[a]],
                "speed_error_mps": float(np.hypot(*(truth.velocity_mps - match.velocity_mps)[:2])),
                "centre_error_m": float(np.hypot(*(truth.centre - match.centre)[:2])),
                "size_error_m": float(np.abs(truth.size_m - match.size_m).max()),
                "yaw_error_rad": abs((truth.yaw_rad - match.yaw_rad + np.pi) % (2 * np.pi) - np.pi),
                "proposed_class": match.described["object_class"],
            }
        else:
            yield {**row, **match.described, "outcome": FALSE if match.moving and truth.clear else NEUTRAL}
    for b, match in enumerate(told):
        if b not in pairs.values():
            row = {"object": None, "proposal": match.name, **match.described}
            yield {**row, "outcome": FALSE if match.moving and match.annotated else NEUTRAL}


def _iou(a: NDArray[np.intp], b: NDArray[np.intp]) -> float:
    both = len(np.intersect1d(a, b, assume_unique=True))
    return both / (len(a) + len(b) - both)
