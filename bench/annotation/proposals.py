"""Proposals of moving objects from a raw drive: sweeps, ego-motion and calibration; no labels.

Nothing is learned and nothing is drawn at random. The whole drive is looked at, future included: free space before and
after a sweep says what in it moves. Memory does not grow with the length of the drive, but for what is found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.annotation.boxes import VEHICLE_M, Box, fit_box
from bench.annotation.doubts import EXPLAINED
from bench.annotation.joining import at_range_of_larger, extend, join, split_people, without_duplicates
from bench.annotation.prepared import Cloud, clouds
from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment, Tracker, find_clusters
from bench.errors import DataError
from bench.records.recording import Recording
from bench.records.reference import ObjectClass
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
TOP_NOT_SEEN, ONE_END = "top not seen", "seen from one end"
RIGID_M = 12.5  # longer vehicles have a joint, or are two
HALF = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """A moving object that was found, through the recording.

    Attributes:
        track_id: "p000" and so on, in the order of their first sweeps.
        object_class: a guess by size and speed, one of `OBJECT_CLASSES`.
        size_m: (3,) float64, length, width and height of its box.
        timestamps_ns: (K,) int64, of the sweeps that it is seen in, increasing.
        centres_m: (K, 3) float64, m, of the box, world frame of the recording's trajectory.
        yaw_rad: (K,) float64, heading in the world; the direction of travel, also in reverse.
        velocity_mps: (K, 2) float64, along the world's x and y; 0 where it rests before, after or between its motion.
        doubts: reasons to look twice, each with the number behind it.
        points_median: returns in a sweep, one for each voxel.
    """

    track_id: str
    object_class: ObjectClass
    size_m: Floats
    timestamps_ns: NDArray[np.int64]
    centres_m: Floats
    yaw_rad: Floats
    velocity_mps: Floats
    doubts: tuple[tuple[str, float], ...]
    points_median: int


def propose(
    recording: Recording,
    *,
    settings: ProposalSettings | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Proposal, ...]:
    """Find everything that moves.

    Args:
        recording: the drive; its annotations, if it has any, are not looked at.
        settings: constants; None for those that were tried.
        progress: called with the share of sweeps that are read.

    Raises:
        DataError: a sweep that cannot be read, or a drive without any.
    """
    if not recording.sweeps:
        raise DataError(recording.root, field="sweeps", expected="lidar sweeps to find moving objects in", got="none")
    settings = settings or ProposalSettings()
    tracker, segment, pieces = Tracker(settings), list[Cloud](), dict[tuple[int, int], list[Proposal]]()

    def judge() -> None:
        boxes = _believed(tracker.take(), segment, settings)
        for box in boxes:
            pieces.setdefault(box.fragment.name, []).append(_proposal(box, boxes, settings))
        segment.clear()

    for cloud in clouds(recording, settings, progress=progress):
        if segment and cloud.timestamp_ns - segment[0].timestamp_ns > settings.segment_s * SECOND_NS:
            judge()
        tracker.add(cloud, find_clusters(cloud, settings))
        segment.append(cloud)
    judge()
    found = [_one_after_the_other(parts) for _, parts in sorted(pieces.items())]
    found.sort(key=lambda one: int(one.timestamps_ns[0]))
    return tuple(replace(one, track_id=f"p{number:03d}") for number, one in enumerate(found))


def _believed(fragments: Sequence[Fragment], segment: Sequence[Cloud], settings: ProposalSettings) -> list[Box]:
    """Boxes of the tracks of a segment that are believed to move."""
    boxes = (fit_box(fragment, settings) for fragment in fragments)
    whole = [box for box in boxes if box is not None and not is_own(box, settings)]
    first = [part for box in whole for part in split_people(box, settings)]
    alone = {box.fragment.name: box for box in first}
    found = []
    for fragment in join(first, settings):
        box = (fit_box(fragment, settings) if fragment.joined else None) or alone[fragment.name]
        found.append(fit_box(extend(box, segment, settings), settings))
    return without_duplicates([box for box in found if box is not None])  # the rest does not stand longer looks


def is_own(box: Box, settings: ProposalSettings) -> bool:
    """Whether it keeps its place beside the lidar while that drives, as only the vehicle itself does."""
    sensors_m = np.array([observation.cloud.sensor_m for observation in box.fragment.observations])
    ranges_m, way_m = np.hypot(*(box.centres_m - sensors_m).T), np.hypot(*np.ptp(sensors_m, axis=0))
    beside = ranges_m.max() < settings.own_range_m and np.ptp(ranges_m) < settings.own_sway_m
    return bool(beside and way_m > settings.own_way_m)


def _proposal(box: Box, boxes: Sequence[Box], settings: ProposalSettings) -> Proposal:
    seen = box.fragment.observations
    size_m = np.array([*box.size_m[:2], box.likely_height_m])
    levelled = np.column_stack([box.centres_m, box.bottom_m + size_m[2] / 2])
    centres = [observation.cloud.road.world(place[None])[0] for observation, place in zip(seen, levelled, strict=True)]
    return Proposal(
        track_id="",
        object_class=box.object_class,
        size_m=size_m,
        timestamps_ns=np.array([observation.cloud.timestamp_ns for observation in seen], dtype=np.int64),
        centres_m=np.array(centres),
        yaw_rad=box.yaw_rad,
        velocity_mps=box.velocity_mps,
        doubts=_doubts(box, boxes, settings),
        points_median=int(np.median([len(observation.rows) for observation in seen])),
    )


def _doubts(box: Box, boxes: Sequence[Box], settings: ProposalSettings) -> tuple[tuple[str, float], ...]:
    seen = box.fragment.observations
    points = float(np.median([len(observation.rows) for observation in seen]))
    moves_s = float(np.ptp(box.motion.times_s[box.moving]))
    away_m = np.hypot(*(box.centres_m - np.array([observation.cloud.sensor_m for observation in seen])).T)
    through = box.fragment.seen_through(settings.least_through)
    echo = at_range_of_larger(box, boxes)
    whole = box.object_class != "vehicle" or (box.size_m[0] >= VEHICLE_M[0] and box.ends_seen)
    looked_at = (
        ("few returns", points, points < settings.few_points),
        ("short", moves_s, moves_s < settings.short_s),
        ("at the edge of the range", float(np.median(away_m)), np.median(away_m) > settings.range_m - settings.edge_m),
        ("fragments joined", float(box.fragment.joined), box.fragment.joined > 0),
        (ONE_END, float(box.size_m[0]), not whole),
        ("longer than a rigid vehicle", float(box.size_m[0]), box.size_m[0] > RIGID_M),
        ("at the range of a larger one", echo, echo > HALF),
        (TOP_NOT_SEEN, float(box.size_m[2]), not box.top_seen),
        ("seen through by few", through, through < settings.few_through),
    )
    assert {reason for reason, _, _ in looked_at} == EXPLAINED.keys()
    return tuple((reason, value) for reason, value, doubted in looked_at if doubted)


def _one_after_the_other(parts: Sequence[Proposal]) -> Proposal:
    """Pieces of one track, from several segments, as one with the largest box."""
    if len(parts) == 1:
        return parts[0]
    longest = max(parts, key=lambda part: len(part.timestamps_ns))
    doubts = {reason: value for part in parts for reason, value in part.doubts if reason != "short"}
    size_m = np.max([part.size_m for part in parts], axis=0)
    if known := [part for part in parts if TOP_NOT_SEEN not in dict(part.doubts)]:
        size_m[2] = max(part.size_m[2] for part in known)
        doubts.pop(TOP_NOT_SEEN, None)
    if any(ONE_END not in dict(part.doubts) for part in parts):
        doubts.pop(ONE_END, None)
    return Proposal(
        track_id="",
        object_class=longest.object_class,
        size_m=size_m,
        timestamps_ns=np.concatenate([part.timestamps_ns for part in parts]),
        centres_m=np.concatenate([part.centres_m for part in parts]),
        yaw_rad=np.concatenate([part.yaw_rad for part in parts]),
        velocity_mps=np.concatenate([part.velocity_mps for part in parts]),
        doubts=tuple(sorted(doubts.items())),
        points_median=int(np.median([part.points_median for part in parts])),
    )
