"""Somebody who walks with a pram: the feet as of every walker, the hands on the bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.synthesis.bodies.body import Built, Part, still, wheel
from bench.synthesis.bodies.gait import STRIDE
from bench.synthesis.bodies.looks import ALLOY, PLASTIC, RUBBER, STEEL, cloth, drawn_clothes
from bench.synthesis.bodies.people import HIP, SIDES, Stature, person_parts, walking_joints
from bench.synthesis.bodies.riders import arm_angles
from bench.synthesis.mesh import Mesh, box, ring, rounded, slab, tube

BAR_XZ_M, BAR_HALF_M = (0.42, 1.02), 0.25
AXLES = {"pram_rear": (0.76, 0.15), "pram_front": (1.32, 0.11)}  # x and radius of the wheels
TRACK_M = 0.27  # half of it


def with_pram(stature: Stature, rng: np.random.Generator) -> Built:
    """A person who pushes a pram along x."""
    parts = person_parts(stature, drawn_clothes(rng)) + _pram(rng)
    shoulder, elbow = arm_angles(stature.height_m, 0.0, (0.0, HIP * stature.height_m), BAR_XZ_M)
    held = {f"{side}_{part}": angle for side in SIDES for part, angle in (("upper_arm", shoulder), ("forearm", elbow))}
    joints = [
        replace(joint, angles_rad=still(held[joint.name]), stationary_rad=held[joint.name])
        if joint.name in held
        else joint
        for joint in walking_joints(stature.height_m, rng)
    ]
    joints += [wheel(name, x, radius) for name, (x, radius) in AXLES.items()]
    return parts, joints, STRIDE * stature.height_m


def _pram(rng: np.random.Generator) -> list[Part]:
    """Frame, carrycot or seat under a hood, a basket below, four wheels."""
    fabric, lining = cloth(rng), cloth(rng)
    (x, z), half = BAR_XZ_M, BAR_HALF_M
    solids: list[Mesh] = [
        tube([x, -half, z], [x, half, z], 0.016, RUBBER, sides=7),
        slab([(0.72, 0.78), (0.76, 0.58), (1.30, 0.54), (1.42, 0.66), (1.44, 0.78)], 0.20, fabric),
        slab([(0.74, 0.77), (1.42, 0.77), (1.42, 0.795), (0.74, 0.795)], 0.18, lining),
        rounded((0.94, 0, 0.80), (0.22, 0.205, 0.26), fabric, sides=10, rows=7),  # the hood
        box([0.46, 0.34, 0.14], [1.03, 0, 0.27], PLASTIC),
    ]
    for side in (-1.0, 1.0):
        solids += [
            tube([x, side * half, z], [AXLES["pram_front"][0], side * 0.22, 0.14], 0.014, STEEL, sides=6),
            tube([AXLES["pram_rear"][0], side * 0.24, 0.16], [1.16, side * 0.21, 0.62], 0.014, STEEL, sides=6),
        ]
    parts: list[Part] = [(mesh, None) for mesh in solids]
    for name, (axle_x, radius) in AXLES.items():
        for side in (-1.0, 1.0):
            hub = np.array([axle_x, side * TRACK_M, radius])
            out, reach = np.array([0.0, 0.02, 0.0]), np.array([0.0, 0.0, radius - 0.02])
            parts += [
                (ring(hub, radius, 0.016, RUBBER, sides=14), name),
                (tube(hub - out, hub + out, 0.03, ALLOY, sides=6), name),
                (tube(hub - reach, hub + reach, 0.010, PLASTIC, sides=4), name),
                (tube(hub - reach[[2, 1, 0]], hub + reach[[2, 1, 0]], 0.010, PLASTIC, sides=4), name),
            ]
        parts.append((tube([axle_x, -TRACK_M, radius], [axle_x, TRACK_M, radius], 0.010, STEEL, sides=5), name))
    return parts
