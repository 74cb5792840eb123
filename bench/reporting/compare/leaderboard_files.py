"""The leaderboard for the terminal, and as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation.summary import Figure
from bench.plain_text import escape_markdown, plain
from bench.recordings import write_text
from bench.reporting.compare.comparison_text import markdown_table, share
from bench.reporting.compare.leaderboard import LEAST_COMMON, Entry, Group, Leaderboard
from bench.reporting.compare.stored_runs import SHOWN_DIGEST
from bench.reporting.sheets import INTERVALS

SCHEMA_VERSION = 1
NOTE = (
    "Over all moving objects of the images that all runs of a table scored, in percent. Runs stand in one table if "
    f"they have at least {100 * LEAST_COMMON:.0f} % of their images in common and the same reference on these. "
    f"{INTERVALS} Ordered by IoU over all object-frames, an undetected one having 0. Rows whose intervals overlap may "
    "still differ: compare judges runs in pairs. Chance: detection at the same level on the mask of another frame. "
    "False positives: share of the image. Images: scored by the run. Images per second: whole runs, on machines that "
    "may differ."
)


def leaderboard_tables(found: Leaderboard) -> Iterator[Table]:
    """A table per group, readable at 100 columns."""
    for group in found.groups:
        table = Table(
            box=SIMPLE_HEAD, padding=(0, 1, 1, 0), show_edge=False, title=_title(group), title_justify="left",
            caption=NOTE, caption_justify="left",
        )  # fmt: skip
        table.add_column("Run, method", overflow="fold", min_width=30)
        figures = _columns(group)
        for heading in ("Images,\nrecs", *figures.values(), "Images\nper s", "Date, code"):
            table.add_column(Text(heading), justify="right", no_wrap=True)
        for entry in group.entries:
            cells = [
                Text(share(entry.figures[name].value) + "\n" + _short_interval(entry.figures[name])) for name in figures
            ]
            label = Text(plain(entry.run), style="bold")
            label.append(f"\n{plain(entry.method)}{_failed(entry)}", style="not bold")
            counts = Text(f"{entry.images}\n{group.recordings}")
            table.add_row(label, counts, *cells, _rate(entry), Text(f"{plain(entry.date)}\n{plain(entry.code)}"))
        yield table


def write_leaderboard(found: Leaderboard, out: Path) -> tuple[Path, ...]:
    """Write `leaderboard.md`, `.csv` and `.json`, each whole or not at all."""
    texts = {
        "leaderboard.md": to_markdown(found),
        "leaderboard.csv": to_csv(found),
        "leaderboard.json": to_json(found),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return tuple(out / name for name in texts)


def to_markdown(found: Leaderboard) -> str:
    """A table per group as GitHub's Markdown, then the runs that cannot be read."""
    parts = ["# Leaderboard"]
    for group in found.groups:
        figures = _columns(group)
        headings = [
            "Run",
            "Method",
            "Images",
            "Recordings",
            *(h.replace("\n", " ") for h in figures.values()),
            "Images per s",
            "Date",
            "Code",
        ]
        rows = [
            [
                *(entry.run, entry.method + _failed(entry), str(entry.images), str(group.recordings)),
                *(f"{share(entry.figures[name].value)} {_interval(entry.figures[name])}".strip() for name in figures),
                *(_rate(entry), entry.date, entry.code),
            ]
            for entry in group.entries
        ]
        parts += [f"## {escape_markdown(_title(group))}", markdown_table(headings, rows, text_columns=2)]
    if found.damaged:
        faults = "\n".join(f"- {escape_markdown(run)}: {escape_markdown(fault)}" for run, fault in found.damaged)
        parts += ["## Runs that cannot be read", faults]
    return "\n\n".join([*parts, NOTE]) + "\n"


def to_csv(found: Leaderboard) -> str:
    """One line per run and figure, ratios at full precision; empty where there is no number."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(
        ["dataset", "split", "protocol", "protocol_digest", "reference_fingerprint", "run", "method", "date", "code",
         "failures", "images_per_second", "figure", "value", "ci95_low", "ci95_high", "cases",
         "images", "images_compared", "recordings"]
    )  # fmt: skip
    for group in found.groups:
        of_group = [
            group.dataset,
            group.split or "",
            group.protocol,
            group.protocol_digest,
            group.reference_fingerprint,
        ]
        for entry in group.entries:
            of_run = [
                entry.run,
                entry.method,
                entry.date,
                entry.code,
                entry.failures,
                _or_empty(entry.frames_per_second),
            ]
            for name, figure in entry.figures.items():
                low, high = figure.ci95 or (math.nan, math.nan)
                numbers = [_or_empty(number) for number in (figure.value, low, high)]
                writer.writerow(
                    [*of_group, *of_run, name, *numbers, figure.cases, entry.images, group.images, group.recordings]
                )
    return buffer.getvalue()


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
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _json_entry(entry: Entry) -> dict[str, object]:
    rate = entry.frames_per_second
    return {
        "run": entry.run,
        "method": entry.method,
        "images": entry.images,
        "figures": {name: figure.model_dump(mode="json") for name, figure in entry.figures.items()},
        "images_per_second": None if math.isnan(rate) else rate,
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
    levels = [name for name in group.entries[0].figures if name.startswith("detection_rate_")]
    highest = max(levels, key=lambda name: float(name.removeprefix("detection_rate_")), default="detection_rate")
    percent = highest.removeprefix("detection_rate").removeprefix("_")
    return {
        highest: f"Detection\nat {percent} %" if percent else "Detection",
        highest.replace("detection_rate", "chance"): "chance",
        "tpr_all": "TPR\nall",
        "iou": "IoU\nall",
        "false_positive_coverage": "False\npositives",
    }


def _interval(figure: Figure) -> str:
    return "" if figure.ci95 is None else f"[{share(figure.ci95[0])}, {share(figure.ci95[1])}]"


def _short_interval(figure: Figure) -> str:
    return "" if figure.ci95 is None else f"{100 * figure.ci95[0]:.0f}-{100 * figure.ci95[1]:.0f}"


def _rate(entry: Entry) -> str:
    return "n/a" if math.isnan(entry.frames_per_second) else f"{entry.frames_per_second:.1f}"


def _failed(entry: Entry) -> str:
    return f", {entry.failures} failures" if entry.failures else ""


def _or_empty(number: float) -> str:
    return "" if math.isnan(number) else repr(number)
