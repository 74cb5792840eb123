"""Validation: everything that is wrong with a data set, found and reported in one pass.

Each check is a function from a recording to findings and knows nothing of the others. Nothing stops at the first fault:
a recording that does not open is read leniently, and what can be used of it is looked at all the same. Limits are those
of physics and of everyday bodies, in `findings`; what a sensor measured is tried against another (the path against
lidar sweeps, boxes against the points in them, stated velocities against positions).
"""

from bench.validation.findings import Finding, Severity
from bench.validation.report import (
    Count,
    Depth,
    RecordingReport,
    ValidationReport,
    read_report,
    validate_dataset,
    validate_recording,
)

__all__ = [
    "Count",
    "Depth",
    "Finding",
    "RecordingReport",
    "Severity",
    "ValidationReport",
    "read_report",
    "validate_dataset",
    "validate_recording",
]
