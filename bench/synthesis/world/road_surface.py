"""Markings on the road: paint, and the wear of years.

Paint: lines, dashes, zebra crossings, stop lines, arrows and bays. Wear: wheel tracks, resurfaced stretches, patches,
trenches, cracks, stains, covers and litter; counts are for the 80 m that a recording sees from near, at full wear, in
layers of fractions of a millimetre, too thin for the lidar and for a shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, Surface, quads, surfaced
from bench.synthesis.scenario import ZEBRA_M
from bench.synthesis.world.plan import AISLE_M, BAY_M, BAY_WIDTH_M, BEND_STEP_M, SHOULDER_M, Alignment, Plan
from bench.synthesis.world.solids import BITUMEN, CAST_IRON, CONCRETE, PAINT, SQUARE, drawn_asphalt, fans, flat, tinted

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
    for street, side_lane in plan.mouths:
        lines += _mouth(side_lane, street.width_m, rng)
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
    return lines


def _avenue(plan: Plan, _: np.random.Generator) -> Lines:
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
    return lines


def _car_park(plan: Plan, _: np.random.Generator) -> Lines:
    """Bays on both sides of the aisle, and in the rows behind."""
    section, lane = plan.section, plan.lane
    half, lines = LINE_M / 2, []
    dividers = np.arange(lane.begin_m + 1.0, lane.end_m - 1.0, BAY_WIDTH_M)
    for edge_m, sign, rows in ((section.right_m, -1.0, section.right_rows), (section.left_m, 1.0, section.left_rows)):
        for start_m in row_starts_m(rows):
            ends = edge_m + sign * np.array([start_m, start_m + BAY_M])
            centres = np.stack([dividers, np.full(len(dividers), ends.mean())], axis=1)
            lines.append(lane.patches(centres, (half, BAY_M / 2) * SQUARE))
        if rows > 1:
            lines += _solid(lane, edge_m + sign * BAY_M, [])
    return lines


def row_starts_m(rows: int) -> tuple[float, ...]:
    """Distance from the edge of the aisle to the beginning of each row of bays."""
    return (0.0, BAY_M, 2 * BAY_M + AISLE_M)[:rows]


def _mouth(lane: Alignment, width_m: float, rng: np.random.Generator) -> Lines:
    """Markings at the end of a side street: a stop line, or short bars to give way at; and its own middle line."""
    lines = _dashes(lane, 0.0, [(-2.0, 6.0)], dash_m=DASH_M, gap_m=DASH_M) if rng.random() < 0.7 else []
    # Who comes out of the side street drives on its other side: to the left of the lane into it.
    right_m, left_m = 0.1, width_m / 2 - 0.15
    if rng.random() < 0.5:
        return [*lines, lane.cells(1.0, 1.0 + BAR_M, right_m, left_m)]
    bars = np.arange(right_m, left_m - 0.3, 0.75)
    return [*lines, *(lane.cells(0.8, 1.2, bar_m, bar_m + 0.5) for bar_m in bars)]


def _zebra(plan: Plan, at_m: float) -> NDArray[np.float64]:
    bars = np.arange(plan.section.right_kerb_m + 0.3, plan.section.left_kerb_m - BAR_M - 0.1, 2 * BAR_M)
    corners = np.array([[-ZEBRA_M / 2, 0.0], [ZEBRA_M / 2, 0.0], [ZEBRA_M / 2, BAR_M], [-ZEBRA_M / 2, BAR_M]])
    centres = np.stack([np.full(len(bars), at_m), bars], axis=1)
    return plan.lane.patches(centres, corners)


def _solid(lane: Alignment, left_m: float, gaps: list[tuple[float, float]], *, width_m: float = LINE_M) -> Lines:
    cells = lane.cells(lane.begin_m, lane.end_m, left_m - width_m / 2, left_m + width_m / 2)
    middles = lane.cuts(lane.begin_m, lane.end_m)
    free = ~_in_gaps(middles[:-1], middles[1:], gaps)
    return [cells[free]]


def _dashes(
    lane: Alignment,
    left_m: float,
    gaps: list[tuple[float, float]],
    *,
    dash_m: float,
    gap_m: float,
    width_m: float = LINE_M,
) -> Lines:
    starts = np.arange(lane.begin_m + 2.0, lane.end_m - dash_m, dash_m + gap_m)
    starts = starts[~_in_gaps(starts, starts + dash_m, gaps)]
    count = int(np.ceil(dash_m / BEND_STEP_M))
    pieces = (starts[:, None] + np.arange(count) * (dash_m / count)).ravel()
    return [lane.pieces(pieces, pieces + dash_m / count, left_m - width_m / 2, left_m + width_m / 2)]


def _in_gaps(
    starts_m: NDArray[np.float64], ends_m: NDArray[np.float64], gaps: list[tuple[float, float]]
) -> NDArray[np.bool_]:
    hit = [(starts_m < end) & (ends_m > start) for start, end in gaps]
    return np.logical_or.reduce(hit) if hit else np.zeros(len(starts_m), dtype=bool)


def _arrows(plan: Plan, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Heads (N, 3, 2) and shafts (N, 4, 2) of a few arrows in the lanes of the ego vehicle's direction."""
    spec, count = plan.spec, int(rng.integers(0, 4)) + (plan.spec.kind != "street")
    along = np.sort(rng.uniform(-5.0, 60.0, count))
    lowest = -spec.lanes_right
    highest = 0 if spec.kind == "street" else spec.lanes_left
    lanes = rng.integers(lowest, highest + 1, count)
    centres = np.stack([along, lanes * spec.lane_width_m], axis=1)
    clear = [abs(at_m - s) > 7.0 for s in along for at_m in spec.zebra_at_m]
    if clear:
        centres = centres[np.array(clear).reshape(count, -1).all(axis=1)]
    return plan.lane.patches(centres, ARROW_HEAD), plan.lane.patches(centres, ARROW_AHEAD)


