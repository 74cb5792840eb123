"""Paint on the road: lines, dashes, zebra crossings, stop lines, arrows and bays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, quads, surfaced
from bench.synthesis.scenario.recording import ZEBRA_M
from bench.synthesis.world.alignment import BEND_STEP_M, Alignment
from bench.synthesis.world.materials import PAINT, tinted
from bench.synthesis.world.plan import AISLE_M, BAY_M, BAY_WIDTH_M, SHOULDER_M, Plan
from bench.synthesis.world.solids import flat

PAINT_M = 0.003  # thickness of a marking
LINE_M, DASH_M, GAP_M = 0.12, 3.0, 6.0  # of a street in town
WIDE_M, LONG_DASH_M, LONG_GAP_M = 0.15, 4.0, 8.0  # of an avenue
BAR_M = 0.5  # width of a stop line, of the bars of a zebra crossing and of their gaps
ARROW_AHEAD = np.array([[0.0, -0.075], [2.6, -0.075], [2.6, 0.075], [0.0, 0.075]])
ARROW_HEAD = np.array([[2.6, -0.38], [4.2, 0.0], [2.6, 0.38]])

Lines = list[NDArray[np.float64]]


def markings(plan: Plan, rng: np.random.Generator) -> list[Mesh]:
    """All paint, as fresh or worn as the recording's road has it."""
    paint = tinted(PAINT, float(rng.uniform(0.68, 1.08)))
    lines = {"street": _street, "avenue": _avenue, "car_park": _car_park}[plan.spec.kind](plan, rng)
    cells = np.concatenate([np.empty((0, 4, 2)), *lines])
    shades = paint.albedo * rng.uniform(0.9, 1.06, len(cells))  # each piece is worn in its own way
    heads, shafts = _arrows(plan, rng)
    return [
        quads(flat(cells, PAINT_M), paint, albedos=shades),
        quads(flat(shafts, PAINT_M), paint),
        surfaced(flat(heads, PAINT_M), paint),
    ]


def _street(plan: Plan, rng: np.random.Generator) -> Lines:
    """Dashes between lanes, broken where side streets open; lines to park by, zebra crossings, stop lines."""
    spec, section, lane = plan.spec, plan.section, plan.lane
    gaps = [(s.at_m - s.width_m / 2 - 3.0, s.at_m + s.width_m / 2 + 3.0) for s, _ in plan.mouths]
    gaps += [(at_m - ZEBRA_M / 2 - 1.5, at_m + ZEBRA_M / 2 + 1.5) for at_m in spec.zebra_at_m]
    lines: Lines = []
    solid_edges = rng.random() < 0.5
    for edge_m, inset_m, side in ((section.right_m, 0.3, "right"), (section.left_m, -0.3, "left")):
        if spec.has_parking(side):  # type: ignore[arg-type]
            lines += _dashes(lane, edge_m, gaps, dash_m=1.0, gap_m=1.0)
        elif solid_edges:
            lines += _solid(lane, edge_m + inset_m, gaps)
    for k in range(1, spec.lanes_left + spec.lanes_right + 1):
        lines += _dashes(lane, section.right_m + k * spec.lane_width_m, gaps, dash_m=DASH_M, gap_m=GAP_M)
    lines += [_zebra(plan, at_m) for at_m in spec.zebra_at_m]
    for at_m in spec.zebra_at_m:
        lines.append(
            lane.cells(at_m - ZEBRA_M / 2 - 1.5, at_m - ZEBRA_M / 2 - 1.0, section.right_m, 0.5 * spec.lane_width_m)
        )
    for street, way in plan.mouths:
        lines += _mouth(way, street.width_m, rng)
    return lines


def _avenue(plan: Plan, rng: np.random.Generator) -> Lines:
    """Solid edge lines and long dashes, on both carriageways."""
    spec, section, lane = plan.spec, plan.section, plan.lane
    lanes = 1 + spec.lanes_left + spec.lanes_right
    far_m = section.left_kerb_m - SHOULDER_M - (2.2 if spec.has_parking("left") else 0.0)
    gaps = [(s.at_m - s.width_m / 2 - 3.0, s.at_m + s.width_m / 2 + 3.0) for s, _ in plan.mouths]
    lines: Lines = []
    for right_m, left_m in ((section.right_m, section.left_m), (far_m - lanes * spec.lane_width_m, far_m)):
        own_gaps = gaps if right_m == section.right_m else []
        lines += _solid(lane, right_m + WIDE_M / 2, own_gaps, width_m=WIDE_M)
        lines += _solid(lane, left_m - WIDE_M / 2, [], width_m=WIDE_M)
        for k in range(1, lanes):
            lines += _dashes(
                lane, right_m + k * spec.lane_width_m, [], dash_m=LONG_DASH_M, gap_m=LONG_GAP_M, width_m=WIDE_M
            )
    for street, way in plan.mouths:
        lines += _mouth(way, street.width_m, rng)
    return lines


