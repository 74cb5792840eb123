"""Bicycles, motorcycles and scooters, and who rides them.

Cyclists' feet follow the pedals, and at speed 0 they stand over the frame. Saddle height: the knee stays bent by about
30 degrees where the pedal is lowest, as bicycle fitters set it (Holmes et al. 1994: 25 to 35 degrees). Distance per
turn of the cranks: 70 turns a minute at 18 km/h is 4.3 m; racers ride larger gears.

Motorcyclists' feet are on rests or a board, and on the ground at speed 0. Measures after common models of each class: a
naked 650 (wheelbase 1.42 m, saddle 0.80 m) and a 125 scooter (1.30 m, 0.78 m).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform, cross
from bench.synthesis.bodies.body import (
    ALLOY,
    CLOTHS,
    GLASS,
    HEADLAMP,
    LEATHER,
    PLASTIC,
    PLATE,
    REFLECTOR,
    RUBBER,
    STEEL,
    STEPS,
    TAIL_LAMP,
    UNDERSIDE,
    Built,
    Joint,
    JointedMesh,
    drawn_clothes,
    drawn_paint,
    for_riding,
    still,
    wheel,
)
from bench.synthesis.bodies.gait import ANKLE, BALL, SHANK, THIGH, rotate_xz, two_links
from bench.synthesis.bodies.people import CHIN, HIP, SIDES, Leg, Stature, helmet, moved_to, person_parts, rider_joints
from bench.synthesis.mesh import Mesh, Surface, box, prism, ring, rounded, slab, tube

SPOKES = 10  # three times as thick as real ones, a third of their number: the same share of what lies behind is hidden
SPOKE_M, FRAME_M = 0.006, 0.018  # width; radius
CRANK_Y_M, PEDAL_Y_M = 0.055, 0.115
LEVEL_RAD = np.pi / 2  # cranks of who stands astride: one pedal before the shins, one behind the calves


@dataclass(frozen=True, slots=True, kw_only=True)
class Bicycle:
    """A bicycle's measures, m; the bottom bracket is at x = 0.

    Attributes:
        wheel_m: radius.
        tyre_m: half of its thickness.
        rear_x_m: rear axle.
        front_x_m: front axle.
        bracket_z_m: height of the bottom bracket.
        crank_m: length of a crank.
        grip_xz_m: where the hands are.
        bar_half_m: half width of the handlebar.
        step_through: a frame without a top tube.
        development_m: distance of one turn of the cranks.
        lean_rad: of its rider's trunk, forward.
        basket: a basket in front.
        bags: bags at the rear wheel.
    """

    wheel_m: float
    tyre_m: float
    rear_x_m: float
    front_x_m: float
    bracket_z_m: float
    crank_m: float
    grip_xz_m: tuple[float, float]
    bar_half_m: float
    step_through: bool
    development_m: float
    lean_rad: float
    basket: bool = False
    bags: bool = False

    def scaled(self, factor: float) -> Bicycle:
        """Return the bicycle for a smaller rider; a child rides a shorter distance per turn."""
        names = ("wheel_m", "rear_x_m", "front_x_m", "bracket_z_m", "crank_m", "bar_half_m", "development_m")
        grip = (self.grip_xz_m[0] * factor, self.grip_xz_m[1] * factor)
        return replace(self, grip_xz_m=grip, **{name: factor * getattr(self, name) for name in names})


def bicycle_joints(bicycle: Bicycle) -> list[Joint]:
    """Wheels, cranks and pedals."""
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    centre, cycle_m = (0.0, 0.0, bicycle.bracket_z_m), bicycle.development_m
    joints = [
        wheel("rear_wheel", bicycle.rear_x_m, bicycle.wheel_m),
        wheel("front_wheel", bicycle.front_x_m, bicycle.wheel_m),
        Joint(name="cranks", pivot_m=centre, cycle_m=cycle_m, angles_rad=turn, stationary_rad=LEVEL_RAD),
    ]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        axle = (0.0, sign * PEDAL_Y_M, bicycle.bracket_z_m + sign * bicycle.crank_m)
        joints.append(
            Joint(name=f"{side}_pedal", parent="cranks", pivot_m=axle, cycle_m=cycle_m, angles_rad=-turn,
                  stationary_rad=-LEVEL_RAD)
        )  # fmt: skip
    return joints


def bicycle_parts(bicycle: Bicycle, paint: Surface, *, saddle_xz_m: tuple[float, float]) -> list[JointedMesh]:
    """All solids; the left crank points up, as at distance 0.

    Args:
        bicycle: its measures.
        paint: of the frame.
        saddle_xz_m: top of the saddle.
    """
    parts: list[JointedMesh] = [(mesh, None) for mesh in _frame(bicycle, paint, saddle_xz_m)]
    for name, x in (("rear_wheel", bicycle.rear_x_m), ("front_wheel", bicycle.front_x_m)):
        parts += [(mesh, name) for mesh in _spoked_wheel(x, bicycle)]
    z = bicycle.bracket_z_m
    parts.append((tube([0, -0.055, z], [0, -0.048, z], 0.095, ALLOY, sides=12), "cranks"))
    parts.append((tube([0, -0.06, z], [0, 0.06, z], 0.018, ALLOY, sides=6), "cranks"))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        end = z + sign * bicycle.crank_m
        crank = box([0.025, 0.014, bicycle.crank_m + 0.03], [0, sign * CRANK_Y_M * 1.2, (z + end) / 2], ALLOY)
        parts += [(crank, "cranks"), (box([0.095, 0.10, 0.022], [0, sign * PEDAL_Y_M, end], PLASTIC), f"{side}_pedal")]
    return parts


def _spoked_wheel(x: float, bicycle: Bicycle) -> list[Mesh]:
    centre, radius = np.array([x, 0.0, bicycle.wheel_m]), bicycle.wheel_m
    inner = radius - 2 * bicycle.tyre_m
    rim = ring(centre, inner + 0.002, 0.010, ALLOY, sides=20)
    meshes = [ring(centre, radius, bicycle.tyre_m, RUBBER, sides=24), rim]
    hub = np.array([0.0, 0.05, 0.0])
    meshes.append(tube(centre - hub, centre + hub, 0.022, ALLOY, sides=6))
    meshes.append(_spokes(inner - 0.01).moved(RigidTransform(np.eye(3), centre)))
    between = np.array([0.0, 0.0, 0.62 * inner])
    reflectors = [box([0.07, 0.012, 0.03], centre + sign * between, REFLECTOR) for sign in (-1, 1)]
    return [*meshes, *reflectors]


def _spokes(length_m: float) -> Mesh:
    """Thin bars of three sides through the hub, each two spokes."""
    turns = np.arange(SPOKES // 2) * (2 * np.pi / SPOKES)
    along, aside = (
        np.stack([np.sin(turns + more), np.zeros_like(turns), np.cos(turns + more)], axis=1)[:, None]
        for more in (0.0, np.pi / 2)
    )
    angles = np.arange(3)[:, None] * (2 * np.pi / 3)
    rim = SPOKE_M / 2 * (np.cos(angles) * aside + np.sin(angles) * cross(along, aside))
    return prism(rim - length_m * along, rim + length_m * along, ALLOY)


def _frame(bicycle: Bicycle, paint: Surface, saddle_xz_m: tuple[float, float]) -> list[Mesh]:
    bracket, rear = (0.0, bicycle.bracket_z_m), (bicycle.rear_x_m, bicycle.wheel_m)
    front, saddle = (bicycle.front_x_m, bicycle.wheel_m), saddle_xz_m
    head_x = bicycle.front_x_m - 0.16  # the fork leans back by some 20 degrees
    top, low = (head_x - 0.03, bicycle.wheel_m + 0.50), (head_x + 0.02, bicycle.wheel_m + 0.36)
    seat = (saddle[0] * 0.78, bicycle.bracket_z_m + 0.78 * (saddle[1] - bicycle.bracket_z_m))
    rail = (saddle[0] * 0.35, bicycle.bracket_z_m + 0.35 * (saddle[1] - bicycle.bracket_z_m))
    bars = [
        (bracket, saddle, FRAME_M),
        (bracket, low, 1.15 * FRAME_M),
        (rail if bicycle.step_through else seat, top, FRAME_M),
    ]
    meshes = [tube([a[0], 0, a[1]], [b[0], 0, b[1]], r, paint, sides=6) for a, b, r in bars]
    for y in (-0.055, 0.055):  # stays and fork blades on both sides of the wheels
        for a, b in ((rear, bracket), (rear, seat), (front, low)):
            meshes.append(tube([a[0], y, a[1]], [b[0], 0.3 * y, b[1]], 0.011, paint, sides=5))
    grip_x, grip_z = bicycle.grip_xz_m
    half = bicycle.bar_half_m
    post_x = saddle[0] * (1 - 0.12 / (saddle[1] - bicycle.bracket_z_m))  # of the seat tube, where the tail lamp is
    meshes += [
        tube([low[0], 0, low[1]], [top[0] - 0.015, 0, grip_z], FRAME_M, paint, sides=6),
        *(tube([top[0] - 0.015, s * 0.04, grip_z], [grip_x, s * half, grip_z], 0.013, ALLOY, sides=5) for s in (-1, 1)),
        *(tube([grip_x - 0.01, s * (half - 0.1), grip_z], [grip_x - 0.04, s * half, grip_z], 0.018, RUBBER, sides=5)
          for s in (-1, 1)),
        box([0.26, 0.05, 0.05], [saddle[0] + 0.04, 0, saddle[1] - 0.03], LEATHER),
        box([0.13, 0.15, 0.05], [saddle[0] - 0.05, 0, saddle[1] - 0.025], LEATHER),
        box([0.06, 0.06, 0.06], [top[0] + 0.03, 0, grip_z - 0.10], HEADLAMP),
        box([0.03, 0.06, 0.04], [post_x - FRAME_M - 0.01, 0, saddle[1] - 0.12], TAIL_LAMP),
    ]  # fmt: skip
    if bicycle.basket:
        meshes.append(box([0.26, 0.36, 0.22], [top[0] + 0.16, 0, grip_z - 0.15], PLASTIC))
    if bicycle.bags:
        meshes += [box([0.32, 0.12, 0.30], [rear[0] - 0.05, s * 0.13, rear[1] + 0.17], LEATHER) for s in (-1, 1)]
        meshes.append(box([0.40, 0.14, 0.02], [rear[0] + 0.0, 0, rear[1] + bicycle.wheel_m + 0.04], PLASTIC))
    return meshes


STRETCHED = 0.963  # of the leg's length, hip to ankle, at the lowest pedal: a knee bent by 31 degrees
SEAT_TUBE = np.tan(np.radians(17.0))  # the hip lies behind the bracket
FOOT_RAD, ANKLING_RAD = np.radians(-12.0), np.radians(8.0)  # toes down, and how the foot tips over a turn
PEDAL_TOP_M = 0.012
SADDLE_BELOW_HIP = 0.052  # of the body height
HELMET = Surface(albedo=0.6, contrast=0.25, texel_m=0.02)

UPRIGHT = Bicycle(
    wheel_m=0.345, tyre_m=0.019, rear_x_m=-0.46, front_x_m=0.66, bracket_z_m=0.285, crank_m=0.17,
    grip_xz_m=(0.26, 1.08), bar_half_m=0.27, step_through=True, development_m=4.4, lean_rad=np.radians(14.0),
)  # fmt: skip
RACING = Bicycle(
    wheel_m=0.335, tyre_m=0.013, rear_x_m=-0.41, front_x_m=0.58, bracket_z_m=0.27, crank_m=0.172,
    grip_xz_m=(0.50, 0.94), bar_half_m=0.215, step_through=False, development_m=6.0, lean_rad=np.radians(44.0),
)  # fmt: skip


def cyclist(stature: Stature, model: Bicycle, rng: np.random.Generator) -> Built:
    """A rider on a bicycle of the right size; the model is for somebody of 1.75 m."""
    upright, fitted = model.step_through, model.scaled(stature.height_m / 1.75)
    bicycle = replace(
        fitted,
        step_through=upright and bool(rng.random() < 0.6),
        basket=bool(rng.random() < 0.3) and upright,
        bags=bool(rng.random() < 0.3) and upright,
    )
    hip_x, hip_z = _hip(stature.height_m, bicycle)
    clothes = for_riding(drawn_clothes(rng))
    parts = bicycle_parts(bicycle, drawn_paint(rng), saddle_xz_m=(hip_x, hip_z - SADDLE_BELOW_HIP * stature.height_m))
    parts += moved_to(hip_x, person_parts(stature, clothes))
    if rng.random() < (0.5 if upright else 1.0):
        parts.append((helmet(stature, hip_x, HELMET), "head"))
    joints = [*bicycle_joints(bicycle), *_rider_joints(stature.height_m, bicycle, (hip_x, hip_z))]
    return parts, joints, bicycle.development_m


def _hip(height_m: float, bicycle: Bicycle) -> tuple[float, float]:
    """Position of the hip on a saddle of the right height, x and z."""
    lowest = _ankle(height_m, bicycle, np.array([np.pi]))[0]
    reach = STRETCHED * (THIGH + SHANK) * height_m
    heights = np.linspace(lowest[1], lowest[1] + reach, 2000)
    x = -SEAT_TUBE * (heights - bicycle.bracket_z_m)
    best = int(np.argmin(np.abs(np.hypot(x - lowest[0], heights - lowest[1]) - reach)))
    return float(x[best]), float(heights[best])


def _ankle(height_m: float, bicycle: Bicycle, crank_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ankle above a pedal, (N, 2) x and z; a crank of angle 0 points up and turns forward."""
    pedal = bicycle.crank_m * np.stack([np.sin(crank_rad), np.cos(crank_rad)], axis=1)
    over = rotate_xz((-BALL * height_m, ANKLE * height_m), _foot(crank_rad))
    return np.asarray(pedal + over + [0.0, bicycle.bracket_z_m + PEDAL_TOP_M])


