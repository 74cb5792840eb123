"""Cars that stand: along the kerb, or in the bays of a car park."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import shapely

from bench.geometry import RigidTransform
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.mesh import Mesh, Surface, joined, slab, tube
from bench.synthesis.world.markings import row_starts_m
from bench.synthesis.world.materials import PANE
from bench.synthesis.world.plan import BAY_M, BAY_WIDTH_M, PARKING_M, Plan
from bench.synthesis.world.site import Site, around, footprint
from bench.synthesis.world.solids import boxes

KINDS = ("car", "hatchback", "saloon", "estate", "suv", "city_car", "van")  # what parks in a street
PLACE_M = 6.0  # of the kerb for each car
FORMS = 3  # different cars of a recording; more would take longer to build than everything else
DETAILED_TRIANGLES = 9_500  # for the cars next to where host and actors drive; the others are simpler
WHEELS_M = 10.0  # farther away than this the wheels of a parked car are a few dark pixels
CAR_M = (4.9, 2.05)  # what a place must hold, with the mirrors; vans that are longer jut out as they do in life
CABINS = (
    ((-1.5, 0.92), (-0.9, 1.42), (0.2, 1.42), (1.0, 0.92)),
    ((-2.0, 0.92), (-1.7, 1.5), (0.1, 1.5), (1.0, 0.92)),
)
FULL_TO_M = 50.0  # along a car park; the bays beyond are empty, and too flat to be seen
GLOW = 4  # column of a mesh's surfaces
TYRE = Surface(albedo=0.08, contrast=0.2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """Somewhere to park.

    Attributes:
        at: world from the car, roughly.
        area: its footprint.
    """

    at: RigidTransform
    area: shapely.Polygon


def parked_cars(plan: Plan, site: Site, rng: np.random.Generator) -> list[Mesh]:
    """Fill a share of the places, the nearest ones with cars in full detail."""
    places = _bays(plan, rng) if plan.spec.kind == "car_park" else _kerbside(plan, rng)
    expected = [place for place in places if rng.random() < plan.spec.parked_cars and site.free(place.area)]
    expected.sort(key=lambda place: site.away_m(place.area))
    kinds = [kind for kind in KINDS if kind in BODIES]
    forms = [make_body(str(own.choice(kinds)), own).mesh for own in rng.spawn(FORMS)] if expected else []
    meshes, left = [], DETAILED_TRIANGLES
    for place, own in zip(expected, rng.spawn(len(expected)), strict=True):
        car = forms[int(own.integers(FORMS))].with_texture_shift(own.uniform(0, 8, 2))
        if left < len(car.corners_m):
            car = _plain_car(own, wheels=site.away_m(place.area) < WHEELS_M)
        if site.claim(around(car, place.at)):
            meshes.append(_unlit(car.moved(place.at)))
            left -= len(car.corners_m)
    return meshes


def _kerbside(plan: Plan, rng: np.random.Generator) -> list[Place]:
    """Places in the parking lanes, away from crossings and mouths, cars in the direction of their side."""
    spec, section = plan.spec, plan.section
    places = []
    for side, kerb_m, sign in (("right", section.right_kerb_m, 1.0), ("left", section.left_kerb_m, -1.0)):
        if not spec.has_parking(side):  # type: ignore[arg-type]
            continue
        blocked = [(at_m, 2.0 + 3.0) for at_m in spec.zebra_at_m]
        blocked += [(s.at_m, s.width_m / 2 + 5.0) for s in spec.side_streets if s.side == side]
        for along_m in np.arange(plan.lane.begin_m + 6.0, plan.lane.end_m - 6.0, PLACE_M):
            if any(abs(along_m - at_m) < half_m + PLACE_M / 2 for at_m, half_m in blocked):
                continue
            left_m = kerb_m + sign * (PARKING_M / 2 + rng.normal(0, 0.06))
            backwards = np.pi if side == "left" else 0.0
            at = plan.lane.place(
                float(along_m + rng.normal(0, 0.25)), float(left_m), turned_rad=backwards + float(rng.normal(0, 0.015))
            )
            places.append(_place(at))
    return places


def _bays(plan: Plan, rng: np.random.Generator) -> list[Place]:
    """The bays of a car park, noses in or out."""
    section, lane, places = plan.section, plan.lane, []
    for edge_m, sign, rows in ((section.right_m, -1.0, section.right_rows), (section.left_m, 1.0, section.left_rows)):
        for row, start_m in enumerate(row_starts_m(rows)):
            for divider_m in np.arange(lane.begin_m + 1.0, FULL_TO_M, BAY_WIDTH_M):
                left_m = edge_m + sign * (start_m + BAY_M / 2 + rng.normal(0, 0.12))
                nose = float(rng.choice([-1.0, 1.0], p=[0.25, 0.75])) * sign * (1.0 if row != 1 else -1.0)
                turn = nose * np.pi / 2 + float(rng.normal(0, 0.02))
                along_m = float(divider_m + BAY_WIDTH_M / 2 + rng.normal(0, 0.08))
                places.append(_place(lane.place(along_m, float(left_m), turned_rad=turn)))
    return places


def _place(at: RigidTransform) -> Place:
    half = np.array(CAR_M) / 2
    return Place(at=at, area=footprint(at, -half, half))


def _unlit(car: Mesh) -> Mesh:
    """The car with its lamps off."""
    surfaces = car.surfaces.copy()
    surfaces[:, GLOW] = 0.0
    return replace(car, surfaces=surfaces)


def _plain_car(rng: np.random.Generator, *, wheels: bool) -> Mesh:
    """A car of a hundred triangles, or fewer without round wheels, for the far places."""
    hull, glass, under, tyres = _plain_parts()[int(rng.integers(len(CABINS)))]
    shade = float(rng.choice([0.12, 0.25, 0.4, 0.55, 0.75]))
    painted = hull.surfaces.copy()
    painted[:, 0] = shade
    return joined([replace(hull, surfaces=painted), glass, tyres if wheels else under])


@cache
def _plain_parts() -> tuple[tuple[Mesh, Mesh, Mesh, Mesh], ...]:
    """A saloon and a hatchback: hull, glass, a dark underside, and wheels instead."""
    paint = Surface(albedo=0.4, contrast=0.06, mirror=0.04)
    side = [(-2.15, 0.35), (-2.1, 0.92), (1.1, 0.94), (2.05, 0.76), (2.15, 0.35), (1.6, 0.2), (-1.7, 0.2)]
    under = boxes([[0.0, 0.0, 0.16]], [3.2, 1.5, 0.32], TYRE)
    tyres = joined([_plain_tyre(x, y) for x in (-1.3, 1.3) for y in (-0.78, 0.78)])
    shapes = []
    for cabin in CABINS:
        (x0, z0), (x1, z1) = cabin[1:3]
        roof = slab([(x0, z0), (x1, z1), (0.9 * x1, z1 + 0.05), (0.95 * x0, z0 + 0.05)], 0.6, paint)
        glass = slab(cabin, [0.82, 0.62, 0.62, 0.82], PANE)
        shapes.append((joined([slab(side, 0.86, paint), roof]), glass, under, tyres))
    return tuple(shapes)


def _plain_tyre(x: float, y: float) -> Mesh:
    """What shows of a tyre: its outer side, and its tread below the hull."""
    tyre = tube([x, y - 0.1, 0.31], [x, y + 0.1, 0.31], 0.31, TYRE, sides=6)
    middles, inner = tyre.corners_m.mean(axis=1), y - 0.1 * np.sign(y)
    return tyre.picked((middles[:, 2] < 0.4) & (np.abs(middles[:, 1] - inner) > 0.01) | (np.abs(middles[:, 1]) > 0.87))
