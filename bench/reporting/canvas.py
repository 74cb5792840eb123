"""Basis of every picture: colours, an empty figure, an image on its axes, the ground seen from above.

The colours are Okabe and Ito's, which stay apart for colour-blind readers.

Source:
    Okabe and Ito 2008, Color Universal Design.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from shapely import get_parts, get_rings

from bench.atomic import write_bytes
from bench.errors import ShapeError
from bench.plain_text import plain
from bench.records.reference import Outline
from bench.reporting.document import data_uri

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
DARK_GREY = "#505050"

_LABEL_SIZES = 4.5, 6.0  # points, in a picture of 1.8 inches and less, of 2.4 inches and more
_LABEL_GAP_PX = 3.0


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


def new_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Figure:
    """Return an empty figure of whole pixels, unknown to pyplot; a constrained one places its axes itself."""
    size_in = round(width_in * DPI) / DPI, round(height_in * DPI) / DPI
    figure = Figure(figsize=size_in, dpi=DPI, facecolor="white", layout=layout)
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Axes:
    """New axes, placed in inches from the lower left corner of the figure."""
    full_width_in, full_height_in = figure.get_size_inches()
    return figure.add_axes(
        (left_in / full_width_in, bottom_in / full_height_in, width_in / full_width_in, height_in / full_height_in)
    )


def figure_bytes(figure: Figure, picture_format: PictureFormat) -> bytes:
    """The figure as a file; equal figures give equal bytes."""
    buffer = io.BytesIO()
    _keep_to_the_font(figure)
    with rc_context(STYLE):
        figure.savefig(buffer, format=picture_format, dpi=DPI, metadata=_UNDATED[picture_format])
    return buffer.getvalue()


def figure_pixels(figure: Figure) -> NDArray[np.uint8]:
    """The figure as an image, (H, W, 3) BGR uint8."""
    buffer = io.BytesIO()
    _keep_to_the_font(figure)
    with rc_context(STYLE):
        figure.savefig(buffer, format="rgba", dpi=DPI)
    size = round(figure.bbox.height), round(figure.bbox.width)
    rgba = np.frombuffer(buffer.getvalue(), dtype=np.uint8).reshape(*size, 4)
    return np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR), dtype=np.uint8)


def _keep_to_the_font(figure: Figure) -> None:
    """Names may hold what no font draws."""
    for text in figure.findobj(Text):
        text.set_text("\n".join(map(plain, text.get_text().split("\n"))))


def write_picture(
    stem: FilePath, figure: Figure, *, formats: Sequence[PictureFormat] = ("png", "svg")
) -> tuple[FilePath, ...]:
    """Write a figure as `<stem>.png` and `<stem>.svg`, or other formats, each whole or not at all."""
    for picture_format in formats:
        write_bytes(stem.with_name(f"{stem.name}.{picture_format}"), figure_bytes(figure, picture_format))
    return tuple(stem.with_name(f"{stem.name}.{picture_format}") for picture_format in formats)


def jpeg_bytes(image: NDArray[np.uint8], *, quality: int) -> bytes:
    """A BGR image as JPEG."""
    return _encoded(".jpg", image, cv2.IMWRITE_JPEG_QUALITY, quality)


def jpeg_uri(image: NDArray[np.uint8], *, quality: int = 82) -> str:
    """A BGR image as a `data:` address."""
    return data_uri(jpeg_bytes(image, quality=quality), "image/jpeg")


def layer_uri(image: NDArray[np.uint8]) -> str:
    """A BGRA image of few colours as a `data:` address; WebP without losses takes half of what PNG takes."""
    content = _encoded(".webp", image, cv2.IMWRITE_WEBP_QUALITY, 101)  # above 100 nothing is lost
    return data_uri(content, "image/webp")


def _encoded(ending: str, image: NDArray[np.uint8], option: int, value: int) -> bytes:
    written, content = cv2.imencode(ending, image, [option, value])
    assert written, "OpenCV writes JPEG and WebP"
    return content.tobytes()


def faded(image: NDArray[np.uint8], strength: float) -> NDArray[np.uint8]:
    """An image, (H, W) grey or (H, W, 3) BGR, in grey mixed with white; `strength` 1 keeps its contrast, 0 is white."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(255.0 - strength * (255.0 - grey), dtype=np.uint8)


def overlay_areas(
    image: NDArray[np.uint8], areas: Mapping[str, NDArray[np.bool_]], *, strength: float = 0.5
) -> NDArray[np.uint8]:
    """Tint areas of an image.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        areas: (H, W) bool, by colour "#rrggbb".
        strength: 0 leaves the image, 1 paints it over.

    Returns:
        (H, W, 3) BGR uint8, a new image.

    Raises:
        ShapeError: an area and the image differ in size.
    """
    tinted = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    for colour, area in areas.items():
        if area.shape != image.shape[:2]:
            raise ShapeError(f"mask: expected {image.shape[:2]}, got {area.shape}")
        tinted[area] = ((1 - strength) * tinted[area] + strength * np.array(rgb(colour)[::-1])).astype(np.uint8)
    return np.asarray(tinted, dtype=np.uint8)


def show_image(axes: Axes, image: NDArray[np.uint8]) -> None:
    """Draw an image, (H, W) grey or (H, W, 3) BGR, so that data coordinates are its pixels (u, v); no ticks."""
    height, width = image.shape[:2]
    shown = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
    axes.imshow(shown, interpolation="antialiased")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])


