"""Vehicles: cars of several shapes, vans, a lorry and a bus, in everyday dimensions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.coachwork import Cabin, Hull, cabin_mesh, hull_mesh
from bench.synthesis.bodies.joints import Joint, wheel
from bench.synthesis.bodies.loft import loft, rounded
from bench.synthesis.bodies.looks import (
    ALLOY,
    CHROME,
    GLASS,
    HEADLAMP,
    PLASTIC,
    PLATE,
    RUBBER,
    TAIL_LAMP,
    UNDERSIDE,
    painted,
)
from bench.synthesis.mesh import Mesh, Surface, box, joined, prism, tube

SIDES = 20
PROFILE = ((0.0, 0.90), (0.12, 1.0), (0.88, 1.0), (1.0, 0.90))  # share of the width, share of the radius


def vehicle_wheels(
    axles_x_m: Sequence[float], outer_y_m: float, radius_m: float, *, width_m: float, spokes: int
) -> tuple[list[Part], list[Joint]]:
    """All wheels of a vehicle; those of an axle turn together.

    Args:
        axles_x_m: where the axles are.
        outer_y_m: the wheels' outer faces, from the middle.
        radius_m: of the tyres.
        width_m: of the tyres.
        spokes: of a wheel.
    """
    parts: list[Part] = []
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
    return joined([tyre, rim, cap, _spokes(0.62 * radius_m, spokes, out)])


def _spokes(length_m: float, count: int, out: NDArray[np.float64]) -> Mesh:
    """Flat bars from the hub outwards, twice as wide at the rim."""
    half_m = length_m * 0.55 / count * out[1]
    along, across = _circle(count)[:, None], _circle(count, turn_rad=np.pi / 2)[:, None]
    share, wide = np.array([[0.0, -1.0], [1.0, -1.7], [1.0, 1.7], [0.0, 1.0]]).T[:, :, None]
    face = share * length_m * along + wide * half_m * across
    return prism(face, face + 0.014 * out, ALLOY)


def _circle(count: int, *, turn_rad: float = 0.0) -> NDArray[np.float64]:
    """(count, 3) directions around the axle, the first one up but for a turn forward."""
    turns = np.arange(count) * (2 * np.pi / count) + turn_rad
    return np.stack([np.sin(turns), np.zeros(count), np.cos(turns)], axis=1)


Built = tuple[list[Part], list[Joint], float]
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
    paint, spokes = painted(rng), int(rng.choice([5, 6, 7, 9]))
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
