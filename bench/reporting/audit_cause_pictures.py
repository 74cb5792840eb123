"""Pictures of why cells are missed and flagged: the image of each kind of motion in which most is missed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.evaluation import Protocol
from bench.harness.audit import AuditSource, ExplainedImage, FalseCause, MissCause, explain_image
from bench.methods import Method
from bench.reporting.audit_cause_tables import FALSE_ALARMS, MISSES
from bench.reporting.canvas import faded, new_figure, rgb_image, show_image, styled
from bench.reporting.colours import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    YELLOW,
    rgb,
)
from bench.reporting.write import write_picture

MISS_COLOURS = {
    MissCause.NEAR_EPIPOLE: BLACK,
    MissCause.ENTERED: GREY,
    MissCause.ABOVE_HORIZON: BLUE,
    MissCause.BELOW_THRESHOLD: SKY_BLUE,
    MissCause.UNCOVERED: ORANGE,
    MissCause.FLOW: VERMILION,
    MissCause.EGO_MOTION: PURPLE,
}
FALSE_COLOURS = {
    FalseCause.ANTI_PARALLEL: YELLOW,
    FalseCause.OTHER_CONSTRAINT: SKY_BLUE,
    FalseCause.UNCOVERED: GREY,
    FalseCause.BESIDE_OBJECT: ORANGE,
    FalseCause.FLOW: VERMILION,
    FalseCause.EGO_MOTION: PURPLE,
}
_PANEL_IN, _TOP_IN, _BOTTOM_IN, _TINT = 3.6, 0.3, 0.72, 0.65


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
        found = explain_image(
            sources[recording], camera=camera, timestamp_ns=timestamp_ns, method=method, protocol=protocol
        )
        title = f"{category.replace('_', ' ')}: {recording}, {timestamp_ns / 1e9:.3f} s"
        files += write_picture(folder / f"causes-{category}", draw_causes(found, title=title))
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


@styled
def draw_causes(found: ExplainedImage, *, title: str) -> Figure:
    """Draw the moving objects' cells on the left, the false alarms on the right, each in the colour of its cause."""
    height, width = found.pixels.shape[:2]
    picture_in = _PANEL_IN * height / width
    full_in = _TOP_IN + picture_in + _BOTTOM_IN
    figure = new_figure(2 * _PANEL_IN, full_in)
    left = {"found": (GREEN, found.hit)} | {MISSES[c]: (MISS_COLOURS[c], found.missed[c]) for c in MissCause}
    right = {FALSE_ALARMS[c]: (FALSE_COLOURS[c], found.flagged[c]) for c in FalseCause}
    for number, (heading, layers) in enumerate({"moving objects": left, "static world": right}.items()):
        axes = figure.add_axes((number / 2 + 0.005, _BOTTOM_IN / full_in, 0.49, picture_in / full_in))
        show_image(axes, _tinted(found, layers))
        axes.set_title(f"{title}, {heading}", pad=3, fontsize=7)
        shares = {name: int(np.count_nonzero(cells)) for name, (_, cells) in layers.items()}
        handles = [
            Patch(facecolor=colour, edgecolor=BLACK, linewidth=0.3, label=f"{name} ({shares[name]})")
            for name, (colour, _) in layers.items()
            if shares[name]
        ]
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2, frameon=False,
                    fontsize=6, handlelength=1.2, columnspacing=1.0)  # fmt: skip
    return figure


def _tinted(found: ExplainedImage, layers: Mapping[str, tuple[str, NDArray[np.bool_]]]) -> NDArray[np.uint8]:
    picture = faded(rgb_image(found.pixels), 0.8).astype(np.float32)
    height, width = picture.shape[:2]
    for colour, cells in layers.values():
        rows = np.repeat(cells, found.cell_size_px, axis=0)
        area = np.repeat(rows, found.cell_size_px, axis=1)[:height, :width]
        picture[area] = (1 - _TINT) * picture[area] + _TINT * np.array(rgb(colour), dtype=np.float32)
    return picture.astype(np.uint8)