def draw_outline(axes: Axes, polygon: Outline, *, colour: str, style: str = "-", width: float = 1.0) -> PathPatch:
    """Outline a polygon with its holes; a thin dark rim keeps it visible on any background."""
    rings = [Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in get_rings(get_parts(polygon))]
    path = Path.make_compound_path(*rings)
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=width, linestyle=style)
    patch.set_path_effects([withStroke(linewidth=width + 0.8, foreground="black")])
    axes.add_patch(patch)
    return patch


def fit_text(text: Text, width_in: float) -> None:
    """Make a text as small as it must be to be no wider."""
    while (share := width_in * DPI / max(text.get_window_extent().width, 1.0)) < 1.0:  # hinted letters shrink in steps
        text.set_fontsize(float(text.get_fontsize()) * min(share, 0.97))


def place_labels(axes: Axes, polygons: Sequence[Outline], texts: Sequence[str]) -> None:
    """Write each text beside its polygon, inside the axes and off the labels already there.

    Above the polygon where there is room, else below it, else further up and down; off the other polygons if it can.
    """
    taken: list[Bbox] = []
    figure_width_in = axes.figure.get_figure(root=True).get_figwidth()
    size = float(np.clip(2.5 * figure_width_in * axes.get_position().width, *_LABEL_SIZES))
    for polygon, text in zip(polygons, texts, strict=True):
        label = axes.text(0, 0, plain(text), fontsize=size, color="white", ha="left", va="bottom", zorder=10)
        label.set_path_effects([effect(linewidth=1.4, foreground="black") for effect in (Stroke, withStroke)])
        extent = label.get_window_extent().transformed(axes.transData.inverted())
        places = _label_places(axes, polygon, width=abs(extent.width), height=abs(extent.height))
        free = [place for place in places if not any(place.overlaps(other) for other in taken)]
        others = [Bbox.from_extents(*other.bounds) for other in polygons if other is not polygon]
        clear = (place for place in free if not any(place.overlaps(other) for other in others))
        chosen = next(clear, free[0] if free else places[-1])
        label.set_position((chosen.x0, chosen.y1))
        taken.append(chosen)


def _label_places(axes: Axes, polygon: Outline, *, width: float, height: float) -> list[Bbox]:
    """Boxes inside the axes where the label of a polygon may stand, the best first; amid the polygon last."""
    left, right = sorted(axes.get_xlim())
    top, bottom = sorted(axes.get_ylim())  # v grows downwards
    u_min, v_min, u_max, v_max = polygon.bounds
    above, below = v_min - _LABEL_GAP_PX, v_max + _LABEL_GAP_PX + height
    amid = float(np.clip((v_min + v_max + height) / 2, top + height, bottom))
    levels = [above, below, *(above - k * height for k in range(1, 6)), *(below + k * height for k in range(1, 6))]
    sides = np.clip(
        [(u_min + u_max - width) / 2, u_min, u_max - width], left + _LABEL_GAP_PX, right - width - _LABEL_GAP_PX
    )
    places = [(u, v) for v in levels if top + height <= v <= bottom for u in sides]
    return [Bbox.from_extents(u, v - height, u + width, v) for u, v in (*places, (sides[0], amid))]


def plan_axes(axes: Axes, *, x_m: tuple[float, float], y_m: tuple[float, float], labels: bool = True) -> None:
    """Set limits in the vehicle frame; data coordinates are (y, x) so that artists take columns swapped.

    Args:
        axes: where to draw.
        x_m: lowest and highest x, forward, m.
        y_m: lowest and highest y, left, m.
        labels: name the axes.
    """
    axes.set(xlim=(y_m[1], y_m[0]), ylim=x_m, aspect="equal")
    axes.xaxis.set_major_locator(MultipleLocator(5))
    axes.yaxis.set_major_locator(MultipleLocator(5))
    axes.tick_params(length=2, pad=2)
    if labels:
        axes.set_xlabel("y (m), left of the ego vehicle", labelpad=1.5)
        axes.set_ylabel("x (m), ahead of the ego vehicle", labelpad=1.5)


def draw_vehicle(axes: Axes, outline_m: NDArray[np.float64]) -> None:
    """Draw the ego vehicle from its outline, (K, 2) in the vehicle frame, with an arrow in its direction of travel."""
    axes.add_patch(PolygonPatch(outline_m[:, ::-1], facecolor=LIGHT_GREY, edgecolor=BLACK, linewidth=0.9, zorder=5))
    low, high = outline_m.min(axis=0), outline_m.max(axis=0)
    (x, y), length = (low + high) / 2, high[0] - low[0]
    axes.annotate(
        "", xy=(y, x + 0.32 * length), xytext=(y, x - 0.32 * length), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


def draw_rings(axes: Axes, radii_m: Sequence[float]) -> None:
    """Circles of constant range about the vehicle's origin, each with its range behind on the right."""
    for radius in radii_m:
        axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor="#606060", linewidth=0.5, linestyle=":", zorder=4))
        at = radius * np.sqrt(0.5)
        axes.text(
            -at, -at, f"{radius:g} m", fontsize=5.5, color="#303030", ha="center", va="center", zorder=4.5,
            clip_on=True, bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.4},
        )  # fmt: skip
