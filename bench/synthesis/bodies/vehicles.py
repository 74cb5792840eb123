"""Vehicles: a hull with wheel arches, lamps and seams, a cabin with panes, wheels and what is mounted on them.

x = 0 halfway along the vehicle. Outlines are after common models of each class.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.body import (
    ALLOY,
    CHROME,
    GLASS,
    HEADLAMP,
    PLASTIC,
    PLATE,
    RUBBER,
    STEEL,
    TAIL_LAMP,
    UNDERSIDE,
    Built,
    Joint,
    JointedMesh,
    drawn_paint,
    wheel,
)
from bench.synthesis.mesh import Mesh, Paint, Surface, box, convex, joined, loft, prism, rounded, tube

SEAM_M = 0.005  # half of the gap beside a door
ARCH_GAP_M = 0.045  # between a tyre and its arch
ARCH_EDGE_M = 0.01  # along the vehicle, where an arch ends straight down
WHEELHOUSE_M = 0.27  # depth
SIDE_STRIPS, SILL_STRIPS, HOUSE_STRIPS, LAMP_STRIPS = (3, 4, 10, 11), (2, 12), (0, 1, 13, 14, 15), (4, 10)
PANES = slice(1, 2)  # the step of the cabin's levels that holds them
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
        """At a position along the vehicle."""
        return float(_along(np.array([x_m]), self.plan_xy_m)[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Cabin:
    """The body around the windows.

    Attributes:
        belt_m: rear x, front x, half width, height of its lower edge.
        roof_m: the same of its upper edge.
        panes: from, to as shares of its length, of the panes at either side.
        rear_window: whether there is one.
    """

    belt_m: tuple[float, float, float, float]
    roof_m: tuple[float, float, float, float]
    panes: tuple[tuple[float, float], ...]
    rear_window: bool = True


def hull_mesh(hull: Hull, paint: Surface) -> Mesh:
    """The hull as one closed surface."""
    positions = _hull_positions(hull)
    wide, top = _along(positions, hull.plan_xy_m), _along(positions, hull.top_xz_m)
    arch_m = hull.wheel_radius_m + ARCH_GAP_M
    away = np.min([np.abs(positions - x) for x in hull.axles_x_m], axis=0)
    arch = hull.wheel_radius_m + np.sqrt(np.maximum(arch_m**2 - away**2, 0.0))
    sill = np.where(away < arch_m + ARCH_EDGE_M / 2, arch, hull.ground_m)
    crease = np.maximum(sill + 0.06, hull.ground_m + 0.62 * (top - hull.ground_m))
    shoulder = np.maximum(crease + 0.01, top - 0.07)
    edge = np.maximum(shoulder + 0.01, top - 0.005)
    ground = np.full_like(positions, hull.ground_m)
    inner = wide - np.minimum(WHEELHOUSE_M, 0.5 * wide)
    side = [
        (inner, ground), (inner, sill), (wide - 0.02, sill), (wide, sill + 0.04), (wide, crease),
        (wide - 0.04, shoulder), (wide - 0.12, edge), (0.45 * wide, edge + 0.02),
    ]  # fmt: skip
    right = np.stack([np.stack([positions, -y, z], axis=1) for y, z in side], axis=1)
    left = right[:, ::-1] * np.array([1.0, -1.0, 1.0])
    painted = [_strip(slice(None), strip, UNDERSIDE) for strip in HOUSE_STRIPS]
    painted += [_strip(slice(None), strip, PLASTIC) for strip in SILL_STRIPS]
    for x in hull.seams_x_m:
        painted += [_strip(_between(positions, x - SEAM_M, x + SEAM_M), strip, UNDERSIDE) for strip in SIDE_STRIPS]
    for (start, end), lamp in ((hull.headlamps_x_m, HEADLAMP), (hull.tail_lamps_x_m, TAIL_LAMP)):
        painted += [_strip(_between(positions, start, end), strip, lamp) for strip in LAMP_STRIPS]
    return loft(np.concatenate([right, left], axis=1), paint, paint=painted)


def cabin_mesh(cabin: Cabin, paint: Surface) -> Mesh:
    """The cabin as one closed surface; its panes are cells of their own."""
    shares = sorted({0.0, 1.0, *(share for pane in cabin.panes for share in pane)})
    glazed = [k for k, share in enumerate(shares[:-1]) if any(low <= share < high for low, high in cabin.panes)]
    count, across = len(shares), (-1.0, -0.86, -0.3, 0.3, 0.86, 1.0)
    levels = [_cabin_ring(cabin, level, shares, across) for level in (0.0, 0.10, 0.84, 0.97)]
    middle = np.array([(cabin.roof_m[0] + cabin.roof_m[1]) / 2, 0.0, 0.0])
    crown = [middle + (levels[3] - middle) * (0.94, 0.86, 1.0) + (0, 0, 0.025),
             middle + (levels[3] - middle) * (0.6, 0.5, 1.0) + (0, 0, 0.04)]  # fmt: skip
    # Along a ring: right side to the front, across the front, left side to the rear, across the rear.
    front, left = count - 1, count - 1 + len(across) - 1
    rear = left + count - 1
    painted: list[Paint] = []
    for cell in glazed:
        painted += [_strip(PANES, cell, GLASS), _strip(PANES, rear - 1 - cell, GLASS)]
    for start in (front, rear) if cabin.rear_window else (front,):
        painted.append((PANES, slice(start + 1, start + len(across) - 2), GLASS))
    return loft([*levels, *crown], paint, paint=painted)


def _along(positions: NDArray[np.float64], outline: Outline) -> NDArray[np.float64]:
    at, values = np.array(outline).T
    return np.asarray(np.interp(positions, at, values))


def _hull_positions(hull: Hull) -> NDArray[np.float64]:
    """Positions along the hull that need a ring."""
    arch_m = hull.wheel_radius_m + ARCH_GAP_M
    turns = np.radians([0, 28, 58, 90, 122, 152, 180])
    positions = [x for x, _ in (*hull.top_xz_m, *hull.plan_xy_m)]
    for axle in hull.axles_x_m:
        # Half a circle, and straight down where it ends.
        positions += [axle + arch_m * float(np.cos(turn)) for turn in turns]
        positions += [axle + sign * (arch_m + ARCH_EDGE_M) for sign in (-1, 1)]
    positions += [x + sign * SEAM_M for x in hull.seams_x_m for sign in (-1, 1)]
    positions += [*hull.headlamps_x_m, *hull.tail_lamps_x_m]
    first, last = hull.top_xz_m[0][0], hull.top_xz_m[-1][0]
    distinct = np.unique(np.round([x for x in positions if first <= x <= last], 4))
    return np.asarray(distinct[np.append(True, np.diff(distinct) > 1e-3)])


def _between(positions: NDArray[np.float64], start: float, end: float) -> slice:
    low, high = np.searchsorted(positions, [start - 1e-4, end - 1e-4])
    return slice(int(low), int(high))


def _strip(steps: slice, around: int, looks: Surface) -> Paint:
    return steps, slice(around, around + 1), looks


def _cabin_ring(cabin: Cabin, level: float, shares: Sequence[float], across: Sequence[float]) -> NDArray[np.float64]:
    """The outline at a level between belt (0) and roof (1)."""
    rear, front, half, height = np.array(cabin.belt_m) + level * (np.array(cabin.roof_m) - np.array(cabin.belt_m))
    side = [(rear + s * (front - rear), half) for s in shares]
    bow = 0.06  # windscreens are bent
    ahead = [(front + bow * (1 - f * f), f * half) for f in across[1:-1]]
    behind = [(rear - 0.4 * bow * (1 - f * f), f * half) for f in across[1:-1]]
    right = [(x, -y) for x, y in side]
    points = [*right, *ahead, *reversed(side), *reversed(behind)]
    return np.array([(x, y, height) for x, y in points])


SIDES = 20
PROFILE = ((0.0, 0.90), (0.12, 1.0), (0.88, 1.0), (1.0, 0.90))  # share of the width, share of the radius


def vehicle_wheels(
    axles_x_m: Sequence[float], outer_y_m: float, radius_m: float, *, width_m: float, spokes: int
) -> tuple[list[JointedMesh], list[Joint]]:
    """All wheels of a vehicle; those of an axle rotate together.

    Args:
        axles_x_m: where the axles are.
        outer_y_m: the wheels' outer faces, from the middle.
        radius_m: of the tyres.
        width_m: of the tyres.
        spokes: of a wheel.
    """
    parts: list[JointedMesh] = []
    joints = [wheel(f"axle_{number}", x, radius_m) for number, x in enumerate(axles_x_m)]
    for joint, x in zip(joints, axles_x_m, strict=True):
        for sign in (-1.0, 1.0):
            hub = RigidTransform(np.eye(3), np.array([x, sign * outer_y_m, radius_m]))
            parts.append((_wheel(radius_m, width_m, spokes, sign).moved(hub), joint.name))
    return parts, joints


@cache
def _wheel(radius_m: float, width_m: float, spokes: int, sign: float) -> Mesh:
    """A wheel of the left (1) or right (-1) side; the middle of its outer face is at the origin."""
    around = _circle(SIDES)
    out = np.array([0.0, sign, 0.0])
    tyre = loft([size * radius_m * around - share * width_m * out for share, size in PROFILE], RUBBER)
    rim = tube(-0.1 * width_m * out, 0.004 * out, 0.66 * radius_m, PLASTIC, sides=14)
    cap = tube(0.0 * out, 0.018 * out, 0.15 * radius_m, ALLOY, sides=6)
    return joined(tyre, rim, cap, _spokes(0.62 * radius_m, spokes, out))


def _spokes(length_m: float, count: int, out: NDArray[np.float64]) -> Mesh:
    """Flat bars from the hub outwards, twice as wide at the rim."""
    half_m = length_m * 0.55 / count * out[1]
    along, across = _circle(count)[:, None], _circle(count, start_rad=np.pi / 2)[:, None]
    share, wide = np.array([[0.0, -1.0], [1.0, -1.7], [1.0, 1.7], [0.0, 1.0]]).T[:, :, None]
    face = share * length_m * along + wide * half_m * across
    return prism(face, face + 0.014 * out, ALLOY)


def _circle(count: int, *, start_rad: float = 0.0) -> NDArray[np.float64]:
    """(count, 3) directions around the axle, the first one up but for a rotation forward."""
    turns = np.arange(count) * (2 * np.pi / count) + start_rad
    return np.stack([np.sin(turns), np.zeros(count), np.cos(turns)], axis=1)


Extras = Callable[[Surface, np.random.Generator], list[Mesh]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """A vehicle's shape.

    Attributes:
        hull: below the windows.
        cabin: around them.
        tyre_m: radius, width.
        plate_m: height of the number plates.
        handles_x_m: of the doors.
        extras: more solids that it carries; None for none.
    """

    hull: Hull
    cabin: Cabin
    tyre_m: tuple[float, float]
    plate_m: float
    handles_x_m: tuple[float, ...]
    extras: Extras | None = None


def vehicle(shape: Vehicle, rng: np.random.Generator) -> Built:
    """Paint and put together a vehicle."""
    paint, spokes = drawn_paint(rng), int(rng.choice([5, 6, 7, 9]))
    radius, width = shape.tyre_m
    outer = shape.hull.half_width_m(shape.hull.axles_x_m[-1]) - 0.015
    wheels, joints = vehicle_wheels(shape.hull.axles_x_m, outer, radius, width_m=width, spokes=spokes)
    meshes = [hull_mesh(shape.hull, paint), cabin_mesh(shape.cabin, paint), *_ends(shape), *_sides(shape, paint)]
    if shape.extras is not None:
        meshes += shape.extras(paint, rng)
    return [(mesh, None) for mesh in meshes] + wheels, joints, 2 * np.pi * radius


def _ends(shape: Vehicle) -> list[Mesh]:
    """Grille, plates, bumper strips, and the inner parts of the lamps."""
    hull, parts = shape.hull, []
    for end, lamp in ((-1, TAIL_LAMP), (0, HEADLAMP)):
        x, top = hull.top_xz_m[-1 if end == 0 else 0]
        half = hull.half_width_m(x)
        height = top - hull.ground_m
        parts += [
            box([0.05, 0.52, 0.11], [x, 0, shape.plate_m], PLATE),
            box([0.035, 1.7 * half, 0.20 * height], [x, 0, hull.ground_m + 0.14 * height], PLASTIC),
        ]
        parts += [
            box([0.04, 0.34 * half, 0.24 * height], [x, s * 0.8 * half, top - 0.2 * height], lamp) for s in (-1, 1)
        ]
        if end == 0:
            parts.append(box([0.03, 1.1 * half, 0.20 * height], [x, 0, top - 0.22 * height], UNDERSIDE))
            parts.append(box([0.05, 0.10, 0.08], [x, 0, top - 0.2 * height], CHROME))
    return parts


def _sides(shape: Vehicle, paint: Surface) -> list[Mesh]:
    """Mirrors and door handles."""
    cabin, parts = shape.cabin, []
    _, front, half, belt = cabin.belt_m
    x = front - 0.16 * (belt + 0.6)
    y = max(half, shape.hull.half_width_m(x))
    for sign in (-1.0, 1.0):
        housing = rounded((x, sign * (y + 0.10), belt + 0.11), (0.07, 0.11, 0.08), paint, sides=6, rows=4)
        glass = box([0.02, 0.13, 0.09], [x - 0.065, sign * (y + 0.10), belt + 0.11], GLASS)
        arm = box([0.05, 0.14, 0.04], [x, sign * (y - 0.02), belt + 0.07], PLASTIC)
        parts += [housing, glass, arm]
        for handle_x in shape.handles_x_m:
            wide = shape.hull.half_width_m(handle_x)
            parts.append(box([0.17, 0.03, 0.028], [handle_x, sign * (wide - 0.015), belt - 0.13], PLASTIC))
    return parts


def _plan(rear_m: float, front_m: float, half_m: float) -> Outline:
    """Seen from above: rounded corners, rounder in front."""
    return (
        (rear_m, 0.78 * half_m), (rear_m + 0.08, 0.90 * half_m), (rear_m + 0.30, 0.975 * half_m),
        (rear_m + 0.75, half_m), (front_m - 0.85, half_m), (front_m - 0.42, 0.965 * half_m),
        (front_m - 0.16, 0.86 * half_m), (front_m, 0.66 * half_m),
    )  # fmt: skip


def _blunt_plan(rear_m: float, front_m: float, half_m: float) -> Outline:
    """Vans and larger: almost a rectangle."""
    return ((rear_m, 0.97 * half_m), (rear_m + 0.06, half_m), (front_m - 0.35, half_m),
            (front_m - 0.12, 0.95 * half_m), (front_m, 0.82 * half_m))  # fmt: skip


VEHICLES: dict[str, Vehicle] = {}  # by the kind that a scenario names; each beside what it carries

VEHICLES["car"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.13, 0.74), (-2.06, 0.92), (-1.90, 0.98), (0.90, 0.95), (1.35, 0.90), (1.90, 0.79), (2.08, 0.69),
                  (2.15, 0.58)),
        plan_xy_m=_plan(-2.13, 2.15, 0.895), ground_m=0.20, axles_x_m=(-1.28, 1.32), wheel_radius_m=0.31,
        seams_x_m=(-0.78, -0.08, 0.88), headlamps_x_m=(1.64, 2.08), tail_lamps_x_m=(-2.06, -1.88),
    ),
    cabin=Cabin(belt_m=(-2.04, 1.04, 0.80, 0.94), roof_m=(-1.62, 0.12, 0.58, 1.445),
                panes=((0.06, 0.26), (0.29, 0.60), (0.63, 0.94))),
    tyre_m=(0.31, 0.205), plate_m=0.42, handles_x_m=(-0.66, 0.06),
)  # fmt: skip
VEHICLES["city_car"] = Vehicle(
    hull=Hull(
        top_xz_m=((-1.80, 0.78), (-1.75, 0.95), (-1.62, 1.00), (0.85, 0.98), (1.20, 0.94), (1.58, 0.84), (1.74, 0.73),
                  (1.80, 0.60)),
        plan_xy_m=_plan(-1.80, 1.80, 0.825), ground_m=0.19, axles_x_m=(-1.17, 1.17), wheel_radius_m=0.285,
        seams_x_m=(-0.35, 0.78), headlamps_x_m=(1.36, 1.74), tail_lamps_x_m=(-1.75, -1.55),
    ),
    cabin=Cabin(belt_m=(-1.68, 1.02, 0.735, 0.97), roof_m=(-1.50, 0.22, 0.56, 1.475),
                panes=((0.07, 0.42), (0.46, 0.94))),
    tyre_m=(0.285, 0.175), plate_m=0.40, handles_x_m=(-0.22,),
)  # fmt: skip
VEHICLES["saloon"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.36, 0.76), (-2.30, 0.94), (-2.15, 1.00), (-1.55, 1.01), (0.95, 0.96), (1.45, 0.91), (2.08, 0.79),
                  (2.28, 0.69), (2.36, 0.57)),
        plan_xy_m=_plan(-2.36, 2.36, 0.915), ground_m=0.18, axles_x_m=(-1.38, 1.44), wheel_radius_m=0.325,
        seams_x_m=(-0.82, -0.05, 0.92), headlamps_x_m=(1.86, 2.28), tail_lamps_x_m=(-2.30, -2.02),
    ),
    cabin=Cabin(belt_m=(-1.86, 1.06, 0.80, 0.95), roof_m=(-1.02, 0.12, 0.57, 1.415),
                panes=((0.10, 0.30), (0.33, 0.62), (0.65, 0.94))),
    tyre_m=(0.325, 0.225), plate_m=0.44, handles_x_m=(-0.70, 0.09),
)  # fmt: skip
VEHICLES["estate"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.36, 0.76), (-2.31, 0.94), (-2.18, 1.00), (0.95, 0.96), (1.45, 0.91), (2.08, 0.79), (2.28, 0.69),
                  (2.36, 0.57)),
        plan_xy_m=_plan(-2.36, 2.36, 0.915), ground_m=0.19, axles_x_m=(-1.38, 1.44), wheel_radius_m=0.325,
        seams_x_m=(-0.82, -0.05, 0.92), headlamps_x_m=(1.86, 2.28), tail_lamps_x_m=(-2.31, -2.06),
    ),
    cabin=Cabin(belt_m=(-2.22, 1.06, 0.80, 0.95), roof_m=(-1.92, 0.12, 0.58, 1.455),
                panes=((0.05, 0.26), (0.28, 0.49), (0.52, 0.70), (0.73, 0.95))),
    tyre_m=(0.325, 0.225), plate_m=0.44, handles_x_m=(-0.70, 0.09),
)  # fmt: skip
VEHICLES["suv"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.23, 0.88), (-2.18, 1.06), (-2.02, 1.12), (0.92, 1.08), (1.40, 1.05), (1.98, 0.96), (2.15, 0.86),
                  (2.23, 0.70)),
        plan_xy_m=_plan(-2.23, 2.23, 0.93), ground_m=0.25, axles_x_m=(-1.32, 1.36), wheel_radius_m=0.36,
        seams_x_m=(-0.75, 0.0, 0.92), headlamps_x_m=(1.74, 2.15), tail_lamps_x_m=(-2.18, -1.95),
    ),
    cabin=Cabin(belt_m=(-2.08, 1.06, 0.82, 1.07), roof_m=(-1.86, 0.16, 0.61, 1.635),
                panes=((0.05, 0.25), (0.28, 0.50), (0.53, 0.71), (0.74, 0.95))),
    tyre_m=(0.36, 0.235), plate_m=0.52, handles_x_m=(-0.62, 0.13),
)  # fmt: skip


def _open_bed(_: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The lining of a pickup's bed, a bar behind the cabin, and at times a load."""
    bed = [
        box([1.62, 1.46, 0.03], [-1.72, 0, 1.02], UNDERSIDE),
        *(box([1.70, 0.09, 0.16], [-1.72, s * 0.80, 1.07], PLASTIC) for s in (-1, 1)),
        box([0.09, 1.60, 0.16], [-2.56, 0, 1.07], PLASTIC),
        *(box([0.09, 0.09, 0.62], [-0.96, s * 0.66, 1.28], PLASTIC) for s in (-1, 1)),
        box([0.09, 1.40, 0.09], [-0.96, 0, 1.58], PLASTIC),
    ]
    crate = Surface(albedo=float(rng.choice([0.15, 0.35, 0.60])), contrast=0.4, texel_m=0.03)
    return [*bed, box([0.80, 1.00, 0.55], [-1.75, 0, 1.30], crate)] if rng.random() < 0.5 else bed