def _foot(crank_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(FOOT_RAD - ANKLING_RAD * np.cos(crank_rad))


def _rider_joints(height_m: float, bicycle: Bicycle, hip: tuple[float, float]) -> list[Joint]:
    """Of who pedals, and at speed 0 stands over the frame in front of the saddle."""
    hip_x, hip_z = hip
    legs = {}
    for side in SIDES:
        crank = np.linspace(0, 2 * np.pi, STEPS + 1) + (0.0 if side == "left" else np.pi)
        reach = _ankle(height_m, bicycle, crank) - np.array(hip)
        thigh, shank = two_links(reach, THIGH * height_m, SHANK * height_m, bends_forward=True)
        legs[side] = Leg(thigh_rad=thigh, shank_rad=shank, foot_rad=_foot(crank))
    ahead = (min(0.16 * height_m, -hip_x + 0.08), 0.0, HIP * height_m - hip_z)
    return rider_joints(
        height_m, hip, lean_rad=bicycle.lean_rad, grip_xz_m=bicycle.grip_xz_m, legs=legs, cycle_m=bicycle.development_m,
        stands_m=ahead, stands_lean_rad=0.5 * bicycle.lean_rad,
    )  # fmt: skip


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
        parts += [(mesh, name) for mesh in _cast_wheel(x, machine)]
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


def _cast_wheel(x: float, machine: Machine) -> list[Mesh]:
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
