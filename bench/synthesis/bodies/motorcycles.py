"""Motorcycles and scooters, and who rides them: feet on rests or a board, and on the ground at speed 0.

Measures after common models of each class: a naked 650 (wheelbase 1.42 m, saddle 0.80 m) and a 125 scooter (1.30 m,
0.78 m).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.synthesis.bodies.body import (
    ALLOY,
    CLOTHS,
    GLASS,
    HEADLAMP,
    LEATHER,
    PLASTIC,
    PLATE,
    RUBBER,
    STEEL,
    TAIL_LAMP,
    UNDERSIDE,
    Built,
    JointedMesh,
    drawn_clothes,
    drawn_paint,
    for_riding,
    still,
    wheel,
)
from bench.synthesis.bodies.gait import ANKLE, SHANK, THIGH, two_links
from bench.synthesis.bodies.people import CHIN, SIDES, Leg, Stature, helmet, moved_to, person_parts, rider_joints
from bench.synthesis.mesh import Mesh, Surface, box, ring, rounded, slab, tube

FULL_FACE = (0.086, 0.068, 0.078)  # of the body height, with the chin
HIP_ABOVE_SADDLE = 0.045  # of the body height
SPOKE_TURNS = np.arange(3) * (np.pi / 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A motorcycle's measures, m; x = 0 near the rider's feet.

    Attributes:
        wheel_m: radius.
        tyre_m: half of its thickness.
        rear_x_m: rear axle.
        front_x_m: front axle.
        saddle_xz_m: where the rider sits.
        foot_xz_m: where the heels are.
        foot_rad: toes up.
        apart_m: by so much each thigh is further out than a pedestrian's.
        fork_xyz_m: upper end of the fork's left leg.
        grip_xz_m: where the hands are.
        bar_half_m: half width of the handlebar.
        lean_rad: of the rider's trunk, forward.
        stops_ahead_m: by so much the rider slides ahead at speed 0, where the machine is narrow enough for the legs.
        solids: the rest, by its paint.
    """

    wheel_m: float
    tyre_m: float
    rear_x_m: float
    front_x_m: float
    saddle_xz_m: tuple[float, float]
    foot_xz_m: tuple[float, float]
    foot_rad: float
    apart_m: float
    fork_xyz_m: tuple[float, float, float]
    grip_xz_m: tuple[float, float]
    bar_half_m: float
    lean_rad: float
    stops_ahead_m: float
    solids: Callable[[Surface, np.random.Generator], list[Mesh]]


def motorcyclist(stature: Stature, machine: Machine, rng: np.random.Generator) -> Built:
    """A rider with a full-face helmet on a motorcycle."""
    height_m, paint = stature.height_m, drawn_paint(rng)
    parts: list[JointedMesh] = [
        (mesh, None) for mesh in [*machine.solids(paint, rng), *_fork(machine), *_handlebar(machine)]
    ]
    for name, x in (("rear_wheel", machine.rear_x_m), ("front_wheel", machine.front_x_m)):
        parts += [(mesh, name) for mesh in _wheel(x, machine)]
    hip = (machine.saddle_xz_m[0], machine.saddle_xz_m[1] + HIP_ABOVE_SADDLE * height_m)
    parts += moved_to(hip[0], person_parts(stature, for_riding(drawn_clothes(rng))))
    shell = Surface(albedo=float(rng.choice(CLOTHS)), contrast=0.15, texel_m=0.02, mirror=0.04)
    parts += [(helmet(stature, hip[0], shell, size=FULL_FACE), "head"), (_visor(stature, hip[0]), "head")]
    cycle_m = 2 * np.pi * machine.wheel_m
    joints = [
        wheel("rear_wheel", machine.rear_x_m, machine.wheel_m),
        wheel("front_wheel", machine.front_x_m, machine.wheel_m),
        *rider_joints(height_m, hip, lean_rad=machine.lean_rad, grip_xz_m=machine.grip_xz_m,
                      legs=dict.fromkeys(SIDES, _leg(height_m, hip, machine)), cycle_m=cycle_m,
                      stands_m=(machine.stops_ahead_m, 0.0, 0.0), apart_m=machine.apart_m),
    ]  # fmt: skip
    return parts, joints, cycle_m


def _visor(stature: Stature, x_m: float) -> Mesh:
    """Bent, in the front of the helmet."""
    middle = x_m + 0.046 * stature.height_m, 0, (CHIN + 0.095) * stature.height_m
    return rounded(middle, np.array([0.048, 0.058, 0.028]) * stature.height_m, GLASS, sides=8, rows=5)