VEHICLES["pickup"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.66, 0.90), (-2.62, 1.02), (1.10, 1.06), (1.60, 1.04), (2.35, 0.98), (2.58, 0.88), (2.66, 0.70)),
        plan_xy_m=_blunt_plan(-2.66, 2.66, 0.93), ground_m=0.28, axles_x_m=(-1.60, 1.62), wheel_radius_m=0.37,
        seams_x_m=(-0.82, 0.15, 1.10), headlamps_x_m=(2.20, 2.58), tail_lamps_x_m=(-2.62, -2.50),
    ),
    cabin=Cabin(belt_m=(-0.88, 1.30, 0.82, 1.03), roof_m=(-0.74, 0.50, 0.64, 1.80),
                panes=((0.08, 0.44), (0.50, 0.93))),
    tyre_m=(0.37, 0.25), plate_m=0.58, handles_x_m=(-0.60, 0.28), extras=_open_bed,
)  # fmt: skip


def _rear_doors(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The gap between a van's rear doors, and often the name of its firm on both sides."""
    gap = box([0.03, 0.014, 1.70], [-2.69, 0, 1.40], UNDERSIDE)
    lettering = Surface(albedo=0.75 if paint.albedo < 0.3 else 0.10, contrast=0.6, texel_m=0.03)
    heights = ((1.45, 0.955), (1.95, 0.913))  # the side leans inwards
    corners = [(x, half + out, z) for x in (-2.0, 0.1) for z, half in heights for out in (-0.01, 0.004)]
    signs = [convex(np.array(corners) * (1.0, side, 1.0), lettering) for side in (-1.0, 1.0)]
    return [gap, *signs] if rng.random() < 0.6 else [gap]


VEHICLES["van"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.70, 1.12), (-2.66, 1.20), (1.50, 1.20), (2.10, 1.08), (2.50, 0.92), (2.66, 0.78), (2.70, 0.66)),
        plan_xy_m=_blunt_plan(-2.70, 2.70, 1.0), ground_m=0.25, axles_x_m=(-1.70, 1.72), wheel_radius_m=0.345,
        seams_x_m=(-0.85, 0.42, 1.30), headlamps_x_m=(2.20, 2.58), tail_lamps_x_m=(-2.66, -2.56),
    ),
    cabin=Cabin(belt_m=(-2.69, 1.86, 0.97, 1.17), roof_m=(-2.62, 1.02, 0.88, 2.33),
                panes=((0.725, 0.95),), rear_window=False),
    tyre_m=(0.345, 0.215), plate_m=0.52, handles_x_m=(0.55,), extras=_rear_doors,
)  # fmt: skip
VEHICLES["minibus"] = Vehicle(
    hull=Hull(
        top_xz_m=((-2.48, 1.00), (-2.44, 1.12), (1.40, 1.10), (1.95, 1.00), (2.28, 0.86), (2.44, 0.72), (2.48, 0.60)),
        plan_xy_m=_blunt_plan(-2.48, 2.48, 0.95), ground_m=0.22, axles_x_m=(-1.45, 1.55), wheel_radius_m=0.335,
        seams_x_m=(-0.75, 0.35, 1.22), headlamps_x_m=(2.0, 2.38), tail_lamps_x_m=(-2.44, -2.34),
    ),
    cabin=Cabin(belt_m=(-2.46, 1.70, 0.92, 1.07), roof_m=(-2.34, 0.85, 0.80, 1.94),
                panes=((0.05, 0.36), (0.40, 0.67), (0.72, 0.95))),
    tyre_m=(0.335, 0.215), plate_m=0.48, handles_x_m=(0.48,),
)  # fmt: skip


