"""The bodies that a scenario can name: cars, a van, a cyclist and pedestrians of several heights."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from bench.synthesis.body import Body, Hinge, Part, assembled
from bench.synthesis.mesh import Mesh, Surface, ball, box, convex, slab, tube

GLASS = Surface(albedo=0.10, contrast=0.35, texel_m=0.02)
RUBBER = Surface(albedo=0.08, contrast=0.30)
METAL = Surface(albedo=0.55, contrast=0.20)
LAMP = Surface(albedo=0.85, contrast=0.10)
SHADES = (0.14, 0.28, 0.42, 0.58, 0.72)  # of paint and coats
SKIN = Surface(albedo=0.55, contrast=0.12)
DARK_CLOTH = Surface(albedo=0.16, contrast=0.35)


Built = tuple[list[Part], float]  # parts, and the way after which their postures repeat


def make_body(kind: str, rng: np.random.Generator) -> Body:
    """Build a body.

    Args:
        kind: a name of `BODIES`.
        rng: chooses its shade and the part of the texture that it wears.
    """
    object_class, build = BODIES[kind]
    paint = Surface(albedo=float(rng.choice(SHADES)), contrast=float(rng.uniform(0.12, 0.2)))
    parts, cycle_m = build(paint)
    shift_m = rng.uniform(0, 8, 2)
    worn = [(mesh.with_texture_shift(shift_m), hinge) for mesh, hinge in parts]
    return assembled(object_class, worn, cycle_m=cycle_m)


def _car_wheels(axles_x_m: tuple[float, float], half_track_m: float, radius_m: float) -> list[Part]:
    parts: list[Part] = []
    for x in axles_x_m:
        for y in (-half_track_m, half_track_m):
            out = 0.11 if y > 0 else -0.11
            spoke = box([1.1 * radius_m, 0.03, 0.07], [x, y + out, radius_m], METAL)
            tyre = tube([x, y - 0.1, radius_m], [x, y + 0.1, radius_m], radius_m, RUBBER, sides=20)
            spin = Hinge(pivot_xz_m=(x, radius_m), cycle_m=2 * np.pi * radius_m)
            parts += [(tyre, spin), (spoke, spin)]
    return parts


def _lamps(front_x_m: float, rear_x_m: float, half_width_m: float, height_m: float) -> list[Part]:
    parts: list[Part] = []
    for y in (-half_width_m, half_width_m):
        parts.append((box([0.06, 0.3, 0.14], [front_x_m, y, height_m], LAMP), None))
        parts.append((box([0.06, 0.22, 0.2], [rear_x_m, y, height_m + 0.06], DARK_CLOTH), None))
    plates: list[Part] = [(box([0.05, 0.5, 0.11], [x, 0.0, height_m - 0.2], LAMP), None) for x in (front_x_m, rear_x_m)]
    return parts + plates


def _car(paint: Surface) -> Built:
    """A hatchback, 4.3 m long, 1.8 m wide and 1.48 m high."""
    hull = slab(
        [
            (-2.1, 0.32),
            (-2.15, 0.55),
            (-2.05, 0.95),
            (1.2, 0.95),
            (2.0, 0.78),
            (2.15, 0.55),
            (2.1, 0.3),
            (1.5, 0.2),
            (-1.6, 0.2),
        ],
        [0.78, 0.84, 0.84, 0.88, 0.76, 0.8, 0.76, 0.86, 0.86],
        paint,
    )
    glass = slab([(-1.95, 0.93), (-1.6, 1.42), (0.1, 1.42), (1.05, 0.93)], [0.8, 0.6, 0.6, 0.82], GLASS)
    roof = slab([(-1.62, 1.4), (-1.55, 1.48), (0.0, 1.48), (0.15, 1.4)], [0.63, 0.56, 0.56, 0.63], paint)
    pillar = slab([(-0.75, 0.95), (-0.62, 1.42), (-0.52, 1.42), (-0.6, 0.95)], [0.84, 0.625, 0.625, 0.84], paint)
    mirrors = box([0.12, 1.98, 0.12], [0.75, 0.0, 1.0], paint)
    parts: list[Part] = [(hull, None), (glass, None), (roof, None), (pillar, None), (mirrors, None)]
    wheels = _car_wheels((-1.3, 1.3), 0.78, 0.31)
    return parts + wheels + _lamps(2.08, -2.1, 0.55, 0.66), 2 * np.pi * 0.31


def _van(paint: Surface) -> Built:
    """A delivery van, 5.4 m long, 2 m wide and 2.3 m high."""
    cargo = slab([(-2.7, 0.4), (-2.7, 2.25), (1.2, 2.3), (1.6, 1.2), (1.6, 0.35)], [0.95, 0.9, 0.9, 0.98, 0.98], paint)
    nose = slab([(1.5, 0.3), (1.5, 1.25), (2.45, 0.98), (2.7, 0.6), (2.65, 0.3)], [0.95, 0.95, 0.85, 0.88, 0.88], paint)
    screen = slab([(1.15, 2.15), (1.25, 2.2), (1.98, 1.14), (1.6, 1.2)], [0.82, 0.82, 0.88, 0.9], GLASS)
    window = slab([(0.3, 1.3), (0.4, 2.0), (1.15, 2.0), (1.4, 1.3)], [0.985, 0.935, 0.935, 0.985], GLASS)
    stripe = box([3.4, 1.96, 0.25], [-0.9, 0.0, 0.9], DARK_CLOTH)
    parts: list[Part] = [(cargo, None), (nose, None), (screen, None), (window, None), (stripe, None)]
    wheels = _car_wheels((-1.75, 1.75), 0.86, 0.34)
    return parts + wheels + _lamps(2.66, -2.7, 0.65, 0.75), 2 * np.pi * 0.34


def _walker(height_m: float) -> Callable[[Surface], Built]:
    """A pedestrian whose arms and legs swing; proportions of an adult, scaled to the height."""

    def build(coat: Surface) -> Built:
        k = height_m / 1.75
        cycle_m = 1.4 * k
        levels = ((0.86, 0.12, 0.17), (1.2, 0.13, 0.18), (1.45, 0.1, 0.21), (1.5, 0.05, 0.1))  # height, depth, width
        points = [[x, y, z] for z, depth, half in levels for x in (-depth, depth) for y in (-half, half)]
        torso = convex(np.array(points) * k, coat)
        head = ball([0.02 * k, 0.0, 1.63 * k], np.array([0.1, 0.085, 0.12]) * k, SKIN)
        neck = tube([0, 0, 1.45 * k], [0.01 * k, 0, 1.58 * k], 0.055 * k, SKIN)
        parts: list[Part] = [(torso, None), (head, None), (neck, None)]
        for side, phase in ((1, 0.0), (-1, np.pi)):
            hip = Hinge(pivot_xz_m=(0.0, 0.9 * k), cycle_m=cycle_m, swing_rad=0.42, phase_rad=phase)
            shoulder = Hinge(pivot_xz_m=(0.0, 1.42 * k), cycle_m=cycle_m, swing_rad=0.4, phase_rad=phase + np.pi)
            y = 0.095 * side * k
            leg = tube([0, y, 0.92 * k], [0, y, 0.06 * k], 0.09 * k, DARK_CLOTH, taper=0.6)
            shoe = box([0.26 * k, 0.09 * k, 0.08 * k], [0.05 * k, y, 0.04 * k], RUBBER)
            y = 0.235 * side * k
            arm = tube([0, y, 1.44 * k], [0.03 * k, y, 0.9 * k], 0.055 * k, coat, taper=0.8)
            hand = ball([0.03 * k, y, 0.84 * k], np.array([0.05, 0.04, 0.08]) * k, SKIN)
            parts += [(leg, hip), (shoe, hip), (arm, shoulder), (hand, shoulder)]
        return parts, cycle_m

    return build


def _cyclist(coat: Surface) -> Built:
    """A rider on an upright bicycle, 1.8 m long and 1.75 m high."""
    radius_m = 0.34
    parts: list[Part] = []
    for x in (-0.52, 0.54):
        spin = Hinge(pivot_xz_m=(x, radius_m), cycle_m=2 * np.pi * radius_m)
        parts += [(rim, spin) for rim in _rim(x, radius_m)]
    bars = [
        ((-0.52, radius_m), (-0.18, 0.95)), ((-0.52, radius_m), (-0.08, 0.3)), ((-0.08, 0.3), (-0.18, 0.95)),
        ((-0.16, 0.85), (0.38, 0.88)), ((-0.08, 0.3), (0.4, 0.8)), ((0.34, 1.05), (0.54, radius_m)),
    ]  # fmt: skip
    for (x0, z0), (x1, z1) in bars:
        parts.append((tube([x0, 0, z0], [x1, 0, z1], 0.02, METAL, sides=6), None))
    parts.append((tube([0.33, -0.28, 1.07], [0.33, 0.28, 1.07], 0.018, METAL, sides=6), None))
    outline = ((-0.3, 0.95, 0.15), (-0.08, 0.95, 0.15), (-0.02, 1.42, 0.2), (0.18, 1.36, 0.2))
    torso = convex([[x, y, z] for x, z, half in outline for y in (-half, half)], coat)
    parts += [(torso, None), (ball([0.16, 0.0, 1.6], [0.12, 0.1, 0.14], SKIN), None)]
    cycle_m = 4.5  # way of one turn of the pedals in a middle gear
    for side, phase in ((1, 0.0), (-1, np.pi)):
        hip = Hinge(pivot_xz_m=(-0.18, 0.98), cycle_m=cycle_m, swing_rad=0.3, phase_rad=phase)
        y = 0.1 * side
        thigh = tube([-0.18, y, 0.98], [0.16, y, 0.66], 0.085, DARK_CLOTH, taper=0.75)
        shank = tube([0.16, y, 0.66], [-0.06, y, 0.24], 0.062, DARK_CLOTH, taper=0.7)
        shoe = box([0.25, 0.08, 0.07], [0.0, y, 0.19], RUBBER)
        parts += [(thigh, hip), (shank, hip), (shoe, hip)]
        parts.append((tube([0.08, 0.2 * side, 1.36], [0.34, 0.24 * side, 1.09], 0.05, coat, taper=0.7), None))
    return parts, cycle_m


def _rim(x_m: float, radius_m: float) -> list[Mesh]:
    """A tyre that can be looked through, with two spokes to see it turn."""
    angles = np.linspace(0, 2 * np.pi, 15)
    outer, inner = radius_m, radius_m - 0.06
    arcs = []
    for a, b in pairwise(angles):
        profile = [(x_m + r * np.sin(t), radius_m + r * np.cos(t)) for t in (a, b) for r in (outer, inner)]
        arcs.append(slab(profile, 0.022, RUBBER))
    for a in (0.0, np.pi / 2):
        along = inner * np.array([np.sin(a), 0.0, np.cos(a)])
        hub = np.array([x_m, 0.0, radius_m])
        arcs.append(tube(hub - along, hub + along, 0.01, METAL, sides=4))
    return arcs


BODIES: dict[str, tuple[str, Callable[[Surface], Built]]] = {
    "car": ("vehicle", _car),
    "van": ("vehicle", _van),
    "cyclist": ("cyclist", _cyclist),
    "adult": ("pedestrian", _walker(1.75)),
    "short_adult": ("pedestrian", _walker(1.6)),
    "child": ("pedestrian", _walker(1.25)),
}
