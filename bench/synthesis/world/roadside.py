"""Objects beside a road: parked cars, lamps, trees and furniture on the pavement, houses and gardens behind it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform
from bench.synthesis.bodies import make_body
from bench.synthesis.mesh import COLUMN_OF, Mesh, Surface, joined, slab, tube
from bench.synthesis.world.plan import BAY_M, BAY_WIDTH_M, PARKING_M, Alignment, Plan, Site, around, footprint, spot
from bench.synthesis.world.road_surface import row_starts_m
from bench.synthesis.world.solids import PANE, boxes
from bench.synthesis.world.structures import (
    DEPTH_M,
    FURNITURE,
    HEDGE_M,
    TREE_FORMS,
    building,
    bush,
    fence,
    gantry,
    globe_lamp,
    guard_rail,
    hedge,
    lamp_post,
    marker_post,
    wall,
)

KINDS = ("car", "saloon", "estate", "suv", "city_car", "van")  # what parks in a street
SPACE_M = 6.0  # of the kerb for each car
CAR_FORMS = 3  # different cars of a recording; more would take longer to build than everything else
DETAILED_TRIANGLES = 9_500  # for the cars next to where ego vehicle and actors drive; the others are simpler
WHEELS_M = 10.0  # farther away than this the wheels of a parked car are a few dark pixels
CAR_M = (4.9, 2.05)  # what a space must hold, with the mirrors; vans that are longer jut out as they do in life
CABINS = (
    ((-1.5, 0.92), (-0.9, 1.42), (0.2, 1.42), (1.0, 0.92)),
    ((-2.0, 0.92), (-1.7, 1.5), (0.1, 1.5), (1.0, 0.92)),
)
FULL_TO_M = 50.0  # along a car park; the bays beyond are empty, and too flat to be seen
TYRE = Surface(albedo=0.08, contrast=0.2)


def parked_cars(plan: Plan, site: Site, rng: np.random.Generator) -> list[Mesh]:
    """Fill a share of the spaces, the nearest ones with cars in full detail."""
    places = _bays(plan, rng) if plan.spec.kind == "car_park" else _kerbside(plan, rng)
    expected = [at for at in places if rng.random() < plan.spec.parked_cars and site.free(_space(at))]
    expected.sort(key=lambda at: site.away_m(_space(at)))
    forms = [make_body(str(own.choice(KINDS)), own).mesh for own in rng.spawn(CAR_FORMS)] if expected else []
    meshes, left = [], DETAILED_TRIANGLES
    for at, own in zip(expected, rng.spawn(len(expected)), strict=True):
        car = forms[int(own.integers(CAR_FORMS))].with_texture_shift(own.uniform(0, 8, 2))
        if left < len(car.corners_m):
            car = _plain_car(own, wheels=site.away_m(_space(at)) < WHEELS_M)
        if site.claim(around(car, at)):
            meshes.append(_unlit(car.moved(at)))
            left -= len(car.corners_m)
    return meshes


def _kerbside(plan: Plan, rng: np.random.Generator) -> list[RigidTransform]:
    """Places in the parking lanes, away from crossings and mouths, cars in the direction of their side."""
    spec, section = plan.spec, plan.section
    spaces = []
    for side, kerb_m, sign in (("right", section.right_kerb_m, 1.0), ("left", section.left_kerb_m, -1.0)):
        if not spec.has_parking(side):  # type: ignore[arg-type]
            continue
        blocked = [(at_m, 2.0 + 3.0) for at_m in spec.zebra_at_m]
        blocked += [(s.at_m, s.width_m / 2 + 5.0) for s in spec.side_streets if s.side == side]
        for along_m in np.arange(plan.lane.begin_m + 6.0, plan.lane.end_m - 6.0, SPACE_M):
            if any(abs(along_m - at_m) < half_m + SPACE_M / 2 for at_m, half_m in blocked):
                continue
            left_m = kerb_m + sign * (PARKING_M / 2 + rng.normal(0, 0.06))
            backwards = np.pi if side == "left" else 0.0
            at = plan.lane.pose(
                float(along_m + rng.normal(0, 0.25)), float(left_m), yaw_rad=backwards + float(rng.normal(0, 0.015))
            )
            spaces.append(at)
    return spaces


def _bays(plan: Plan, rng: np.random.Generator) -> list[RigidTransform]:
    """The bays of a car park, noses in or out."""
    section, lane, spaces = plan.section, plan.lane, []
    for edge_m, sign, rows in ((section.right_m, -1.0, section.right_rows), (section.left_m, 1.0, section.left_rows)):
        for row, start_m in enumerate(row_starts_m(rows)):
            for divider_m in np.arange(lane.begin_m + 1.0, FULL_TO_M, BAY_WIDTH_M):
                left_m = edge_m + sign * (start_m + BAY_M / 2 + rng.normal(0, 0.12))
                nose = float(rng.choice([-1.0, 1.0], p=[0.25, 0.75])) * sign * (1.0 if row != 1 else -1.0)
                turn = nose * np.pi / 2 + float(rng.normal(0, 0.02))
                along_m = float(divider_m + BAY_WIDTH_M / 2 + rng.normal(0, 0.08))
                spaces.append(lane.pose(along_m, float(left_m), yaw_rad=turn))
    return spaces


def _space(at: RigidTransform) -> shapely.Polygon:
    """What a car at a place needs, roughly."""
    half = np.array(CAR_M) / 2
    return footprint(at, -half, half)


def _unlit(car: Mesh) -> Mesh:
    """The car with its lamps off."""
    surfaces = car.surfaces.copy()
    surfaces[:, COLUMN_OF["glow"]] = 0.0
    return replace(car, surfaces=surfaces)


def _plain_car(rng: np.random.Generator, *, wheels: bool) -> Mesh:
    """A car of a hundred triangles, or fewer without round wheels, for the far ones."""
    hull, glass, under, tyres = _plain_parts()[int(rng.integers(len(CABINS)))]
    shade = float(rng.choice([0.12, 0.25, 0.4, 0.55, 0.75]))
    painted = hull.surfaces.copy()
    painted[:, COLUMN_OF["albedo"]] = shade
    return joined(replace(hull, surfaces=painted), glass, tyres if wheels else under)


@cache
def _plain_parts() -> tuple[tuple[Mesh, Mesh, Mesh, Mesh], ...]:
    """A saloon and a hatchback: hull, glass, a dark underside, and wheels instead."""
    paint = Surface(albedo=0.4, contrast=0.06, mirror=0.04)
    side = [(-2.15, 0.35), (-2.1, 0.92), (1.1, 0.94), (2.05, 0.76), (2.15, 0.35), (1.6, 0.2), (-1.7, 0.2)]
    under = boxes([[0.0, 0.0, 0.16]], [3.2, 1.5, 0.32], TYRE)
    tyres = joined(*(_plain_tyre(x, y) for x in (-1.3, 1.3) for y in (-0.78, 0.78)))
    shapes = []
    for cabin in CABINS:
        (x0, z0), (x1, z1) = cabin[1:3]
        roof = slab([(x0, z0), (x1, z1), (0.9 * x1, z1 + 0.05), (0.95 * x0, z0 + 0.05)], 0.6, paint)
        glass = slab(cabin, [0.82, 0.62, 0.62, 0.82], PANE)
        shapes.append((joined(slab(side, 0.86, paint), roof), glass, under, tyres))
    return tuple(shapes)


def _plain_tyre(x: float, y: float) -> Mesh:
    """Build the visible part of a tyre: its outer side, and its tread below the hull."""
    tyre = tube([x, y - 0.1, 0.31], [x, y + 0.1, 0.31], 0.31, TYRE, sides=6)
    middles, inner = tyre.corners_m.mean(axis=1), y - 0.1 * np.sign(y)
    return tyre.select((middles[:, 2] < 0.4) & (np.abs(middles[:, 1] - inner) > 0.01) | (np.abs(middles[:, 1]) > 0.87))


TREE_STEP_M = 9.0
NEAR_M = 18.0  # from where ego vehicle and actors drive: within it leaves and twigs are built one by one
NARROW_M = 1.6  # pavements below this are too narrow for trees
PIECE_M = 4.0  # of hedges, walls and rails, each of which may be left out
RAIL_M = 0.45  # of a guard rail behind the kerb
MARKER_STEP_M, MARKER_M = 25.0, 0.9  # of marker posts; behind the kerb, and behind a guard rail there
SUNK_M = 0.05  # houses reach into the ground, which slopes a little between pavement and verge


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roadside:
    """One side of a road.

    Attributes:
        lane: of the road.
        kerb_m: its kerb, to the left of the lane.
        back_m: where the pavement ends and the fronts begin.
        sign: 1 on the left, -1 on the right.
        begin_m: first position along the lane.
        end_m: last one.
    """

    lane: Alignment
    kerb_m: float
    back_m: float
    sign: int
    begin_m: float
    end_m: float

    def at(self, along_m: float, behind_m: float, height_m: float) -> RigidTransform:
        """A frame behind the kerb: y away from the road, z up."""
        yaw_rad = 0.0 if self.sign > 0 else np.pi
        return self.lane.pose(along_m, self.kerb_m + self.sign * behind_m, height_m, yaw_rad=yaw_rad)

    def front(self, along_m: float, height_m: float) -> RigidTransform:
        """A frame where the pavement ends: y away from the road, z up."""
        return self.at(along_m, abs(self.back_m - self.kerb_m), height_m)


def roadsides(plan: Plan) -> list[Roadside]:
    """Both sides of the ego vehicle's street, then those of the side streets."""
    spec, section, lane = plan.spec, plan.section, plan.lane
    sides = [
        Roadside(
            lane=lane, kerb_m=kerb_m, back_m=kerb_m + sign * spec.pavement_m, sign=sign, begin_m=lane.begin_m,
            end_m=lane.end_m,
        )
        for kerb_m, sign in ((section.right_kerb_m, -1), (section.left_kerb_m, 1))
    ]  # fmt: skip
    for street, side_lane in plan.mouths:
        for sign in (-1, 1):
            kerb_m, depth_m = sign * street.width_m / 2, min(spec.pavement_m, 2.5)
            side = Roadside(
                lane=side_lane, kerb_m=kerb_m, back_m=kerb_m + sign * depth_m, sign=sign,
                begin_m=spec.pavement_m + DEPTH_M + 0.5, end_m=side_lane.end_m,
            )  # fmt: skip
            sides.append(side)
    return sides