def _load(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The box of a lorry, with lettering, guards against running under on their posts, and its frame."""
    side = Surface(albedo=float(rng.choice([0.30, 0.55, 0.75])), contrast=0.08, texel_m=0.02)
    lettering = Surface(albedo=float(rng.choice([0.08, 0.18])), contrast=0.5, texel_m=0.05)
    return [
        box([4.60, 2.40, 2.30], [-1.05, 0, 2.15], side),
        box([2.80, 2.41, 0.55], [-0.95, 0, 2.45], lettering),
        box([4.64, 2.42, 0.09], [-1.05, 0, 1.03], STEEL),
        box([6.0, 0.85, 0.22], [-0.3, 0, 0.85], UNDERSIDE),
        box([1.35, 2.30, 0.10], [0.05, 0, 0.55], STEEL),
        box([1.35, 2.30, 0.10], [0.05, 0, 0.80], STEEL),
        box([0.10, 2.30, 0.14], [-3.25, 0, 0.52], PLASTIC),
        box([0.50, 2.2, 0.45], [1.05, 0, 0.75], paint),
        *(box([1.05, 0.32, 0.06], [-1.9, s * 1.02, 0.97], PLASTIC) for s in (-1, 1)),
        *(box([0.07, 0.06, 0.36], [x, s * 1.10, 0.67], STEEL) for x in (-0.5, 0.6) for s in (-1, 1)),
        *(box([0.08, 0.08, 0.34], [-3.23, s * 0.36, 0.69], PLASTIC) for s in (-1, 1)),
        box([0.04, 2.04, 0.06], [-3.28, 0, 0.73], PLASTIC),
        *(box([0.06, 0.30, 0.14], [-3.3, s * 0.9, 0.72], TAIL_LAMP) for s in (-1, 1)),
    ]


VEHICLES["lorry"] = Vehicle(
    hull=Hull(
        top_xz_m=((1.35, 1.30), (1.42, 1.36), (2.95, 1.36), (3.12, 1.28), (3.20, 1.05)),
        plan_xy_m=((1.35, 1.08), (1.42, 1.10), (2.85, 1.10), (3.06, 1.04), (3.20, 0.88)), ground_m=0.36,
        axles_x_m=(-1.9, 2.1), wheel_radius_m=0.44, seams_x_m=(1.62, 2.66), headlamps_x_m=(2.85, 3.12),
        tail_lamps_x_m=(1.35, 1.36),
    ),
    cabin=Cabin(belt_m=(1.38, 3.06, 1.07, 1.33), roof_m=(1.40, 2.82, 0.98, 2.50),
                panes=((0.22, 0.92),), rear_window=False),
    tyre_m=(0.44, 0.25), plate_m=0.62, handles_x_m=(1.78,), extras=_load,
)  # fmt: skip
VEHICLES["bus"] = Vehicle(
    hull=Hull(
        top_xz_m=((-5.95, 1.10), (-5.90, 1.18), (5.86, 1.18), (5.95, 1.10)),
        plan_xy_m=((-5.95, 1.20), (-5.85, 1.27), (5.70, 1.27), (5.88, 1.22), (5.95, 1.10)), ground_m=0.30,
        axles_x_m=(-2.6, 3.2), wheel_radius_m=0.48, seams_x_m=(4.15, 5.35, -0.60, 0.60), headlamps_x_m=(5.70, 5.90),
        tail_lamps_x_m=(-5.90, -5.75),
    ),
    cabin=Cabin(belt_m=(-5.92, 5.92, 1.26, 1.14), roof_m=(-5.86, 5.76, 1.20, 2.98),
                panes=tuple((0.02 + 0.12 * k, 0.13 + 0.12 * k) for k in range(8))),
    tyre_m=(0.48, 0.28), plate_m=0.62, handles_x_m=(),
)  # fmt: skip


TRACTOR_M = 3.5  # from a lorry's place to that of the same cab before a long trailer


def _long_lorry(load: Extras) -> Vehicle:
    """An articulated lorry of 13.6 m: the lorry's cab before a trailer."""
    lorry = VEHICLES["lorry"]
    hull, cabin = lorry.hull, lorry.cabin
    ahead = replace(
        hull,
        top_xz_m=tuple((x + TRACTOR_M, z) for x, z in hull.top_xz_m),
        plan_xy_m=tuple((x + TRACTOR_M, y) for x, y in hull.plan_xy_m),
        axles_x_m=(-5.3, -4.1, -2.9, 2.6, hull.axles_x_m[1] + TRACTOR_M),
        seams_x_m=tuple(x + TRACTOR_M for x in hull.seams_x_m),
        headlamps_x_m=(hull.headlamps_x_m[0] + TRACTOR_M, hull.headlamps_x_m[1] + TRACTOR_M),
        tail_lamps_x_m=(hull.tail_lamps_x_m[0] + TRACTOR_M, hull.tail_lamps_x_m[1] + TRACTOR_M),
    )
    belt, roof = (
        (rear + TRACTOR_M, front + TRACTOR_M, half, z) for rear, front, half, z in (cabin.belt_m, cabin.roof_m)
    )
    return replace(
        lorry, hull=ahead, cabin=replace(cabin, belt_m=belt, roof_m=roof), handles_x_m=(1.78 + TRACTOR_M,), extras=load
    )


def _chassis() -> list[Mesh]:
    """Frame, guards against running under, and rear lamps of a trailer."""
    return [
        box([11.4, 0.9, 0.25], [-1.0, 0, 0.95], UNDERSIDE),
        *(box([4.0, 0.06, 0.12], [0.2, s * 1.18, z], STEEL) for s in (-1, 1) for z in (0.55, 0.85)),
        box([0.10, 2.4, 0.16], [-6.75, 0, 0.55], PLASTIC),
        *(box([0.06, 0.35, 0.16], [-6.8, s * 0.95, 0.75], TAIL_LAMP) for s in (-1, 1)),
        *(box([3.6, 0.34, 0.06], [-4.1, s * 1.04, 1.03], PLASTIC) for s in (-1, 1)),
    ]


def _tank(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """A tank of polished or painted metal: smooth, round and long; hoses and a walkway."""
    polished = Surface(albedo=float(rng.uniform(0.45, 0.7)), contrast=0.03, mirror=float(rng.choice([0.05, 0.15, 0.3])))
    skin = polished if rng.random() < 0.6 else paint
    return [
        *_chassis(),
        tube([-6.7, 0, 2.25], [4.3, 0, 2.25], 1.2, skin, sides=48),
        box([10.0, 0.5, 0.08], [-1.2, 0, 3.46], STEEL),
        *(tube([-5.5, s * 1.12, 1.2], [0.8, s * 1.12, 1.2], 0.09, RUBBER, sides=8) for s in (-1, 1)),
        *(box([0.06, 2.42, 2.44], [x, 0, 2.25], STEEL) for x in (-3.2, 0.6) if rng.random() < 0.5),
    ]


def _trailer(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """A box or a curtain of one colour, with lettering or none."""
    side = Surface(albedo=float(rng.choice([0.08, 0.3, 0.55, 0.75])), contrast=0.05, texel_m=0.02)
    skin = side if rng.random() < 0.7 else paint
    parts = [*_chassis(), box([11.2, 2.48, 2.85], [-1.15, 0, 2.55], skin)]
    if rng.random() < 0.5:
        lettering = Surface(albedo=0.75 if skin.albedo < 0.3 else 0.1, contrast=0.5, texel_m=0.05)
        parts.append(box([float(rng.uniform(2, 6)), 2.49, 0.8], [float(rng.uniform(-3, 1)), 0, 2.8], lettering))
    return parts


VEHICLES["tanker"] = _long_lorry(_tank)
VEHICLES["articulated_lorry"] = _long_lorry(_trailer)
VEHICLES["coach"] = Vehicle(
    hull=Hull(
        top_xz_m=((-6.35, 1.50), (-6.30, 1.62), (6.26, 1.62), (6.35, 1.50)),
        plan_xy_m=((-6.35, 1.18), (-6.25, 1.27), (6.05, 1.27), (6.26, 1.20), (6.35, 1.02)), ground_m=0.32,
        axles_x_m=(-3.9, -2.6, 3.6), wheel_radius_m=0.50, seams_x_m=(-1.5, 0.4, 2.3, 4.8, 5.7),
        headlamps_x_m=(6.05, 6.30), tail_lamps_x_m=(-6.30, -6.15),
    ),
    cabin=Cabin(belt_m=(-6.30, 6.32, 1.26, 1.58), roof_m=(-6.24, 5.95, 1.18, 3.55), panes=((0.03, 0.97),)),
    tyre_m=(0.50, 0.30), plate_m=0.62, handles_x_m=(),
)  # fmt: skip
