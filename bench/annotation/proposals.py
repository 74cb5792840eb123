"""Proposals of moving objects from a raw drive: sweeps, ego-motion and calibration; no labels.

Nothing is learned and nothing is drawn at random. The whole drive is looked at, future included: free space before and
after a sweep says what in it moves. Memory does not grow with the length of the drive, but for what is found.

Tracks are put together and cut apart: fragments of one object, people side by side, and gaps. They are carried on where
their box still holds points. People who go side by side are one cluster; seen along their way, their heads or bodies
are apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from bench.annotation.boxes import VEHICLE_M, Box, axes, fit_box
from bench.annotation.prepared import Cloud, clouds
from bench.annotation.settings import ProposalSettings
from bench.annotation.store import Doubt, StoredTrack, box_states
from bench.annotation.tracking import Fragment, Observation, Tracker, find_clusters
from bench.errors import DataError
from bench.records.recording import Recording
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
SMALL = 0.25  # a fragment has at most this share of the larger one's points
TOGETHER, LEAST_TOGETHER = 0.5, 3  # of its sweeps, in which both are seen
INSIDE_M = 0.3  # around the larger box
PERSON_M = (2.4, 1.1)  # largest length and width of what is no vehicle
SPEED_SHARE = 0.08  # of the speed, by which fragments may differ further
AROUND_M = 0.15  # of a box in which points are looked for
LEAST_HELD = 3
ECHO_M = 0.3  # depth of a ghost, and by how much its range may differ from what it repeats
SHARED = 0.5  # of a track's points that a larger one has too
LARGEST_M = (2.6, 2.6, 2.2)  # length, width and height of people beside each other; what is larger is a vehicle
FROM = (0.8, 0.2)  # of the height: heads, which are apart where arms touch; bodies, of which a child's is lower
CELL_M, SMOOTH_CELLS = 0.05, 1.5  # of the profile of the points seen from above
TOP = 0.99  # quantile of the heights
APART_M = 0.45  # two people are at least this far apart
VALLEY = 0.5  # of the lower peak, that the profile falls to between two people

EXPLAINED = {  # reasons of `propose`, as the review page explains them
    "few returns": "Returns in most sweeps. Its box and class rest on little; look in the image what it is.",
    "short": "Seconds that it moves. Look whether something moved at all, or was hidden before.",
    "at the edge of the range": "Metres from the lidar, where returns are few. What rests may pass for a slow mover.",
    "fragments joined": "Tracks that were put together, as mirrors and wheels. Look whether the box holds one object.",
    "seen from one end": "Length of the box, m. Only one end was seen, so the vehicle may be longer.",
    "longer than a rigid vehicle": "Length, m. A bus or lorry with a joint, or two vehicles close together.",
    "at the range of a larger one": "Share of its sweeps at a larger one's range. Maybe a ghost beside a reflector.",
    "top not seen": "Height that was seen, m. The lidar's highest beam cuts it; the box goes on to a likely height.",
    "seen through by few": "Share of its returns where other sweeps see through. Few: at rest, or long and slow.",
}
TOP_NOT_SEEN, ONE_END = "top not seen", "seen from one end"
RIGID_M = 12.5  # longer vehicles have a joint, or are two
HALF = 0.5


def propose(recording: Recording, *, settings: ProposalSettings | None = None) -> tuple[StoredTrack, ...]:
    """Find everything that moves.

    Args:
        recording: the drive; its annotations, if it has any, are not looked at.
        settings: constants; None for those that were tried.

    Returns:
        Tracks as a review file holds them, called "p000" and so on in the order of their first sweeps. Class and height
        may be guesses; headings are the direction of travel, also in reverse; velocities are 0 where an object rests
        before, after or between its motion. Points count once for each voxel.

    Raises:
        DataError: a sweep that cannot be read, or a drive without any.
    """
    if not recording.sweeps:
        raise DataError(recording.root, field="sweeps", expected="lidar sweeps to find moving objects in", got="none")
    settings = settings or ProposalSettings()
    tracker, segment, pieces = Tracker(settings), list[Cloud](), dict[tuple[int, int], list[StoredTrack]]()

    def judge() -> None:
        boxes = _believed(tracker.take(), segment, settings)
        for box in boxes:
            pieces.setdefault(box.fragment.name, []).append(_proposal(box, boxes, settings))
        segment.clear()

    for cloud in clouds(recording, settings):
        if segment and cloud.timestamp_ns - segment[0].timestamp_ns > settings.segment_s * SECOND_NS:
            judge()
        tracker.add(cloud, find_clusters(cloud, settings))
        segment.append(cloud)
    judge()
    found = [_one_after_the_other(parts) for _, parts in sorted(pieces.items())]
    found.sort(key=lambda track: track.states[0].timestamp_ns)
    return tuple(track.model_copy(update={"id": f"p{number:03d}"}) for number, track in enumerate(found))


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


def _proposal(box: Box, boxes: Sequence[Box], settings: ProposalSettings) -> StoredTrack:
    seen = box.fragment.observations
    size_m = np.array([*box.size_m[:2], box.likely_height_m])
    levelled = np.column_stack([box.centres_m, box.bottom_m + size_m[2] / 2])
    centres = [observation.cloud.road.world(place[None])[0] for observation, place in zip(seen, levelled, strict=True)]
    times_ns = np.array([observation.cloud.timestamp_ns for observation in seen], dtype=np.int64)
    return StoredTrack(
        id="p",
        object_class=box.object_class,
        size_m=tuple(size_m.tolist()),
        doubts=_doubts(box, boxes, settings),
        points_median=float(np.floor(np.median([len(observation.rows) for observation in seen]))),
        states=box_states(times_ns, np.array(centres), box.yaw_rad, box.velocity_mps),
    )


def _doubts(box: Box, boxes: Sequence[Box], settings: ProposalSettings) -> tuple[Doubt, ...]:
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
    return tuple(Doubt(reason=reason, value=value) for reason, value, doubted in looked_at if doubted)


def _one_after_the_other(parts: Sequence[StoredTrack]) -> StoredTrack:
    """Pieces of one track, from several segments, as one with the largest box."""
    if len(parts) == 1:
        return parts[0]
    doubts = {doubt.reason: doubt for part in parts for doubt in part.doubts if doubt.reason != "short"}
    certain = {reason: [part for part in parts if reason not in part.reasons] for reason in (TOP_NOT_SEEN, ONE_END)}
    length_m, width_m, height_m = (max(sides_m) for sides_m in zip(*(part.size_m for part in parts), strict=True))
    changed = {
        "size_m": (length_m, width_m, max([part.size_m[2] for part in certain[TOP_NOT_SEEN]], default=height_m)),
        "doubts": tuple(doubts[reason] for reason in sorted(doubts) if not certain.get(reason)),
        "points_median": float(np.floor(np.median([part.points_median for part in parts]))),
        "states": tuple(state for part in parts for state in part.states),
    }
    return max(parts, key=lambda part: len(part.states)).model_copy(update=changed)


def join(boxes: Sequence[Box], settings: ProposalSettings) -> list[Fragment]:
    """Tracks without those that are a part of a larger one: mirrors, wheels, what is seen through windows.

    A part that moves as the larger one and fits it gives it its points; one inside that does not is dropped.
    """
    order = sorted(boxes, key=lambda box: (-box.fragment.points, box.fragment.name))
    gone: set[int] = set()
    joined = []
    for rank, large in enumerate(order):
        if id(large) in gone:
            continue
        fragment = large.fragment
        for small in order[rank + 1 :]:
            if id(small) in gone or small.fragment.points > SMALL * fragment.points:
                continue
            fits, inside = _belongs(small, large, settings)
            if fits or inside:
                gone.add(id(small))
            if fits:
                fragment = _with_points_of(fragment, small.fragment)
        joined.append(fragment)
    return joined


def _belongs(small: Box, large: Box, settings: ProposalSettings) -> tuple[bool, bool]:
    """Say whether a part moves as the larger one and both fit one object, and whether it lies inside."""
    both = sorted(set(small.fragment.numbers) & set(large.fragment.numbers))
    if len(both) < max(TOGETHER * len(small.fragment.numbers), LEAST_TOGETHER):
        return False, False
    mine = np.searchsorted(small.fragment.numbers, both)
    theirs = np.searchsorted(large.fragment.numbers, both)
    away = small.centres_m[mine] - large.centres_m[theirs]
    cosine, sine = np.cos(large.yaw_rad[theirs]), np.sin(large.yaw_rad[theirs])
    place = np.median(
        np.stack([away[:, 0] * cosine + away[:, 1] * sine, away[:, 1] * cosine - away[:, 0] * sine], axis=1), axis=0
    )
    inside = bool((np.abs(place) < large.size_m[:2] / 2 + INSIDE_M).all())
    low = np.minimum(-large.size_m[:2] / 2, place - small.size_m[:2] / 2)
    high = np.maximum(large.size_m[:2] / 2, place + small.size_m[:2] / 2)
    allowed = np.maximum(
        settings.joined_m if large.object_class == "vehicle" else PERSON_M, large.size_m[:2] + INSIDE_M
    )
    slower = np.median(small.motion.velocity_mps[mine], axis=0) - np.median(large.motion.velocity_mps[theirs], axis=0)
    alike = np.hypot(*slower) < settings.joined_mps + SPEED_SHARE * large.speed_mps
    return bool(alike and (high - low < allowed).all()), inside


def _with_points_of(large: Fragment, small: Fragment) -> Fragment:
    more = {observation.cloud.number: observation.rows for observation in small.observations}
    empty = np.empty(0, dtype=np.intp)
    observations = tuple(
        replace(observation, rows=np.union1d(observation.rows, more.get(observation.cloud.number, empty)))
        for observation in large.observations
    )
    return replace(large, observations=observations, joined=large.joined + 1)


def extend(box: Box, clouds: Sequence[Cloud], settings: ProposalSettings) -> Fragment:
    """Carry a track on at both ends and over gaps, since the ends of a drive have witnesses on one side only.

    Args:
        box: the track.
        clouds: all sweeps of the segment, in time.
        settings: of the proposals.
    """
    seen = {observation.cloud.number: observation for observation in box.fragment.observations}
    numbers = np.array(box.fragment.numbers)
    first, last = (int(np.searchsorted([cloud.number for cloud in clouds], end)) for end in (numbers[0], numbers[-1]))
    for state, beyond in ((0, reversed(clouds[:first])), (len(numbers) - 1, iter(clouds[last + 1 :]))):
        for cloud in beyond:
            held = _held(box, state, cloud, settings)
            if held is None:
                break
            seen[cloud.number] = held
    for cloud in clouds[first:last]:
        if cloud.number not in seen:
            held = _held(box, int(np.argmin(np.abs(numbers - cloud.number))), cloud, settings)
            if held is not None:
                seen[cloud.number] = held
    return replace(box.fragment, observations=tuple(seen[number] for number in sorted(seen)))


def _held(box: Box, state: int, cloud: Cloud, settings: ProposalSettings) -> Observation | None:
    """The points in the box that a state predicts for another sweep; None where there are too few."""
    known = box.fragment.observations[state]
    seconds = (cloud.timestamp_ns - known.cloud.timestamp_ns) / SECOND_NS
    if abs(seconds) > (settings.extend_s if box.moving[state] else settings.rest_s) or not len(cloud.points):
        return None
    velocity, yaw = box.velocity_mps[state], box.yaw_rad[state]
    away = cloud.points[:, :2] - (box.centres_m[state] + velocity * seconds) - np.outer(cloud.offset_s, velocity)
    along = away @ axes(yaw)
    within = (np.abs(along) <= box.size_m[:2] / 2 + AROUND_M).all(axis=1)
    rows = np.flatnonzero(within & (cloud.points[:, 2] <= box.bottom_m[state] + box.size_m[2] + AROUND_M))
    enough = max(LEAST_HELD, settings.held_share * len(known.rows))
    return Observation(cloud=cloud, rows=rows) if len(rows) >= enough else None


def without_duplicates(boxes: Sequence[Box]) -> list[Box]:
    """Leave out tracks most of whose points a larger one has too, since both were carried on into each other."""
    kept: list[Box] = []
    for box in sorted(boxes, key=lambda box: (-box.fragment.points, box.fragment.name)):
        if all(_shared(box.fragment, other.fragment) < SHARED * box.fragment.points for other in kept):
            kept.append(box)
    return kept


def _shared(small: Fragment, large: Fragment) -> int:
    """Number of points that two tracks have in common."""
    theirs = {observation.cloud.number: observation.rows for observation in large.observations}
    both = (one for one in small.observations if one.cloud.number in theirs)
    return sum(len(np.intersect1d(one.rows, theirs[one.cloud.number])) for one in both)


def at_range_of_larger(box: Box, others: Sequence[Box]) -> float:
    """Largest share of a track's sweeps in which it is flat and as far from the lidar as a part of another one.

    Beams that fire together with one that meets a strong reflector may tell its range: a ghost that moves with it.
    """
    shares = [0.0]
    for other in others:
        if box.fragment.points < other.fragment.points:
            theirs = {one.cloud.number: _span_m(one) for one in other.fragment.observations}
            mine = [(_span_m(one), theirs[one.cloud.number]) for one in box.fragment.observations
                    if one.cloud.number in theirs]  # fmt: skip
            alike = [
                last - first < ECHO_M and nearest - ECHO_M < first and last < farthest + ECHO_M
                for (first, last), (nearest, farthest) in mine
            ]
            shares.append(sum(alike) / len(box.fragment.observations))
    return max(shares)


def _span_m(observation: Observation) -> tuple[float, float]:
    """Shortest and longest distance of the points from the lidar, seen from above."""
    away_m = np.hypot(*(observation.points[:, :2] - observation.cloud.sensor_m).T)
    return float(away_m.min()), float(away_m.max())


def split_people(box: Box, settings: ProposalSettings) -> list[Box]:
    """Cut a track between people beside each other.

    Args:
        box: a believed track.
        settings: of the proposals.

    Returns:
        A box for each of the people, in the order across the heading, if each is believed to move; else `box`.
    """
    if (box.size_m > LARGEST_M).any():
        return [box]
    seen = [_in_box(box, number) for number in range(len(box.yaw_rad))]
    across_m, up_m = np.concatenate(seen).T
    top_m = np.quantile(up_m, TOP)
    cuts_m = max((_valleys(across_m[up_m > share * top_m]) for share in FROM), key=len)
    if not len(cuts_m):
        return [box]
    parts = [
        fit_box(_part(box.fragment, [np.searchsorted(cuts_m, one[:, 0]) == part for one in seen], part), settings)
        for part in range(len(cuts_m) + 1)
    ]
    believed = [part for part in parts if part is not None]
    return believed if len(believed) == len(parts) else [box]


def _in_box(box: Box, number: int) -> Floats:
    """(N, 2) float64, m, the points of a sweep across the heading from the track's place, and above the road."""
    points, yaw = box.motion.points[number], box.yaw_rad[number]
    across = (points[:, :2] - box.motion.positions_m[number]) @ np.array([-np.sin(yaw), np.cos(yaw)])
    return np.column_stack([across, points[:, 2] - box.bottom_m[number]])


