"""What stands in rows: low walls, fences and guard rails, each piece along x with its front at y = 0."""

from __future__ import annotations

import numpy as np

from bench.synthesis.mesh import Mesh, Surface, quads
from bench.synthesis.world.materials import CONCRETE, DARK_STEEL, STEEL, WOOD, tinted
from bench.synthesis.world.solids import assembled, boxes

# A W-beam's cross-section, from below: way towards the traffic, and height; 0.31 m high, its top at 0.75 m (EN 1317).
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
    return assembled([body, coping]).with_texture_shift(rng.uniform(0, 8, 2))


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
    return assembled([quads(corners, surface, albedos=shades), rails, ends])


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
    return assembled([quads(beam, STEEL), boxes(centres, [0.08, 0.1, 0.8], tinted(STEEL, 0.8))])