def lamps(plan: Plan, side: Roadside, site: Site, rng: np.random.Generator) -> Iterator[Mesh]:
    """Lamp posts along a kerb, 18 to 28 m apart."""
    kind, kerb_m = plan.spec.kind, plan.spec.kerb_m
    step_m = float(rng.uniform(18.0, 28.0))
    post = (
        lamp_post(9.0, 1.6)
        if kind == "avenue"
        else lamp_post(float(rng.uniform(4.5, 6.5)), float(rng.uniform(0.3, 1.1)))
    )
    if kind == "car_park" and rng.random() < 0.6:
        post = globe_lamp(rng)
    for along_m in np.arange(side.begin_m + rng.uniform(2.0, step_m), side.end_m, step_m):
        at = side.at(float(along_m), 0.7 if kind == "avenue" else 0.45, kerb_m)
        if site.claim(spot(at, 0.12)):
            yield post.moved(at)


def trees(
    plan: Plan, side: Roadside, site: Site, rng: np.random.Generator, forms: dict[bool, list[Mesh]]
) -> Iterator[Mesh]:
    """Trees at some of their positions, before the fronts where the pavement is narrow."""
    depth_m = abs(side.back_m - side.kerb_m)
    behind_m = 0.95 if depth_m > NARROW_M and plan.spec.kind == "street" else depth_m + 1.6
    phase_m = rng.uniform(0.0, TREE_STEP_M)
    for along_m in np.arange(side.begin_m + phase_m, side.end_m, TREE_STEP_M):
        which, turn = int(rng.integers(TREE_FORMS)), rng.uniform(0, 2 * np.pi)
        at = side.at(float(along_m), behind_m, plan.spec.kerb_m)
        area = spot(at, 0.3)
        if rng.random() < plan.spec.trees and site.claim(area):
            yield forms[site.away_m(area) < NEAR_M][which].moved(
                at @ RigidTransform.from_yaw(float(turn), [0.0, 0.0, 0.0])
            )