def _valleys(places_m: Floats) -> Floats:
    """(K,) float64, m, where a profile of points is lowest between two peaks that stand apart."""
    from scipy.signal import find_peaks  # a second and a half, which opening a drive need not wait for

    if len(places_m) < 2:
        return np.empty(0)
    low = places_m.min() - APART_M
    counts = np.bincount(((places_m - low) / CELL_M).astype(np.intp), minlength=2)
    profile = gaussian_filter1d(np.pad(counts, (0, int(APART_M / CELL_M))).astype(np.float64), SMOOTH_CELLS)
    peaks, _ = find_peaks(profile, distance=APART_M / CELL_M, height=VALLEY * profile.max() / 2)
    cuts = []
    for left, right in pairwise(peaks):
        lowest = left + int(np.argmin(profile[left : right + 1]))
        if profile[lowest] < VALLEY * min(profile[left], profile[right]):
            cuts.append(low + (lowest + 0.5) * CELL_M)
    return np.array(cuts)


def _part(fragment: Fragment, chosen: list[NDArray[np.bool_]], number: int) -> Fragment:
    observations = [
        Observation(cloud=one.cloud, rows=one.rows[rows])
        for one, rows in zip(fragment.observations, chosen, strict=True)
        if rows.any()
    ]
    return replace(fragment, observations=tuple(observations), part=number)
