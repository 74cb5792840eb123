"""Everything that looks wrong in the recordings of a data set."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from operator import attrgetter
from typing import Literal

import numpy as np
from pydantic import computed_field

from bench.atomic import read_regular
from bench.errors import BenchError, DataError
from bench.recordings import Recording, RecordingHandle
from bench.recordings.validation import FileModel
from bench.records.recording import Content
from bench.validation.findings import (
    Finding,
    Severity,
    Undecided,
    annotation_file,
    calibration_file,
    causes,
    new_finding,
    unusable,
)
from bench.validation.fits.box_fit import BoxFit, check_unboxed
from bench.validation.fits.cameras import check_cameras
from bench.validation.fits.static_world import check_static_world
from bench.validation.quick.boxes import check_annotated, check_boxes
from bench.validation.quick.calibration import check_calibration, check_length_units
from bench.validation.quick.motion import check_ego_limits, check_motion
from bench.validation.quick.sensors import check_images, check_sweeps
from bench.validation.quick.times import check_annotation_times, check_clocks, check_coverage, check_time_units

SAMPLED_IMAGES, NEIGHBOURING_IMAGES = 120, 6  # of each camera, in runs of so many
SAMPLED_SWEEPS, NEIGHBOURING_SWEEPS = 24, 2
LARGEST_COMPARED_BYTES = 100_000_000  # of an image or a sweep; larger files hold whole drives


class Count(FileModel):
    """Number of those that were read, and of all."""

    read: int = 0
    all: int = 0


class RecordingReport(FileModel):
    """One recording.

    Attributes:
        name: of the recording.
        images: of all cameras.
        sweeps: of the lidar.
        undecided: quantities that the recording cannot tell.
        contents: what is in its files, read and not read.
        findings: errors first, in the order in which they were found; causes before their possible consequences.
    """

    name: str
    images: Count = Count()
    sweeps: Count = Count()
    undecided: tuple[Undecided, ...] = ()
    contents: tuple[Content, ...] = ()
    findings: tuple[Finding, ...]


Check = Callable[[Recording], Iterator[Finding | Undecided]]
# Each with the file of findings that name none.
CHECKS: tuple[tuple[Check, Callable[[Recording], object]], ...] = (
    (check_time_units, attrgetter("root")),
    (check_length_units, attrgetter("root")),
    (check_calibration, calibration_file),
    (check_clocks, attrgetter("root")),
    (check_coverage, attrgetter("root")),
    (check_ego_limits, attrgetter("trajectory.source")),
    (check_static_world, attrgetter("trajectory.source")),
    (check_annotated, annotation_file),
    (check_annotation_times, annotation_file),
    (check_boxes, annotation_file),
    (check_motion, annotation_file),
    (check_cameras, calibration_file),
)


def validate_recording(
    handle: RecordingHandle, *, deep: bool = False, progress: Callable[[float], None] = lambda _: None
) -> RecordingReport:
    """Find all that is wrong with a recording.

    Args:
        handle: the recording.
        deep: read every image and sweep, not a sample.
        progress: called with the share that is done, 0 to 1.
    """
    try:
        recording = handle.open()
    except DataError as error:
        faults = (unusable(each) for each in (error, *error.others))
        return RecordingReport(name=handle.name, findings=_ordered(faults, handle.name))
    findings: list[Finding] = []
    others: list[Undecided | Content] = [*recording.contents]

    def add(told: Iterable[Finding | Undecided | Content], file: object = "") -> None:
        for each in told:
            if isinstance(each, Finding):
                findings.append(replace(each, file=each.file or str(file)))
            else:
                others.append(each)

    for check, file in CHECKS:
        add(check(recording), file(recording))
    rows = {
        camera: _sampled(len(images), deep, SAMPLED_IMAGES, NEIGHBOURING_IMAGES)
        for camera, images in recording.images.items()
    }
    sweep_rows = _sampled(len(recording.sweeps), deep, SAMPLED_SWEEPS, NEIGHBOURING_SWEEPS)
    images = Count(read=sum(map(len, rows.values())), all=sum(map(len, recording.images.values())))
    steps = count(1)

    def step() -> None:
        progress(next(steps) / (images.read + len(sweep_rows)))

    for camera in recording.cameras:
        add(check_images(recording, camera, rows[camera], step))
    box_fit = BoxFit(recording)
    add(check_sweeps(recording, sweep_rows, box_fit.add, step))
    for content in recording.contents:
        if content.suspect:
            got = f"{content.count} that are passed over: {content.why}"
            add([new_finding("not-read", got, file=recording.root, field=content.what, times=content.count)])
    add(box_fit.findings(), annotation_file(recording))
    if not any(finding.severity is Severity.ERROR for finding in findings):
        # By wrong calibration or boxes nothing would have its box.
        add(check_unboxed(recording), annotation_file(recording))
    return RecordingReport(
        name=handle.name,
        findings=_ordered(findings, handle.name),
        undecided=tuple(each for each in others if isinstance(each, Undecided)),
        contents=tuple(each for each in others if isinstance(each, Content)),
        images=images,
        sweeps=Count(read=len(sweep_rows), all=len(recording.sweeps)),
    )


def _ordered(findings: Iterable[Finding], recording: str) -> tuple[Finding, ...]:
    """Errors first; findings that may follow from a cause that was found come last, as warnings."""
    ordered = [replace(finding, recording=recording) for finding in findings]
    for cause in causes():
        if any(finding.check in cause.known_by and finding.severity is Severity.ERROR for finding in ordered):
            hint = f"may follow from {cause.name}: correct that, validate again"
            consequences = [finding for finding in ordered if finding.check in cause.following]
            ordered = [finding for finding in ordered if finding.check not in cause.following]
            ordered += [replace(finding, severity=Severity.WARNING, hint=hint) for finding in consequences]
    return tuple(sorted(ordered, key=lambda finding: finding.severity is not Severity.ERROR))


def _sampled(count: int, deep: bool, most: int, run: int) -> list[int]:
    """Of so many files those that are read: all, or runs of neighbours spread over the drive."""
    if deep or count <= most:
        return list(range(count))
    firsts = np.linspace(0, count - run, most // run).round().astype(int)
    return sorted({int(first) + i for first in firsts for i in range(run)})


class ValidationReport(FileModel, extra="ignore"):
    """A data set, and its file; the counts in a file are not read back.

    Attributes:
        schema_version: of the file.
        dataset: name.
        recordings: in the order of the data set.
    """

    schema_version: Literal[1] = 1
    dataset: str
    recordings: tuple[RecordingReport, ...]

    @computed_field
    def errors(self) -> int:
        """Number of errors."""
        return self.count(Severity.ERROR)

    @computed_field
    def warnings(self) -> int:
        """Number of warnings."""
        return self.count(Severity.WARNING)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All of them."""
        return tuple(finding for recording in self.recordings for finding in recording.findings)

    def count(self, severity: Severity) -> int:
        """Number of findings of a severity."""
        return sum(finding.severity is severity for finding in self.findings)

    def as_json(self) -> str:
        """JSON text."""
        return json.dumps(self.model_dump(), indent=1, ensure_ascii=False) + "\n"