def street_furniture(plan: Plan, side: Roadside, site: Site, rng: np.random.Generator) -> Iterator[Mesh]:
    """Signs, bins and the like: near the kerb if they are small, against the fronts if not."""
    builders, odds, sizes = zip(*FURNITURE, strict=True)
    depth_m = abs(side.back_m - side.kerb_m)
    if plan.spec.kind == "avenue":
        builders, odds, sizes = builders[:1], (1.0,), sizes[:1]
    count = rng.poisson((side.end_m - side.begin_m) / (9.0 if plan.spec.kind == "street" else 16.0))
    for along_m in np.sort(rng.uniform(side.begin_m, side.end_m, count)):
        which = int(rng.choice(len(builders), p=np.array(odds) / sum(odds)))
        half_x, half_y = sizes[which]
        behind_m = 0.2 + half_y if half_y < 0.4 else depth_m - half_y - 0.15
        if behind_m < half_y + 0.2:
            continue
        at = side.at(float(along_m), float(behind_m), plan.spec.kerb_m)
        thing = builders[which](rng)
        low, high = thing.corners_m[..., :2].min(axis=(0, 1)), thing.corners_m[..., :2].max(axis=(0, 1))
        area = footprint(at, np.minimum(low, (-half_x, -half_y)), np.maximum(high, (half_x, half_y)))
        if plan.road.disjoint(area) and site.claim(area):
            yield thing.moved(at)


