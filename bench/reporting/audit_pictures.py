"""Examples of an audit: the polygons that fit worst, and those that fit as most do, over the exact masks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from shapely import Polygon

from bench.evaluation import Protocol
from bench.harness.audit import AuditSummary, Compensation, lenient
from bench.recordings import ImageRef, Recording, RecordingHandle, read_image, read_truth
from bench.reference import ReferenceBuilder
from bench.reporting.audit_chart import COLOURS
from bench.reporting.canvas import new_figure, rgb_image, show_image, styled
from bench.reporting.colours import SKY_BLUE
from bench.reporting.outlines import draw_outline
from bench.reporting.overlay import overlay_mask
from bench.reporting.write import write_picture

MARGIN = 0.35  # around the object, of its larger side
SMALLEST_PX = 60  # side of what is shown
_PANEL_IN, _TOP_IN, _BOTTOM_IN = 3.2, 0.42, 0.28


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Example:
    """An object-frame to look at.

    Attributes:
        title: what it is an example of.
        image: (H, W) grey uint8.
        mask: (H, W) bool, the exact mask.
        polygons: by kind.
    """

    title: str
    image: NDArray[np.uint8]
    mask: NDArray[np.bool_]
    polygons: Mapping[str, Polygon]


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
        audit: its figures.
        polygons: its rows.
        handles: of the recordings, by name.
        protocol: of the audit.
    """
    files: list[Path] = []
    for name, rows in example_rows(polygons, kind=audit.polygon_kinds[0]).items():
        examples = [
            _example(row, title, handles[str(row["recording"])].open(), audit, protocol) for title, row in rows.items()
        ]
        files += write_picture(folder / f"examples-{name}", draw_examples(examples, audit.polygon_kinds))
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


@styled
def draw_examples(examples: list[Example], kinds: tuple[str, ...]) -> Figure:
    """Draw object-frames side by side, each enlarged to its surroundings."""
    width_in, height_in = len(examples) * _PANEL_IN, _TOP_IN + _PANEL_IN + _BOTTOM_IN
    figure = new_figure(width_in, height_in)
    for number, example in enumerate(examples):
        axes = figure.add_axes(
            (number / len(examples) + 0.01, _BOTTOM_IN / height_in, 0.98 / len(examples), _PANEL_IN / height_in)
        )
        tinted = overlay_mask(example.image, mask=example.mask, colour=SKY_BLUE, strength=0.45)
        show_image(axes, rgb_image(tinted))
        for kind, colour in zip(kinds, COLOURS, strict=False):
            if kind in example.polygons:
                draw_outline(axes, example.polygons[kind], colour=colour)
        left, top, right, bottom = _window(example)
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_title(example.title, pad=3, fontsize=7)
    handles: list[Line2D | Patch] = [Patch(color=SKY_BLUE, alpha=0.6, label="exact mask")]
    handles += [Line2D([], [], color=colour, label=kind) for kind, colour in zip(kinds, COLOURS, strict=False)]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, borderaxespad=0.1)
    return figure


def _window(example: Example) -> tuple[float, float, float, float]:
    """A square about mask and polygons: left, top, right, bottom."""
    u, v, width, height = cv2.boundingRect(example.mask.astype(np.uint8))
    bounds = np.array([(u, v, u + width, v + height), *(polygon.bounds for polygon in example.polygons.values())])
    low, high = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    middle = (low + high) / 2
    half = max(float((high - low).max()) * (0.5 + MARGIN), SMALLEST_PX / 2)
    return middle[0] - half, middle[1] - half, middle[0] + half, middle[1] + half


def _example(row: pd.Series, title: str, recording: Recording, audit: AuditSummary, protocol: Protocol) -> Example:
    camera, track_id = str(row["camera"]), str(row["track_id"])
    image = next(ref for ref in recording.images[camera] if ref.timestamp_ns == row["timestamp_ns"])
    track = next(track for track in recording.tracks if track.track_id == track_id)
    polygons = {
        kind: _polygon(recording, image, track_id, protocol=protocol, kind=kind) for kind in audit.polygon_kinds
    }
    return Example(
        title=f"{title}: IoU {row['iou']:.2f} ({audit.polygon_kinds[0]}), {row['range_m']:.1f} m\n"
        f"{recording.name}, {track_id}",
        image=read_image(image, recording.cameras[camera]),
        mask=read_truth(image, recording.cameras[camera]) == track.instance_id,
        polygons={kind: polygon for kind, polygon in polygons.items() if polygon is not None},
    )


def _polygon(recording: Recording, image: ImageRef, track_id: str, *, protocol: Protocol, kind: str) -> Polygon | None:
    builder = ReferenceBuilder(recording, image.camera, lenient(protocol.reference_settings(), kind))
    return next((item.polygon for item in builder.build(image).objects if item.track_id == track_id), None)
