"""The leaderboard for the terminal, and as Markdown, CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.table import Table
from rich.text import Text

from bench.errors import BenchError, DataError
from bench.evaluation import summarise
from bench.evaluation.row_source import CommonImages
from bench.evaluation.summary import Metric
from bench.harness import RunSummary
from bench.harness.sweep import MARK
from bench.plain_text import escape_markdown, plain
from bench.reporting import formats
from bench.reporting.compare.runs import (
    SHOWN_DIGEST,
    differing_settings,
    fingerprint,
    restricted,
    settings_text,
)
from bench.reporting.stored_run import StoredRun, read_stored_run

UNITS = "units"  # a run that did not end has these and no summary
ORDERED_BY = "iou"
# Of the images of each run, so many must be common: one run that scored a few would else shrink the table of all.
LEAST_COMMON = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A run in a table.

    Attributes:
        run: folder, relative to the one that was searched.
        method: with the settings in which its runs of the group differ.
        metrics: by name, over all moving objects and all images of the group.
        images: that the run scored; the group may be taken over fewer.
        frames_per_second: images scored over the wall time of the run.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
    """

    run: str
    method: str
    metrics: dict[str, Metric]
    images: int
    frames_per_second: float
    date: str
    code: str
    failures: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Runs of one data set, split and protocol, on the images that all of them scored, where their references agree.

    Best first by IoU over all moving object-frames.

    Attributes:
        images: that all runs scored; all values are of these.
        reference_fingerprint: of the reference on these images.
    """

    dataset: str
    split: str | None
    protocol: str
    protocol_digest: str
    reference_fingerprint: str
    images: int
    object_frames: int
    recordings: int
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaderboard:
    """What a folder holds.

    Attributes:
        groups: runs that compare; never two in one table that do not.
        damaged: folder and fault of every run that cannot be read.
    """

    groups: tuple[Group, ...]
    damaged: tuple[tuple[str, str], ...]


def read_leaderboard(folder: Path) -> Leaderboard:
    """Find and read all runs under a folder, at any depth; the values of a sweep below it are no entries.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    if not folder.is_dir():
        raise DataError(folder, expected="a folder of runs", got="no such folder")
    found = {file.parent for file in folder.rglob("summary.json")}
    found |= {units.parent for units in folder.rglob(UNITS) if units.is_dir()}
    found = {run for run in found if run.parent == folder or not (run.parent / MARK).is_file()}
    if not found:
        raise DataError(folder, expected="at least one run", got="no summary.json at any depth")
    sound: list[StoredRun] = []
    damaged: list[tuple[str, str]] = []
    for run in sorted(found):
        name = run.relative_to(folder).as_posix()
        try:
            sound.append(read_stored_run(run, label=name))
        except BenchError as error:
            damaged.append((name, str(error)))
    groups: list[Group] = []
    for key in sorted({_key(run) for run in sound}):
        runs = [run for run in sound if _key(run) == key]
        if len({_reference(run) for run in runs}) > 1:
            runs = _readable(runs, damaged)
        groups += [_group(alike) for alike in _comparable(runs)]
    return Leaderboard(groups=tuple(groups), damaged=tuple(sorted(damaged)))


def _readable(runs: Sequence[StoredRun], damaged: list[tuple[str, str]]) -> list[StoredRun]:
    """The runs whose tables can be read and are those of their summary; the others are listed as damaged."""
    readable = []
    for run in runs:
        try:
            if fingerprint(run) != _reference(run):
                raise DataError(
                    run.folder, expected="the tables that summary.json is of", got="those of another reference"
                )
            readable.append(run)
        except BenchError as error:
            damaged.append((run.label, str(error)))
    return readable


def _key(run: StoredRun) -> tuple[str, str, str]:
    return run.summary.dataset, run.summary.split or "", run.summary.protocol.digest


