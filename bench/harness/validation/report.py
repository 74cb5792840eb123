"""What validation says of a data set."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from bench.harness.validation.findings import Finding, Severity
from bench.harness.validation.recording import Depth, validate_recording
from bench.recordings import RecordingHandle

SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingReport:
    """One recording.

    Attributes:
        name: of the recording.
        findings: errors first.
        images: how many images were read, and how many there are.
        sweeps: how many sweeps were read, and how many there are.
    """

    name: str
    findings: tuple[Finding, ...]
    images: tuple[int, int]
    sweeps: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationReport:
    """A data set.

    Attributes:
        dataset: name.
        depth: how many images and sweeps were to be read.
        recordings: in the order of the data set.
    """

    dataset: str
    depth: Depth
    recordings: tuple[RecordingReport, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All of them."""
        return tuple(finding for recording in self.recordings for finding in recording.findings)

    def count(self, severity: Severity) -> int:
        """How many findings of a severity."""
        return sum(finding.severity is severity for finding in self.findings)

    def as_json(self) -> str:
        """JSON text, one object with a list of findings."""
        content = {
            "schema_version": SCHEMA_VERSION,
            "dataset": self.dataset,
            "depth": self.depth.value,
            "errors": self.count(Severity.ERROR),
            "warnings": self.count(Severity.WARNING),
            "recordings": [
                {
                    "name": recording.name,
                    "images": {"read": recording.images[0], "all": recording.images[1]},
                    "sweeps": {"read": recording.sweeps[0], "all": recording.sweeps[1]},
                }
                for recording in self.recordings
            ],
            "findings": [asdict(finding) for finding in self.findings],
        }
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


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
        findings, read = validate_recording(
            handle,
            depth=depth,
            progress=lambda share, number=number: report(number + share, len(handles)),  # type: ignore[misc]
        )
        reports.append(
            RecordingReport(name=handle.name, findings=tuple(findings), images=read["images"], sweeps=read["sweeps"])
        )
        report(number + 1, len(handles))
    return ValidationReport(dataset=name, depth=depth, recordings=tuple(reports))
