"""Cyclists: riders whose feet follow the pedals, and who stand over the frame when they do not go.

Saddle height: the knee stays bent by about 30 degrees where the pedal is lowest, as bicycle fitters set it (Holmes et
al. 1994: 25 to 35 degrees). Way per turn of the cranks: 70 turns a minute at 18 km/h is 4.3 m; racers ride larger
gears.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.bicycle import Bicycle, bicycle_joints, bicycle_parts
from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.joints import STEPS, Joint, still
from bench.synthesis.bodies.loft import rounded
from bench.synthesis.bodies.looks import dressed, for_riding, painted
from bench.synthesis.bodies.person import (
    CHIN,
    ELBOW,
    FOREARM,
    HAND,
    HIP,
    HIP_Y,
    KNEE,
    NECK,
    SHOULDER,
    SHOULDER_Y,
    SIDES,
    UPPER_ARM,
    WAIST,
    Figure,
    person_parts,
)  # fmt: skip
from bench.synthesis.bodies.walking import ANKLE, BALL, SHANK, THIGH, turned_xz, two_links
from bench.synthesis.mesh import Mesh, Surface

STRETCHED = 0.963  # of the leg's length, hip to ankle, at the lowest pedal: a knee bent by 31 degrees
SEAT_TUBE = np.tan(np.radians(17.0))  # the hip lies behind the bracket
FOOT_RAD, ANKLING_RAD = np.radians(-12.0), np.radians(8.0)  # toes down, and how the foot tips over a turn
PEDAL_TOP_M = 0.012
SADDLE_BELOW_HIP = 0.052  # of the body height
HELMET = Surface(albedo=0.6, contrast=0.25, texel_m=0.02)

CITY_BICYCLE = Bicycle(
    wheel_m=0.345, tyre_m=0.019, rear_x_m=-0.46, front_x_m=0.66, bracket_z_m=0.285, crank_m=0.17,
    grip_xz_m=(0.26, 1.08), bar_half_m=0.27, step_through=True, development_m=4.4,
)  # fmt: skip
RACING_BICYCLE = Bicycle(
    wheel_m=0.335, tyre_m=0.013, rear_x_m=-0.41, front_x_m=0.58, bracket_z_m=0.27, crank_m=0.172,
    grip_xz_m=(0.50, 0.94), bar_half_m=0.215, step_through=False, development_m=6.0,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Riding:
    """How somebody sits.

    Attributes:
        lean_rad: of the trunk, forward.
        bicycle: what is ridden, for somebody of 1.75 m.
    """

    lean_rad: float
    bicycle: Bicycle


UPRIGHT = Riding(lean_rad=np.radians(14.0), bicycle=CITY_BICYCLE)
RACING = Riding(lean_rad=np.radians(44.0), bicycle=RACING_BICYCLE)


def cyclist(figure: Figure, riding: Riding, rng: np.random.Generator) -> tuple[list[Part], list[Joint], float]:
    """A rider on a bicycle of the right size."""
    upright = riding.bicycle.step_through
    fitted = riding.bicycle.scaled(figure.height_m / 1.75)
    bicycle = replace(
        fitted,
        step_through=upright and bool(rng.random() < 0.6),
        basket=bool(rng.random() < 0.3) and upright,
        bags=bool(rng.random() < 0.3) and upright,
    )
    hip_x, hip_z = _hip(figure.height_m, bicycle)
    clothes = for_riding(dressed(rng))
    parts = bicycle_parts(bicycle, painted(rng), saddle_xz_m=(hip_x, hip_z - SADDLE_BELOW_HIP * figure.height_m))
    parts += [(_shifted(mesh, hip_x), joint) for mesh, joint in person_parts(figure, clothes)]
    if rng.random() < (0.5 if upright else 1.0):
        size = np.array([0.070, 0.056, 0.050]) * figure.head * figure.height_m
        crown = rounded((hip_x + 0.002, 0, (CHIN + 0.092) * figure.height_m), size, HELMET)
        parts.append((crown, "head"))
    joints = [*bicycle_joints(bicycle), *_rider_joints(figure.height_m, riding.lean_rad, bicycle, (hip_x, hip_z))]
    return parts, joints, bicycle.development_m


def _shifted(mesh: Mesh, x_m: float) -> Mesh:
    return mesh.moved(RigidTransform(np.eye(3), np.array([x_m, 0.0, 0.0])))


def _hip(height_m: float, bicycle: Bicycle) -> tuple[float, float]:
    """Where the hip is on a saddle of the right height, x and z."""
    lowest = _ankle(height_m, bicycle, np.array([np.pi]))[0]
    reach = STRETCHED * (THIGH + SHANK) * height_m
    heights = np.linspace(lowest[1], lowest[1] + reach, 2000)
    x = -SEAT_TUBE * (heights - bicycle.bracket_z_m)
    best = int(np.argmin(np.abs(np.hypot(x - lowest[0], heights - lowest[1]) - reach)))
    return float(x[best]), float(heights[best])


def _ankle(height_m: float, bicycle: Bicycle, crank_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ankle above a pedal, (N, 2) x and z; a crank of angle 0 points up and turns forward."""
    pedal = bicycle.crank_m * np.stack([np.sin(crank_rad), np.cos(crank_rad)], axis=1)
    over = turned_xz((-BALL * height_m, ANKLE * height_m), _foot(crank_rad))
    return np.asarray(pedal + over + [0.0, bicycle.bracket_z_m + PEDAL_TOP_M])


