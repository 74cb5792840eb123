"""Riders: somebody on a saddle with the hands on grips, whatever is below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.body import STEPS, Joint, Part, still
from bench.synthesis.bodies.gait import ANKLE, BALL, two_links
from bench.synthesis.bodies.people import (
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
    Stature,
)
from bench.synthesis.mesh import Mesh, Surface, rounded


def moved_to(x_m: float, parts: Sequence[Part]) -> list[Part]:
    """The parts moved along x."""
    move = RigidTransform(np.eye(3), np.array([x_m, 0.0, 0.0]))
    return [(mesh.moved(move), joint) for mesh, joint in parts]


def helmet(
    stature: Stature, x_m: float, surface: Surface, *, size: tuple[float, float, float] = (0.070, 0.056, 0.050)
) -> Mesh:
    """A helmet for the head of somebody whose parts were moved to `x_m`; `size` in shares of the body height."""
    middle = (x_m + 0.002, 0, (CHIN + 0.092) * stature.height_m)
    return rounded(middle, np.array(size) * stature.head * stature.height_m, surface)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leg:
    """Angles of a rider's leg over a cycle, (STEPS + 1,) each, from straight down, forward positive; and at speed 0."""

    thigh_rad: NDArray[np.float64]
    shank_rad: NDArray[np.float64]
    foot_rad: NDArray[np.float64]
    stands_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)


def rider_joints(
    height_m: float,
    hip_xz_m: tuple[float, float],
    *,
    lean_rad: float,
    grip_xz_m: tuple[float, float],
    legs: Mapping[str, Leg],
    cycle_m: float,
    stands_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    stands_lean_rad: float | None = None,
    apart_m: float = 0.0,
) -> list[Joint]:
    """Joints of `person_parts` that are moved along x to above the hip: somebody on a saddle, hands on the grips.

    Args:
        height_m: of the rider.
        hip_xz_m: where the hip is on the saddle.
        lean_rad: of the trunk, forward.
        grip_xz_m: of the hands.
        legs: by side.
        cycle_m: distance of one cycle of the legs.
        stands_m: where the hip is at speed 0, from the saddle.
        stands_lean_rad: of the trunk then; None for the same.
        apart_m: by so much each thigh is further out than that of a pedestrian.
    """
    h, (hip_x, hip_z) = height_m, hip_xz_m
    saddle = (0.0, 0.0, hip_z - HIP * h)  # from the build posture, whose feet stand on the ground
    stands = (stands_m[0], stands_m[1], saddle[2] + stands_m[2])
    lean = (lean_rad, lean_rad if stands_lean_rad is None else stands_lean_rad)

    def joint(
        name: str, parent: str | None, x: float, y: float, z: float, angles_rad: NDArray[np.float64],
        stationary_rad: float,
    ) -> Joint:  # fmt: skip
        return Joint(
            name=name, parent=parent, pivot_m=(hip_x + x * h, y * h, z * h), cycle_m=cycle_m,
            angles_rad=angles_rad, stationary_rad=stationary_rad,
        )  # fmt: skip

    def shifted(joint: Joint, shift_m: tuple[float, ...], then_m: tuple[float, float, float]) -> Joint:
        return replace(joint, shifts_m=np.tile(shift_m, (STEPS + 1, 1)), stationary_shift_m=then_m)

    joints = [
        shifted(joint("root", None, 0, 0, 0, still(), 0.0), saddle, stands),
        joint("hips", "root", 0, 0, HIP, still(0.6 * lean[0]), 0.6 * lean[1]),
        joint("chest", "hips", 0, 0, WAIST, still(0.4 * lean[0]), 0.4 * lean[1]),
        joint("head", "chest", 0, 0, NECK, still(-0.8 * lean[0]), -0.8 * lean[1]),
    ]
    hips = (hip_x, HIP * h + saddle[2]), (hip_x + stands[0], HIP * h + stands[2])
    arms = [arm_angles(h, angle, hip, grip_xz_m) for angle, hip in zip(lean, hips, strict=True)]
    for side, sign in SIDES.items():
        leg, y, shoulder_y = legs[side], sign * HIP_Y, sign * SHOULDER_Y
        thigh, shank, foot = leg.stands_rad
        out = (0.0, sign * apart_m, 0.0)
        joints += [
            shifted(joint(f"{side}_thigh", "root", 0, y, HIP, -leg.thigh_rad, -thigh), out, out),
            joint(f"{side}_shank", f"{side}_thigh", 0, y, KNEE, leg.thigh_rad - leg.shank_rad, thigh - shank),
            joint(f"{side}_foot", f"{side}_shank", 0, y, ANKLE, leg.shank_rad - leg.foot_rad, shank - foot),
            joint(f"{side}_toes", f"{side}_foot", BALL, y, 0, still(), 0.0),
            joint(f"{side}_upper_arm", "chest", 0, shoulder_y, SHOULDER, still(arms[0][0]), arms[1][0]),
            joint(f"{side}_forearm", f"{side}_upper_arm", 0, shoulder_y, ELBOW, still(arms[0][1]), arms[1][1]),
        ]
    return joints


def arm_angles(
    height_m: float, lean_rad: float, hip: tuple[float, float], grip_xz_m: tuple[float, float]
) -> tuple[float, float]:
    """Angles of shoulder and elbow of hands on the grips, about the y axis, from a trunk that leans."""
    waist = np.array(hip) + (WAIST - HIP) * height_m * np.array([np.sin(0.6 * lean_rad), np.cos(0.6 * lean_rad)])
    shoulder = waist + (SHOULDER - WAIST) * height_m * np.array([np.sin(lean_rad), np.cos(lean_rad)])
    reach = np.array(grip_xz_m) - shoulder
    upper, lower = two_links(reach, UPPER_ARM * height_m, (FOREARM + HAND / 2) * height_m, bends_forward=False)
    return float(-upper[0] - lean_rad), float(upper[0] - lower[0])