def _leg(height_m: float, hip: tuple[float, float], machine: Machine) -> Leg:
    """A leg to the foot rest, at speed 0 to the ground."""
    links = THIGH * height_m, SHANK * height_m
    ankle = machine.foot_xz_m[0], machine.foot_xz_m[1] + ANKLE * height_m
    (thigh,), (shank,) = two_links([np.subtract(ankle, hip)], *links, bends_forward=True)
    (stands,), (below,) = two_links([(0.10, ANKLE * height_m - hip[1])], *links, bends_forward=True)
    return Leg(
        thigh_rad=still(float(thigh)),
        shank_rad=still(float(shank)),
        foot_rad=still(machine.foot_rad),
        stands_rad=(float(stands), float(below), 0.0),
    )


def _wheel(x: float, machine: Machine) -> list[Mesh]:
    """A tyre on a cast wheel of six spokes, with a brake disc."""
    centre, inner = np.array([x, 0.0, machine.wheel_m]), machine.wheel_m - 2 * machine.tyre_m
    meshes = [
        ring(centre, machine.wheel_m, machine.tyre_m, RUBBER, sides=20),
        ring(centre, inner + 0.004, 0.014, PLASTIC, sides=16),
        tube([x, -0.075, machine.wheel_m], [x, 0.075, machine.wheel_m], 0.04, ALLOY, sides=8),
        tube([x, 0.050, machine.wheel_m], [x, 0.056, machine.wheel_m], 0.62 * inner, STEEL, sides=12),
    ]
    for turn in SPOKE_TURNS:
        reach = (inner - 0.01) * np.array([np.sin(turn), 0.0, np.cos(turn)])
        meshes.append(tube(centre - reach, centre + reach, 0.016, PLASTIC, sides=5))
    return meshes


def _handlebar(machine: Machine) -> list[Mesh]:
    """Handlebar, grips and mirrors."""
    (x, z), half = machine.grip_xz_m, machine.bar_half_m
    middle, meshes = np.array([x + 0.10, 0.0, z]), []
    for sign in (-1.0, 1.0):
        mirror = np.array([x + 0.10, sign * (half - 0.02), z + 0.20])
        meshes += [
            tube(middle, [x + 0.02, sign * (half - 0.12), z], 0.014, STEEL, sides=6),
            tube([x + 0.02, sign * (half - 0.13), z], [x - 0.02, sign * half, z], 0.020, RUBBER, sides=6),
            tube([x + 0.03, sign * (half - 0.14), z], mirror, 0.007, PLASTIC, sides=5),
            rounded(mirror, (0.025, 0.065, 0.045), PLASTIC, sides=6, rows=4),
            box([0.006, 0.10, 0.06], mirror - [0.024, 0, 0], GLASS),
        ]
    return meshes


def _tail(x: float, z: float, plate_z: float) -> list[Mesh]:
    """Tail lamp, and the number plate on its holder."""
    return [
        box([0.05, 0.16, 0.06], [x, 0, z], TAIL_LAMP),
        tube([x + 0.06, 0, z - 0.02], [x - 0.06, 0, plate_z + 0.08], 0.02, PLASTIC, sides=5),
        box([0.02, 0.20, 0.18], [x - 0.07, 0, plate_z], PLATE),
    ]


def _fork(machine: Machine) -> list[Mesh]:
    """Both legs of the fork, down to the front axle."""
    x, y, z = machine.fork_xyz_m
    ends = [([x, side * y, z], [machine.front_x_m, side * y, machine.wheel_m]) for side in (-1, 1)]
    return [tube(top, axle, 0.028, STEEL, sides=6) for top, axle in ends]


