"""The shapes of the vehicles that a scenario can name; outlines after common models of each class."""

from __future__ import annotations

import numpy as np

from bench.synthesis.bodies.body import PLASTIC, STEEL, TAIL_LAMP, UNDERSIDE
from bench.synthesis.bodies.vehicles import Cabin, Hull, Outline, Vehicle
from bench.synthesis.mesh import Mesh, Surface, box, convex


def _plan(rear_m: float, front_m: float, half_m: float) -> Outline:
    """Seen from above: rounded corners, rounder in front."""
    return (
        (rear_m, 0.78 * half_m), (rear_m + 0.08, 0.90 * half_m), (rear_m + 0.30, 0.975 * half_m),
        (rear_m + 0.75, half_m), (front_m - 0.85, half_m), (front_m - 0.42, 0.965 * half_m),
        (front_m - 0.16, 0.86 * half_m), (front_m, 0.66 * half_m),
    )  # fmt: skip


def _blunt_plan(rear_m: float, front_m: float, half_m: float) -> Outline:
    """Vans and larger: almost a rectangle."""
    return ((rear_m, 0.97 * half_m), (rear_m + 0.06, half_m), (front_m - 0.35, half_m),
            (front_m - 0.12, 0.95 * half_m), (front_m, 0.82 * half_m))  # fmt: skip


HATCHBACK = Vehicle(
    hull=Hull(
        top_xz_m=((-2.13, 0.74), (-2.06, 0.92), (-1.90, 0.98), (0.90, 0.95), (1.35, 0.90), (1.90, 0.79), (2.08, 0.69),
                  (2.15, 0.58)),
        plan_xy_m=_plan(-2.13, 2.15, 0.895), ground_m=0.20, axles_x_m=(-1.28, 1.32), wheel_radius_m=0.31,
        seams_x_m=(-0.78, -0.08, 0.88), headlamps_x_m=(1.64, 2.08), tail_lamps_x_m=(-2.06, -1.88),
    ),
    cabin=Cabin(belt_m=(-2.04, 1.04, 0.80, 0.94), roof_m=(-1.62, 0.12, 0.58, 1.445),
                panes=((0.06, 0.26), (0.29, 0.60), (0.63, 0.94))),
    tyre_m=(0.31, 0.205), plate_m=0.42, handles_x_m=(-0.66, 0.06),
)  # fmt: skip
CITY_CAR = Vehicle(
    hull=Hull(
        top_xz_m=((-1.80, 0.78), (-1.75, 0.95), (-1.62, 1.00), (0.85, 0.98), (1.20, 0.94), (1.58, 0.84), (1.74, 0.73),
                  (1.80, 0.60)),
        plan_xy_m=_plan(-1.80, 1.80, 0.825), ground_m=0.19, axles_x_m=(-1.17, 1.17), wheel_radius_m=0.285,
        seams_x_m=(-0.35, 0.78), headlamps_x_m=(1.36, 1.74), tail_lamps_x_m=(-1.75, -1.55),
    ),
    cabin=Cabin(belt_m=(-1.68, 1.02, 0.735, 0.97), roof_m=(-1.50, 0.22, 0.56, 1.475),
                panes=((0.07, 0.42), (0.46, 0.94))),
    tyre_m=(0.285, 0.175), plate_m=0.40, handles_x_m=(-0.22,),
)  # fmt: skip
SALOON = Vehicle(
    hull=Hull(
        top_xz_m=((-2.36, 0.76), (-2.30, 0.94), (-2.15, 1.00), (-1.55, 1.01), (0.95, 0.96), (1.45, 0.91), (2.08, 0.79),
                  (2.28, 0.69), (2.36, 0.57)),
        plan_xy_m=_plan(-2.36, 2.36, 0.915), ground_m=0.18, axles_x_m=(-1.38, 1.44), wheel_radius_m=0.325,
        seams_x_m=(-0.82, -0.05, 0.92), headlamps_x_m=(1.86, 2.28), tail_lamps_x_m=(-2.30, -2.02),
    ),
    cabin=Cabin(belt_m=(-1.86, 1.06, 0.80, 0.95), roof_m=(-1.02, 0.12, 0.57, 1.415),
                panes=((0.10, 0.30), (0.33, 0.62), (0.65, 0.94))),
    tyre_m=(0.325, 0.225), plate_m=0.44, handles_x_m=(-0.70, 0.09),
)  # fmt: skip
ESTATE = Vehicle(
    hull=Hull(
        top_xz_m=((-2.36, 0.76), (-2.31, 0.94), (-2.18, 1.00), (0.95, 0.96), (1.45, 0.91), (2.08, 0.79), (2.28, 0.69),
                  (2.36, 0.57)),
        plan_xy_m=_plan(-2.36, 2.36, 0.915), ground_m=0.19, axles_x_m=(-1.38, 1.44), wheel_radius_m=0.325,
        seams_x_m=(-0.82, -0.05, 0.92), headlamps_x_m=(1.86, 2.28), tail_lamps_x_m=(-2.31, -2.06),
    ),
    cabin=Cabin(belt_m=(-2.22, 1.06, 0.80, 0.95), roof_m=(-1.92, 0.12, 0.58, 1.455),
                panes=((0.05, 0.26), (0.28, 0.49), (0.52, 0.70), (0.73, 0.95))),
    tyre_m=(0.325, 0.225), plate_m=0.44, handles_x_m=(-0.70, 0.09),
)  # fmt: skip
SUV = Vehicle(
    hull=Hull(
        top_xz_m=((-2.23, 0.88), (-2.18, 1.06), (-2.02, 1.12), (0.92, 1.08), (1.40, 1.05), (1.98, 0.96), (2.15, 0.86),
                  (2.23, 0.70)),
        plan_xy_m=_plan(-2.23, 2.23, 0.93), ground_m=0.25, axles_x_m=(-1.32, 1.36), wheel_radius_m=0.36,
        seams_x_m=(-0.75, 0.0, 0.92), headlamps_x_m=(1.74, 2.15), tail_lamps_x_m=(-2.18, -1.95),
    ),
    cabin=Cabin(belt_m=(-2.08, 1.06, 0.82, 1.07), roof_m=(-1.86, 0.16, 0.61, 1.635),
                panes=((0.05, 0.25), (0.28, 0.50), (0.53, 0.71), (0.74, 0.95))),
    tyre_m=(0.36, 0.235), plate_m=0.52, handles_x_m=(-0.62, 0.13),
)  # fmt: skip


