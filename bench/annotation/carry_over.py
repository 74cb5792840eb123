"""Decisions kept when proposals are made anew, and those of two reviewers as one review."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from itertools import count

import numpy as np
from scipy.optimize import linear_sum_assignment
from shapely.geometry import Polygon

from bench.annotation.decisions import Motion, ReviewedTrack, after, applied, in_force, motion_of, opening
from bench.annotation.store import BoxState, Decision, Draw, Reject, Reopen, Review, StoredTrack, merged_spans
from bench.errors import UsageError

SIZE_M = 0.3  # two reviewers' boxes of one object have sides as long as this
LEAST_IOU = 0.5  # of outlines seen from above, added up over time, from which on two tracks are the same


def carry_over(old: Review, new: Review) -> Review:
    """Give new proposals the decisions in force of older ones.

    Where a track is the same, by IoU of its boxes over time, its decisions go to the new one. A track that was decided
    on is kept as it was, unless it was only rejected, where it has no equal among the new ones, or where a decision
    cannot be carried out on its equal, such as a split at a time that the new track does not reach. New proposals that
    a reviewer has drawn already are left out. What was watched stays watched where the data are the same.

    Args:
        old: with decisions.
        new: proposals of the same recording, without decisions.

    Returns:
        `new` with the decisions; those that were taken back are gone.

    Raises:
        UsageError: old decisions that cannot be carried out, on their own tracks neither.
    """
    decisions = in_force(old.decisions)
    same = _same(old.tracks, new.tracks)
    drawn = [decision.drawn for decision in decisions if isinstance(decision, Draw)]
    unmatched = [track for track in new.tracks if track.id not in same.values()]
    known = set(_same(drawn, unmatched).values())
    while True:
        carried, names = _carried(old, new.with_tracks(t for t in new.tracks if t.id not in known), decisions, same)
        refused = _refused(carried)
        if not refused:
            return carried
        replaced = [track_id for track_id in same if names[track_id] in refused]
        if not replaced:
            applied(carried)  # raises: the old review could not be carried out either
        for track_id in replaced:
            known.add(same.pop(track_id))  # the reviewer's track takes the place of its equal


def merge_reviews(a: Review, b: Review) -> Review:
    """Put two reviewers' reviews of a drive together; where they differ, somebody has to decide again.

    Args:
        a: whose proposals and decisions are kept.
        b: of the same drive, perhaps of other proposals.

    Returns:
        `a`, in which every track is undecided whose equal in `b`, by IoU of its boxes over time, has another status,
        class, kind of motion or size, or that has none; and in which tracks of `b` without an equal are drawn. What
        either watched counts as watched.

    Raises:
        UsageError: reviews of different drives, or decisions that cannot be carried out.
    """
    if a.recording != b.recording:
        raise UsageError(f"merged reviews: expected two of one drive, got {a.recording!r} and {b.recording!r}")
    mine, theirs = ({track.id: track for track in applied(one) if track.status != "rejected"} for one in (a, b))
    same = _same(map(_as_drawn, mine.values()), map(_as_drawn, theirs.values()))
    differ = [name for name, track in mine.items() if name not in same or not _agree(track, theirs[same[name]])]
    drawn = [_as_drawn(track) for name, track in theirs.items() if name not in same.values()]
    taken = {track.id for track in a.tracks} | {track.id for track in applied(a)}
    free = (name for number in count() if (name := f"m{number:03d}") not in taken)
    made = {"made_at": datetime.now(UTC), "reviewer": "merged"}
    decisions = [Draw(drawn=track.model_copy(update={"id": next(free)}), **made) for track in drawn]
    reopened = [Reopen(tracks=(*differ, *(draw.drawn.id for draw in decisions)), **made)] if differ or drawn else []
    return a.model_copy(
        update={
            "decisions": (*a.decisions, *decisions, *reopened),
            "watched_ns": merged_spans([*a.watched_ns, *b.watched_ns]),
        }
    )


def _agree(a: ReviewedTrack, b: ReviewedTrack) -> bool:
    told = [(track.status, track.object_class, track.category, track.unclear) for track in (a, b)]
    return told[0] == told[1] and bool(np.abs(a.size_m - b.size_m).max() <= SIZE_M)


def _as_drawn(track: ReviewedTrack) -> StoredTrack:
    """A track as it stands, as a reviewer's own."""
    motion = track.motion
    rows = zip(motion.times_ns, motion.centres_m, motion.yaws_rad, motion.velocities_mps, strict=True)
    return StoredTrack(
        id=track.id,
        source="drawn",
        object_class=track.object_class,
        category=track.category,
        unclear=track.unclear,
        size_m=tuple(track.size_m.tolist()),
        points_median=track.points_median,
        states=tuple(
            BoxState(timestamp_ns=int(time), centre_m=centre.tolist(), yaw_rad=float(yaw), velocity_mps=way.tolist())
            for time, centre, yaw, way in rows
        ),
    )


