"""Decisions kept when proposals are made anew."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment
from shapely.geometry import Polygon

from bench.annotation.decisions import Motion, in_force, motion_of
from bench.annotation.store import Decision, Draw, Reject, Review, StoredTrack

LEAST_IOU = 0.5  # of outlines seen from above, added up over time, from which on two tracks are the same


def carry_over(old: Review, new: Review) -> Review:
    """Give new proposals the decisions in force of older ones.

    Where a track is the same, by IoU of its boxes over time, its decisions go to the new one. A track that was decided
    on and has no equal among the new ones is kept as it was, unless it was only rejected. New proposals that a
    reviewer has drawn already are left out. What was watched stays watched where the data are the same.

    Args:
        old: with decisions.
        new: proposals of the same recording, without decisions.

    Returns:
        `new` with the decisions; those that were taken back are gone.
    """
    decisions = in_force(old.decisions)
    names = _same(old.tracks, new.tracks)
    drawn = [decision.drawn for decision in decisions if isinstance(decision, Draw)]
    twice = set(_same(drawn, [track for track in new.tracks if track.id not in names.values()]).values())
    wanted = {_root(name) for one in decisions if not isinstance(one, Reject) for name in _named(one)}
    kept = []
    taken = {track.id for track in new.tracks} | {track.id for track in drawn}
    for track in old.tracks:
        if track.id in wanted and track.id not in names:
            names[track.id] = next(name for i in range(len(taken) + 1) if (name := _kept_id(track.id, i)) not in taken)
            taken.add(names[track.id])
            kept.append(track.model_copy(update={"id": names[track.id]}))
    names |= {track.id: track.id for track in drawn}
    return new.model_copy(
        update={
            "tracks": (*(track for track in new.tracks if track.id not in twice), *kept),
            "decisions": tuple(told for one in decisions if (told := _renamed(one, names)) is not None),
            "watched_ns": old.watched_ns if old.proposed and old.proposed.data == _data(new) else new.watched_ns,
        }
    )


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
        return f"{names[root]}{dot}{rest}"

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