def _car_park(plan: Plan, _: np.random.Generator) -> Lines:
    """Bays on both sides of the aisle, and in the rows behind."""
    section, lane = plan.section, plan.lane
    half, lines = LINE_M / 2, []
    dividers = np.arange(lane.begin_m + 1.0, lane.end_m - 1.0, BAY_WIDTH_M)
    for edge_m, sign, rows in ((section.right_m, -1.0, section.right_rows), (section.left_m, 1.0, section.left_rows)):
        for start_m in row_starts_m(rows):
            ends = edge_m + sign * np.array([start_m, start_m + BAY_M])
            corners = np.array([[-half, -BAY_M / 2], [half, -BAY_M / 2], [half, BAY_M / 2], [-half, BAY_M / 2]])
            centres = np.stack([dividers, np.full(len(dividers), ends.mean())], axis=1)
            lines.append(lane.patches(centres, np.broadcast_to(corners, (len(centres), 4, 2))))
        if rows > 1:
            lines += _solid(lane, edge_m + sign * BAY_M, [])
    return lines


def row_starts_m(rows: int) -> tuple[float, ...]:
    """How far behind the edge of the aisle each row of bays begins."""
    return (0.0, BAY_M, 2 * BAY_M + AISLE_M)[:rows]


def _mouth(way: Alignment, width_m: float, rng: np.random.Generator) -> Lines:
    """Where a side street ends: a stop line, or short bars to give way at; and its own middle line."""
    lines = _dashes(way, 0.0, [(-2.0, 6.0)], dash_m=DASH_M, gap_m=DASH_M) if rng.random() < 0.7 else []
    # Who comes out of the side street drives on its other side: to the left of the way into it.
    right_m, left_m = 0.1, width_m / 2 - 0.15
    if rng.random() < 0.5:
        return [*lines, way.cells(1.0, 1.0 + BAR_M, right_m, left_m)]
    bars = np.arange(right_m, left_m - 0.3, 0.75)
    return [*lines, *(way.cells(0.8, 1.2, bar_m, bar_m + 0.5) for bar_m in bars)]


def _zebra(plan: Plan, at_m: float) -> NDArray[np.float64]:
    bars = np.arange(plan.section.right_kerb_m + 0.3, plan.section.left_kerb_m - BAR_M - 0.1, 2 * BAR_M)
    corners = np.array([[-ZEBRA_M / 2, 0.0], [ZEBRA_M / 2, 0.0], [ZEBRA_M / 2, BAR_M], [-ZEBRA_M / 2, BAR_M]])
    centres = np.stack([np.full(len(bars), at_m), bars], axis=1)
    return plan.lane.patches(centres, np.broadcast_to(corners, (len(bars), 4, 2)))


def _solid(way: Alignment, left_m: float, gaps: list[tuple[float, float]], *, width_m: float = LINE_M) -> Lines:
    cells = way.cells(way.begin_m, way.end_m, left_m - width_m / 2, left_m + width_m / 2)
    middles = way.cuts(way.begin_m, way.end_m)
    free = ~_in_gaps(middles[:-1], middles[1:], gaps)
    return [cells[free]]


def _dashes(
    way: Alignment,
    left_m: float,
    gaps: list[tuple[float, float]],
    *,
    dash_m: float,
    gap_m: float,
    width_m: float = LINE_M,
) -> Lines:
    starts = np.arange(way.begin_m + 2.0, way.end_m - dash_m, dash_m + gap_m)
    starts = starts[~_in_gaps(starts, starts + dash_m, gaps)]
    count = int(np.ceil(dash_m / BEND_STEP_M))
    pieces = (starts[:, None] + np.arange(count) * (dash_m / count)).ravel()
    return [way.pieces(pieces, pieces + dash_m / count, left_m - width_m / 2, left_m + width_m / 2)]


def _in_gaps(
    starts_m: NDArray[np.float64], ends_m: NDArray[np.float64], gaps: list[tuple[float, float]]
) -> NDArray[np.bool_]:
    hit = [(starts_m < end) & (ends_m > start) for start, end in gaps]
    return np.logical_or.reduce(hit) if hit else np.zeros(len(starts_m), dtype=bool)


def _arrows(plan: Plan, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Heads (N, 3, 2) and shafts (N, 4, 2) of a few arrows in the lanes of the host's direction."""
    spec, count = plan.spec, int(rng.integers(0, 4)) + (plan.spec.kind != "street")
    along = np.sort(rng.uniform(-5.0, 60.0, count))
    lowest = -spec.lanes_right
    highest = 0 if spec.kind == "street" else spec.lanes_left
    lanes = rng.integers(lowest, highest + 1, count)
    centres = np.stack([along, lanes * spec.lane_width_m], axis=1)
    clear = [abs(at_m - s) > 7.0 for s in along for at_m in spec.zebra_at_m]
    if clear:
        centres = centres[np.array(clear).reshape(count, -1).all(axis=1)]
    heads = plan.lane.patches(centres, np.broadcast_to(ARROW_HEAD, (len(centres), 3, 2)))
    shafts = plan.lane.patches(centres, np.broadcast_to(ARROW_AHEAD, (len(centres), 4, 2)))
    return heads, shafts
