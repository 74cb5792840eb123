"""Car bodies: a hull with wheel arches, lamps and seams, and a cabin with panes, from a few outlines.

x = 0 half way along the vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies.loft import Paint, loft
from bench.synthesis.bodies.looks import GLASS, HEADLAMP, PLASTIC, TAIL_LAMP, UNDERSIDE
from bench.synthesis.mesh import Mesh, Surface

SEAM_M = 0.005  # half of the gap beside a door
ARCH_GAP_M = 0.045  # between a tyre and its arch
ARCH_EDGE_M = 0.01  # along the vehicle, where an arch ends straight down
WHEELHOUSE_M = 0.27  # depth
SIDE_STRIPS, SILL_STRIPS, HOUSE_STRIPS, LAMP_STRIPS = (3, 4, 10, 11), (2, 12), (0, 1, 13, 14, 15), (4, 10)
PANES = 1  # the step of the cabin's levels that holds them
Outline = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hull:
    """The body below the windows.

    Attributes:
        top_xz_m: side view of its upper edge, rear to front.
        plan_xy_m: half width over x, rear to front.
        ground_m: clearance below it.
        axles_x_m: middles of the wheel arches.
        wheel_radius_m: of the tyres in them.
        seams_x_m: edges of doors.
        headlamps_x_m: from, to; where they reach around the front corners.
        tail_lamps_x_m: likewise at the rear.
    """

    top_xz_m: Outline
    plan_xy_m: Outline
    ground_m: float
    axles_x_m: tuple[float, ...]
    wheel_radius_m: float
    seams_x_m: tuple[float, ...]
    headlamps_x_m: tuple[float, float]
    tail_lamps_x_m: tuple[float, float]

    def half_width_m(self, x_m: float) -> float:
        """At a place along the vehicle."""
        return float(_along(np.array([x_m]), self.plan_xy_m)[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Cabin:
    """The body around the windows.

    Attributes:
        belt_m: rear x, front x, half width, height of its lower edge.
        roof_m: the same of its upper edge.
        panes: from, to as shares of its length, of the panes at either side.
        seams: shares of its length with the edges of high doors.
        windscreen: whether there is one.
        rear_window: whether there is one.
    """

    belt_m: tuple[float, float, float, float]
    roof_m: tuple[float, float, float, float]
    panes: tuple[tuple[float, float], ...]
    seams: tuple[float, ...] = ()
    windscreen: bool = True
    rear_window: bool = True


def hull_mesh(hull: Hull, paint: Surface) -> Mesh:
    """The hull as one closed surface."""
    places = _hull_places(hull)
    wide, top = _along(places, hull.plan_xy_m), _along(places, hull.top_xz_m)
    arch_m = hull.wheel_radius_m + ARCH_GAP_M
    away = np.min([np.abs(places - x) for x in hull.axles_x_m], axis=0)
    arch = hull.wheel_radius_m + np.sqrt(np.maximum(arch_m**2 - away**2, 0.0))
    sill = np.where(away < arch_m + ARCH_EDGE_M / 2, arch, hull.ground_m)
    crease = np.maximum(sill + 0.06, hull.ground_m + 0.62 * (top - hull.ground_m))
    shoulder = np.maximum(crease + 0.01, top - 0.07)
    edge = np.maximum(shoulder + 0.01, top - 0.005)
    ground = np.full_like(places, hull.ground_m)
    inner = wide - np.minimum(WHEELHOUSE_M, 0.5 * wide)
    side = [
        (inner, ground), (inner, sill), (wide - 0.02, sill), (wide, sill + 0.04), (wide, crease),
        (wide - 0.04, shoulder), (wide - 0.12, edge), (0.45 * wide, edge + 0.02),
    ]  # fmt: skip
    right = np.stack([np.stack([places, -y, z], axis=1) for y, z in side], axis=1)
    left = right[:, ::-1] * np.array([1.0, -1.0, 1.0])
    painted = [_strip(slice(None), strip, UNDERSIDE) for strip in HOUSE_STRIPS]
    painted += [_strip(slice(None), strip, PLASTIC) for strip in SILL_STRIPS]
    for x in hull.seams_x_m:
        painted += [_strip(_between(places, x - SEAM_M, x + SEAM_M), strip, UNDERSIDE) for strip in SIDE_STRIPS]
    for (start, end), lamp in ((hull.headlamps_x_m, HEADLAMP), (hull.tail_lamps_x_m, TAIL_LAMP)):
        painted += [_strip(_between(places, start, end), strip, lamp) for strip in LAMP_STRIPS]
    return loft(np.concatenate([right, left], axis=1), paint, paint=painted)


def cabin_mesh(cabin: Cabin, paint: Surface) -> Mesh:
    """The cabin as one closed surface; its panes are cells of their own."""
    shares, glazed, dark = _side_shares(cabin)
    count, across = len(shares), (-1.0, -0.86, -0.3, 0.3, 0.86, 1.0)
    levels = [_cabin_ring(cabin, level, shares, across) for level in (0.0, 0.10, 0.84, 0.97)]
    middle = np.array([(cabin.roof_m[0] + cabin.roof_m[1]) / 2, 0.0, 0.0])
    crown = [middle + (levels[3] - middle) * (0.94, 0.86, 1.0) + (0, 0, 0.025),
             middle + (levels[3] - middle) * (0.6, 0.5, 1.0) + (0, 0, 0.04)]  # fmt: skip
    # Along a ring: right side to the front, across the front, left side to the rear, across the rear.
    front, left = count - 1, count - 1 + len(across) - 1
    rear = left + count - 1
    painted: list[Paint] = []
    for cells, looks, step in ((glazed, GLASS, slice(PANES, PANES + 1)), (dark, UNDERSIDE, slice(0, 3))):
        for cell in cells:
            painted += [_strip(step, cell, looks), _strip(step, rear - 1 - cell, looks)]
    inner = (1, len(across) - 2)
    for there, start in ((cabin.windscreen, front), (cabin.rear_window, rear)):
        if there:
            painted.append((slice(PANES, PANES + 1), slice(start + inner[0], start + inner[1]), GLASS))
    return loft([*levels, *crown], paint, paint=painted)


def _along(places: NDArray[np.float64], outline: Outline) -> NDArray[np.float64]:
    at, values = np.array(outline).T
    return np.asarray(np.interp(places, at, values))


def _hull_places(hull: Hull) -> NDArray[np.float64]:
    """Where along the hull it needs a ring."""
    arch_m = hull.wheel_radius_m + ARCH_GAP_M
    turns = np.radians([0, 28, 58, 90, 122, 152, 180])
    places = [x for x, _ in (*hull.top_xz_m, *hull.plan_xy_m)]
    for axle in hull.axles_x_m:
        # Half a circle, and straight down where it ends.
        places += [axle + arch_m * float(np.cos(turn)) for turn in turns]
        places += [axle + sign * (arch_m + ARCH_EDGE_M) for sign in (-1, 1)]
    places += [x + sign * SEAM_M for x in hull.seams_x_m for sign in (-1, 1)]
    places += [*hull.headlamps_x_m, *hull.tail_lamps_x_m]
    first, last = hull.top_xz_m[0][0], hull.top_xz_m[-1][0]
    found = np.unique(np.round([x for x in places if first <= x <= last], 4))
    return np.asarray(found[np.append(True, np.diff(found) > 1e-3)])


def _between(places: NDArray[np.float64], start: float, end: float) -> slice:
    low, high = np.searchsorted(places, [start - 1e-4, end - 1e-4])
    return slice(int(low), int(high))


def _strip(steps: slice, around: int, looks: Surface) -> Paint:
    return steps, slice(around, around + 1), looks


def _side_shares(cabin: Cabin) -> tuple[list[float], list[int], list[int]]:
    """Shares along a side, and which of the cells between them are panes and seams."""
    length = cabin.belt_m[1] - cabin.belt_m[0]
    gaps = [(s - SEAM_M / length, s + SEAM_M / length) for s in cabin.seams]
    shares = sorted({0.0, 1.0, *(s for pair in (*cabin.panes, *gaps) for s in pair)})

    def cells(spans: Sequence[tuple[float, float]]) -> list[int]:
        return [k for k, s in enumerate(shares[:-1]) if any(low <= s < high for low, high in spans)]

    return shares, cells(cabin.panes), cells(gaps)


def _cabin_ring(cabin: Cabin, level: float, shares: Sequence[float], across: Sequence[float]) -> NDArray[np.float64]:
    """The outline at a level between belt (0) and roof (1)."""
    rear, front, half, height = np.array(cabin.belt_m) + level * (np.array(cabin.roof_m) - np.array(cabin.belt_m))
    side = [(rear + s * (front - rear), half) for s in shares]
    bow = 0.06 if cabin.windscreen else 0.01  # windscreens are bent
    ahead = [(front + bow * (1 - f * f), f * half) for f in across[1:-1]]
    behind = [(rear - 0.4 * bow * (1 - f * f), f * half) for f in across[1:-1]]
    right = [(x, -y) for x, y in side]
    points = [*right, *ahead, *reversed(side), *reversed(behind)]
    return np.array([(x, y, height) for x, y in points])
