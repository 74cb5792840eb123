"""Colours, and canvases of pictures.

The colours of every picture: Okabe and Ito's, which stay apart for colour-blind readers.

Source:
    Okabe and Ito 2008, Color Universal Design.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.plain_text import plain
from bench.reference.records import Category

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType


BLACK = "#000000"
ORANGE = "#e69f00"
SKY_BLUE = "#56b4e9"
GREEN = "#009e73"
YELLOW = "#f0e442"
BLUE = "#0072b2"
VERMILION = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#999999"
LIGHT_GREY = "#d9d9d9"

TRUE_POSITIVE = GREEN
FALSE_NEGATIVE = SKY_BLUE
FALSE_POSITIVE = VERMILION

# Never the green of a mask; orange and vermilion do not meet, since the host either stands or drives.
CATEGORY_COLOURS = {
    Category.CROSSING: YELLOW,
    Category.OVERTAKING: SKY_BLUE,
    Category.PRECEDING: VERMILION,
    Category.APPROACHING: PURPLE,
    Category.STATIC_EGO: ORANGE,
    Category.MOVING: BLUE,
}


def category_colour(category: Category | None) -> str:
    """Colour of a kind of motion; grey where it is unknown."""
    return GREY if category is None else CATEGORY_COLOURS[category]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of "#rrggbb", 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


PictureFormat = Literal["png", "svg", "pdf"]

DPI = 200
STYLE: dict[RcKeyType, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "hatch.linewidth": 0.6,
    "savefig.bbox": None,
    "svg.hashsalt": "fisheye-bench",
    "pdf.fonttype": 42,  # TrueType, which publishers ask for
    "text.parse_math": False,  # names may hold dollar signs
}
_UNDATED: dict[PictureFormat, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

styled = rc_context(STYLE)  # decorates every function that draws


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure on an Agg canvas, strange to pyplot."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, picture_format: PictureFormat) -> bytes:
    """The figure as a file; equal figures give equal bytes."""
    for text in figure.findobj(Text):
        text.set_text("\n".join(map(plain, text.get_text().split("\n"))))  # names may hold what no font draws
    buffer = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=picture_format, dpi=DPI, metadata=_UNDATED[picture_format])
    return buffer.getvalue()


def rgb_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image as it is stored, (H, W) grey or (H, W, 3) BGR, as (H, W, 3) RGB.

    Raises:
        ShapeError: another shape or type.
    """
    if image.dtype != np.uint8 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ShapeError(f"image: expected (H, W) or (H, W, 3) uint8, got {image.shape} {image.dtype}")
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code), dtype=np.uint8)


def faded(image_rgb: NDArray[np.uint8], strength: float) -> NDArray[np.uint8]:
    """The image in grey, mixed with white; `strength` 1 keeps its contrast, 0 leaves white."""
    grey = cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return np.repeat((255.0 - strength * (255.0 - grey)).astype(np.uint8)[:, :, None], 3, axis=2)


def show_image(axes: Axes, image_rgb: NDArray[np.uint8]) -> None:
    """Draw an image so that data coordinates are its pixels (u, v); no ticks."""
    height, width = image_rgb.shape[:2]
    axes.imshow(image_rgb, interpolation="antialiased")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
