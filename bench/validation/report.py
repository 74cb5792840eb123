"""Everything that looks wrong in the recordings of a data set."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import computed_field

from bench.atomic import read_regular
from bench.errors import BenchError, DataError
from bench.recordings import Recording, RecordingHandle
from bench.recordings.validation import FileModel, read_json
from bench.records.recording import Content
from bench.validation.box_fit import BoxFit
from bench.validation.boxes import check_annotated, check_boxes
from bench.validation.calibration import check_calibration
from bench.validation.cameras import check_cameras
from bench.validation.clocks import check_annotation_times, check_clocks, check_coverage
from bench.validation.drive import annotation_file, calibration_file
from bench.validation.findings import Finding, Severity, Undecided, unusable
from bench.validation.images import check_images
from bench.validation.motion import check_motion
from bench.validation.static_world import check_static_world
from bench.validation.sweeps import SweepChecks
from bench.validation.unboxed import check_unboxed
from bench.validation.units import check_ego_limits, check_length_units, check_time_units

SAMPLED_IMAGES, NEIGHBOURING_IMAGES = 120, 6  # of each camera, in runs of so many
SAMPLED_SWEEPS, NEIGHBOURING_SWEEPS = 24, 2
LARGEST_COMPARED_BYTES = 100_000_000  # of an image or a sweep; larger files hold whole drives


class Depth(StrEnum):
    """Share of the images and sweeps that is read."""

    SAMPLED = "sampled"
    DEEP = "deep"


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

BY_EGO_MOTION = frozenset({
    "object-jump", "object-speed", "heading", "velocity", "empty-box", "tight-box", "box-time", "box-short",
    "box-reading", "box-place",
})  # fmt: skip
BY_TIMES = frozenset({
    "image-times", "ego-motion-missing", "sensor-overlap", "point-times", "annotation-time", "annotation-outside",
})  # fmt: skip
BY_LENGTHS = BY_EGO_MOTION | {
    "camera-mounting", "lidar-mounting", "sensor-outside", "sweep-range", "road-height", "box-size", "box-grows",
    "box-height", "object-in-ego", "same-object", "crowded-boxes",
}  # fmt: skip
EGO_MOTION = frozenset({
    "ego-speed", "ego-turn", "ego-cornering", "ego-jump", "ego-motion-unit", "ego-motion-scale",
})  # fmt: skip
CAUSES = (  # what causes it, by which findings that is known, and findings that may follow from it
    ("the unit of times", frozenset({"time-unit"}), BY_TIMES),
    ("the unit of lengths", frozenset({"length-unit"}), BY_LENGTHS),
    ("the lidar's mounting", frozenset({"lidar-pose"}), BY_EGO_MOTION),
    ("the ego-motion", EGO_MOTION, BY_EGO_MOTION),
)


def validate_recording(
    handle: RecordingHandle, *, depth: Depth = Depth.SAMPLED, progress: Callable[[float], None] = lambda _: None
) -> RecordingReport:
    """Find all that is wrong with a recording.

    Args:
        handle: the recording.
        depth: how many images and sweeps are read.
        progress: called with the share that is done, 0 to 1.
    """
    findings: list[Finding] = []
    undecided: list[Undecided] = []
    images = sweeps = Count()
    contents: tuple[Content, ...] = ()
    try:
        recording = handle.open()
    except DataError as error:
        findings += (unusable(each) for each in (error, *error.others))
    else:
        for check, file in CHECKS:
            for told in check(recording):
                if isinstance(told, Undecided):
                    undecided.append(told)
                else:
                    findings.append(replace(told, file=told.file or str(file(recording))))
        rows = {
            camera: _sampled(len(recording.images[camera]), depth, SAMPLED_IMAGES, NEIGHBOURING_IMAGES)
            for camera in recording.cameras
        }
        sweep_rows = _sampled(len(recording.sweeps), depth, SAMPLED_SWEEPS, NEIGHBOURING_SWEEPS)
        images = Count(read=sum(map(len, rows.values())), all=sum(map(len, recording.images.values())))
        sweeps = Count(read=len(sweep_rows), all=len(recording.sweeps))
        box_fit = BoxFit(recording)
        steps = count(1)

        def step() -> None:
            progress(next(steps) / (images.read + sweeps.read))

        for camera in recording.cameras:
            findings += check_images(recording, camera, rows[camera], step)
        sweep_checks = SweepChecks(recording, box_fit)
        findings += sweep_checks.check(sweep_rows, step)
        contents = (*recording.contents, *sweep_checks.contents())
        findings += _passed_over(recording)
        findings += box_fit.findings()
        if not any(finding.severity is Severity.ERROR for finding in findings):
            findings += check_unboxed(recording)  # by wrong calibration or boxes nothing would have its box
    named = [replace(finding, recording=handle.name) for finding in findings]
    for name, causing, following in CAUSES:
        named = _causes_first(named, name, causing, following)
    ordered = tuple(sorted(named, key=lambda finding: finding.severity != "error"))
    return RecordingReport(
        name=handle.name,
        findings=ordered,
        undecided=tuple(undecided),
        contents=contents,
        images=images,
        sweeps=sweeps,
    )


def _passed_over(recording: Recording) -> Iterator[Finding]:
    """Files and messages that lie among those that are read, and are not."""
    for content in recording.contents:
        if content.suspect:
            yield Finding(
                check="not-read",
                severity=Severity.WARNING,
                file=str(recording.root),
                field=content.what,
                expected="files and messages that are read",
                got=f"{content.count} that are passed over: {content.why}",
                hint="convert, unpack or remove them",
                times=content.count,
            )


def _causes_first(
    findings: list[Finding], name: str, causing: frozenset[str], following: frozenset[str]
) -> list[Finding]:
    """Move findings that may follow from a cause to the end, as warnings; as they are where it is not found."""
    if not any(finding.check in causing and finding.severity is Severity.ERROR for finding in findings):
        return findings
    hint = f"may follow from {name}: correct that, validate again"
    return [finding for finding in findings if finding.check not in following] + [
        replace(finding, severity=Severity.WARNING, hint=hint) for finding in findings if finding.check in following
    ]


def _sampled(count: int, depth: Depth, most: int, run: int) -> list[int]:
    """Of so many files those that are read: all, or runs of neighbours spread over the drive."""
    if depth is Depth.DEEP or count <= most:
        return list(range(count))
    firsts = np.linspace(0, count - run, most // run).round().astype(int)
    return sorted({int(first) + i for first in firsts for i in range(run)})


class ValidationReport(FileModel, extra="ignore"):
    """A data set, and its file; the counts in a file are not read back.

    Attributes:
        schema_version: of the file.
        dataset: name.
        depth: how many images and sweeps were to be read.
        recordings: in the order of the data set.
    """

    schema_version: Literal[1] = 1
    dataset: str
    depth: Depth
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


def read_report(file: Path) -> ValidationReport:
    """Read a report that was stored as JSON.

    Raises:
        DataError: missing or not a report.
    """
    return read_json(ValidationReport, file)


def validate_dataset(
    name: str,
    handles: Sequence[RecordingHandle],
    *,
    depth: Depth = Depth.SAMPLED,
    progress: Callable[[float, int], None] | None = None,
) -> ValidationReport:
    """Validate recordings one after the other; memory does not grow with their number or length.

    Args:
        name: of the data set.
        handles: its recordings.
        depth: how many images and sweeps are read.
        progress: called with recordings done, fractions allowed, and their number.
    """
    reports = []
    report = progress or (lambda _done, _total: None)
    for number, handle in enumerate(handles):

        def share_done(share: float, number: int = number) -> None:
            report(number + share, len(handles))

        reports.append(validate_recording(handle, depth=depth, progress=share_done))
        report(number + 1, len(handles))
    same = _same_drives(handles)
    told = (one.model_copy(update={"findings": (*one.findings, *same.get(one.name, ()))}) for one in reports)
    return ValidationReport(dataset=name, depth=depth, recordings=tuple(told))


def _same_drives(handles: Sequence[RecordingHandle]) -> dict[str, tuple[Finding, ...]]:
    """Findings of recordings whose middle images and sweep are, byte by byte, those of one before."""
    findings: dict[str, tuple[Finding, ...]] = {}
    first: dict[bytes, str] = {}
    for handle in handles if len(handles) > 1 else ():
        digest = _middle_digest(handle)
        if digest in first:
            finding = Finding(
                check="same-drive",
                severity=Severity.WARNING,
                recording=handle.name,
                expected="another drive under each name",
                got=f"the images and the sweep of {first[digest]!r} in the middle of it",
                hint="leave one of them out: intervals take recordings as independent",
            )
            findings[handle.name] = (finding,)
        elif digest is not None:
            first[digest] = handle.name
    return findings


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
