"""The column of panels of one frame: flow, the four deviations, likelihood, segmentation (the paper's figure 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.methods.contract import Segmentation
from bench.reference.records import ReferenceFrame
from bench.reporting.canvas import GREEN, LIGHT_GREY, faded, rgb, rgb_image, show_image, styled
from bench.reporting.outlines import draw_references
from bench.reporting.panel_grid import PanelGrid

LIKELIHOOD_SATURATION = 0.02  # the paper's figure 6
SCORE_SATURATION = 1.0
DEVIATION_SATURATION = 0.05  # a deviation of weight 1 that makes a likelihood of 0.02 by itself is 0.048
FLOW_SATURATION_PX = 16.0
ARROWS_ACROSS = 24
COLOUR_MAP = "inferno"
FLOW_COLOUR_MAP = "viridis"
DEVIATIONS = {
    "epipolar": "epipolar",
    "positive_depth": "positive depth",
    "positive_height": "positive height",
    "anti_parallel": "anti-parallel",
    "three_view": "three views",
}
_NUMERALS = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PanelColumn:
    """One frame to draw.

    Attributes:
        image: the current image, (H, W) grey or (H, W, 3) BGR uint8.
        segmentation: the method's word on it; panels appear for the `parts` it has.
        reference: the frame's reference.
        title: above the column; empty for camera and time.
    """

    image: NDArray[np.uint8]
    segmentation: Segmentation
    reference: ReferenceFrame
    title: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    label: str
    expected: Callable[[PanelColumn], bool]
    draw: Callable[[Axes, PanelColumn], None]
    saturation: float | None = None
    colour_map: str = COLOUR_MAP
    unit: str = ""


@styled
def draw_panels(columns: PanelColumn | Sequence[PanelColumn], *, column_width_in: float | None = None) -> Figure:
    """Draw frames side by side, each as a column of panels.

    Args:
        columns: the frames; images of one size.
        column_width_in: width of an image; None for a paper's column or page, as the number of frames asks for.

    Returns:
        A row for everything that any of the frames has; a frame without it leaves its place empty.

    Raises:
        UsageError: no frame.

    Source:
        Mariotti and Eising 2020, figure 6.
    """
    frames = [columns] if isinstance(columns, PanelColumn) else list(columns)
    if not frames:
        raise UsageError("panels: expected at least one frame, got none")
    rows = [row for row in _rows() if any(row.expected(frame) for frame in frames)]
    width_in = column_width_in or (2.6 if len(frames) == 1 else max(1.5, 6.3 / len(frames)))
    height_in = width_in * frames[0].image.shape[0] / frames[0].image.shape[1]
    grid = PanelGrid(columns=len(frames), rows=len(rows), width_in=width_in, height_in=height_in)
    for r, row in enumerate(rows):
        for c, frame in enumerate(frames):
            axes = grid.axes(r, c)
            if row.expected(frame):
                row.draw(axes, frame)
            else:
                axes.set_axis_off()
            if r == 0:
                axes.set_title(frame.title or _default_title(frame.reference), pad=3, fontsize=7)
        grid.label(r, f"({_NUMERALS[r]}) {row.label}")
        if row.saturation is not None:
            grid.colour_bar(r, saturation=row.saturation, colour_map=row.colour_map, unit=row.unit)
    return grid.figure


def _rows() -> list[_Row]:
    deviations = [
        _Row(
            label=label,
            expected=lambda frame, name=name: name in (frame.segmentation.parts or {}),  # type: ignore[misc]
            draw=lambda axes, frame, name=name: _draw_deviation(axes, frame, name),  # type: ignore[misc]
            saturation=DEVIATION_SATURATION,
            unit="deviation",
        )
        for name, label in DEVIATIONS.items()
    ]
    return [
        _Row(
            label="flow",
            expected=lambda frame: {"flow_u", "flow_v"} <= set(frame.segmentation.parts or {}),
            draw=_draw_flow,
            saturation=FLOW_SATURATION_PX,
            colour_map=FLOW_COLOUR_MAP,
            unit="px per frame",
        ),
        *deviations,
        _Row(
            label="likelihood",
            expected=lambda frame: _has_likelihood(frame, score=False),
            draw=_draw_likelihood,
            saturation=LIKELIHOOD_SATURATION,
            unit="likelihood",
        ),
        _Row(
            label="score",
            expected=lambda frame: _has_likelihood(frame, score=True),
            draw=_draw_likelihood,
            saturation=SCORE_SATURATION,
            unit="score",
        ),
        _Row(label="segmentation", expected=lambda _: True, draw=_draw_segmentation),
    ]


def _draw_flow(axes: Axes, frame: PanelColumn) -> None:
    """Arrows from where the pixel was in the previous image to where it is now, on an even grid."""
    parts, cell = frame.segmentation.parts, frame.segmentation.cell_size_px
    assert parts is not None
    flow_u, flow_v = parts["flow_u"], parts["flow_v"]
    show_image(axes, faded(rgb_image(frame.image), 0.45))
    step = max(1, flow_u.shape[1] // ARROWS_ACROSS)
    picked = np.s_[step // 2 :: step, step // 2 :: step]
    v, u = (np.mgrid[: flow_u.shape[0], : flow_u.shape[1]] * cell + (cell - 1) / 2)[:, *picked]
    inside = (u < frame.image.shape[1]) & (v < frame.image.shape[0])
    seen = inside & frame.reference.valid[np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)]
    back_u, back_v = flow_u[picked][seen], flow_v[picked][seen]
    length_px = np.hypot(back_u, back_v)
    axes.quiver(
        u[seen], v[seen], -back_u, -back_v, length_px,
        angles="xy", scale_units="xy", scale=1.0, pivot="tip", width=0.0045, headwidth=4.0, headlength=4.5,
        minlength=0.6, cmap=FLOW_COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=FLOW_SATURATION_PX, clip=True),
    )  # fmt: skip


def _has_likelihood(frame: PanelColumn, *, score: bool) -> bool:
    return frame.segmentation.likelihood is not None and frame.segmentation.likelihood_is_score == score


def _draw_deviation(axes: Axes, frame: PanelColumn, name: str) -> None:
    assert frame.segmentation.parts is not None
    _draw_cells(axes, frame, frame.segmentation.parts[name], DEVIATION_SATURATION)


def _draw_likelihood(axes: Axes, frame: PanelColumn) -> None:
    assert frame.segmentation.likelihood is not None
    saturation = SCORE_SATURATION if frame.segmentation.likelihood_is_score else LIKELIHOOD_SATURATION
    _draw_cells(axes, frame, frame.segmentation.likelihood, saturation)


def _draw_cells(axes: Axes, frame: PanelColumn, values: NDArray[np.float32], saturation: float) -> None:
    """Colour the cells; light grey where the lens or the method sees nothing."""
    height, width = frame.image.shape[:2]
    cell = frame.segmentation.cell_size_px
    rows, columns = values.shape
    middle = cell // 2
    seen = frame.reference.valid[middle::cell, middle::cell]
    hidden = ~np.pad(seen, ((0, rows - seen.shape[0]), (0, columns - seen.shape[1])), mode="edge")
    if frame.segmentation.undefined is not None:
        hidden |= frame.segmentation.undefined
    shown = np.ma.masked_array(values, mask=hidden | ~np.isfinite(values))
    axes.set_facecolor(LIGHT_GREY)
    axes.imshow(
        shown, cmap=COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=saturation, clip=True), interpolation="nearest",
        extent=(-0.5, columns * cell - 0.5, rows * cell - 0.5, -0.5),
    )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])


def _draw_segmentation(axes: Axes, frame: PanelColumn) -> None:
    image = rgb_image(frame.image)
    height, width = image.shape[:2]
    moving = frame.segmentation.mask_at(width, height) & frame.reference.valid
    tinted = image.copy()
    tinted[moving] = (0.45 * image[moving] + 0.55 * np.array(rgb(GREEN))).astype(np.uint8)
    show_image(axes, tinted)
    draw_references(axes, frame.reference.objects)


def _default_title(reference: ReferenceFrame) -> str:
    return f"{reference.camera}, {reference.timestamp_ns / 1e9:.2f} s"