def _foot(crank_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(FOOT_RAD - ANKLING_RAD * np.cos(crank_rad))


def _rider_joints(height_m: float, lean_rad: float, bicycle: Bicycle, hip: tuple[float, float]) -> list[Joint]:
    h, (hip_x, hip_z) = height_m, hip
    ride = (0.0, 0.0, hip_z - HIP * h)  # from the build posture, whose feet stand on the ground
    # Astride in front of the saddle.
    stand = (min(0.16 * h, -hip_x + 0.08), 0.0, 0.0)
    lean = {"ride": lean_rad, "stand": 0.5 * lean_rad}

    def joint(
        name: str, parent: str | None, x: float, y: float, z: float, angles_rad: NDArray[np.float64],
        standing_rad: float,
    ) -> Joint:  # fmt: skip
        return Joint(
            name=name, parent=parent, pivot_m=(hip_x + x * h, y * h, z * h), cycle_m=bicycle.development_m,
            angles_rad=angles_rad, standing_rad=standing_rad,
        )  # fmt: skip

    root = replace(
        joint("root", None, 0, 0, 0, still(), 0.0), shifts_m=np.tile(ride, (STEPS + 1, 1)), standing_shift_m=stand
    )
    joints = [
        root,
        joint("hips", "root", 0, 0, HIP, still(0.6 * lean_rad), 0.3 * lean_rad),
        joint("chest", "hips", 0, 0, WAIST, still(0.4 * lean_rad), 0.2 * lean_rad),
        joint("head", "chest", 0, 0, NECK, still(-0.8 * lean_rad), -0.4 * lean_rad),
    ]
    arms = {
        posture: _arm(h, lean[posture], (hip_x + shift[0], HIP * h + shift[2]), bicycle)
        for posture, shift in (("ride", ride), ("stand", stand))
    }
    for side, sign in SIDES.items():
        crank = np.linspace(0, 2 * np.pi, STEPS + 1) + (0.0 if side == "left" else np.pi)
        thigh, shank = two_links(_ankle(h, bicycle, crank) - np.array(hip), THIGH * h, SHANK * h, bends_forward=True)
        y, shoulder_y = sign * HIP_Y, sign * SHOULDER_Y
        joints += [
            joint(f"{side}_thigh", "root", 0, y, HIP, -thigh, 0.0),
            joint(f"{side}_shank", f"{side}_thigh", 0, y, KNEE, thigh - shank, 0.0),
            joint(f"{side}_foot", f"{side}_shank", 0, y, ANKLE, shank - _foot(crank), 0.0),
            joint(f"{side}_toes", f"{side}_foot", BALL, y, 0, still(), 0.0),
            joint(f"{side}_upper_arm", "chest", 0, shoulder_y, SHOULDER, still(arms["ride"][0]), arms["stand"][0]),
            joint(
                f"{side}_forearm", f"{side}_upper_arm", 0, shoulder_y, ELBOW, still(arms["ride"][1]), arms["stand"][1]
            ),
        ]
    return joints


def _arm(height_m: float, lean_rad: float, hip: tuple[float, float], bicycle: Bicycle) -> tuple[float, float]:
    """Angles of shoulder and elbow of hands on the grips, about the y axis, from a trunk that leans."""
    waist = np.array(hip) + (WAIST - HIP) * height_m * np.array([np.sin(0.6 * lean_rad), np.cos(0.6 * lean_rad)])
    shoulder = waist + (SHOULDER - WAIST) * height_m * np.array([np.sin(lean_rad), np.cos(lean_rad)])
    reach = np.array(bicycle.grip_xz_m) - shoulder
    upper, lower = two_links(reach, UPPER_ARM * height_m, (FOREARM + HAND / 2) * height_m, bends_forward=False)
    return float(-upper[0] - lean_rad), float(upper[0] - lower[0])