def validate_dataset(
    name: str,
    handles: Sequence[RecordingHandle],
    *,
    deep: bool = False,
    progress: Callable[[float, int], None] = lambda _done, _all: None,
) -> ValidationReport:
    """Validate recordings one after the other; memory does not grow with their number or length.

    Args:
        name: of the data set.
        handles: its recordings.
        deep: read every image and sweep, not a sample.
        progress: called with recordings done, fractions allowed, and their number.
    """
    reports = []
    first: dict[bytes, str] = {}
    for number, handle in enumerate(handles):

        def share_done(share: float, number: int = number) -> None:
            progress(number + share, len(handles))

        report = validate_recording(handle, deep=deep, progress=share_done)
        digest = _middle_digest(handle) if len(handles) > 1 else None
        if digest is not None and first.setdefault(digest, handle.name) != handle.name:
            got = f"the images and the sweep of {first[digest]!r} in the middle of it"
            same = replace(new_finding("same-drive", got), recording=handle.name)
            report = report.model_copy(update={"findings": (*report.findings, same)})
        reports.append(report)
        progress(number + 1, len(handles))
    return ValidationReport(dataset=name, recordings=tuple(reports))


def _middle_digest(handle: RecordingHandle) -> bytes | None:
    """SHA-256 of the middle image of each camera, and of the middle sweep; None where they cannot be read."""
    digest = hashlib.sha256()
    try:
        recording = handle.open()
        files = [[ref.path for ref in refs] for refs in recording.images.values()]
        for paths in filter(None, [*files, [sweep.path for sweep in recording.sweeps]]):
            digest.update(read_regular(paths[len(paths) // 2], largest_bytes=LARGEST_COMPARED_BYTES))
    except (BenchError, OSError):  # told by the checks of the recording, or one file of everything
        return None
    return digest.digest()