def fronts(plan: Plan, side: Roadside, site: Site, rng: np.random.Generator) -> Iterator[Mesh]:
    """Houses and gardens one after the other, as far as they fit between the streets."""
    spec, ground_m = plan.spec, plan.spec.kerb_m - SUNK_M
    house_share = {"street": 1.0 - spec.hedges, "car_park": 0.35, "avenue": 0.2}[spec.kind] * spec.buildings
    free = plan.paved.buffer(-0.2)
    shapely.prepare(free)
    along_m = side.begin_m
    while along_m < side.end_m - 4.0:
        length_m, house = float(rng.uniform(8.0, 15.0)), rng.random() < house_share
        middle_m = along_m + length_m / 2
        at = side.front(middle_m, ground_m)
        area = footprint(at, [-length_m / 2 + 0.02, 0.05], [length_m / 2 - 0.02, DEPTH_M])
        if house and (shapely.intersects(free, area) or not site.claim(area)):
            along_m += 2.0
            continue
        if house:
            yield building(length_m, rng).moved(at)
        else:
            yield from _garden(plan, side, site, along_m, length_m, free, rng)
        along_m += length_m + float(rng.choice([0.0, 0.0, 0.0, 3.0]))


def _garden(
    plan: Plan,
    side: Roadside,
    site: Site,
    along_m: float,
    length_m: float,
    free: BaseGeometry,
    rng: np.random.Generator,
) -> Iterator[Mesh]:
    """A hedge, fence or wall in pieces, bushes and a tree behind it; or nothing but them."""
    style, height_m = (
        str(rng.choice(["hedge", "fence", "wall", "open"], p=[0.4, 0.25, 0.2, 0.15])),
        rng.uniform(0.7, 1.6),
    )
    count = max(1, round(length_m / PIECE_M))
    piece_m = length_m / count
    form = {"hedge": hedge, "fence": fence, "wall": wall}.get(style)
    ground_m = plan.spec.kerb_m - SUNK_M
    for k in range(count):
        at = side.front(along_m + (k + 0.5) * piece_m, ground_m)
        area = footprint(at, [-piece_m / 2 + 0.02, 0.02], [piece_m / 2 - 0.02, HEDGE_M])
        if form is not None and not shapely.intersects(free, area) and site.claim(area):
            yield form(piece_m, float(height_m), rng, near=site.away_m(area) < NEAR_M).moved(at)
    for _ in range(int(rng.integers(0, 3))):
        at = side.at(
            along_m + float(rng.uniform(0, length_m)), abs(side.back_m - side.kerb_m) + rng.uniform(1.5, 6), ground_m
        )
        shrub = bush(rng)
        area = around(shrub, at)
        if not shapely.intersects(plan.paved, area) and site.claim(area):
            yield shrub.moved(at)


def guard_rails(plan: Plan, site: Site) -> Iterator[Mesh]:
    """On both edges of an avenue's median, and behind its right kerb where no side street opens."""
    section, rail = plan.section, guard_rail(PIECE_M)
    if plan.spec.kind != "avenue":
        return
    lines = [(section.right_kerb_m - RAIL_M, np.pi), (section.left_m + 1.2, 0.0), (section.left_m + 1.8, np.pi)]
    for left_m, yaw_rad in lines:
        for along_m in np.arange(plan.lane.begin_m + PIECE_M / 2, plan.lane.end_m, PIECE_M):
            at = plan.lane.pose(float(along_m), left_m, 0.0, yaw_rad=yaw_rad)
            area = footprint(at, [-PIECE_M / 2 + 0.01, -0.09], [PIECE_M / 2 - 0.01, 0.12])
            if plan.road.disjoint(area) and site.claim(area):
                yield rail.moved(at)


def fast_road(plan: Plan, site: Site, rng: np.random.Generator) -> Iterator[Mesh]:
    """Marker posts behind both kerbs, and gantries over the whole road."""
    lane, post = plan.lane, marker_post()
    right, left = sides = roadsides(plan)[:2]
    steps_m = np.arange(lane.begin_m + 2.0, lane.end_m, MARKER_STEP_M) if plan.spec.marker_posts else ()
    for along_m in steps_m:
        for side in sides:
            at = side.at(float(along_m), MARKER_M, plan.spec.kerb_m)
            if site.claim(spot(at, 0.1)):
                yield post.moved(at)
    low_m, high_m = right.kerb_m - 2 * MARKER_M, left.kerb_m + 2 * MARKER_M
    span_m = high_m - low_m
    for along_m in plan.spec.gantries_at_m:
        at = lane.pose(along_m, high_m, 0.0, yaw_rad=np.pi)  # its x against the traffic, its y to the right
        feet = [at, lane.pose(along_m, low_m, 0.0)]
        if all(site.claim(spot(foot, 0.3)) for foot in feet):
            yield gantry(span_m, plan.spec.lanes_left + 1 + plan.spec.lanes_right, rng).moved(at)
