"""Reviews of drives: proposed, made anew with the decisions kept, and compared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment
from shapely.geometry import Polygon

from bench.annotation import store
from bench.annotation.decisions import Motion, ReviewedTrack, State, applied, history, opening, to_tracks, undecided
from bench.annotation.evaluate import evaluate_proposals
from bench.annotation.proposals import propose
from bench.errors import BenchError, OutputError, UsageError
from bench.execution import FailedTask, Progress, TaskExecutor, compute_all
from bench.harness.digests import REFERENCE_CODE, code_digest, digest_ego_motion, digest_of, digest_sweeps
from bench.recordings import Recording, RecordingHandle
from bench.records.recording import COMPLETELY

MODULES = ("boxes", "free_space", "prepared", "proposals", "settings", "tracking")
CODE = (*REFERENCE_CODE, *(f"annotation/{name}.py" for name in MODULES))
# Decisions that leave the boxes as they are.
DESCRIBING = (store.Judge, store.SetClass, store.SetUnclear, store.SetCategory)
SIZE_M = 0.3  # two reviewers' boxes of one object have sides as long as this
LEAST_IOU = 0.5  # of outlines seen from above, added up over time, from which on two tracks are the same


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposedDrive:
    """Result of proposing the objects of a recording.

    Attributes:
        name: of the recording.
        objects: proposals in its file.
        doubted: those with a doubt.
        computed: False where the file held the proposals of the same data and code.
        failure: why there are none; empty where there are.
    """

    name: str
    objects: int = 0
    doubted: int = 0
    computed: bool = True
    failure: str = ""


def propose_drives(
    dataset: str,
    handles: Sequence[RecordingHandle],
    folder: Path,
    *,
    executor: TaskExecutor,
    progress: Progress = lambda _done, _total: None,
) -> tuple[ProposedDrive, ...]:
    """Propose the moving objects of recordings and store each drive's when it is done.

    Decisions of a reviewer stay with the tracks that are the same.

    Args:
        dataset: name of the data set.
        handles: the recordings.
        folder: of the review files.
        executor: computes a recording at a time on each worker.
        progress: called with recordings done and their number.

    Returns:
        What became of each, in the order of `handles`.

    Raises:
        OutputError: a file cannot be written.
    """
    progress(0, len(handles))
    drives = compute_all(executor, partial(propose_drive, dataset, folder), handles, progress=progress)
    return tuple(
        ProposedDrive(name=handle.name, failure=drive.reason) if isinstance(drive, FailedTask) else drive
        for handle, drive in zip(handles, drives, strict=True)
    )


def propose_drive(dataset: str, folder: Path, handle: RecordingHandle) -> ProposedDrive:
    """Propose the moving objects of one recording; see `propose_drives`."""
    file = store.review_file(folder, handle.name)
    try:
        recording = handle.open()
        made_from = proposal_digests(recording)
        stored = store.read_review(file) if file.exists() else None
        computed = stored is None or stored.proposed != made_from
        if computed:
            made = store.Review(dataset=dataset, recording=handle.name, proposed=made_from, tracks=propose(recording))
            stored = made if stored is None else carry_over(stored, made)
            store.write_review(file, stored)
    except BenchError as error:
        return ProposedDrive(name=handle.name, failure=str(error))
    assert stored is not None
    doubted = sum(bool(track.doubts) for track in opening(stored).values())
    return ProposedDrive(name=handle.name, objects=len(stored.tracks), doubted=doubted, computed=computed)


def proposal_digests(recording: Recording) -> store.Proposed:
    """Digests of the sweeps, ego-motion and calibration of a recording, and of the code that finds what moves."""
    cameras = {name: digest_of(camera) for name, camera in recording.cameras.items()}  # they tell where the road is
    data = digest_of(digest_ego_motion(recording), cameras, recording.vehicle_outline_m, digest_sweeps(recording))
    return store.Proposed(data=data, code=code_digest(CODE))


def evaluate_drives(
    handles: Sequence[RecordingHandle],
    folder: Path,
    *,
    against: Path | None = None,
    executor: TaskExecutor,
    progress: Progress = lambda _done, _total: None,
) -> tuple[pd.DataFrame, float]:
    """Compare stored proposals with annotations; those that a reviewer rejected are left out, corrections count.

    Args:
        handles: recordings with a review file and annotations.
        folder: of the review files.
        against: of another reviewer's, with which they are compared in place of the annotations.
        executor: computes a recording at a time on each worker.
        progress: called with recordings done and their number.

    Returns:
        Rows of `evaluate_proposals`, and the minutes that the sweeps took.

    Raises:
        DataError: a review file that is missing or damaged, or a recording that cannot be read.
        UsageError: a recording without annotations, or a worker that ended.
    """
    frames, minutes = list[pd.DataFrame](), 0.0
    evaluated = compute_all(executor, partial(_evaluate_drive, folder, against), handles, progress=progress)
    for handle, outcome in zip(handles, evaluated, strict=True):
        if isinstance(outcome, FailedTask):
            raise UsageError(f"{handle.name}: {outcome.reason}")
        frames.append(outcome[0])
        minutes += outcome[1]
    return pd.concat(frames, ignore_index=True), minutes


def _evaluate_drive(folder: Path, against: Path | None, handle: RecordingHandle) -> tuple[pd.DataFrame, float]:
    review = store.read_review(store.review_file(folder, handle.name))
    recording = handle.open()
    if against is not None:
        other = to_tracks(store.read_review(store.review_file(against, handle.name)), recording, unreviewed=True)
        recording = replace(recording, tracks=other, annotated=COMPLETELY)
    frames = evaluate_proposals(recording, to_tracks(review, recording, unreviewed=True))
    times_ns = [ref.timestamp_ns for ref in recording.sweeps]
    return frames, (times_ns[-1] - times_ns[0]) / 60e9 if times_ns else 0.0


def merge_drives(names: Iterable[str], folder: Path, against: Path, out: Path) -> list[Path]:
    """Write two reviewers' reviews of drives as one each; see `merge_reviews`.

    Args:
        names: of the recordings.
        folder: of the review files that are kept where both agree.
        against: of the other reviewer's.
        out: of the merged files; none is replaced.

    Raises:
        DataError: a review file that is missing or damaged.
        OutputError: a file is there already, or cannot be written.
    """
    files = [store.review_file(out, name) for name in names]
    for file in files:
        if file.exists():
            raise OutputError(file, got="a review that is there already", hint="give another folder")
    for file in files:
        sides = [store.read_review(place / file.name) for place in (folder, against)]
        store.write_review(file, merge_reviews(*sides))
    return files


def merge_reviews(a: store.Review, b: store.Review) -> store.Review:
    """Put two reviewers' reviews of a drive together; where they differ, somebody has to decide again.

    Args:
        a: whose proposals and decisions are kept.
        b: of the same drive, perhaps of other proposals.

    Returns:
        `a`, in which every track is undecided whose equal in `b`, by IoU of its boxes over time, has another status,
        class, kind of motion or size, or that has none; and in which tracks of `b` without an equal are drawn. What
        either watched counts as watched.

    Raises:
        UsageError: decisions that cannot be carried out.
    """
    mine, theirs = (
        {name: track for name, track in applied(review).items() if track.status != "rejected"} for review in (a, b)
    )
    same = _same(mine, theirs)
    differ = [name for name, track in mine.items() if name not in same or not _agree(track, theirs[same[name]])]
    made = {"made_at": datetime.now(UTC), "reviewer": "merged"}
    taken = {track.id for track in a.tracks} | applied(a).keys()
    free = (name for number in count() if (name := f"m{number:03d}") not in taken)
    missing = [track for name, track in theirs.items() if name not in same.values()]
    drawn = [store.Draw(drawn=_as_drawn(track, next(free)), **made) for track in missing]
    names = (*differ, *(draw.drawn.id for draw in drawn))
    reopened = [store.Judge(action="reopen", tracks=names, **made)] if names else []
    return a.model_copy(update={"decisions": (*a.decisions, *drawn, *reopened)}).watched(b.watched_ns)


def _agree(a: ReviewedTrack, b: ReviewedTrack) -> bool:
    told = [(track.status, track.object_class, track.category, track.unclear) for track in (a, b)]
    return told[0] == told[1] and bool(np.abs(a.size_m - b.size_m).max() <= SIZE_M)


def _as_drawn(track: ReviewedTrack, name: str) -> store.StoredTrack:
    """A track as it stands, as a reviewer's own."""
    motion = track.motion
    return store.StoredTrack(
        id=name,
        object_class=track.object_class,
        category=track.category,
        unclear=track.unclear,
        size_m=tuple(track.size_m.tolist()),
        points_median=track.points_median,
        states=store.box_states(motion.times_ns, motion.centres_m, motion.yaws_rad, motion.velocities_mps),
    )


