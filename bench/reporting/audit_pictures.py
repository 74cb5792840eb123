"""The files of an audit: how well polygons fit by distance, polygons over images, why cells are missed and flagged."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.audit import (
    AUDIT,
    AuditSource,
    AuditSummary,
    Compensation,
    ExplainedImage,
    FalseCause,
    MissCause,
    explain_image,
    lenient,
)
from bench.evaluation import Protocol
from bench.methods import Method
from bench.recordings import Recording, RecordingHandle, read_image, read_truth
from bench.reference import ReferenceBuilder
from bench.reporting import canvas
from bench.reporting.audit_tables import FALSE_ALARMS, MISSES, report

COLOURS = (canvas.ORANGE, canvas.BLUE, canvas.GREEN, canvas.PURPLE)
BIN_M = 1.0
FEWEST = 3  # object-frames of a point; fewer say nothing about quartiles
_PANEL_IN, _HEIGHT_IN = 2.6, 3.0


@canvas.styled
def draw_fit_by_distance(audit: AuditSummary, polygons: pa.Table) -> Figure:
    """Draw median and quartiles of the IoU over the distance, each kind of polygon in its colour.

    Args:
        audit: for names and aims.
        polygons: the rows behind them.
    """
    rows = polygons.to_pandas()
    rows = rows[rows["compensation"] == Compensation.FULL.value]
    classes = sorted(set(rows["object_class"])) or ["none"]
    width_in = max(len(classes) * _PANEL_IN, 4.0)
    figure = canvas.new_figure(width_in, _HEIGHT_IN, layout="constrained")
    title = f"Reference polygons of {audit.dataset}"
    legend = "Median and quartiles; dotted: the aim for kinds that follow the outline"
    figure.suptitle(f"{title}\n{legend}", x=0.01, ha="left", fontsize=8)
    panels = figure.subplots(1, len(classes), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, classes, strict=True):
        of_class = rows[rows["object_class"] == name]
        for kind, colour in zip(audit.polygon_kinds, cycle(COLOURS), strict=False):
            _draw_kind(axes, of_class[of_class["kind"] == kind], kind=kind, colour=colour)
        aims = {aim.expected for aim in audit.aims if aim.object_class == name}
        for expected in sorted(aims):
            axes.axhline(expected, color=canvas.GREY, linewidth=0.8, linestyle=":")
        frames = len(of_class[of_class["kind"] == audit.polygon_kinds[0]])
        axes.set(xlabel="distance (m)", ylim=(0.3, 1.0), xlim=(0, max(float(rows["range_m"].max()), 8.0)))
        axes.set_title(f"{name}, {frames} object-frames", pad=3)
        axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    panels[0].set_ylabel("IoU with the exact mask")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(COLOURS), frameon=False)
    return figure


def _draw_kind(axes: Axes, rows: pd.DataFrame, *, kind: str, colour: str) -> None:
    by_bin = rows.groupby(np.floor(rows["range_m"] / BIN_M))["iou"]
    low, median, high = (by_bin.quantile(share)[by_bin.size() >= FEWEST] for share in (0.25, 0.5, 0.75))
    middles_m = (median.index.to_numpy(dtype=np.float64) + 0.5) * BIN_M
    axes.fill_between(middles_m, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(middles_m, median, color=colour, marker="o", markersize=3, linewidth=1.2, label=kind)


def write_audit_files(folder: Path, audit: AuditSummary, polygons: pa.Table) -> tuple[Path, ...]:
    """Write `audit.md`, `audit.csv`, `fit.png` and `fit.svg` beside `audit.json`; all of their paths.

    Args:
        folder: of the audit.
        audit: its summary.
        polygons: its rows.
    """
    tables = report(audit).write(folder, "audit")
    chart = draw_fit_by_distance(audit, polygons)
    return (folder / AUDIT, *tables, *canvas.write_picture(folder / "fit", chart))


MARGIN = 0.35  # around the object, of its larger side
SMALLEST_PX = 60  # side of what is shown
_EXAMPLE_IN = 3.2


@canvas.styled
def write_examples(
    folder: Path,
    audit: AuditSummary,
    polygons: pa.Table,
    *,
    handles: Mapping[str, RecordingHandle],
    protocol: Protocol,
) -> tuple[Path, ...]:
    """Write `examples-<class>.png` and `.svg` for every class that has object-frames.

    Args:
        folder: of the audit.
        audit: its summary.
        polygons: its rows.
        handles: of the recordings, by name.
        protocol: of the audit.
    """
    files: list[Path] = []
    colours = dict(zip(audit.polygon_kinds, cycle(COLOURS), strict=False))
    legend: list[Line2D | Patch] = [Patch(color=canvas.SKY_BLUE, alpha=0.6, label="exact mask")]
    legend += [Line2D([], [], color=colour, label=kind) for kind, colour in colours.items()]
    for name, rows in example_rows(polygons, kind=audit.polygon_kinds[0]).items():
        figure = canvas.new_figure(len(rows) * _EXAMPLE_IN, _EXAMPLE_IN + 0.7, layout="constrained")
        for axes, (which, row) in zip(figure.subplots(1, len(rows)), rows.items(), strict=True):
            _draw_example(axes, row, handles[str(row["recording"])].open(), colours=colours, protocol=protocol)
            fit = f"{which}: IoU {row['iou']:.2f} ({audit.polygon_kinds[0]}), {row['range_m']:.1f} m"
            axes.set_title(f"{fit}\n{row['recording']}, {row['track_id']}", pad=3, fontsize=7)
        figure.legend(handles=legend, loc="outside lower center", ncols=len(legend), frameon=False)
        files += canvas.write_picture(folder / f"examples-{name}", figure)
    return tuple(files)


def example_rows(polygons: pa.Table, *, kind: str) -> dict[str, dict[str, pd.Series]]:
    """By class, the object-frames of median and of worst IoU; ties go to the first in name and time."""
    rows = polygons.to_pandas()
    rows = rows[(rows["compensation"] == Compensation.FULL.value) & (rows["kind"] == kind)]
    rows = rows.sort_values(["iou", "recording", "camera", "timestamp_ns", "track_id"], ignore_index=True)
    return {
        str(name): {"median": part.iloc[len(part) // 2], "worst": part.iloc[0]}
        for name, part in rows.groupby("object_class")
    }


def _draw_example(
    axes: Axes, row: pd.Series, recording: Recording, *, colours: Mapping[str, str], protocol: Protocol
) -> None:
    """Draw the exact mask and the polygons of an object-frame, enlarged to its surroundings."""
    camera, track_id = str(row["camera"]), str(row["track_id"])
    image = next(ref for ref in recording.images[camera] if ref.timestamp_ns == row["timestamp_ns"])
    track = next(track for track in recording.tracks if track.track_id == track_id)
    mask = read_truth(image, recording.cameras[camera]) == track.instance_id
    pixels = read_image(image, recording.cameras[camera])
    canvas.show_image(axes, canvas.overlay_areas(pixels, {canvas.SKY_BLUE: mask}, strength=0.45))
    u, v, width, height = cv2.boundingRect(mask.astype(np.uint8))
    bounds: list[tuple[float, float, float, float]] = [(u, v, u + width, v + height)]
    for kind, colour in colours.items():
        builder = ReferenceBuilder(recording, camera, lenient(protocol.reference_settings(), kind))
        polygon = next((item.polygon for item in builder.build(image).objects if item.track_id == track_id), None)
        if polygon is not None:
            canvas.draw_outline(axes, polygon, colour=colour)
            bounds.append(polygon.bounds)
    low, high = np.min(bounds, axis=0)[:2], np.max(bounds, axis=0)[2:]
    (u, v), half = (low + high) / 2, max(float((high - low).max()) * (0.5 + MARGIN), SMALLEST_PX / 2)
    axes.set(xlim=(u - half, u + half), ylim=(v + half, v - half))


MISS_COLOURS = {
    MissCause.NEAR_EPIPOLE: canvas.BLACK,
    MissCause.ENTERED: canvas.GREY,
    MissCause.ABOVE_HORIZON: canvas.BLUE,
    MissCause.BELOW_THRESHOLD: canvas.SKY_BLUE,
    MissCause.UNCOVERED: canvas.ORANGE,
    MissCause.FLOW: canvas.VERMILION,
    MissCause.EGO_MOTION: canvas.PURPLE,
}
FALSE_COLOURS = {
    FalseCause.ANTI_PARALLEL: canvas.YELLOW,
    FalseCause.OTHER_CONSTRAINT: canvas.SKY_BLUE,
    FalseCause.UNCOVERED: canvas.GREY,
    FalseCause.BESIDE_OBJECT: canvas.ORANGE,
    FalseCause.FLOW: canvas.VERMILION,
    FalseCause.EGO_MOTION: canvas.PURPLE,
}
_CAUSE_IN, _CAUSE_BELOW_IN, _TINT = 3.6, 0.75, 0.65


def write_cause_pictures(
    folder: Path,
    misses: pa.Table,
    *,
    sources: Mapping[str, AuditSource],
    method: Method,
    protocol: Protocol,
) -> tuple[Path, ...]:
    """Write `causes-<category>.png` and `.svg` for every kind of motion that has missed cells.

    Args:
        folder: of the audit.
        misses: its rows.
        sources: recordings by name.
        method: that was audited.
        protocol: of the audit.
    """
    files: list[Path] = []
    for category, (recording, camera, timestamp_ns) in worst_images(misses).items():
        explained = explain_image(
            sources[recording], camera=camera, timestamp_ns=timestamp_ns, method=method, protocol=protocol
        )
        title = f"{category.replace('_', ' ')}: {recording}, {timestamp_ns / 1e9:.3f} s"
        files += canvas.write_picture(folder / f"causes-{category}", draw_causes(explained, title=title))
    return tuple(files)


def worst_images(misses: pa.Table) -> dict[str, tuple[str, str, int]]:
    """By category, recording, camera and time of the object-frame with most missed cells; ties go to the first."""
    rows = misses.to_pandas()
    rows["missed"] = rows["cells"] - rows["hit"]
    order = ["missed", "recording", "camera", "timestamp_ns", "track_id"]
    rows = rows[rows["missed"] > 0].sort_values(order, ascending=[False, *[True] * 4])
    first = rows.drop_duplicates("category").sort_values("category")
    keys = zip(first["category"], first["recording"], first["camera"], first["timestamp_ns"], strict=True)
    return {str(name): (str(recording), str(camera), int(time_ns)) for name, recording, camera, time_ns in keys}


@canvas.styled
def draw_causes(explained: ExplainedImage, *, title: str) -> Figure:
    """Draw the moving objects' cells on the left, the false alarms on the right, each in the colour of its cause."""
    height, width = explained.pixels.shape[:2]
    figure = canvas.new_figure(2 * _CAUSE_IN, _CAUSE_IN * height / width + _CAUSE_BELOW_IN, layout="constrained")
    left = {"found": (canvas.GREEN, explained.hit)} | {
        MISSES[c]: (MISS_COLOURS[c], explained.missed[c]) for c in MissCause
    }
    right = {FALSE_ALARMS[c]: (FALSE_COLOURS[c], explained.flagged[c]) for c in FalseCause}
    panels = figure.subplots(1, 2)
    for axes, heading, layers in zip(panels, ("moving objects", "static world"), (left, right), strict=True):
        areas = {colour: _pixels(cells, explained) for colour, cells in layers.values()}
        canvas.show_image(axes, canvas.overlay_areas(canvas.faded(explained.pixels, 0.8), areas, strength=_TINT))
        axes.set_title(f"{title}, {heading}", pad=3, fontsize=7)
        shares = {name: int(np.count_nonzero(cells)) for name, (_, cells) in layers.items()}
        handles = [
            Patch(facecolor=colour, edgecolor=canvas.BLACK, linewidth=0.3, label=f"{name} ({shares[name]})")
            for name, (colour, _) in layers.items()
            if shares[name]
        ]
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2, frameon=False,
                    fontsize=6, handlelength=1.2, columnspacing=1.0)  # fmt: skip
    return figure


def _pixels(cells: NDArray[np.bool_], explained: ExplainedImage) -> NDArray[np.bool_]:
    """(H, W) bool, the pixels of cells."""
    height, width = explained.pixels.shape[:2]
    every: NDArray[np.bool_] = np.kron(cells, np.ones((explained.cell_size_px, explained.cell_size_px), dtype=bool))
    return every[:height, :width]
