"""Trees with ragged crowns, hedges and bushes, each in a frame of its own."""

from __future__ import annotations

import numpy as np

from bench.synthesis.mesh import Mesh
from bench.synthesis.world.materials import BARK, LEAVES, tinted
from bench.synthesis.world.solids import assembled, bars, blobs, boxes, leaves, posts

FORMS = 3  # of trees in a recording, near and far
HEDGE_M = 0.8  # thickness


def drawn_trees(rng: np.random.Generator) -> dict[bool, list[Mesh]]:
    """A few forms, with single leaves (True) and for far away (False); turned, no two look alike."""
    return {near: [tree(own, near=near) for own in rng.spawn(FORMS)] for near in (True, False)}


def tree(rng: np.random.Generator, *, near: bool) -> Mesh:
    """A street tree of 5 to 9 m: a trunk, three boughs, a crown of lumps that leaves stick out of.

    Gaps between the lumps and single leaves at their rim are what makes its shadow dappled.

    Args:
        rng: draws its form.
        near: whether single leaves can be told apart.
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
    return assembled(
        [
            posts([[0.0, 0.0, -0.05]], bole_m + 0.6, radius_m, BARK, sides=9, taper=0.7),
            bars(forks, tips, 0.5 * radius_m, BARK, sides=5, taper=0.4),
            blobs(centres, radii, green, rng),
            leaves(centres, radii, green, rng, count=140 if near else 40, size_m=0.38 if near else 0.7),
        ]
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
    return assembled([boxes(centres, sizes, green), twigs]).with_texture_shift(rng.uniform(0, 8, 2))


def bush(rng: np.random.Generator) -> Mesh:
    """A low bush."""
    count = int(rng.integers(2, 5))
    centres = rng.uniform((-0.5, -0.4, 0.25), (0.5, 0.4, 0.6), (count, 3))
    radii = rng.uniform((0.35, 0.35, 0.3), (0.7, 0.6, 0.6), (count, 3))
    green = tinted(LEAVES, float(rng.uniform(0.7, 1.3)))
    return assembled([blobs(centres, radii, green, rng), leaves(centres, radii, green, rng, count=40, size_m=0.18)])