NEAR_M = (-15.0, 65.0)  # along the lane
JOINTS, TRACKS, RESURFACED, RIMS, PATCHES, CRACKS, STAINS, COVERS, LITTER = (
    np.arange(0.3, 2.9, 0.3) / 1000.0
)  # m, layers
TRACK_M, TRACK_OFFSET_M = 0.55, 0.75  # width of a wheel track, and its distance from the middle of the lane
RIM_M = 0.05  # bitumen around a patch
JOINT_M = 0.03  # between the courses of the paver, which lays lane by lane
FULL = {"patches": 30, "trenches": 6, "cracks": 45, "stains": 70, "litter": 200, "covers": 8}


@dataclass(frozen=True, slots=True, kw_only=True)
class Carriageway:
    """Extent of the wear: a lane and how far the road reaches to its sides.

    Attributes:
        lane: along the road.
        right_m: its right edge, to the left of the lane.
        left_m: its left edge.
    """

    lane: Alignment
    right_m: float
    left_m: float

    def drawn_positions(self, count: int, rng: np.random.Generator, *, edge_m: float = 0.3) -> NDArray[np.float64]:
        """(count, 2) along and left, anywhere on the road."""
        along = rng.uniform(*NEAR_M, count)
        return np.stack([along, rng.uniform(self.right_m + edge_m, self.left_m - edge_m, count)], axis=1)


