"""Recordings to audit, with their exact masks; the same work for each, and what every audit stores of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from bench.errors import DataError
from bench.execution import FailedTask, Progress, TaskExecutor, compute_all
from bench.harness.digests import digest_of, digest_recording
from bench.harness.manifest import CodeOfRun
from bench.harness.stored import Provenance, provenance_since
from bench.recordings import DatasetCard, Recording, RecordingHandle, open_dataset
from bench.records.reference import IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.scenario import RecordingSpec

Found = TypeVar("Found")
_Audited = tuple[Found, str, int, list[str]]  # what the work found, digest of the data, images used, problems


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditSource:
    """One recording; it travels to other processes.

    Attributes:
        recorded: as the benchmark reads it.
        exact: the same with the true calibration; None where the card names no scenario.
        scene: the scenario that it was rendered from, and its part there; None where it is not in the card's scenario.
    """

    recorded: RecordingHandle
    exact: RecordingHandle | None = None
    scene: tuple[Scenario, RecordingSpec] | None = None


def audit_sources(card: DatasetCard, *, split: str | None, recordings: int | None) -> tuple[AuditSource, ...]:
    """The recordings of an audit.

    Args:
        card: the data set.
        split: of it; None for all.
        recordings: how many, spread evenly over the split so that a few still show every kind of drive; None for all.

    Raises:
        DataError: the data set or its scenario cannot be read.
    """
    every = open_dataset(card, split)
    count = len(every) if recordings is None else min(recordings, len(every))
    handles = [every[k * len(every) // count] for k in range(count)]
    if card.scenario is None:
        return tuple(AuditSource(recorded=handle) for handle in handles)
    scenario = read_scenario(card.scenario)
    scenes = {spec.name: (scenario, spec) for spec in scenario.recordings}
    options = {**card.content.options, "calibration": "exact"}
    exact_card = replace(card, content=card.content.model_copy(update={"options": options}))
    exact = {handle.name: handle for handle in open_dataset(exact_card, split)}
    return tuple(
        AuditSource(recorded=handle, exact=exact[handle.name], scene=scenes.get(handle.name)) for handle in handles
    )


@dataclass(slots=True, kw_only=True, eq=False)
class OpenedSource:
    """A recording that is audited.

    Attributes:
        source: where it is from.
        recording: as the benchmark reads it.
        instance_of: instance id by track, -1 (which no pixel has) for a track that truth images do not know.
        images: that were used; counted by the work.
        problems: one line per image that could not be used; added by the work.
    """

    source: AuditSource
    recording: Recording
    instance_of: Mapping[str, int]
    images: int = 0
    problems: list[str] = field(default_factory=list)


class AuditModel(BaseModel):
    """A record that an audit stores."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class StoredAudit(AuditModel):
    """The part that every audit stores.

    Attributes:
        schema_version: of the file.
        dataset: name of the data set.
        card: its file, as it was named.
        split: of it; None for all.
        recordings: that were used.
        images: that were used.
        failures: one line per recording or image that could not be used.
        data: digest of the recordings' data.
        code: of this package, and its libraries.
        provenance: how the audit came about.
    """

    schema_version: int = 1
    dataset: str
    card: str
    split: str | None
    recordings: int
    images: int
    failures: tuple[str, ...]
    data: str
    code: CodeOfRun
    provenance: Provenance


def audit_each(
    work: Callable[[OpenedSource], Found],
    *,
    card: DatasetCard,
    split: str | None,
    recordings: int | None,
    executor: TaskExecutor,
    progress: Progress | None,
) -> tuple[list[Found], StoredAudit]:
    """Do the same with every recording.

    Args:
        work: a function of a module, or a partial of one; its `DataError` is the failure of the recording.
        card: the data set, rendered.
        split: of it; None for all.
        recordings: how many of them; None for all.
        executor: does the work; the result does not depend on it.
        progress: called with the recordings done and their number.

    Returns:
        found: of the recordings that could be used, in the order of the data set.
        stored: what every audit stores.

    Raises:
        DataError: none could be used; the first one's own error, which says what to do, where there is one.
    """
    start_s = perf_counter()
    sources = audit_sources(card, split=split, recordings=recordings)
    outcomes = compute_all(executor, partial(_done, work=work), sources, progress=progress)
    audited = [outcome for outcome in outcomes if isinstance(outcome, tuple)]
    failures = [
        f"recording {source.recorded.name!r}: {outcome.reason if isinstance(outcome, FailedTask) else outcome}"
        for source, outcome in zip(sources, outcomes, strict=True)
        if not isinstance(outcome, tuple)
    ]
    if not audited:
        mistakes = (outcome for outcome in outcomes if isinstance(outcome, DataError))
        got = "; ".join(failures) or "none"
        raise next(mistakes, DataError(card.file, expected="a recording that can be audited", got=got))
    found, digests, counts, problems = zip(*audited, strict=True)
    images = sum(counts)
    return [*found], StoredAudit(
        dataset=card.name,
        card=str(card.file),
        split=split,
        recordings=len(audited),
        images=images,
        failures=(*failures, *chain.from_iterable(problems)),
        data=digest_of(sorted(digests)),
        code=CodeOfRun.here(),
        provenance=provenance_since(start_s, images=images),
    )


