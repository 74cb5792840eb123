"""Objects beside the road: lamp posts, signs, bins, shelters, trees, hedges, fences, guard rails and houses.

Furniture has a frame of its own on the ground: y away from the road, x against the traffic beside it, so that a sign
faces x. Hedges, walls, fences and rails run along x with their front at y = 0. A house stands in the frame of its
front: x along the front, to the right for who looks at it from the street; y into the house; z up from the pavement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, Surface, joined, quads, surfaced
from bench.synthesis.world.solids import (
    BARK,
    CONCRETE,
    DARK_STEEL,
    FRAME,
    KERB,
    LAMP_LENS,
    LEAVES,
    LIT_ADVERT,
    LIT_PANE,
    PANE,
    SIGN_BLUE,
    SIGN_RED,
    SIGN_WHITE,
    SQUARE,
    STEEL,
    WOOD,
    bars,
    blobs,
    boxes,
    drawn_wall,
    leaves,
    posts,
    tinted,
)

TREE_FORMS = 3  # of trees in a recording, near and far
HEDGE_M = 0.8  # thickness


def drawn_trees(rng: np.random.Generator) -> dict[bool, list[Mesh]]:
    """A few forms, with single leaves (True) and for far away (False); rotated, all look different."""
    return {near: [tree(own, near=near) for own in rng.spawn(TREE_FORMS)] for near in (True, False)}


def tree(rng: np.random.Generator, *, near: bool) -> Mesh:
    """A street tree of 5 to 9 m: a trunk, three boughs, a crown of lumps that leaves stick out of.

    Gaps between the lumps and single leaves at their rim are what makes its shadow dappled.

    Args:
        rng: draws its form.
        near: whether single leaves can be distinguished.
    """
    height_m, count = float(rng.uniform(5.0, 9.0)), int(rng.integers(4, 8))
    bole_m, radius_m = 0.38 * height_m, float(rng.uniform(0.09, 0.2))
    spread_m = float(rng.uniform(0.16, 0.26)) * height_m
    turns = np.arange(count) * 2.4 + rng.uniform(0, 6)
    away = spread_m * rng.uniform(0.35, 0.8, count) * (np.arange(count) > 0)
    heights = np.linspace(0.86, 0.5, count) * height_m + rng.normal(0, 0.15, count)
    centres = np.stack([away * np.cos(turns), away * np.sin(turns), heights], axis=1)
    radii = spread_m * rng.uniform(0.4, 0.62, (count, 1)) * np.array([1.0, 1.0, 0.85])
    green = tinted(LEAVES, float(rng.uniform(0.7, 1.25)))
    tips = centres[1:4] * (0.8, 0.8, 0.98)
    forks = np.broadcast_to(np.array([0.0, 0.0, 0.9 * bole_m]), tips.shape)
    return joined(
        posts([[0.0, 0.0, -0.05]], bole_m + 0.6, radius_m, BARK, sides=9, taper=0.7),
        bars(forks, tips, 0.5 * radius_m, BARK, sides=5, taper=0.4),
        blobs(centres, radii, green, rng),
        leaves(centres, radii, green, rng, count=140 if near else 40, size_m=0.38 if near else 0.7),
    ).with_texture_shift(rng.uniform(0, 8, 2))


def hedge(length_m: float, height_m: float, rng: np.random.Generator, *, near: bool = True) -> Mesh:
    """A clipped hedge along x, its front at y = 0: uneven pieces with twigs sticking out."""
    count = max(1, round(length_m / 1.3))
    x = (np.arange(count) + 0.5) * (length_m / count) - length_m / 2
    heights = height_m * rng.uniform(0.92, 1.06, count)
    centres = np.stack([x, HEDGE_M / 2 + 0.05 * rng.standard_normal(count), heights / 2 - 0.05], axis=1)
    sizes = np.stack([np.full(count, length_m / count + 0.06), np.full(count, HEDGE_M), heights], axis=1)
    green = tinted(LEAVES, float(rng.uniform(0.7, 1.2)))
    twigs = leaves(centres, sizes / 2, green, rng, count=round(9 * length_m) if near else 0, size_m=0.16)
    return joined(boxes(centres, sizes, green), twigs).with_texture_shift(rng.uniform(0, 8, 2))


def bush(rng: np.random.Generator) -> Mesh:
    """A low bush."""
    count = int(rng.integers(2, 5))
    centres = rng.uniform((-0.5, -0.4, 0.25), (0.5, 0.4, 0.6), (count, 3))
    radii = rng.uniform((0.35, 0.35, 0.3), (0.7, 0.6, 0.6), (count, 3))
    green = tinted(LEAVES, float(rng.uniform(0.7, 1.3)))
    return joined(blobs(centres, radii, green, rng), leaves(centres, radii, green, rng, count=40, size_m=0.18))


# A W-beam's cross-section, from below: towards the traffic, and height; 0.31 m high, its top at 0.75 m (EN 1317).
BEAM_M = np.array([(0.0, 0.44), (0.08, 0.49), (0.08, 0.54), (0.0, 0.595), (0.08, 0.65), (0.08, 0.70), (0.0, 0.75)])
POST_STEP_M = 2.0


def wall(length_m: float, height_m: float, rng: np.random.Generator, *, near: bool = True) -> Mesh:
    """A low wall of brick, stone or concrete with a coping."""
    stone = Surface(albedo=float(rng.uniform(0.3, 0.6)), contrast=0.2, texel_m=float(rng.choice([0.01, 0.02])))
    del near  # a wall is as simple as it gets
    body = boxes([[0.0, 0.12, height_m / 2 - 0.05]], [length_m, 0.24, height_m + 0.1], stone)
    coping = boxes(
        [[0.0, 0.12, height_m + 0.02]], [length_m, 0.32, 0.07], tinted(CONCRETE, float(rng.uniform(0.8, 1.2)))
    )
    return joined(body, coping).with_texture_shift(rng.uniform(0, 8, 2))


def fence(length_m: float, height_m: float, rng: np.random.Generator, *, near: bool = True) -> Mesh:
    """Boards or bars between two rails."""
    boards = rng.random() < 0.6
    surface = tinted(WOOD, float(rng.uniform(0.5, 1.9))) if boards else tinted(DARK_STEEL, float(rng.uniform(0.6, 2.0)))
    width_m, pitch_m = (0.10, 0.14) if boards else (0.022, 0.13)
    if not near:
        width_m, pitch_m = 4 * width_m, 4 * pitch_m
    x = np.arange(-length_m / 2 + pitch_m / 2, length_m / 2, pitch_m)
    faces = np.stack([x, np.zeros(len(x)), np.full(len(x), 0.06)], axis=1)
    tall = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]]) * (width_m, height_m - 0.06)
    corners = faces[:, None] + np.insert(tall, 1, 0.0, axis=1)
    rails = boxes([[0.0, 0.04, z] for z in (0.25 * height_m, 0.8 * height_m)], [length_m, 0.05, 0.06], surface)
    ends = boxes([[end, 0.05, height_m / 2] for end in (-length_m / 2, length_m / 2)], [0.1, 0.1, height_m], surface)
    shades = surface.albedo * rng.uniform(0.85, 1.1, len(x))
    return joined(quads(corners, surface, albedos=shades), rails, ends)


def guard_rail(length_m: float) -> Mesh:
    """A W-beam on posts, facing towards negative y."""
    half = length_m / 2
    low, high = BEAM_M[:-1], BEAM_M[1:]
    beam = [
        [[-half, -y0, z0], [half, -y0, z0], [half, -y1, z1], [-half, -y1, z1]]
        for (y0, z0), (y1, z1) in zip(low, high, strict=True)
    ]
    x = np.arange(-half + POST_STEP_M / 2, half, POST_STEP_M)
    centres = np.stack([x, np.full(len(x), 0.06), np.full(len(x), 0.33)], axis=1)
    return joined(quads(beam, STEEL), boxes(centres, [0.08, 0.1, 0.8], tinted(STEEL, 0.8)))


FOOT_M = -0.05  # posts reach this far into the ground


def lamp_post(height_m: float, reach_m: float) -> Mesh:
    """A lamp post whose head hangs over the road: 4 to 6 m high in a street, 9 m on an avenue."""
    head_y = -reach_m
    return joined(
        posts([[0.0, 0.0, FOOT_M]], height_m, 0.085, STEEL, sides=8, taper=0.6),
        boxes([[0.0, head_y / 2, height_m - 0.06]], [0.07, reach_m, 0.07], STEEL),
        boxes([[0.0, head_y - 0.25, height_m - 0.03]], [0.28, 0.62, 0.12], DARK_STEEL),
        boxes([[0.0, head_y - 0.25, height_m - 0.10]], [0.22, 0.5, 0.03], LAMP_LENS),
    )


def marker_post() -> Mesh:
    """A post of white plastic at the edge of a fast road, with a black band and a reflector that faces the traffic."""
    return joined(
        boxes([[0.0, 0.0, 0.48]], [0.06, 0.12, 1.06], SIGN_WHITE),
        boxes([[0.0, 0.0, 0.86]], [0.064, 0.124, 0.2], tinted(DARK_STEEL, 0.5)),
        boxes([[0.03, 0.0, 0.86]], [0.02, 0.05, 0.16], LIT_ADVERT),
    )


GANTRY_M = 5.6  # clear height; 4.7 m are the least on European motorways


def gantry(span_m: float, lanes: int, rng: np.random.Generator) -> Mesh:
    """A gantry across a road along y, from 0 to `span_m`, with a direction sign and lit signs over its lanes.

    Its signs face x, against the traffic.
    """
    beam_m = GANTRY_M + 0.5
    parts = [
        boxes([[0.0, y, beam_m / 2] for y in (0.0, span_m)], [0.35, 0.35, beam_m + 0.3], STEEL),
        boxes([[0.0, span_m / 2, z] for z in (GANTRY_M + 0.1, GANTRY_M + 0.9)], [0.25, span_m, 0.18], STEEL),
        boxes([[0.2, span_m * rng.uniform(0.3, 0.6), beam_m + 0.4]], [0.1, 4.0, 2.4], SIGN_BLUE),
    ]
    for lane in range(lanes):
        y = span_m * (lane + 0.5) / lanes
        parts.append(boxes([[0.3, y, GANTRY_M + 0.5]], [0.12, 1.2, 1.2], tinted(DARK_STEEL, 0.4)))
        rows, columns = np.divmod(np.flatnonzero(rng.random(16) < 0.45), 4)
        lit = np.stack([np.full(len(rows), 0.37), y + 0.25 * (columns - 1.5), GANTRY_M + 0.5 + 0.25 * (rows - 1.5)], 1)
        if len(lit):
            parts.append(boxes(lit, [0.02, 0.14, 0.14], replace(LIT_ADVERT, glow=0.05)))
    return joined(*parts)


def sign(rng: np.random.Generator) -> Mesh:
    """A traffic sign: a disc, triangle or rectangle with a symbol, on a post."""
    shape = str(rng.choice(["disc", "triangle", "square"]))
    z, size_m = float(rng.uniform(2.1, 2.4)), 0.6
    sides = {"disc": 16, "triangle": 3, "square": 4}[shape]
    angles = np.arange(sides) * (2 * np.pi / sides) + (np.pi / 2 if shape == "triangle" else np.pi / 4)
    radius_m = 0.42 if shape != "disc" else size_m / 2
    rim, face = (SIGN_BLUE, SIGN_WHITE) if shape == "square" else (SIGN_RED, SIGN_WHITE)
    if shape == "disc" and rng.random() < 0.3:
        rim = face = SIGN_BLUE
    parts = [posts([[0.0, 0.0, FOOT_M]], z + 0.35, 0.03, STEEL, sides=6)]
    for share, before_m, surface in ((1.0, 0.045, rim), (0.76, 0.05, face)):
        ring = share * radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        parts.append(_plate(ring, before_m, z, surface))
    parts.append(_plate(radius_m * np.stack([np.cos(angles), -np.sin(angles)], axis=1), 0.04, z, STEEL))
    bars = rng.uniform((-0.1, -0.14), (0.1, 0.06), (int(rng.integers(1, 4)), 2))
    tall = np.array([[-0.04, 0.0], [0.04, 0.0], [0.04, 0.13], [-0.04, 0.13]])
    symbol = np.insert(bars[:, None] + tall, 0, 0.055, axis=2) + np.array([0.0, 0.0, z])
    return joined(*parts, quads(symbol, tinted(SIGN_BLUE, 0.4)))


def _plate(ring: NDArray[np.float64], x_m: float, z_m: float, surface: Surface) -> Mesh:
    """A convex plate in the plane of y and z; it faces x if its ring runs anticlockwise from y to z."""
    corners = np.column_stack([np.full(len(ring), x_m), ring[:, 0], ring[:, 1] + z_m])
    fan = np.stack([np.tile(corners[0], (len(ring) - 2, 1)), corners[1:-1], corners[2:]], axis=1)
    return surfaced(fan, surface)


def litter_bin(rng: np.random.Generator) -> Mesh:
    """A bin on a post, or wheeled bins put out for collection."""
    if rng.random() < 0.5:
        dark = tinted(DARK_STEEL, float(rng.uniform(0.6, 2.0)))
        return joined(posts([[0, 0, FOOT_M]], 1.1, 0.03, STEEL), posts([[0, 0.0, 0.5]], 0.55, 0.19, dark, sides=9))
    x = np.arange(int(rng.integers(1, 4))) * 0.68
    body = np.stack([x, np.zeros(len(x)), np.full(len(x), 0.5)], axis=1)
    shades = rng.uniform(0.1, 0.35, len(x))
    plastic = Surface(albedo=0.2, contrast=0.06)
    lids = boxes(body + np.array([0, -0.03, 0.54]), [0.6, 0.78, 0.09], plastic, albedos=1.3 * shades)
    return joined(boxes(body, [0.56, 0.7, 1.0], plastic, albedos=shades), lids)


def bollards(rng: np.random.Generator) -> Mesh:
    """A row of three to five bollards, of steel or of stone."""
    count = int(rng.integers(3, 6))
    feet = np.stack([1.5 * np.arange(count), np.zeros(count), np.full(count, FOOT_M)], axis=1)
    height_m, radius_m, band_m, surface = (
        (0.6, 0.17, 0.02, CONCRETE) if rng.random() < 0.4 else (0.9, 0.05, 0.052, DARK_STEEL)
    )
    bands = posts(feet + np.array([0, 0, 0.72]), 0.1, band_m, SIGN_WHITE, sides=8)
    return joined(posts(feet, height_m, radius_m, surface, sides=8), bands)


def planter(rng: np.random.Generator) -> Mesh:
    """A concrete or wooden tub with a bush."""
    tub = tinted(CONCRETE, float(rng.uniform(0.7, 1.2))) if rng.random() < 0.6 else WOOD
    return joined(boxes([[0, 0, 0.25]], [1.3, 0.8, 0.5], tub), _lifted(bush(rng), 0.3))


def cabinet(rng: np.random.Generator) -> Mesh:
    """A cabinet of the telephone or power company, stickers on its doors."""
    width_m = float(rng.uniform(0.7, 1.6))
    grey = Surface(albedo=float(rng.uniform(0.4, 0.6)), contrast=0.06)
    body = boxes([[0, 0.0, 0.6]], [width_m, 0.35, 1.3], grey)
    positions = rng.uniform((-width_m / 2.6, 0.3), (width_m / 2.6, 1.0), (4, 2))
    low = np.stack([positions[:, 0], np.full(4, -0.185), positions[:, 1]], axis=1)
    half = rng.uniform(0.03, 0.12, (4, 1, 2))
    square = SQUARE * half
    faces = low[:, None] + np.insert(square, 1, 0.0, axis=2)
    return joined(body, quads(faces, SIGN_WHITE, albedos=rng.uniform(0.15, 0.9, 4)))


def advertising(rng: np.random.Generator) -> Mesh:
    """A round column or a lit panel, its posters a patchwork of light and dark."""
    if rng.random() < 0.4:
        column = posts([[0, 0, FOOT_M]], 2.9, 0.6, SIGN_WHITE, sides=14)
        column.surfaces[:28, 0] = np.repeat(rng.uniform(0.15, 0.85, 14), 2)
        lid = posts([[0, 0, 2.85]], 0.2, 0.7, DARK_STEEL, sides=14)
        return joined(column, lid)
    frame = boxes([[0, 0, 1.45]], [0.14, 1.35, 2.4], DARK_STEEL)
    feet = boxes([[0, 0, 0.1]], [0.12, 1.0, 0.4], DARK_STEEL)
    rows, columns = np.meshgrid(np.arange(5), np.arange(3))
    corner = np.stack([columns.ravel() * 0.4 - 0.6, rows.ravel() * 0.42 + 0.4], axis=1)
    cell = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.42], [0.0, 0.42]])
    poster = np.insert(corner[:, None] + cell, 0, 0.075, axis=2)
    shades = rng.uniform(0.15, 0.85, len(poster))
    back = poster[:, ::-1] * (-1, 1, 1)
    return joined(frame, feet, quads(np.concatenate([poster, back]), LIT_ADVERT, albedos=np.tile(shades, 2)))


def shelter(rng: np.random.Generator) -> Mesh:
    """A bus shelter of glass with a bench."""
    del rng
    corners = [[x, y, FOOT_M] for x in (-1.9, 1.9) for y in (0.0, 1.3)]
    back = [[-1.9, 1.3, 0.2], [1.9, 1.3, 0.2], [1.9, 1.3, 2.2], [-1.9, 1.3, 2.2]]
    side = [[-1.9, 0.1, 0.2], [-1.9, 1.3, 0.2], [-1.9, 1.3, 2.2], [-1.9, 0.1, 2.2]]
    return joined(
        posts(corners, 2.4, 0.045, DARK_STEEL),
        boxes([[0, 0.6, 2.4]], [4.2, 1.7, 0.12], STEEL),
        boxes([[0, 1.0, 0.47]], [2.4, 0.4, 0.06], WOOD),
        boxes([[0, 1.05, 0.22]], [2.0, 0.08, 0.45], DARK_STEEL),
        quads([back, side], PANE),
    )


def bicycle_stands(rng: np.random.Generator) -> Mesh:
    """Hoops to lock a bicycle to."""
    count = int(rng.integers(2, 5))
    feet = np.array([[0.9 * k, y, FOOT_M] for k in range(count) for y in (-0.35, 0.35)])
    bars = boxes([[0.9 * k, 0.0, 0.78] for k in range(count)], [0.05, 0.75, 0.05], STEEL)
    return joined(posts(feet, 0.85, 0.025, STEEL, sides=6), bars)


def globe_lamp(rng: np.random.Generator) -> Mesh:
    """A short post with a globe, as squares and car parks have."""
    return joined(
        posts([[0.0, 0.0, FOOT_M]], 3.6, 0.06, DARK_STEEL, sides=8, taper=0.7),
        blobs([[0.0, 0.0, 3.75]], [[0.22, 0.22, 0.22]], LAMP_LENS, rng),
    )


def _lifted(mesh: Mesh, by_m: float) -> Mesh:
    mesh.corners_m[..., 2] += by_m
    return mesh


# What may stand near a kerb, how often, and the half length and half depth that it needs, m.
FURNITURE: tuple[tuple[Callable[[np.random.Generator], Mesh], float, tuple[float, float]], ...] = (
    (sign, 0.30, (0.35, 0.35)),
    (litter_bin, 0.18, (0.3, 0.4)),
    (bollards, 0.12, (0.2, 0.2)),
    (planter, 0.12, (0.8, 0.55)),
    (cabinet, 0.10, (0.8, 0.25)),
    (advertising, 0.08, (0.7, 0.7)),
    (bicycle_stands, 0.07, (0.3, 0.45)),
    (shelter, 0.03, (2.1, 0.8)),
)


DEPTH_M = 10.0
FLOOR_M, GROUND_FLOOR_M = 3.0, 3.4
LIT_SHARE = 0.3  # of the windows; their glow only shows at night
BEFORE_M = 0.03  # frames stand this far before the wall, panes 1 cm more, so that nothing lies in one plane


@dataclass(frozen=True, slots=True, kw_only=True)
class HouseStyle:
    """Properties of a house.

    Attributes:
        floors: with the ground floor.
        shop: ground floor of large panes below a sign.
        bands: windows as long bands, as offices have them, instead of single ones.
        gable: a pitched roof.
        pitch_m: from window to window.
        window_m: width and height of a window.
        shutters: beside the windows.
    """

    floors: int
    shop: bool
    bands: bool
    gable: bool
    pitch_m: float
    window_m: tuple[float, float]
    shutters: bool


def drawn_style(rng: np.random.Generator) -> HouseStyle:
    """Town houses mostly, some of them shops, some offices."""
    bands = rng.random() < 0.15
    return HouseStyle(
        floors=int(rng.integers(1, 6)),
        shop=bool(rng.random() < 0.35),
        bands=bool(bands),
        gable=bool(not bands and rng.random() < 0.6),
        pitch_m=float(rng.uniform(2.2, 3.4)),
        window_m=(float(rng.uniform(0.9, 1.5)), float(rng.uniform(1.2, 1.7))),
        shutters=bool(rng.random() < 0.25),
    )


def building(length_m: float, rng: np.random.Generator) -> Mesh:
    """A house of a length, in the frame of its front."""
    style, wall = drawn_style(rng), drawn_wall(rng)
    height_m = GROUND_FLOOR_M + (style.floors - 1) * FLOOR_M + 0.5
    body = boxes([[0.0, DEPTH_M / 2, height_m / 2]], [length_m, DEPTH_M, height_m], wall)
    plinth = boxes([[0.0, -0.04, 0.25]], [length_m, 0.08, 0.5], tinted(KERB, float(rng.uniform(0.6, 1.1))))
    cornice = boxes([[0.0, -0.12, height_m - 0.1]], [length_m, 0.26, 0.2], tinted(wall, 0.8))
    shift = rng.uniform(0, 8, 2)
    parts = [body.with_texture_shift(shift), cornice, *_roof(style, length_m, height_m, wall, rng)]
    parts += _shop(length_m, wall, rng) if style.shop else [plinth, *_door(length_m, rng)]
    first = 1 if style.shop else 0
    columns = _columns(length_m, style)
    windows = [(x, _sill_m(floor)) for floor in range(first, style.floors) for x in columns]
    if not style.shop:
        windows = [w for w in windows if w[1] > 2.0 or abs(w[0] - _door_x(length_m)) > 1.3]
    parts += _windows(np.array(windows).reshape(-1, 2), style, length_m, rng)
    if rng.random() < 0.5:  # a downpipe between two houses
        parts.append(boxes([[length_m / 2 - 0.2, -0.08, height_m / 2]], [0.1, 0.1, height_m], tinted(FRAME, 0.6)))
    return joined(*parts)


def _sill_m(floor: int) -> float:
    return 1.0 if floor == 0 else GROUND_FLOOR_M + (floor - 1) * FLOOR_M + 0.85


def _columns(length_m: float, style: HouseStyle) -> NDArray[np.float64]:
    if style.bands:
        return np.array([0.0])
    count = max(1, int(length_m // style.pitch_m))
    return np.asarray((np.arange(count) - (count - 1) / 2) * (length_m / count))


def _door_x(length_m: float) -> float:
    return -length_m / 2 + 1.3


def _windows(places_m: NDArray[np.float64], style: HouseStyle, length_m: float, rng: np.random.Generator) -> list[Mesh]:
    """Frames, panes of their own shade, a bar across, and sills; some are lit."""
    if len(places_m) == 0:
        return []
    count, (width_m, height_m) = len(places_m), style.window_m
    if style.bands:
        width_m, height_m = length_m - 1.0, 1.5
    low = np.stack([places_m[:, 0], np.full(count, -BEFORE_M), places_m[:, 1]], axis=1)
    frame = tinted(FRAME, float(rng.uniform(0.3, 1.15)))
    bars = int(max(2, width_m // 1.6)) if style.bands else int(rng.integers(1, 3))
    lit = rng.random(count) < LIT_SHARE
    shade = PANE.albedo * rng.uniform(0.6, 2.2, count)  # curtains and dark rooms
    panes = _upright(low + np.array([0, -0.01, 0.07]), width_m - 0.14, height_m - 0.14)
    shifts = rng.uniform(0, 8, (count, 2))
    parts = [
        quads(_upright(low, width_m, height_m), frame),
        quads(panes[~lit], PANE, albedos=shade[~lit], shifts_m=shifts[~lit]),
        quads(panes[lit], LIT_PANE, shifts_m=shifts[lit]),
    ]
    across = (np.arange(1, bars) - bars / 2) * (width_m / bars)
    middles = (low[:, None] + across[:, None] * np.array([1.0, 0.0, 0.0])).reshape(-1, 3)
    parts.append(quads(_upright(middles + np.array([0, -0.02, 0]), 0.07, height_m), frame))
    parts.append(quads(_sills(low, width_m + 0.2), tinted(KERB, 1.1)))
    if style.shutters and not style.bands:
        wood = tinted(WOOD, float(rng.uniform(0.4, 1.6)))
        beside = np.concatenate([low + np.array([side * (0.75 * width_m + 0.02), 0, 0]) for side in (-1, 1)])
        parts.append(quads(_upright(beside, 0.48 * width_m, height_m), wood))
    return parts


def _sills(low_m: NDArray[np.float64], width_m: float) -> NDArray[np.float64]:
    """Front and top of the stones below windows."""
    half, out_m, high_m = width_m / 2, -0.12, 0.07
    edge = low_m + np.array([0.0, out_m, -high_m])
    fronts = _upright(edge, width_m, high_m)
    top = np.array([[-half, out_m, 0.0], [half, out_m, 0.0], [half, 0.0, 0.0], [-half, 0.0, 0.0]])
    return np.concatenate([fronts, low_m[:, None] + top])


def _upright(low_m: NDArray[np.float64], width_m: float, height_m: float) -> NDArray[np.float64]:
    """(N, 4, 3) patches that face the street, from the middles (N, 3) of their lower edges."""
    half = width_m / 2
    return np.asarray(
        low_m[:, None] + np.array([[-half, 0, 0], [half, 0, 0], [half, 0, height_m], [-half, 0, height_m]])
    )


def _door(length_m: float, rng: np.random.Generator) -> list[Mesh]:
    x, wood = _door_x(length_m), tinted(WOOD, float(rng.uniform(0.35, 1.8)))
    low = np.array([[x, -0.09, 0.0]])
    step = boxes([[x, -0.12, 0.07]], [1.5, 0.26, 0.14], KERB)
    pane = quads(_upright(low + np.array([0, -0.01, 1.3]), 0.5, 0.6), PANE)
    return [
        quads(_upright(low, 1.25, 2.35), FRAME),
        quads(_upright(low + np.array([0, -0.005, 0]), 1.05, 2.2), wood),
        pane,
        step,
    ]


def _shop(length_m: float, wall: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Large panes between pillars, a sign above, now and then an awning."""
    count = max(1, round(length_m / 3.2))
    middles = (np.arange(count) - (count - 1) / 2) * (length_m / count)
    low = np.stack([middles, np.full(count, -BEFORE_M), np.full(count, 0.35)], axis=1)
    width_m, door = length_m / count - 0.5, int(rng.integers(count))
    panes = _upright(low, width_m, 2.2)
    panes[door, :2, 2] = 0.05
    goods = quads(
        panes, LIT_PANE if rng.random() < 0.6 else PANE,
        albedos=rng.uniform(0.12, 0.4, count), shifts_m=rng.uniform(0, 8, (count, 2)),
    )  # fmt: skip
    sign = boxes([[0.0, -0.1, 2.95]], [length_m - 0.3, 0.2, 0.55], tinted(wall, float(rng.choice([0.4, 0.6, 1.5]))))
    letters = np.arange(-0.3 * length_m, 0.3 * length_m, 0.42)
    letters = letters[rng.random(len(letters)) < 0.85]
    feet = np.stack([letters, np.full(len(letters), -0.21), np.full(len(letters), 2.8)], axis=1)
    parts = [goods, sign, quads(_upright(feet, 0.26, 0.3), LIT_ADVERT)]
    if rng.random() < 0.4:
        edge = [[-length_m / 2 + 0.3, -1.1, 2.3], [length_m / 2 - 0.3, -1.1, 2.3]]
        top = [[length_m / 2 - 0.3, -0.05, 2.65], [-length_m / 2 + 0.3, -0.05, 2.65]]
        parts.append(quads([edge + top], Surface(albedo=float(rng.uniform(0.25, 0.8)), contrast=0.08)))
    return parts


def _roof(style: HouseStyle, length_m: float, height_m: float, wall: Surface, rng: np.random.Generator) -> list[Mesh]:
    if not style.gable:
        return []
    rise_m, half = float(rng.uniform(2.0, 4.0)), length_m / 2
    tiles = Surface(albedo=float(rng.uniform(0.18, 0.36)), contrast=0.25, texel_m=0.03)
    slope = [[-half, -0.3, height_m], [half, -0.3, height_m], [half, DEPTH_M / 2, height_m + rise_m]]
    slope.append([-half, DEPTH_M / 2, height_m + rise_m])
    back = [[half, DEPTH_M, height_m], [-half, DEPTH_M, height_m], slope[3], slope[2]]
    ends = [[[x, 0.0, height_m], [x, DEPTH_M, height_m], [x, DEPTH_M / 2, height_m + rise_m]] for x in (half, -half)]
    return [quads([slope, back], tiles), surfaced(np.array([ends[0], ends[1][::-1]]), wall)]