def wear(plan: Plan, asphalt: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Everything that makes one piece of road differ from the next."""
    amount = float(rng.beta(2.0, 2.5))  # from 0, just laid, to 1, cracked and patched all over
    section = plan.section
    inner_m = section.left_m + 0.4 if plan.spec.kind == "avenue" else section.left_kerb_m
    road = Carriageway(lane=plan.lane, right_m=section.right_kerb_m, left_m=inner_m)
    meshes = _courses(plan, asphalt, rng) + _tracks(plan, asphalt, amount)
    meshes += _patches(road, asphalt, amount, rng) + _trenches(road, asphalt, amount, rng)
    meshes += _cracks(road, asphalt, amount, rng) + _stains(road, asphalt, amount, rng)
    return meshes + _covers(road, rng) + _litter(road, asphalt, rng)


def _courses(plan: Plan, asphalt: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Joints between the paver's courses, and a lane or two that was resurfaced for a stretch."""
    spec, meshes = plan.spec, []
    for k in range(1, spec.lanes_left + spec.lanes_right + 1):
        joint_m = plan.section.right_m + k * spec.lane_width_m + float(rng.uniform(-0.25, 0.25))
        cells = plan.lane.cells(*NEAR_M, joint_m, joint_m + JOINT_M)
        meshes.append(quads(flat(cells, JOINTS), tinted(asphalt, 0.72)))
    for _ in range(int(rng.integers(3))):
        k, start_m = int(rng.integers(spec.lanes_left + spec.lanes_right + 1)), float(rng.uniform(NEAR_M[0], 45.0))
        edge_m = plan.section.right_m + k * spec.lane_width_m
        cells = plan.lane.cells(start_m, start_m + float(rng.uniform(8, 25)), edge_m, edge_m + spec.lane_width_m)
        fresh = tinted(drawn_asphalt(rng), float(rng.uniform(0.75, 1.0)))
        meshes.append(quads(flat(cells, RESURFACED), fresh, shifts_m=np.tile(rng.uniform(0, 8, 2), (len(cells), 1))))
    return meshes


def _tracks(plan: Plan, asphalt: Surface, amount: float) -> list[Mesh]:
    """Tyres polish the stones: each track a few per cent darker, in two steps so that its edge is soft."""
    spec, lane, meshes = plan.spec, plan.lane, []
    for k in range(spec.lanes_left + spec.lanes_right + 1):
        middle_m = plan.section.right_m + (k + 0.5) * spec.lane_width_m
        for offset_m in (-TRACK_OFFSET_M, TRACK_OFFSET_M):
            for step, half_m in enumerate((0.5 * TRACK_M, 0.28 * TRACK_M), start=1):
                centre_m = middle_m + offset_m
                cells = lane.cells(lane.begin_m, lane.end_m, centre_m - half_m, centre_m + half_m)
                surface = tinted(asphalt, 1.0 - 0.04 * step * (0.4 + amount))
                meshes.append(quads(flat(cells, TRACKS + step * 5e-5), surface))
    return meshes


def _patches(road: Carriageway, asphalt: Surface, amount: float, rng: np.random.Generator) -> list[Mesh]:
    """Holes that were cut square and filled, most with a rim of bitumen."""
    count = rng.poisson(FULL["patches"] * amount)
    positions, meshes = road.drawn_positions(count, rng, edge_m=0.8), []
    for position in positions:
        half = rng.uniform((0.25, 0.2), (1.6, 0.7))
        meshes += _patch(road.lane, position, half, float(rng.normal(0, 0.05)), asphalt, rng)
    return meshes


def _trenches(road: Carriageway, asphalt: Surface, amount: float, rng: np.random.Generator) -> list[Mesh]:
    """Strips over pipes and cables: right across the road, or along it."""
    meshes = []
    for _ in range(rng.poisson(FULL["trenches"] * amount)):
        along_m = float(rng.uniform(*NEAR_M))
        if rng.random() < 0.6:
            position, half = (along_m, (road.left_m + road.right_m) / 2), (0.3, (road.left_m - road.right_m) / 2)
        else:
            position, half = tuple(road.drawn_positions(1, rng, edge_m=0.8)[0]), (float(rng.uniform(2, 5)), 0.3)
        meshes += _patch(road.lane, np.array(position), np.array(half), float(rng.normal(0, 0.01)), asphalt, rng)
    return meshes


def _patch(
    lane: Alignment,
    position: NDArray[np.float64],
    half_m: NDArray[np.float64],
    turn_rad: float,
    asphalt: Surface,
    rng: np.random.Generator,
) -> list[Mesh]:
    turn = np.array([[np.cos(turn_rad), np.sin(turn_rad)], [-np.sin(turn_rad), np.cos(turn_rad)]])
    fill = Surface(
        albedo=asphalt.albedo * float(rng.uniform(0.68, 1.12)),
        contrast=asphalt.contrast * float(rng.uniform(0.8, 1.2)),
        texel_m=asphalt.texel_m * float(rng.uniform(0.8, 1.4)),
    )
    shift = rng.uniform(0, 8, (1, 2))
    meshes = [quads(flat(lane.patches(position, (SQUARE * half_m) @ turn), PATCHES), fill, shifts_m=shift)]
    if rng.random() < 0.6:
        meshes.append(quads(flat(lane.patches(position, (SQUARE * (half_m + RIM_M)) @ turn), RIMS), BITUMEN))
    return meshes


def _cracks(road: Carriageway, asphalt: Surface, amount: float, rng: np.random.Generator) -> list[Mesh]:
    """Wandering lines: open ones of one or two centimetres, sealed ones as wide as a hand."""
    meshes = []
    for position in road.drawn_positions(rng.poisson(FULL["cracks"] * amount), rng, edge_m=0.5):
        sealed = rng.random() < 0.4
        count, heading = int(rng.integers(6, 28)), float(rng.choice([0.0, np.pi / 2])) + rng.normal(0, 0.3)
        headings = heading + 0.35 * rng.standard_normal(count).cumsum() * 0.5 + 0.25 * rng.standard_normal(count)
        steps = rng.uniform(0.12, 0.3, count)[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
        line = position + np.concatenate([np.zeros((1, 2)), steps.cumsum(axis=0)])
        line[:, 1] = np.clip(line[:, 1], road.right_m + 0.05, road.left_m - 0.05)
        half = (0.03 if sealed else 0.008) * rng.uniform(0.6, 1.3, count + 1)[:, None]
        aside = np.gradient(line, axis=0)[:, ::-1] * (-1, 1)
        aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
        left, right = (road.lane.points(*(line + sign * half * aside).T) for sign in (1, -1))
        cells = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
        meshes.append(quads(flat(cells, CRACKS), BITUMEN if sealed else tinted(asphalt, 0.55)))
    return meshes


def _stains(road: Carriageway, asphalt: Surface, amount: float, rng: np.random.Generator) -> list[Mesh]:
    """Oil, damp and spilt paint: blots with a darker heart."""
    count = rng.poisson(FULL["stains"] * (0.3 + 0.7 * amount))
    positions = road.drawn_positions(count, rng)
    factor = np.where(rng.random(count) < 0.85, rng.uniform(0.72, 0.93, count), rng.uniform(1.06, 1.2, count))
    angles = np.arange(11) * (2 * np.pi / 11)
    rims = np.exp(0.25 * rng.standard_normal((count, 11, 1))) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rims = rims * rng.uniform(0.08, 0.5, (count, 1, 1)) * rng.uniform((0.6, 0.4), (1.6, 0.9), (count, 1, 2))
    meshes = []
    for step, share in enumerate((1.0, 0.6)):
        lifted = flat(road.lane.patches(positions, share * rims), STAINS + step * 1e-4)
        meshes.append(fans(lifted, asphalt, albedos=asphalt.albedo * factor ** (0.6 + 0.6 * step)))
    return meshes


def _covers(road: Carriageway, rng: np.random.Generator) -> list[Mesh]:
    """Manholes in the lanes, and gullies at the kerb every 20 m or so."""
    count = 2 + rng.poisson(FULL["covers"] / 2)
    positions = road.drawn_positions(count, rng, edge_m=0.9)
    angles = np.arange(14) * (2 * np.pi / 14)
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    meshes = [
        fans(flat(road.lane.patches(positions, np.tile(radius_m * rim, (count, 1, 1))), COVERS + lift_m), surface)
        for radius_m, lift_m, surface in (
            (0.36, 0.0, tinted(CONCRETE, 0.8)),
            (0.32, 1e-4, CAST_IRON),
            (0.22, 2e-4, tinted(CAST_IRON, 1.2)),
        )
    ]
    for edge_m, sign in ((road.right_m, 1.0), (road.left_m, -1.0)):
        along = np.arange(NEAR_M[0] + rng.uniform(0, 15), NEAR_M[1], 19.0)
        centres = np.stack([along, np.full(len(along), edge_m + sign * 0.2)], axis=1)
        for scale, lift_m, surface in (((0.26, 0.17), 0.0, CAST_IRON), ((0.2, 0.02), 2e-4, tinted(CAST_IRON, 0.3))):
            bars = (
                centres if lift_m == 0 else np.concatenate([centres + np.array([0.0, dy]) for dy in (-0.09, 0.0, 0.09)])
            )
            cells = road.lane.patches(bars, scale * SQUARE)
            meshes.append(quads(flat(cells, COVERS + lift_m), surface))
    return meshes


def _litter(road: Carriageway, asphalt: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Leaves, stones, gum and paper: specks of a few centimetres, most of them near the kerb."""
    count = rng.poisson(FULL["litter"] * rng.uniform(0.2, 1.0))
    away = rng.exponential(0.7, count)
    left = np.where(rng.random(count) < 0.5, road.right_m + 0.05 + away, road.left_m - 0.05 - away)
    left = np.clip(left, road.right_m + 0.05, road.left_m - 0.05)
    centres = np.stack([rng.uniform(*NEAR_M, count), left], axis=1)
    turn = rng.uniform(0, 2 * np.pi, (count, 1)) + np.arange(4) * (np.pi / 2)
    corners = rng.uniform(0.012, 0.045, (count, 1, 1)) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    shade = asphalt.albedo * rng.choice([0.5, 0.7, 1.3, 1.6], count)
    return [quads(flat(road.lane.patches(centres, corners), LITTER), asphalt, albedos=shade)]
