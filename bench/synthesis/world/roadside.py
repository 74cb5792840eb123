"""What stands beside a road: lamps, trees and other things on the pavement, houses and gardens behind it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform
from bench.synthesis.mesh import Mesh
from bench.synthesis.world.alignment import Alignment
from bench.synthesis.world.barriers import fence, guard_rail, wall
from bench.synthesis.world.buildings import DEPTH_M, building
from bench.synthesis.world.furniture import THINGS, globe_lamp, lamp_post
from bench.synthesis.world.greenery import FORMS, HEDGE_M, bush, hedge
from bench.synthesis.world.plan import Plan
from bench.synthesis.world.site import Site, around, footprint, spot

TREE_STEP_M = 9.0
NEAR_M = 18.0  # from where host and actors drive: within it leaves and twigs are built one by one
NARROW_M = 1.6  # pavements below this have no room for trees
PIECE_M = 4.0  # of hedges, walls and rails, each of which may be left out
RAIL_M = 0.45  # of a guard rail behind the kerb
SUNK_M = 0.05  # houses reach into the ground, which slopes a little between pavement and verge


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roadside:
    """One side of a road.

    Attributes:
        way: the road's lane.
        kerb_m: its kerb, to the left of the lane.
        back_m: where the pavement ends and the fronts begin.
        sign: 1 on the left, -1 on the right.
        begin_m: first place along the lane.
        end_m: last one.
    """

    way: Alignment
    kerb_m: float
    back_m: float
    sign: int
    begin_m: float
    end_m: float

    def at(self, along_m: float, behind_m: float, height_m: float) -> RigidTransform:
        """A frame behind the kerb: y away from the road, z up."""
        turned_rad = 0.0 if self.sign > 0 else np.pi
        return self.way.place(along_m, self.kerb_m + self.sign * behind_m, height_m, turned_rad=turned_rad)

    def front(self, along_m: float, height_m: float) -> RigidTransform:
        """The same where the pavement ends."""
        return self.at(along_m, abs(self.back_m - self.kerb_m), height_m)


def roadsides(plan: Plan) -> list[Roadside]:
    """Both sides of the host's street, then those of the side streets."""
    spec, section, lane = plan.spec, plan.section, plan.lane
    sides = [
        Roadside(
            way=lane, kerb_m=kerb_m, back_m=kerb_m + sign * spec.pavement_m, sign=sign, begin_m=lane.begin_m,
            end_m=lane.end_m,
        )
        for kerb_m, sign in ((section.right_kerb_m, -1), (section.left_kerb_m, 1))
    ]  # fmt: skip
    for street, way in plan.mouths:
        for sign in (-1, 1):
            kerb_m, depth_m = sign * street.width_m / 2, min(spec.pavement_m, 2.5)
            side = Roadside(
                way=way, kerb_m=kerb_m, back_m=kerb_m + sign * depth_m, sign=sign,
                begin_m=spec.pavement_m + DEPTH_M + 0.5, end_m=way.end_m,
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
    """Trees at some of their places, before the fronts where the pavement is narrow."""
    depth_m = abs(side.back_m - side.kerb_m)
    behind_m = 0.95 if depth_m > NARROW_M and plan.spec.kind == "street" else depth_m + 1.6
    phase_m = rng.uniform(0.0, TREE_STEP_M)
    for along_m in np.arange(side.begin_m + phase_m, side.end_m, TREE_STEP_M):
        which, turn = int(rng.integers(FORMS)), rng.uniform(0, 2 * np.pi)
        at = side.at(float(along_m), behind_m, plan.spec.kerb_m)
        area = spot(at, 0.3)
        if rng.random() < plan.spec.trees and site.claim(area):
            yield forms[site.away_m(area) < NEAR_M][which].moved(
                at @ RigidTransform.from_yaw(float(turn), [0.0, 0.0, 0.0])
            )


def things(plan: Plan, side: Roadside, site: Site, rng: np.random.Generator) -> Iterator[Mesh]:
    """Signs, bins and the like: near the kerb if they are small, against the fronts if not."""
    builders, odds, sizes = zip(*THINGS, strict=True)
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
    for left_m, turned_rad in lines:
        for along_m in np.arange(plan.lane.begin_m + PIECE_M / 2, plan.lane.end_m, PIECE_M):
            at = plan.lane.place(float(along_m), left_m, 0.0, turned_rad=turned_rad)
            area = footprint(at, [-PIECE_M / 2 + 0.01, -0.09], [PIECE_M / 2 - 0.01, 0.12])
            if plan.road.disjoint(area) and site.claim(area):
                yield rail.moved(at)