def _done(source: AuditSource, *, work: Callable[[OpenedSource], Found]) -> _Audited[Found] | DataError:
    """Return the result of the work, or the user's mistake that prevents it; a bug is raised."""
    try:
        recording = source.recorded.open()
        if not any(image.truth_path for images in recording.images.values() for image in images):
            raise DataError(
                recording.root,
                expected="rendered masks (truth/<camera>/<timestamp_ns>.png), against which an audit compares",
                got="a recording without",
                hint="audit a rendered data set, for example demo",
            )
        digest = digest_recording(recording)
        instance_of = {track.track_id: track.instance_id or -1 for track in recording.tracks}
        opened = OpenedSource(source=source, recording=recording, instance_of=instance_of)
        return work(opened), digest, opened.images, opened.problems
    except DataError as error:
        return error


def same_objects(
    by_lidar: Sequence[ReferenceFrame], ids: NDArray[np.uint16], instance_of: Mapping[str, int]
) -> tuple[ReferenceFrame, ...]:
    """References of one image that differ in their regions alone; the exact masks make the last one.

    An object is evaluated in all of them or in none. Ignored are those that a lidar reference does not evaluate, and
    those of which the camera sees no pixel, which a mask cannot score (as occluded). Category and reason of every other
    object are the first lidar reference's.

    Args:
        by_lidar: at least one, of the same annotations.
        ids: (H, W) uint16, the image's true instance ids.
        instance_of: instance id by track.

    Returns:
        The lidar references, and the one whose regions G and I are the exact masks in V.
    """
    first = by_lidar[0]
    shown = ids.astype(np.int32)
    masks = {item.track_id: (shown == instance_of[item.track_id]) & first.valid for item in first.objects}
    evaluated = {track_id for track_id, mask in masks.items() if mask.any()}
    for reference in by_lidar:
        evaluated &= {item.track_id for item in reference.objects if item.status is Status.EVALUATED}
    same = [_evaluating(reference, evaluated) for reference in by_lidar]
    labels, ignored = np.zeros_like(first.labels), np.zeros_like(first.ignored)
    objects: list[ReferenceObject] = []
    for number, item in enumerate(same[0].objects, start=1):
        mask = masks[item.track_id]
        if item.status is Status.EVALUATED:
            labels[mask] = number
            item = replace(item, region_px=int(np.count_nonzero(mask)), unknown_px=0)
        elif item.status is Status.IGNORED:
            ignored |= mask
        objects.append(item)
    none = np.zeros_like(ignored)
    exact = replace(first, objects=tuple(objects), labels=labels, ignored=ignored, unknown=none, left_out=none)
    return (*same, exact)


def _evaluating(reference: ReferenceFrame, evaluated: Set[str]) -> ReferenceFrame:
    """The reference with its other evaluated objects ignored, their regions among the ignored ones."""
    objects = list(reference.objects)
    others = [k for k, item in enumerate(objects) if item.status is Status.EVALUATED and item.track_id not in evaluated]
    if not others:
        return reference
    for k in others:
        objects[k] = replace(objects[k], status=Status.IGNORED, reason=IgnoreReason.OCCLUDED, region_px=0, unknown_px=0)
    regions = np.isin(reference.labels, np.array(others) + 1)
    return replace(
        reference,
        objects=tuple(objects),
        labels=np.where(regions, 0, reference.labels),
        ignored=reference.ignored | regions,
    )
