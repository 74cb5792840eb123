"""Proposals of the drives of a data set: in workers, resumable, stored as review files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pandas as pd

from bench.annotation.carry_over import carry_over, merge_reviews
from bench.annotation.decisions import opening
from bench.annotation.evaluate import evaluate_proposals
from bench.annotation.export import to_tracks
from bench.annotation.proposals import Proposal, propose
from bench.annotation.store import (
    BoxState,
    Doubt,
    Proposed,
    Review,
    StoredTrack,
    read_review,
    review_file,
    write_review,
)
from bench.errors import BenchError, OutputError, UsageError
from bench.execution import FailedTask, TaskExecutor
from bench.harness.digests import REFERENCE_CODE, code_digest, digest_ego_motion, digest_of, digest_sweeps
from bench.recordings import Recording, RecordingHandle
from bench.records.recording import COMPLETELY

MODULES = (
    *("boxes", "free_space", "ground", "joining", "prepared", "proposals"),
    *("registration", "settings", "tracking"),
)
CODE = (*REFERENCE_CODE, *(f"annotation/{name}.py" for name in MODULES))


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
    progress: Callable[[float, int], None] = lambda _done, _total: None,
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
    done: dict[str, ProposedDrive] = {}
    progress(0, len(handles))
    for handle, result in executor.compute(partial(propose_drive, dataset, folder), handles):
        if isinstance(result, FailedTask):
            result = ProposedDrive(name=handle.name, failure=result.reason)
        done[handle.name] = result
        progress(len(done), len(handles))
    return tuple(done[handle.name] for handle in handles)


def propose_drive(dataset: str, folder: Path, handle: RecordingHandle) -> ProposedDrive:
    """Propose the moving objects of one recording; see `propose_drives`."""
    file = review_file(folder, handle.name)
    try:
        recording = handle.open()
        made_from = proposal_digests(recording)
        stored = read_review(file) if file.exists() else None
        computed = stored is None or stored.proposed != made_from
        if computed:
            tracks = tuple(stored_track(proposal) for proposal in propose(recording))
            made = Review(dataset=dataset, recording=handle.name, proposed=made_from, tracks=tracks)
            stored = made if stored is None else carry_over(stored, made)
            write_review(file, stored)
    except BenchError as error:
        return ProposedDrive(name=handle.name, failure=str(error))
    assert stored is not None
    doubted = sum(bool(track.doubts) for track in opening(stored).values())
    return ProposedDrive(name=handle.name, objects=len(stored.tracks), doubted=doubted, computed=computed)


def proposal_digests(recording: Recording) -> Proposed:
    """Digests of the sweeps, ego-motion and calibration of a recording, and of the code that finds what moves."""
    cameras = {name: digest_of(camera) for name, camera in recording.cameras.items()}  # they tell where the road is
    data = digest_of(digest_ego_motion(recording), cameras, recording.vehicle_outline_m, digest_sweeps(recording))
    return Proposed(data=data, code=code_digest(CODE))


def stored_track(proposal: Proposal) -> StoredTrack:
    """A proposal as a review file holds it."""
    rows = zip(proposal.timestamps_ns, proposal.centres_m, proposal.yaw_rad, proposal.velocity_mps, strict=True)
    return StoredTrack(
        id=proposal.track_id,
        source="proposed",
        object_class=proposal.object_class,
        size_m=tuple(proposal.size_m.tolist()),
        doubts=tuple(Doubt(reason=reason, value=value) for reason, value in proposal.doubts),
        points_median=float(proposal.points_median),
        states=tuple(
            BoxState(timestamp_ns=int(time), centre_m=centre.tolist(), yaw_rad=float(yaw), velocity_mps=way.tolist())
            for time, centre, yaw, way in rows
        ),
    )


def evaluate_drives(
    handles: Sequence[RecordingHandle],
    folder: Path,
    *,
    against: Path | None = None,
    executor: TaskExecutor,
    progress: Callable[[float, int], None] = lambda _done, _total: None,
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
    done: dict[str, tuple[pd.DataFrame, float]] = {}
    for handle, result in executor.compute(partial(_evaluate_drive, folder, against), handles):
        if isinstance(result, FailedTask):
            raise UsageError(f"{handle.name}: {result.reason}")
        done[handle.name] = result
        progress(len(done), len(handles))
    frames, minutes = zip(*(done[handle.name] for handle in handles), strict=True)
    return pd.concat(frames, ignore_index=True), float(sum(minutes))


def merge_drives(names: Iterable[str], folder: Path, against: Path, out: Path) -> tuple[Path, ...]:
    """Merge two reviewers' reviews of drives; see `merge_reviews`.

    Args:
        names: of the recordings.
        folder: of the review files that are kept where both agree.
        against: of the other reviewer's.
        out: of the merged files; none is replaced.

    Returns:
        The files.

    Raises:
        DataError: a review file that is missing or damaged.
        OutputError: a file is there already, or cannot be written.
    """
    files = [review_file(out, name) for name in names]
    for file in files:
        if file.exists():
            raise OutputError(file, got="a review that is there already", hint="give another folder")
    for file in files:
        write_review(file, merge_reviews(*(read_review(place / file.name) for place in (folder, against))))
    return tuple(files)


def _evaluate_drive(folder: Path, against: Path | None, handle: RecordingHandle) -> tuple[pd.DataFrame, float]:
    review = read_review(review_file(folder, handle.name))
    recording = handle.open()
    if against is not None:
        other = to_tracks(read_review(review_file(against, handle.name)), recording, unreviewed=True)
        recording = replace(recording, tracks=other, annotated=COMPLETELY)
    frames = evaluate_proposals(recording, to_tracks(review, recording, unreviewed=True))
    times_ns = [ref.timestamp_ns for ref in recording.sweeps]
    return frames, (times_ns[-1] - times_ns[0]) / 60e9 if times_ns else 0.0