def carry_over(old: store.Review, new: store.Review) -> store.Review:
    """Give new proposals the decisions in force of older ones.

    Where a track is the same, by IoU of its boxes over time, its status, class, kind of motion and unclear go to the
    new one. A track that a reviewer corrected, cut or merged, or that has no equal and was not only rejected, is kept
    as it was; it and what was drawn take the place of their equals. What was watched stays watched where the data are
    the same.

    Args:
        old: with decisions.
        new: proposals of the same recording, without decisions.

    Returns:
        `new` with the decisions; those that were taken back are gone.

    Raises:
        UsageError: old decisions that cannot be carried out.
    """
    decisions, _ = history(old.decisions)
    shaped = {_root(name) for told in decisions if not isinstance(told, DESCRIBING) for name in _named(told)}
    judged = {_root(name) for told in decisions if not _rejects(told) for name in _named(told)}
    drawn = [decision.drawn for decision in decisions if isinstance(decision, store.Draw)]
    before, proposed = opening(old), opening(new)
    same = _same(before, proposed)
    replaced = {same[name] for name in same if name in shaped}
    left = {name: track for name, track in proposed.items() if name not in same.values()}
    replaced |= set(_same({track.id: undecided(track) for track in drawn}, left).values())
    names = {name: other for name, other in same.items() if name not in shaped} | {
        track.id: track.id for track in drawn
    }
    tracks = [track for track in new.tracks if track.id not in replaced]
    taken = {track.id for track in tracks} | {track.id for track in drawn}
    for track in old.tracks:
        if track.id in judged and track.id not in names:
            free = (f"{track.id}-{number}" if number else track.id for number in count())
            names[track.id] = next(name for name in free if name not in taken)
            taken.add(names[track.id])
            tracks.append(track.model_copy(update={"id": names[track.id]}))
    moved = (renamed for decision in decisions if (renamed := _renamed(decision, names)) is not None)
    carried = new.model_copy(update={"tracks": tuple(tracks), "decisions": tuple(moved)})
    applied(carried)  # raises where the old review could not be carried out either
    same_data = old.proposed is not None and new.proposed is not None and old.proposed.data == new.proposed.data
    return carried.watched(old.watched_ns) if same_data else carried


