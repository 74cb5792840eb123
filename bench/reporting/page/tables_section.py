"""The tables of a page, ready to be filled in."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench.evaluation.summary import Summary
from bench.harness import Provenance, RunSummary
from bench.reporting.numbers import count, difference, interval, mean, ours, paper, percent
from bench.reporting.page.cells import Cell, CellRow, CellTable, figure_cell, figures_table
from bench.reporting.sheets import COMPARED, detection_figures
from bench.reporting.tables import FALSE_POSITIVES, TableRow, table_rows

BREAKDOWNS = {
    "object_class": ("By class", "class"),
    "range_m": ("By range", "nearest point (m)"),
    "ego_speed_mps": ("By speed of the host", "speed (m/s)"),
    "camera": ("By camera", "camera"),
    "points": ("By lidar points on the object", "points"),
}
REASONS = {
    "unclear": "flagged as unclear by the annotation",
    "class_not_in_protocol": "a class that the protocol does not score",
    "motion_unknown": "no velocity is known",
    "category_not_in_protocol": "a kind of motion that the protocol does not score",
    "out_of_view": "outside of the lens's view",
    "no_sweep": "no lidar sweep near the image",
    "beyond_range": "farther away than the protocol's range limit",
    "too_few_points": "fewer lidar points than the protocol asks for",
    "polygon_too_small": "a reference polygon below the protocol's area",
    "occluded": "wholly behind nearer objects",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A named length, in percent of the longest possible."""

    name: str
    text: str
    value: float
    interval: str = ""


def headline(rows: Sequence[TableRow]) -> CellTable:
    """Ours beside the paper's: detection rates, TPR and IoU."""
    shown = [row for row in rows if row.name != FALSE_POSITIVES]
    rates = detection_figures(rows)
    return CellTable(
        caption="Results by kind of motion, the paper's figures beside them",
        headings=("kind of motion", "recordings", "object-frames", "objects", *_headings(rates)),
        rows=tuple(
            CellRow(
                name=row.label,
                counts=(count(row.recordings), count(row.frames), count(row.tracks)),
                cells=tuple(_headline_cell(row, name) for name in (*rates, "tpr", "iou_detected")),
            )
            for row in shown
        ),
    )


def _headings(rates: dict[str, str]) -> list[str]:
    first, *others = rates.values()
    return [f"{first} (any pixel)", *(f"found {heading}" for heading in others), "TPR of the found", "IoU of the found"]


def _headline_cell(row: TableRow, name: str) -> Cell:
    figure, notes = row.figures[name], list[str]()
    if name.startswith("detection_rate"):
        chance = row.figures[name.replace("detection_rate", "chance")]
        notes += [] if math.isnan(chance.value) else [f"chance {ours(chance)}"]
    if name in COMPARED:
        told = f" ({difference(figure)})" if difference(figure) else ""
        notes.append(f"paper {paper(figure)}{told}")
    return figure_cell(figure, notes=tuple(notes))


def false_positive_lines(figures: Summary) -> list[tuple[str, str, str]]:
    """Name, figure, and the paper's figure or what it means."""
    last = next(row for row in table_rows(figures) if row.name == FALSE_POSITIVES)
    coverage = last.figures["coverage"]
    return [
        (
            "of the image's area, on average",
            f"{ours(coverage)} {interval(coverage)}",
            f"paper {paper(coverage)} ({difference(coverage)})",
        ),
        (
            "of the valid pixels",
            f"{ours(last.figures['coverage_valid'])} {interval(last.figures['coverage_valid'])}",
            "inside the lens's view and off the host's body",
        ),
        (
            "frames with a large false patch",
            f"{ours(last.figures['frame_rate'])} {interval(last.figures['frame_rate'])}",
            "larger than the protocol states",
        ),
        (
            "false patches per frame",
            mean(last.figures["components_per_frame"]),
            f"over {last.frames} images{of_recordings(last.recordings)}",
        ),
    ]


def of_recordings(recordings: int | None) -> str:
    """For example " of 20 recordings", to be added; "" where it is unknown."""
    return "" if recordings is None else f" of {recordings} recordings"


def breakdown_tables(figures: Summary) -> list[CellTable]:
    """A table for every way to split the object-frames."""
    kinds = {name.replace("_", " "): row for name, row in figures.categories.items()}
    found = (
        [figures_table("By kind of motion", "kind", {"all": figures.all_moving} | kinds)]
        if len([r for r in kinds.values() if r.object_frames]) > 1
        else []
    )
    return [*found, *(figures_table(*BREAKDOWNS[name], rows) for name, rows in figures.breakdowns.items() if rows)]


def cause_bars(figures: Summary) -> list[Bar]:
    """Share of the false pixels by cause, largest first."""
    causes = sorted(figures.false_positive_causes.items(), key=lambda item: -item[1].value)
    return [
        Bar(
            name=name.replace("_", " "),
            text=percent(cause.value),
            value=100 * cause.value,
            interval="" if cause.ci95 is None else f"{100 * cause.ci95[0]:.1f} to {100 * cause.ci95[1]:.1f}",
        )
        for name, cause in causes
        if not math.isnan(cause.value)
    ]


def stage_bars(made: Provenance) -> list[Bar]:
    """Time of every stage, longest first, against all of them."""
    total = sum(made.stage_seconds.values()) or 1.0
    order = sorted(made.stage_seconds.items(), key=lambda item: -item[1])
    per_image = 1e3 / max(made.images, 1)
    return [
        Bar(name=name, text=f"{per_image * seconds:.1f} ms per image ({seconds:.1f} s)", value=100 * seconds / total)
        for name, seconds in order
    ]


def provenance_rows(run: RunSummary) -> list[tuple[str, str]]:
    """What made the run."""
    made = run.provenance
    return [
        ("data set", f"{run.dataset} ({run.card})" + (f", split {run.split}" if run.split else "")),
        ("method", run.method.name),
        ("its settings", json.dumps(run.method.settings)),
        ("protocol", f"{run.protocol.name}, version {run.protocol.version}, digest {run.protocol.digest[:16]}"),
        ("reference", f"fingerprint {run.reference_fingerprint[:16]}"),
        ("data", f"fingerprint {made.data_fingerprint[:16]}"),
        ("code", f"fisheye-bench {made.version}, commit {_commit(made.commit)}"),
        ("Python and libraries", ", ".join([made.python, *(f"{n} {v}" for n, v in made.libraries.items())])),
        ("started", made.started_utc),
        ("took", f"{made.seconds:.1f} s for {made.images} images, at most {made.peak_memory_mb:.0f} MB"),
    ]


def ledger_rows(figures: Summary) -> dict[str, list[tuple[str, int, str]]]:
    """Where every annotated object and every image ended: name, count, why."""
    objects, images = figures.objects, figures.images
    return {
        "objects": [
            ("evaluated", objects.evaluated, "scored above"),
            ("static", objects.static, "does not move, so it is neither searched for nor ignored"),
            *(
                (f"ignored: {name.replace('_', ' ')}", count, REASONS.get(name, ""))
                for name, count in objects.ignored.items()
            ),
            ("annotated, the sum", objects.annotated, "every annotated object in every image, once"),
        ],
        "images": [
            ("scored", images.evaluated, ""),
            ("skipped", images.skipped, "no image before it to compare with, at the time that is due"),
            ("failed", images.failed, "could not be used"),
            ("all, the sum", images.images, "but the first of each recording, which have no history"),
        ],
    }


def _commit(commit: str | None) -> str:
    if commit is None:
        return "unknown"
    return f"{commit[:12]} with changes" if commit.endswith("+") else commit[:12]