def _comparable(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Runs of one data set, split and protocol in groups whose references agree on their common images."""
    groups: list[list[StoredRun]] = []
    for run in sorted(runs, key=lambda run: (-run.summary.images.evaluated, run.label)):
        joined = next((group for group in groups if _agree(group, run)), None)
        if joined is None:
            groups.append([run])
        else:
            joined.append(run)
    return groups


def _agree(group: Sequence[StoredRun], run: StoredRun) -> bool:
    """Whether a run has enough images in common with all of a group, and the same reference on them."""
    if any(_reference(one) == _reference(run) for one in group):
        return True
    images = _common_images([*group, run])
    common, scored = images.count(), max(one.summary.images.evaluated for one in (*group, run))
    if not common or common < LEAST_COMMON * scored:
        return False
    return fingerprint(restricted(group[0], images)) == fingerprint(restricted(run, images))


def _reference(run: StoredRun) -> str:
    return run.summary.reference_fingerprint


def _common_images(runs: Sequence[StoredRun]) -> CommonImages:
    """The images of all runs; those of the same reference scored the same."""
    return CommonImages(list({_reference(run): run.frames for run in runs}.values()))


def _group(runs: Sequence[StoredRun]) -> Group:
    first = runs[0]
    reference, summaries = _reference(first), [run.summary for run in runs]
    if len({_reference(run) for run in runs}) > 1:
        images = _common_images(runs)
        reference = fingerprint(restricted(first, images))
        summaries = [_summary_on(run, images) for run in runs]
    settings = differing_settings([run.summary for run in runs])
    entries = [_entry(run, of_run, own) for run, of_run, own in zip(runs, summaries, settings, strict=True)]
    return Group(
        dataset=first.summary.dataset,
        split=first.summary.split,
        protocol=first.summary.protocol.name,
        protocol_digest=first.summary.protocol.digest,
        reference_fingerprint=reference,
        images=summaries[0].images.evaluated,
        object_frames=summaries[0].all_moving.object_frames,
        recordings=summaries[0].all_moving.recordings,
        entries=tuple(sorted(entries, key=_order)),
    )


def _summary_on(run: StoredRun, images: CommonImages) -> RunSummary:
    """The summary with all metrics of some images only."""
    rows = restricted(run, images)
    found = summarise(rows.objects, rows.frames, protocol=run.protocol)
    return run.summary.model_copy(update={name: getattr(found, name) for name in type(found).model_fields})


def _entry(run: StoredRun, compared: RunSummary, settings: dict[str, object]) -> Entry:
    summary, moving = run.summary, compared.all_moving
    made = summary.provenance
    method = f"{summary.method.name} ({settings_text(settings)})" if settings else summary.method.name
    commit = "" if made.commit is None else f" {made.commit[:8]}{'+' if made.commit.endswith('+') else ''}"
    return Entry(
        run=run.label,
        method=method,
        metrics={name: moving.metric(name) for name in moving.metric_names()}
        | {"false_positive_coverage": compared.false_positives.coverage},
        images=summary.images.evaluated,
        frames_per_second=made.images / made.seconds if made.seconds else math.nan,
        date=made.started_utc[:10],
        code=f"{made.version}{commit}",
        failures=len(summary.failures),
    )


def _order(entry: Entry) -> tuple[float, str]:
    value = entry.metrics[ORDERED_BY].value
    return (math.inf if math.isnan(value) else -value), entry.run


SCHEMA_VERSION = 1
NOTE = (
    "Over all moving objects of the images that all runs of a table scored, in percent. Runs stand in one table if "
    f"they have at least {100 * LEAST_COMMON:.0f} % of their images in common and the same reference on these. "
    f"{formats.INTERVALS} Ordered by IoU over all object-frames, an undetected one having 0. Rows whose intervals "
    "overlap may still differ: compare judges runs in pairs. Chance: detection at the same level on the mask of "
    "another frame. False positives: share of the image. Images: scored by the run. Images per second: whole runs, on "
    "machines that may differ."
)


def leaderboard_tables(found: Leaderboard) -> Iterator[Table]:
    """A table per group, readable at 100 columns."""
    for group in found.groups:
        table = formats.terminal_table(_title(group), caption=NOTE, below=1)
        table.add_column("Run, method", overflow="fold", min_width=30)
        columns = _columns(group)
        formats.number_columns(table, ("Images,\nrecs", *columns.values(), "Images\nper s", "Date, code"))
        for entry in group.entries:
            metrics = [entry.metrics[name] for name in columns]
            label = Text(plain(entry.run), style="bold")
            label.append(f"\n{plain(entry.method)}{_failed(entry)}", style="not bold")
            table.add_row(
                label,
                Text(f"{entry.images}\n{group.recordings}"),
                *(Text(f"{formats.hundredths(metric.value)}\n{formats.short_interval(metric)}") for metric in metrics),
                _rate(entry),
                Text(f"{plain(entry.date)}\n{plain(entry.code)}"),
            )
        yield table


def write_leaderboard(found: Leaderboard, out: Path) -> tuple[Path, ...]:
    """Write `leaderboard.md`, `.csv` and `.json`, each whole or not at all."""
    texts = {
        "leaderboard.md": to_markdown(found),
        "leaderboard.csv": to_csv(found),
        "leaderboard.json": to_json(found),
    }
    return formats.write_texts(out, texts)


def to_markdown(found: Leaderboard) -> str:
    """A table per group as GitHub's Markdown, then the runs that cannot be read."""
    parts = ["# Leaderboard"]
    for group in found.groups:
        columns = _columns(group)
        headings = ["Run", "Method", "Images", "Recordings", *(h.replace("\n", " ") for h in columns.values())]
        headings += ["Images per s", "Date", "Code"]
        rows = []
        for entry in group.entries:
            metrics = [entry.metrics[name] for name in columns]
            row = [entry.run, entry.method + _failed(entry), str(entry.images), str(group.recordings)]
            row += [f"{formats.hundredths(metric.value)} {formats.interval(metric)}".strip() for metric in metrics]
            rows.append([*row, _rate(entry), entry.date, entry.code])
        parts += [f"## {escape_markdown(_title(group))}", formats.markdown_table(headings, rows, labels=2)]
    if found.damaged:
        faults = "\n".join(f"- {escape_markdown(run)}: {escape_markdown(fault)}" for run, fault in found.damaged)
        parts += ["## Runs that cannot be read", faults]
    return "\n\n".join([*parts, NOTE]) + "\n"


def to_csv(found: Leaderboard) -> str:
    """One line per run and metric, ratios at full precision; empty where there is no number."""
    columns = ["dataset", "split", "protocol", "protocol_digest", "reference_fingerprint", "run", "method", "date",
               "code", "failures", "images_per_second", "figure", "value", "ci95_low", "ci95_high", "cases", "images",
               "images_compared", "recordings"]  # fmt: skip
    lines = [
        [group.dataset, group.split, group.protocol, group.protocol_digest, group.reference_fingerprint, entry.run,
         entry.method, entry.date, entry.code, entry.failures, entry.frames_per_second, name, metric.value,
         *(metric.ci95 or (None, None)), metric.cases, entry.images, group.images, group.recordings]
        for group in found.groups
        for entry in group.entries
        for name, metric in entry.metrics.items()
    ]  # fmt: skip
    return formats.csv_text(lines, columns)


def to_json(found: Leaderboard) -> str:
    """Groups and damaged runs at full precision; null where there is no number."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": NOTE,
        "groups": [
            asdict(group) | {"entries": [_json_entry(entry) for entry in group.entries]} for group in found.groups
        ],
        "damaged": [{"run": run, "fault": fault} for run, fault in found.damaged],
    }
    return formats.json_text(content)


def _json_entry(entry: Entry) -> dict[str, object]:
    return {
        "run": entry.run,
        "method": entry.method,
        "images": entry.images,
        "figures": {name: metric.model_dump(mode="json") for name, metric in entry.metrics.items()},
        "images_per_second": entry.frames_per_second,
        "date": entry.date,
        "code": entry.code,
        "failures": entry.failures,
    }


def _title(group: Group) -> str:
    protocol = f"{group.protocol} ({group.protocol_digest[:SHOWN_DIGEST]})"
    return (
        f"{group.dataset}, {group.split or 'all recordings'}, {protocol}, "
        f"reference {group.reference_fingerprint[:SHOWN_DIGEST]}: {group.images} images that all scored, "
        f"{group.object_frames} object-frames, {group.recordings} recordings"
    )


def _columns(group: Group) -> dict[str, str]:
    """Detection at the highest level of the protocol with its chance level, coverage, IoU, false positives."""
    highest = ["detection_rate", *formats.detection_levels(group.entries[0].metrics)][-1]
    return {
        highest: "Detection" if highest == "detection_rate" else f"Detection\nat {formats.level_percent(highest):g} %",
        formats.chance_of(highest): "chance",
        "tpr_all": "TPR\nall",
        "iou": "IoU\nall",
        "false_positive_coverage": "False\npositives",
    }


def _rate(entry: Entry) -> str:
    return "n/a" if math.isnan(entry.frames_per_second) else f"{entry.frames_per_second:.1f}"


def _failed(entry: Entry) -> str:
    return f", {entry.failures} failures" if entry.failures else ""