def _same(old: State, new: State) -> dict[str, str]:
    """Pairs of ids, each at most once, with the largest sum of IoU."""
    ious = np.array([[tracks_iou(a, b) for b in new.values()] for a in old.values()]).reshape(len(old), len(new))
    names, others = list(old), list(new)
    pairs = zip(*linear_sum_assignment(ious, maximize=True), strict=True)
    return {names[i]: others[j] for i, j in pairs if ious[i, j] >= LEAST_IOU}


def tracks_iou(a: ReviewedTrack, b: ReviewedTrack) -> float:
    """Intersection over union of two tracks' outlines seen from above, added up over the times of both."""
    _, rows_a, rows_b = np.intersect1d(a.motion.times_ns, b.motion.times_ns, return_indices=True)
    shared = sum(
        _outline(a.motion, i, a.size_m).intersection(_outline(b.motion, j, b.size_m)).area
        for i, j in zip(rows_a, rows_b, strict=True)
    )
    both = sum(len(track.motion) * track.size_m[0] * track.size_m[1] for track in (a, b))
    return float(shared / (both - shared))


def _outline(motion: Motion, row: int, size_m: np.ndarray) -> Polygon:
    cos, sin = np.cos(motion.yaws_rad[row]), np.sin(motion.yaws_rad[row])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * size_m[:2] / 2
    return Polygon(corners @ np.array([[cos, sin], [-sin, cos]]) + motion.centres_m[row, :2])


def _root(name: str) -> str:
    """The id before any split."""
    return name.partition(".")[0]


def _rejects(decision: store.Decision) -> bool:
    return isinstance(decision, store.Judge) and decision.action == "reject"


def _named(decision: store.Decision) -> tuple[str, ...]:
    if isinstance(decision, store.Draw):
        return (decision.drawn.id,)
    return getattr(decision, "tracks", None) or (getattr(decision, "track", ""),)


def _renamed(decision: store.Decision, names: Mapping[str, str]) -> store.Decision | None:
    """The decision about the tracks under their new names; None where none of them is left."""
    if isinstance(decision, store.Draw):
        return decision
    told = [name for name in _named(decision) if not _rejects(decision) or _root(name) in names]
    renamed = [f"{names.get(_root(name), _root(name))}{name.removeprefix(_root(name))}" for name in told]
    if not renamed:
        return None
    return decision.model_copy(
        update={"tracks": tuple(renamed)} if hasattr(decision, "tracks") else {"track": renamed[0]}
    )
