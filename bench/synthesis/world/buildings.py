"""Houses: walls, roofs, doors, shop fronts and windows in several looks.

A house stands in the frame of its front: x along the front, to the right for who looks at it from the street; y into
the house; z up from the pavement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, Surface, joined, quads, surfaced
from bench.synthesis.world.solids import FRAME, KERB, LIT_ADVERT, LIT_PANE, PANE, WOOD, boxes, drawn_wall, tinted

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
    return joined(parts)


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
