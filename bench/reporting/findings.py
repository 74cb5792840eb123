"""Findings in data and predictions, as text, those that read alike in one; and proposals against annotations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from bench.atomic import write_text
from bench.methods.predictions import FaultKind, PredictionIndex
from bench.plain_text import counted, listed
from bench.reporting import formats
from bench.reporting.document import Block, Column, Heading, Heads, Paragraph, Report, Style, Table
from bench.validation.findings import Finding, Severity
from bench.validation.report import Count, RecordingReport, ValidationReport

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
    whole = images.read == images.all and sweeps.read == sweeps.all
    yield Paragraph(
        f"{counted(errors, 'error')} and {counted(warnings, 'warning')} in "
        f"{counted(len(report.recordings), 'recording')}; "
        f"read {images.read} of {counted(images.all, 'image')} and {sweeps.read} of {counted(sweeps.all, 'sweep')}"
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
    parts = [f"{len(found.usable)} of {counted(found.expected, 'image')} have a usable {found.form}"]
    if found.unscored:
        parts.append(f"of images that are not scored: {counted(found.unscored, 'prediction')}")
    if found.elsewhere:
        parts.append(f"of recordings that are not scored: {counted(found.elsewhere, 'file')}")
    if threshold is not None and found.usable:
        above = "" if found.largest > threshold else ", so that none does"
        parts.append(f"the largest score is {found.largest:.4g}, and above {threshold:g} a pixel moves{above}")
    return "; ".join(parts)


# Proposals against annotations.


WHERE: dict[str, Heads] = {"range": "range", "group": "group"}
COUNTS: dict[str, Heads] = {
    "object_frames": "object-frames",
    "recall": Column("recall, %", formats.number(1, times=100, none="n/a")),
    "precision": Column("precision, %", formats.number(1, times=100, none="n/a")),
    "switches": "switches",
    "false_tracks_per_minute": Column("false tracks a minute", formats.number(1, none="n/a")),
    "class_right": Column("class right, %", formats.number(1, times=100, none="n/a")),
}
ERRORS: dict[str, Heads] = {
    f"{error}_{of}": Column(heading, formats.number(digits, none="n/a"))
    for error, name, digits in (
        ("speed_error", "speed error, m/s", 2),
        ("centre_error", "centre error, m", 2),
        ("size_error", "size error, m", 2),
        ("yaw_error_deg", "yaw error, degrees", 1),
    )
    for of, heading in (("median", name), ("p90", "p90"))
}
WORST: dict[str, Heads] = {"recording": "recording", "track": "track", "wrong": "what is wrong", "frames": "frames"}
MOST_SHOWN = 20  # of the worst tracks
HOW = (
    "An object-frame is an annotated object that moves, in a sweep, with 10 returns or more. A proposal finds it where "
    "the returns in both boxes have an IoU of at least 0.5; a second proposal for one object is false. What a reviewer "
    "rejected is left out, and corrections count. Proposals at rest and unclear objects are neither right nor wrong.",
    "A switch is a change from one proposal to another on one object. A track is false with more false object-frames "
    "than others. Class right and errors: of object-frames that were found, median and 90th percentile. n/a: nothing "
    "to count.",
    "The worst tracks are those with the most object-frames that are missed, false, of another class, or whose box is "
    "off by more than 1 m or 20 degrees; evaluate-tracks.csv has them all.",
)


def scores_tables(scores: pd.DataFrame, minutes: float, worst: pd.DataFrame) -> list[Table]:
    """Everything as tables: percent, m/s, m and degrees; that of the worst tracks where there are any.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        worst: see `bench.annotation.worst_tracks`.
    """
    found = f"Found: half or more of the returns in either box are in both. Sweeps of {60 * minutes:.0f} s."
    more = len(worst) - MOST_SHOWN
    note = f"{more} more in evaluate-tracks.csv." if more > 0 else ""
    tracks = Table(title="The worst tracks", columns=WORST, rows=worst.head(MOST_SHOWN), words=3, note=note)
    return [
        Table(columns=WHERE | COUNTS, rows=scores, words=2, note=found),
        Table(columns=WHERE | ERRORS, rows=scores, words=2, note="Errors: medians and 90th percentiles."),
        *([tracks] if len(worst) else []),
    ]


def write_proposal_scores(
    out: Path,
    scores: pd.DataFrame,
    minutes: float,
    *,
    worst: pd.DataFrame,
    dataset: str,
    recordings: Sequence[str],
) -> tuple[Path, ...]:
    """Write `evaluate.html`, `.md` and `.csv`, and `evaluate-tracks.csv`; their paths.

    Args:
        out: folder, is made.
        scores: as `minutes`, see `scores_tables`.
        minutes: how long the sweeps took.
        worst: all tracks with which something is wrong.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    count = counted(len(recordings), "recording") + (f", {recordings[0]}" if len(recordings) == 1 else "")
    blocks: list[Block] = [
        Paragraph(f"{count}, {60 * minutes:.0f} s of sweeps."),
        *scores_tables(scores, minutes, worst),
        Heading("How to read it"),
        *map(Paragraph, HOW),
    ]
    title = f"Proposals of {dataset} against its annotations"
    files = Report(title=title, blocks=blocks, numbers=scores, page=True).write(out, "evaluate")
    tracks = out / "evaluate-tracks.csv"
    write_text(tracks, worst.to_csv(index=False))
    return *files, tracks
