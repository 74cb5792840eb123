"""Bicycles: frame, wheels with spokes, cranks and pedals that stay level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.geometry import RigidTransform, cross
from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.joints import STEPS, Joint, wheel
from bench.synthesis.bodies.loft import ring
from bench.synthesis.bodies.looks import ALLOY, HEADLAMP, LEATHER, PLASTIC, REFLECTOR, RUBBER, TAIL_LAMP
from bench.synthesis.mesh import Mesh, Surface, box, prism, tube

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
        development_m: way of one turn of the cranks.
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
    basket: bool = False
    bags: bool = False

    def scaled(self, factor: float) -> Bicycle:
        """The same for a smaller rider; a child pedals through a shorter way."""
        names = ("wheel_m", "rear_x_m", "front_x_m", "bracket_z_m", "crank_m", "bar_half_m", "development_m")
        grip = (self.grip_xz_m[0] * factor, self.grip_xz_m[1] * factor)
        return replace(self, grip_xz_m=grip, **{name: factor * getattr(self, name) for name in names})


def bicycle_joints(bicycle: Bicycle) -> list[Joint]:
    """Wheels, cranks and pedals."""
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    centre, way_m = (0.0, 0.0, bicycle.bracket_z_m), bicycle.development_m
    joints = [
        wheel("rear_wheel", bicycle.rear_x_m, bicycle.wheel_m),
        wheel("front_wheel", bicycle.front_x_m, bicycle.wheel_m),
        Joint(name="cranks", pivot_m=centre, cycle_m=way_m, angles_rad=turn, standing_rad=LEVEL_RAD),
    ]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        axle = (0.0, sign * PEDAL_Y_M, bicycle.bracket_z_m + sign * bicycle.crank_m)
        joints.append(
            Joint(name=f"{side}_pedal", parent="cranks", pivot_m=axle, cycle_m=way_m, angles_rad=-turn,
                  standing_rad=-LEVEL_RAD)
        )  # fmt: skip
    return joints


def bicycle_parts(bicycle: Bicycle, paint: Surface, *, saddle_xz_m: tuple[float, float]) -> list[Part]:
    """All solids; the left crank points up, as at way 0.

    Args:
        bicycle: its measures.
        paint: of the frame.
        saddle_xz_m: top of the saddle.
    """
    parts: list[Part] = [(mesh, None) for mesh in _frame(bicycle, paint, saddle_xz_m)]
    for name, x in (("rear_wheel", bicycle.rear_x_m), ("front_wheel", bicycle.front_x_m)):
        parts += [(mesh, name) for mesh in _wheel(x, bicycle)]
    z = bicycle.bracket_z_m
    parts.append((tube([0, -0.055, z], [0, -0.048, z], 0.095, ALLOY, sides=12), "cranks"))
    parts.append((tube([0, -0.06, z], [0, 0.06, z], 0.018, ALLOY, sides=6), "cranks"))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        end = z + sign * bicycle.crank_m
        crank = box([0.025, 0.014, bicycle.crank_m + 0.03], [0, sign * CRANK_Y_M * 1.2, (z + end) / 2], ALLOY)
        parts += [(crank, "cranks"), (box([0.095, 0.10, 0.022], [0, sign * PEDAL_Y_M, end], PLASTIC), f"{side}_pedal")]
    return parts


def _wheel(x: float, bicycle: Bicycle) -> list[Mesh]:
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