def _roadster(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    solids = [
        rounded((0.20, 0, 0.86), (0.29, 0.135, 0.14), paint, sides=10, rows=7),  # the tank
        box([0.44, 0.30, 0.36], [0.14, 0, 0.48], UNDERSIDE),
        box([0.20, 0.38, 0.16], [0.24, 0, 0.56], ALLOY),
        slab([(-0.62, 0.83), (-0.62, 0.76), (0.0, 0.70), (0.02, 0.76), (-0.25, 0.80)], 0.115, LEATHER),
        slab([(-0.74, 0.86), (-0.70, 0.76), (-0.20, 0.66), (-0.10, 0.72), (-0.40, 0.80)], 0.10, paint),
        *(tube([-0.62, s * 0.12, 0.31], [-0.02, s * 0.13, 0.44], 0.035, PLASTIC, sides=6) for s in (-1, 1)),
        tube([0.30, -0.10, 0.42], [-0.10, -0.17, 0.30], 0.030, STEEL, sides=7),
        tube([-0.10, -0.17, 0.30], [-0.68, -0.20, 0.42], 0.055, STEEL, sides=9),
        tube([0.0, -0.26, 0.33], [0.0, 0.26, 0.33], 0.016, RUBBER, sides=6),  # foot rests
        tube([0.53, 0, 0.66], [0.48, 0, 1.00], 0.05, PLASTIC, sides=7),
        box([0.10, 0.26, 0.05], [0.52, 0, 0.99], ALLOY),
        rounded((0.62, 0, 0.91), (0.07, 0.10, 0.10), PLASTIC, sides=9, rows=6),
        rounded((0.655, 0, 0.91), (0.05, 0.085, 0.085), HEADLAMP, sides=9, rows=6),
        slab([(0.62, 0.60), (0.84, 0.65), (1.02, 0.58), (0.84, 0.63)], 0.07, paint),  # above the front wheel
        *_tail(-0.74, 0.82, 0.62),
    ]
    if rng.random() < 0.5:  # a case behind the saddle
        solids.append(rounded((-0.60, 0, 1.02), (0.20, 0.22, 0.18), PLASTIC, sides=10, rows=6))
    return solids


def _scooter(paint: Surface, rng: np.random.Generator) -> list[Mesh]:
    solids = [
        slab([(-0.72, 0.66), (-0.60, 0.42), (-0.10, 0.34), (-0.02, 0.60), (-0.06, 0.70), (-0.66, 0.74)], 0.16, paint),
        slab([(-0.70, 0.79), (-0.68, 0.73), (-0.04, 0.69), (0.0, 0.75), (-0.20, 0.78)], 0.14, LEATHER),
        slab([(-0.14, 0.20), (0.46, 0.20), (0.52, 0.26), (-0.14, 0.26)], 0.17, PLASTIC),  # the board
        slab([(0.44, 0.22), (0.54, 0.22), (0.60, 0.60), (0.50, 0.96), (0.44, 0.96)], (0.17, 0.17, 0.22, 0.13, 0.13),
             paint),  # the shield before the legs
        tube([0.50, 0, 0.90], [0.46, 0, 1.02], 0.06, PLASTIC, sides=8),
        rounded((0.50, 0, 1.02), (0.11, 0.16, 0.07), paint, sides=10, rows=6),
        rounded((0.565, 0, 1.02), (0.06, 0.08, 0.05), HEADLAMP, sides=9, rows=6),
        slab([(0.58, 0.46), (0.80, 0.55), (0.98, 0.40), (0.96, 0.37), (0.80, 0.50), (0.60, 0.42)], 0.075, paint),
        box([0.42, 0.14, 0.20], [-0.42, 0.12, 0.30], UNDERSIDE),
        tube([-0.20, -0.14, 0.28], [-0.66, -0.17, 0.34], 0.05, STEEL, sides=8),
        *_tail(-0.73, 0.70, 0.52),
    ]  # fmt: skip
    if rng.random() < 0.4:  # the box of who delivers
        cloth = Surface(albedo=float(rng.choice(CLOTHS)), contrast=0.3, texel_m=0.03)
        solids += [box([0.42, 0.44, 0.42], [-0.66, 0, 1.04], cloth), box([0.36, 0.20, 0.05], [-0.62, 0, 0.81], STEEL)]
    return solids


ROADSTER = Machine(
    wheel_m=0.305, tyre_m=0.055, rear_x_m=-0.62, front_x_m=0.80, saddle_xz_m=(-0.18, 0.79), foot_xz_m=(-0.04, 0.35),
    foot_rad=np.radians(-8.0), apart_m=0.075, fork_xyz_m=(0.51, 0.10, 1.00), grip_xz_m=(0.40, 1.06),
    bar_half_m=0.37, lean_rad=np.radians(22.0), stops_ahead_m=0.0, solids=_roadster,
)  # fmt: skip
SCOOTER = Machine(
    wheel_m=0.24, tyre_m=0.05, rear_x_m=-0.50, front_x_m=0.80, saddle_xz_m=(-0.28, 0.77), foot_xz_m=(0.20, 0.26),
    foot_rad=0.0, apart_m=0.03, fork_xyz_m=(0.62, 0.075, 0.55), grip_xz_m=(0.38, 1.04), bar_half_m=0.34,
    lean_rad=np.radians(6.0), stops_ahead_m=0.24, solids=_scooter,
)  # fmt: skip
