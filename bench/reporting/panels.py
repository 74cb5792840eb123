"""The panels of one frame: flow, the deviations, likelihood, segmentation (the paper's figure 6)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.records.reference import ReferenceFrame
from bench.records.segmentation import Segmentation
from bench.reporting import canvas
from bench.reporting.formats import frame_name
from bench.reporting.overlay import draw_references, overlay_areas, unknown_bands

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
_WIDTH_IN, _LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN, _GAP_IN = 2.6, 0.26, 0.62, 0.22, 0.05, 0.06
_NOTE_IN = 0.1
BAND_NOTE = "coloured: unknown bands, which count neither way; inside: cores"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Panel:
    label: str
    draw: Callable[[Axes], None]
    saturation: float | None = None
    colour_map: str = COLOUR_MAP
    unit: str = ""


@canvas.styled
def draw_panels(
    image: NDArray[np.uint8], *, segmentation: Segmentation, reference: ReferenceFrame, made_by: str = ""
) -> Figure:
    """Draw a frame as a column of panels, one for everything that the method shows of its work.

    Args:
        image: the current image, (H, W) grey or (H, W, 3) BGR uint8.
        segmentation: the method's answer; panels appear for the `parts` it has.
        reference: the frame's reference.
        made_by: method and protocol, below the name of the image; empty where they are said beside the picture.

    Source:
        Mariotti and Eising 2020, figure 6.
    """
    panels = list(_panels(image, segmentation, reference))
    height_in = _WIDTH_IN * image.shape[0] / image.shape[1]
    note_in = _NOTE_IN if unknown_bands(reference).any() else 0.0
    top_in = _TOP_IN + bool(made_by) * _NOTE_IN
    full_in = top_in + len(panels) * height_in + (len(panels) - 1) * _GAP_IN + note_in + _BOTTOM_IN
    width_in = _LEFT_IN + _WIDTH_IN + _RIGHT_IN
    figure = canvas.new_figure(width_in, full_in)
    across = {"left": _LEFT_IN / width_in, "right": (_LEFT_IN + _WIDTH_IN) / width_in}
    down = {"bottom": (_BOTTOM_IN + note_in) / full_in, "top": 1 - top_in / full_in, "hspace": _GAP_IN / height_in}
    rows = figure.subplots(len(panels), 1, squeeze=False, gridspec_kw=across | down)[:, 0]
    for axes, panel, numeral in zip(rows, panels, _NUMERALS, strict=False):
        panel.draw(axes)
        axes.set_ylabel(f"({numeral}) {panel.label}", fontsize=7, labelpad=3)
        if panel.saturation is not None:
            _draw_colour_bar(axes, panel, panel.saturation)
    rows[0].set_title(f"{frame_name(reference)}\n{made_by}".rstrip(), pad=3, fontsize=6)
    if note_in:
        rows[-1].set_xlabel(BAND_NOTE, fontsize=5.5, labelpad=1)
    return figure


def _draw_colour_bar(axes: Axes, panel: _Panel, saturation: float) -> None:
    scale = ScalarMappable(norm=Normalize(vmin=0.0, vmax=saturation), cmap=panel.colour_map)
    beside = axes.inset_axes((1.023, 0.05, 0.035, 0.9))
    bar = axes.figure.colorbar(scale, cax=beside, extend="max", ticks=[0.0, saturation / 2, saturation])
    bar.ax.tick_params(labelsize=6, length=2, pad=1.5)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.set_label(panel.unit, fontsize=6)
    bar.ax.yaxis.set_label_coords(4.6, 0.5)  # one line for all bars, whatever their numbers' width


def _panels(image: NDArray[np.uint8], segmentation: Segmentation, reference: ReferenceFrame) -> Iterator[_Panel]:
    parts = segmentation.parts or {}
    cells = partial(_draw_cells, segmentation=segmentation, reference=reference)
    if "flow_u" in parts and "flow_v" in parts:
        flow = partial(_draw_flow, image=image, segmentation=segmentation, reference=reference)
        yield _Panel(label="flow", draw=flow, saturation=FLOW_SATURATION_PX, colour_map=FLOW_COLOUR_MAP,
                     unit="px per frame")  # fmt: skip
    for name, label in DEVIATIONS.items():
        if name in parts:
            draw = partial(cells, values=parts[name], saturation=DEVIATION_SATURATION)
            yield _Panel(label=label, draw=draw, saturation=DEVIATION_SATURATION, unit="deviation")
    if segmentation.likelihood is not None:
        is_score = segmentation.likelihood_is_score
        label, saturation = ("score", SCORE_SATURATION) if is_score else ("likelihood", LIKELIHOOD_SATURATION)
        draw = partial(cells, values=segmentation.likelihood, saturation=saturation)
        yield _Panel(label=label, draw=draw, saturation=saturation, unit=label)
    result = partial(_draw_segmentation, image=image, segmentation=segmentation, reference=reference)
    yield _Panel(label="segmentation", draw=result)


def _draw_flow(axes: Axes, *, image: NDArray[np.uint8], segmentation: Segmentation, reference: ReferenceFrame) -> None:
    """Arrows from where the pixel was in the previous image to where it is now, on an even grid."""
    parts, cell = segmentation.parts, segmentation.cell_size_px
    assert parts is not None
    flow_u, flow_v = parts["flow_u"], parts["flow_v"]
    canvas.show_image(axes, canvas.faded(image, 0.45))
    step = max(1, flow_u.shape[1] // ARROWS_ACROSS)
    picked = np.s_[step // 2 :: step, step // 2 :: step]
    v, u = (np.mgrid[: flow_u.shape[0], : flow_u.shape[1]] * cell + (cell - 1) / 2)[:, *picked]
    inside = (u < image.shape[1]) & (v < image.shape[0])
    seen = inside & reference.valid[np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)]
    back_u, back_v = flow_u[picked][seen], flow_v[picked][seen]
    length_px = np.hypot(back_u, back_v)
    axes.quiver(
        u[seen], v[seen], -back_u, -back_v, length_px,
        angles="xy", scale_units="xy", scale=1.0, pivot="tip", width=0.0045, headwidth=4.0, headlength=4.5,
        minlength=0.6, cmap=FLOW_COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=FLOW_SATURATION_PX, clip=True),
    )  # fmt: skip


def _draw_cells(
    axes: Axes,
    *,
    segmentation: Segmentation,
    reference: ReferenceFrame,
    values: NDArray[np.float32],
    saturation: float,
) -> None:
    """Colour the cells; light grey where the lens or the method sees nothing."""
    height, width = reference.valid.shape
    cell = segmentation.cell_size_px
    rows, columns = values.shape
    middle = cell // 2
    seen = reference.valid[middle::cell, middle::cell]
    hidden = ~np.pad(seen, ((0, rows - seen.shape[0]), (0, columns - seen.shape[1])), mode="edge")
    if segmentation.undefined is not None:
        hidden |= segmentation.undefined
    shown = np.ma.masked_array(values, mask=hidden | ~np.isfinite(values))
    axes.set_facecolor(canvas.LIGHT_GREY)
    axes.imshow(
        shown, cmap=COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=saturation, clip=True), interpolation="nearest",
        extent=(-0.5, columns * cell - 0.5, rows * cell - 0.5, -0.5),
    )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])


def _draw_segmentation(
    axes: Axes, *, image: NDArray[np.uint8], segmentation: Segmentation, reference: ReferenceFrame
) -> None:
    height, width = reference.valid.shape
    moving = segmentation.mask_at(width, height) & reference.valid
    canvas.show_image(axes, overlay_areas(image, {canvas.GREEN: moving}, strength=0.55))
    draw_references(axes, reference)
