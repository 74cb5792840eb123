"""Draw docs/surface-patches.png: one object of the demo, the patches of its returns, its core and its unknown band.

python docs/surface_patches.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patches import Polygon as PolygonPatch

from bench.evaluation.protocol import load_protocol
from bench.recordings import load_card, open_dataset, read_image, read_truth
from bench.reference.build import ReferenceBuilder
from bench.reference.exposure import Exposure
from bench.reference.motion import AnnotationIndex
from bench.reference.scanned import ScannedObject
from bench.reporting import figures, frame

DOCS = Path(__file__).parent
CARD, DRIVE, TRACK, TIME_NS = DOCS.parent / "datasets" / "demo.yaml", "crossing-adult-and-child", "adult", 2400000007
CAPTION = f"{DRIVE} of the demo, {TRACK}, {TIME_NS / 1e9:.1f} s, by surface-v1"
MARGIN_PX, PANEL_IN, TALL_IN, TITLE_IN, BELOW_IN = 4, 3.3, 5.6, 0.45, 0.55  # of the picture


@figures.styled
def draw() -> Figure:
    """Draw the returns and patches on the left, core, band and exact mask on the right."""
    recording = next(handle for handle in open_dataset(load_card(str(CARD))) if handle.name == DRIVE).open()
    camera = next(iter(recording.cameras.values()))
    builder = ReferenceBuilder(recording, camera.name, load_protocol("surface-v1").reference)
    image = next(image for image in recording.images[camera.name] if image.timestamp_ns == TIME_NS)
    annotated = AnnotationIndex(recording, builder.settings).at(TIME_NS)
    exposure = Exposure.at(TIME_NS, recording=recording, camera=camera, valid=builder.valid)
    scanned = builder._scanned(next(one for one in annotated if one.track.track_id == TRACK), exposure)
    region = builder._region(scanned)
    assert region is not None, "the object is in view"
    exact = read_truth(image, camera) == next(t.instance_id for t in recording.tracks if t.track_id == TRACK)

    figure = figures.new_figure(2 * PANEL_IN, TALL_IN + TITLE_IN + BELOW_IN)
    height_in = TALL_IN + TITLE_IN + BELOW_IN
    pixels = frame.faded(read_image(image, camera), 0.5)
    left, right = (figures.axes_at(figure, k * PANEL_IN + 0.05, BELOW_IN, PANEL_IN - 0.1, TALL_IN) for k in (0, 1))
    frame.show_image(left, pixels)
    draw_patches(left, scanned)
    areas = {}
    for mask, colour in ((region.core, figures.GREEN), (region.possible & ~region.core, figures.SKY_BLUE)):
        areas[colour] = np.zeros(exact.shape, dtype=bool)
        areas[colour][region.window] = mask
    frame.show_image(right, frame.overlay_areas(pixels, areas))
    right.contour(exact, levels=[0.5], colors=figures.BLACK, linewidths=1.2)
    middle_u, middle_v = (float((axis.start + axis.stop) / 2) for axis in region.window[::-1])
    half_px = (region.window[0].stop - region.window[0].start) / 2 + MARGIN_PX
    for axes, title in ((left, "Returns and their patches"), (right, "Core, unknown band, exact mask")):
        across_px = half_px * (PANEL_IN - 0.1) / TALL_IN
        axes.set(xlim=(middle_u - across_px, middle_u + across_px), ylim=(middle_v + half_px, middle_v - half_px))
        axes.set_title(title, pad=4, fontsize=9)
    handles = [
        Line2D([], [], marker="o", linestyle="", color=figures.VERMILION, markersize=3, label="return"),
        Patch(facecolor=figures.YELLOW, edgecolor=figures.BLACK, label="a single patch"),
        Patch(facecolor="none", edgecolor=figures.BLUE, label="between four neighbours"),
        Patch(facecolor="none", edgecolor=figures.ORANGE, label="with a free end"),
        Patch(facecolor=figures.GREEN, alpha=0.6, label="core: counts"),
        Patch(facecolor=figures.SKY_BLUE, alpha=0.6, label="unknown: does not count"),
        Line2D([], [], color=figures.BLACK, label="exact mask"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False, fontsize=7)
    figure.text(0.5, 1 - 0.08 / height_in, CAPTION, ha="center", va="top", fontsize=7)
    return figure


def draw_patches(axes: Axes, scanned: ScannedObject) -> None:
    """Draw all patches, those with a free end in another colour, and one of them filled."""
    patches = scanned.patches
    corners_px = scanned.exposure.project(patches.corners.reshape(3, -1).T).reshape(4, -1, 2)
    linked = patches.grid.linked.all(axis=0)
    for colour, chosen in ((figures.BLUE, linked), (figures.ORANGE, ~linked)):
        for number in np.flatnonzero(chosen):
            axes.add_patch(PolygonPatch(corners_px[:, number], fill=False, edgecolor=colour, linewidth=0.4))
    inner = np.flatnonzero(linked)
    one = inner[np.argmin(np.abs(scanned.pixels[inner] - np.median(scanned.pixels[inner], axis=0)).sum(axis=1))]
    axes.add_patch(PolygonPatch(corners_px[:, one], facecolor=figures.YELLOW, alpha=0.8, edgecolor=figures.BLACK))
    axes.plot(*scanned.pixels.T, ".", color=figures.VERMILION, markersize=1.8)


if __name__ == "__main__":
    figures.write_picture(DOCS / "surface-patches", draw(), formats=("png",))
