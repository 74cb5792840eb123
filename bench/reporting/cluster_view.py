"""An object's lidar cluster with its polygon in both views: from above and in the fisheye image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from shapely import Polygon

from bench.reference.records import ObjectGeometry
from bench.reporting.canvas import DPI, ORANGE, SKY_BLUE, VERMILION, new_figure, rgb_image, show_image, styled
from bench.reporting.outlines import draw_outline
from bench.reporting.vehicle_plan import draw_vehicle, plan_axes

_WIDTH_IN, _LEFT_IN, _BOTTOM_IN, _TOP_IN, _GAP_IN, _RIGHT_IN = 7.0, 0.42, 0.36, 0.22, 0.12, 0.04
_SURROUNDINGS_M = 3.0
_CLOUD = "#777777"
_DOT_SHARE, _DOT_SIZES = 0.3, (0.05, 3.0)
_INSET_SHARE = 0.42
_INSET_BELOW = 0.35  # an object that fills less than this share of the image is shown larger in a corner


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClusterView:
    """One object, ready to be drawn.

    Attributes:
        geometry: the object's points and annotated shape at exposure.
        image: (H, W) grey or (H, W, 3) BGR uint8.
        polygon: the reference polygon in pixels.
        vehicle_outline_m: (L, 2) float64, the host from above, vehicle frame, m.
        title: names the object.
    """

    geometry: ObjectGeometry
    image: NDArray[np.uint8]
    polygon: Polygon
    vehicle_outline_m: NDArray[np.float64]
    title: str = ""


@styled
def draw_cluster(view: ClusterView) -> Figure:
    """Draw the point cloud from above on the left and the image on the right.

    Source:
        Mariotti and Eising 2020, the figure on ground truth generation.
    """
    height, width = view.image.shape[:2]
    # The square plan and the image share one height and fill the width.
    side_in = (_WIDTH_IN - _LEFT_IN - _GAP_IN - _RIGHT_IN) / (1 + width / height)
    full_in = side_in + _BOTTOM_IN + _TOP_IN
    figure = new_figure(_WIDTH_IN, full_in)
    bottom, tall = _BOTTOM_IN / full_in, side_in / full_in
    plan = figure.add_axes((_LEFT_IN / _WIDTH_IN, bottom, side_in / _WIDTH_IN, tall))
    picture_left = (_LEFT_IN + side_in + _GAP_IN) / _WIDTH_IN
    picture = figure.add_axes((picture_left, bottom, side_in * width / height / _WIDTH_IN, tall))
    _draw_plan(plan, view)
    _draw_picture(picture, view)
    plan.set_title("(a) point cloud from above", pad=3)
    picture.set_title("(b) " + (view.title or "fisheye image"), pad=3)
    return figure


def _draw_plan(axes: Axes, view: ClusterView) -> None:
    found = view.geometry
    around, cluster, outline_m = found.surroundings_vehicle, found.cluster_vehicle, found.outline_m
    axes.scatter(around[:, 1], around[:, 0], s=0.4, c=_CLOUD, linewidths=0, rasterized=True)
    axes.scatter(cluster[:, 1], cluster[:, 0], s=2.5, c=SKY_BLUE, linewidths=0, zorder=4.5, rasterized=True)
    if len(outline_m):
        axes.add_patch(PolygonPatch(outline_m[:, ::-1], fill=False, edgecolor=ORANGE, linewidth=1.3, zorder=4))
    draw_vehicle(axes, view.vehicle_outline_m)
    corners = [part for part in (cluster[:, :2], outline_m, view.vehicle_outline_m) if len(part)]
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    half_m = (high - low).max() / 2 + _SURROUNDINGS_M
    (x, y) = (low + high) / 2
    plan_axes(axes, x_m=(x - half_m, x + half_m), y_m=(y - half_m, y + half_m))


def _draw_picture(axes: Axes, view: ClusterView) -> None:
    image = rgb_image(view.image)
    show_image(axes, image)
    height, width = image.shape[:2]
    _draw_cluster_pixels(axes, view)
    u_min, v_min, u_max, v_max = view.polygon.bounds
    if max((u_max - u_min) / width, (v_max - v_min) / height) < _INSET_BELOW:
        _draw_inset(axes, view, image)


def _draw_cluster_pixels(axes: Axes, view: ClusterView) -> None:
    seen = view.geometry.pixels[np.isfinite(view.geometry.pixels).all(axis=1)]
    size = _dot_size(axes, view.polygon, len(seen))
    axes.scatter(seen[:, 0], seen[:, 1], s=size, c=SKY_BLUE, linewidths=0, zorder=3, rasterized=True)
    draw_outline(axes, view.polygon, colour=VERMILION, width=1.1).set_zorder(3.5)


def _dot_size(axes: Axes, polygon: Polygon, dots: int) -> float:
    """Area of a dot, points squared, so that the dots leave most of the object to be seen."""
    origin, corner = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    points_per_px = abs(corner[0] - origin[0]) * 72.0 / DPI
    return float(np.clip(_DOT_SHARE * polygon.area * points_per_px**2 / max(dots, 1), *_DOT_SIZES))


def _draw_inset(axes: Axes, view: ClusterView, image: NDArray[np.uint8]) -> None:
    """The object enlarged, in the upper or lower corner that is farther from it."""
    height, width = image.shape[:2]
    u_min, v_min, u_max, v_max = view.polygon.bounds
    u, v = (u_min + u_max) / 2, (v_min + v_max) / 2
    half_v = 0.65 * max(v_max - v_min, (u_max - u_min) * height / width, 8.0)
    half_u = half_v * width / height
    left = 0.01 if u > width / 2 else 0.99 - _INSET_SHARE
    bottom = 0.01 if v < height / 2 else 0.99 - _INSET_SHARE
    inset = axes.inset_axes((left, bottom, _INSET_SHARE, _INSET_SHARE))
    show_image(inset, image)
    inset.set(xlim=(u - half_u, u + half_u), ylim=(v + half_v, v - half_v))
    _draw_cluster_pixels(inset, view)
    corner = (u - half_u, v - half_v)
    axes.add_patch(Rectangle(corner, 2 * half_u, 2 * half_v, edgecolor="white", linewidth=0.8, fill=False, zorder=2.5))
    for spine in inset.spines.values():
        spine.set(edgecolor="white", linewidth=0.8)