def _carried(
    old: Review, new: Review, decisions: Sequence[Decision], same: Mapping[str, str]
) -> tuple[Review, dict[str, str]]:
    """The new review with old tracks that have no equal, and the names that old tracks have in it."""
    names = dict(same)
    wanted = {_root(name) for one in decisions if not isinstance(one, Reject) for name in _named(one)}
    names |= {decision.drawn.id: decision.drawn.id for decision in decisions if isinstance(decision, Draw)}
    taken = {track.id for track in new.tracks} | set(names.values())
    kept = []
    for track in old.tracks:
        if track.id in wanted and track.id not in names:
            names[track.id] = next(name for i in range(len(taken) + 1) if (name := _kept_id(track.id, i)) not in taken)
            taken.add(names[track.id])
            kept.append(track.model_copy(update={"id": names[track.id]}))
    carried = new.model_copy(
        update={
            "tracks": (*new.tracks, *kept),
            "decisions": tuple(told for one in decisions if (told := _renamed(one, names)) is not None),
            "watched_ns": old.watched_ns if old.proposed and old.proposed.data == _data(new) else new.watched_ns,
        }
    )
    return carried, names


def _refused(review: Review) -> set[str]:
    """Tracks that the first decision that cannot be carried out is about; none where all can."""
    state = opening(review)
    for decision in review.decisions:
        try:
            state = after(state, decision)
        except UsageError:
            return {_root(name) for name in _named(decision)}
    return set()


def tracks_iou(a: StoredTrack, b: StoredTrack) -> float:
    """Intersection over union of two tracks' outlines seen from above, added up over the times of both."""
    of_a, of_b = motion_of(a.states), motion_of(b.states)
    _, rows_a, rows_b = np.intersect1d(of_a.times_ns, of_b.times_ns, return_indices=True)
    shared = sum(
        _outline(of_a, i, a.size_m).intersection(_outline(of_b, j, b.size_m)).area
        for i, j in zip(rows_a, rows_b, strict=True)
    )
    both = len(of_a) * a.size_m[0] * a.size_m[1] + len(of_b) * b.size_m[0] * b.size_m[1]
    return float(shared / (both - shared))


def _outline(motion: Motion, row: int, size_m: tuple[float, float, float]) -> Polygon:
    cos, sin = np.cos(motion.yaws_rad[row]), np.sin(motion.yaws_rad[row])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(size_m[:2]) / 2
    return Polygon(corners @ np.array([[cos, sin], [-sin, cos]]) + motion.centres_m[row, :2])


def _same(old: Iterable[StoredTrack], new: Iterable[StoredTrack]) -> dict[str, str]:
    """Pairs of ids, each at most once, with the largest sum of IoU."""
    rows, columns = tuple(old), tuple(new)
    ious = np.zeros((len(rows), len(columns)))
    for i, a in enumerate(rows):
        for j, b in enumerate(columns):
            if max(a.states[0].timestamp_ns, b.states[0].timestamp_ns) <= min(
                a.states[-1].timestamp_ns, b.states[-1].timestamp_ns
            ):
                ious[i, j] = tracks_iou(a, b)
    pairs = zip(*linear_sum_assignment(ious, maximize=True), strict=True)
    return {rows[i].id: columns[j].id for i, j in pairs if ious[i, j] >= LEAST_IOU}


def _root(name: str) -> str:
    """The id before any split."""
    return name.partition(".")[0]


def _kept_id(name: str, number: int) -> str:
    return name if number == 0 else f"{name}-{number}"


def _named(decision: Decision) -> tuple[str, ...]:
    if isinstance(decision, Draw):
        return (decision.drawn.id,)
    return getattr(decision, "tracks", None) or (getattr(decision, "track", ""),)


def _renamed(decision: Decision, names: Mapping[str, str]) -> Decision | None:
    """The decision about the tracks under their new names; None where none of them is left."""

    def renamed(name: str) -> str:
        root, dot, rest = name.partition(".")
        return f"{names.get(root, root)}{dot}{rest}"

    if isinstance(decision, Draw):
        return decision
    if isinstance(decision, Reject):
        left = tuple(renamed(name) for name in decision.tracks if _root(name) in names)
        return decision.model_copy(update={"tracks": left}) if left else None
    if tracks := getattr(decision, "tracks", ()):
        return decision.model_copy(update={"tracks": tuple(renamed(name) for name in tracks)})
    return decision.model_copy(update={"track": renamed(getattr(decision, "track", ""))})


def _data(review: Review) -> str | None:
    return review.proposed.data if review.proposed else None
