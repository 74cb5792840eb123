"""Vehicles: cars of several shapes, vans, a lorry and a bus, in everyday dimensions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.coachwork import Cabin, Hull, cabin_mesh, hull_mesh
from bench.synthesis.bodies.joints import Joint
from bench.synthesis.bodies.loft import rounded
from bench.synthesis.bodies.looks import CHROME, GLASS, HEADLAMP, PLASTIC, PLATE, TAIL_LAMP, UNDERSIDE, painted
from bench.synthesis.bodies.wheels import vehicle_wheels
from bench.synthesis.mesh import Mesh, Surface, box

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
