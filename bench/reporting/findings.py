"""Findings in data and predictions, as text: the first few of each kind, those that read alike in one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.methods.predictions import FaultKind, PredictionIndex
from bench.plain_text import counted, listed
from bench.reporting.document import Block, Heading, Paragraph, Style, Table
from bench.validation import Count, Depth, Finding, RecordingReport, Severity, ValidationReport

SHOWN = 5  # findings of one check in one recording, of which the file has all; faults of a kind
SHOWN_PLACES = 3  # of findings that read alike
STYLES: dict[Severity, Style] = {Severity.ERROR: "bad", Severity.WARNING: "warn"}


def findings_report(report: ValidationReport) -> Iterator[Block]:
    """The findings by recording and check, and what was read."""
    for recording in report.recordings:
        yield from _findings(recording)
    yield from _contents(report)
    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    images, sweeps = (
        Count(read=sum(one.read for one in counts), all=sum(one.all for one in counts))
        for counts in ([each.images for each in report.recordings], [each.sweeps for each in report.recordings])
    )
    whole = report.depth is Depth.DEEP or (images.read == images.all and sweeps.read == sweeps.all)
    yield Paragraph(
        f"{counted(errors, 'error')} and {counted(warnings, 'warning')} in "
        f"{counted(len(report.recordings), 'recording')}; "
        f"read {images.read} of {images.all} images and {sweeps.read} of {sweeps.all} sweeps"
        + ("" if whole else "; --deep reads all")
    )


def _contents(report: ValidationReport) -> Iterator[Block]:
    """What nothing reads of the files of all recordings, in one line each; the JSON says what is read as what."""
    counts: Counter[tuple[str, str]] = Counter()
    for content in (content for recording in report.recordings for content in recording.contents):
        if not content.read_as:
            counts[content.what, content.why] += content.count
    for (what, why), count in counts.items():
        yield Paragraph(f"not read: {what}{f' ({count})' if count > 1 else ''}, {why}", "dim")


def _findings(recording: RecordingReport) -> Iterator[Block]:
    """Those of one check together as the first of them comes."""
    checks: dict[str, dict[tuple[Severity, str, str, str], list[Finding]]] = {}
    for finding in recording.findings:
        text = (finding.severity, finding.expected, finding.got, finding.hint)
        checks.setdefault(finding.check, {}).setdefault(text, []).append(finding)
    if checks or recording.undecided:
        yield Heading(recording.name)
    for check, groups in checks.items():
        for (severity, expected, got, hint), findings in list(groups.items())[:SHOWN]:
            places = listed([_where(finding) for finding in findings], SHOWN_PLACES)
            yield Paragraph(f"  {severity.value:7}  {check}: {places}{_occurrence(findings)}", STYLES[severity])
            yield Paragraph(f"           expected {expected}; got {got}")
            if hint:
                yield Paragraph(f"           {hint}")
        if rest := sum(map(len, list(groups.values())[SHOWN:])):
            yield Paragraph(f"           ... and {rest} more of {check}; --json FILE has all")
    for undecided in recording.undecided:
        yield Paragraph(f"  cannot tell  {undecided.about}: {undecided.why}")


def _where(finding: Finding) -> str:
    """File below the recording's folder, and the field in it."""
    parts = Path(finding.file).parts
    if finding.recording in parts:
        parts = parts[len(parts) - parts[::-1].index(finding.recording) :] or parts[-1:]
    return ": ".join(filter(None, (str(Path(*parts)), finding.field)))


def _occurrence(findings: Sequence[Finding]) -> str:
    """Number of occurrences, if more than one, and their time, if known; "" for neither."""
    count, time_ns = sum(finding.times for finding in findings), findings[0].timestamp_ns
    times = f"{count} times" if count > 1 else ""
    at = "" if time_ns is None else f"{'first ' if times else ''}at {time_ns}"
    both = ", ".join(filter(None, (times, at)))
    return f" ({both})" if both else ""


def prediction_table(found: PredictionIndex, *, whole: bool = False) -> Table | None:
    """The faults of each kind, the first few or all, with the number of all; None where there is none."""
    rows = []
    for kind in FaultKind:
        faults = found.of_kind(kind)
        label = f"{kind.value}: {len(faults)}"
        rows += [(label, fault.place, fault.reason) for fault in (faults if whole else faults[:SHOWN])]
        rows += [(label, "...", "")] if len(faults) > SHOWN and not whole else []
    columns = ["fault: how many", "file or image", "why"]
    return Table(title="Predictions that do not fit", columns=columns, rows=rows, words=3) if rows else None


def prediction_line(found: PredictionIndex, *, threshold: float | None) -> str:
    """For example "12 of 16 images have a mask; 2 files are of images that are not scored".

    Args:
        found: the predictions.
        threshold: score above which a pixel moves; None for masks.
    """
    parts = [f"{len(found.usable)} of {found.expected} images have a usable {found.form}"]
    if found.unscored:
        parts.append(f"{found.unscored} predictions are of images that are not scored")
    if found.elsewhere:
        parts.append(f"{found.elsewhere} files are of recordings that are not scored")
    if threshold is not None and found.usable:
        above = "" if found.largest > threshold else ", so that none does"
        parts.append(f"the largest score is {found.largest:.4g}, and above {threshold:g} a pixel moves{above}")
    return "; ".join(parts)