def _open_bed(_: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The lining of a pickup's bed, a bar behind the cabin, and at times a load."""
    bed = [
        box([1.62, 1.46, 0.03], [-1.72, 0, 1.02], UNDERSIDE),
        *(box([1.70, 0.09, 0.16], [-1.72, s * 0.80, 1.07], PLASTIC) for s in (-1, 1)),
        box([0.09, 1.60, 0.16], [-2.56, 0, 1.07], PLASTIC),
        *(box([0.09, 0.09, 0.62], [-0.96, s * 0.66, 1.28], PLASTIC) for s in (-1, 1)),
        box([0.09, 1.40, 0.09], [-0.96, 0, 1.58], PLASTIC),
    ]
    crate = Surface(albedo=float(rng.choice([0.15, 0.35, 0.60])), contrast=0.4, texel_m=0.03)
    return [*bed, box([0.80, 1.00, 0.55], [-1.75, 0, 1.30], crate)] if rng.random() < 0.5 else bed


PICKUP = Vehicle(
    hull=Hull(
        top_xz_m=((-2.66, 0.90), (-2.62, 1.02), (1.10, 1.06), (1.60, 1.04), (2.35, 0.98), (2.58, 0.88), (2.66, 0.70)),
        plan_xy_m=_blunt_plan(-2.66, 2.66, 0.93), ground_m=0.28, axles_x_m=(-1.60, 1.62), wheel_radius_m=0.37,
        seams_x_m=(-0.82, 0.15, 1.10), headlamps_x_m=(2.20, 2.58), tail_lamps_x_m=(-2.62, -2.50),
    ),
    cabin=Cabin(belt_m=(-0.88, 1.30, 0.82, 1.03), roof_m=(-0.74, 0.50, 0.64, 1.80),
                panes=((0.08, 0.44), (0.50, 0.93))),
    tyre_m=(0.37, 0.25), plate_m=0.58, handles_x_m=(-0.60, 0.28), extras=_open_bed,
)  # fmt: skip


def _rear_doors(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The gap between a van's rear doors, and often the name of its firm on both sides."""
    gap = box([0.03, 0.014, 1.70], [-2.69, 0, 1.40], UNDERSIDE)
    lettering = Surface(albedo=0.75 if paint.albedo < 0.3 else 0.10, contrast=0.6, texel_m=0.03)
    heights = ((1.45, 0.955), (1.95, 0.913))  # the side leans inwards
    corners = [(x, half + out, z) for x in (-2.0, 0.1) for z, half in heights for out in (-0.01, 0.004)]
    signs = [convex(np.array(corners) * (1.0, side, 1.0), lettering) for side in (-1.0, 1.0)]
    return [gap, *signs] if rng.random() < 0.6 else [gap]


VAN = Vehicle(
    hull=Hull(
        top_xz_m=((-2.70, 1.12), (-2.66, 1.20), (1.50, 1.20), (2.10, 1.08), (2.50, 0.92), (2.66, 0.78), (2.70, 0.66)),
        plan_xy_m=_blunt_plan(-2.70, 2.70, 1.0), ground_m=0.25, axles_x_m=(-1.70, 1.72), wheel_radius_m=0.345,
        seams_x_m=(-0.85, 0.42, 1.30), headlamps_x_m=(2.20, 2.58), tail_lamps_x_m=(-2.66, -2.56),
    ),
    cabin=Cabin(belt_m=(-2.69, 1.86, 0.97, 1.17), roof_m=(-2.62, 1.02, 0.88, 2.33),
                panes=((0.725, 0.95),), rear_window=False),
    tyre_m=(0.345, 0.215), plate_m=0.52, handles_x_m=(0.55,), extras=_rear_doors,
)  # fmt: skip
MINIBUS = Vehicle(
    hull=Hull(
        top_xz_m=((-2.48, 1.00), (-2.44, 1.12), (1.40, 1.10), (1.95, 1.00), (2.28, 0.86), (2.44, 0.72), (2.48, 0.60)),
        plan_xy_m=_blunt_plan(-2.48, 2.48, 0.95), ground_m=0.22, axles_x_m=(-1.45, 1.55), wheel_radius_m=0.335,
        seams_x_m=(-0.75, 0.35, 1.22), headlamps_x_m=(2.0, 2.38), tail_lamps_x_m=(-2.44, -2.34),
    ),
    cabin=Cabin(belt_m=(-2.46, 1.70, 0.92, 1.07), roof_m=(-2.34, 0.85, 0.80, 1.94),
                panes=((0.05, 0.36), (0.40, 0.67), (0.72, 0.95))),
    tyre_m=(0.335, 0.215), plate_m=0.48, handles_x_m=(0.48,),
)  # fmt: skip


def _load(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    """The box of a lorry, with lettering, guards against running under on their posts, and its frame."""
    side = Surface(albedo=float(rng.choice([0.30, 0.55, 0.75])), contrast=0.08, texel_m=0.02)
    lettering = Surface(albedo=float(rng.choice([0.08, 0.18])), contrast=0.5, texel_m=0.05)
    return [
        box([4.60, 2.40, 2.30], [-1.05, 0, 2.15], side),
        box([2.80, 2.41, 0.55], [-0.95, 0, 2.45], lettering),
        box([4.64, 2.42, 0.09], [-1.05, 0, 1.03], STEEL),
        box([6.0, 0.85, 0.22], [-0.3, 0, 0.85], UNDERSIDE),
        box([1.35, 2.30, 0.10], [0.05, 0, 0.55], STEEL),
        box([1.35, 2.30, 0.10], [0.05, 0, 0.80], STEEL),
        box([0.10, 2.30, 0.14], [-3.25, 0, 0.52], PLASTIC),
        box([0.50, 2.2, 0.45], [1.05, 0, 0.75], paint),
        *(box([1.05, 0.32, 0.06], [-1.9, s * 1.02, 0.97], PLASTIC) for s in (-1, 1)),
        *(box([0.07, 0.06, 0.36], [x, s * 1.10, 0.67], STEEL) for x in (-0.5, 0.6) for s in (-1, 1)),
        *(box([0.08, 0.08, 0.34], [-3.23, s * 0.36, 0.69], PLASTIC) for s in (-1, 1)),
        box([0.04, 2.04, 0.06], [-3.28, 0, 0.73], PLASTIC),
        *(box([0.06, 0.30, 0.14], [-3.3, s * 0.9, 0.72], TAIL_LAMP) for s in (-1, 1)),
    ]


LORRY = Vehicle(
    hull=Hull(
        top_xz_m=((1.35, 1.30), (1.42, 1.36), (2.95, 1.36), (3.12, 1.28), (3.20, 1.05)),
        plan_xy_m=((1.35, 1.08), (1.42, 1.10), (2.85, 1.10), (3.06, 1.04), (3.20, 0.88)), ground_m=0.36,
        axles_x_m=(-1.9, 2.1), wheel_radius_m=0.44, seams_x_m=(1.62, 2.66), headlamps_x_m=(2.85, 3.12),
        tail_lamps_x_m=(1.35, 1.36),
    ),
    cabin=Cabin(belt_m=(1.38, 3.06, 1.07, 1.33), roof_m=(1.40, 2.82, 0.98, 2.50),
                panes=((0.22, 0.92),), rear_window=False),
    tyre_m=(0.44, 0.25), plate_m=0.62, handles_x_m=(1.78,), extras=_load,
)  # fmt: skip
BUS = Vehicle(
    hull=Hull(
        top_xz_m=((-5.95, 1.10), (-5.90, 1.18), (5.86, 1.18), (5.95, 1.10)),
        plan_xy_m=((-5.95, 1.20), (-5.85, 1.27), (5.70, 1.27), (5.88, 1.22), (5.95, 1.10)), ground_m=0.30,
        axles_x_m=(-2.6, 3.2), wheel_radius_m=0.48, seams_x_m=(4.15, 5.35, -0.60, 0.60), headlamps_x_m=(5.70, 5.90),
        tail_lamps_x_m=(-5.90, -5.75),
    ),
    cabin=Cabin(belt_m=(-5.92, 5.92, 1.26, 1.14), roof_m=(-5.86, 5.76, 1.20, 2.98),
                panes=tuple((0.02 + 0.12 * k, 0.13 + 0.12 * k) for k in range(8)), seams=()),
    tyre_m=(0.48, 0.28), plate_m=0.62, handles_x_m=(),
)  # fmt: skip
