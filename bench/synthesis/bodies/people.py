"""People: the solids of a person, a pedestrian who walks or stands still, one with a pram, and riders on a saddle.

The solids are upright with hanging arms. Lengths are shares of the body height (D. A. Winter, *Biomechanics and Motor
Control of Human Movement*, figure 4.1, after Drillis and Contini 1966); a child's head is larger in proportion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.body import (
    ALLOY,
    PLASTIC,
    RUBBER,
    STEEL,
    STEPS,
    Built,
    Clothes,
    Joint,
    JointedMesh,
    cloth,
    drawn_clothes,
    still,
    wheel,
)
from bench.synthesis.bodies.gait import (
    ANKLE,
    BALL,
    HEEL,
    SHANK,
    STRIDE,
    THIGH,
    TOE,
    hip_heights,
    phases,
    two_links,
    walking_leg,
)
from bench.synthesis.mesh import Mesh, Surface, box, convex, ellipses, limb, loft, ring, rounded, slab, tube

HIP, KNEE = ANKLE + SHANK + THIGH, ANKLE + SHANK  # heights
WAIST, SHOULDER, NECK, CHIN = 0.60, 0.815, 0.845, 0.87
HIP_Y, SHOULDER_Y = 0.050, 0.122  # half of the distance between the joints
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.09
ELBOW, WRIST = SHOULDER - UPPER_ARM, SHOULDER - UPPER_ARM - FOREARM
SIDES = {"left": 1.0, "right": -1.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stature:
    """Height and build.

    Attributes:
        height_m: without shoes.
        girth: thickness of trunk and limbs relative to an average adult's.
        head: size of the head relative to an adult's of that height.
    """

    height_m: float
    girth: float = 1.0
    head: float = 1.0


def person_parts(stature: Stature, clothes: Clothes) -> list[JointedMesh]:
    """All solids of a person.

    Returns:
        Parts on the joints `hips`, `chest`, `head`, and `thigh`, `shank`, `foot`, `toes`, `upper_arm`, `forearm` with
        `left_` and `right_` before them.
    """
    parts: list[JointedMesh] = [*_trunk(stature, clothes), *_head(stature, clothes)]
    for side, sign in SIDES.items():
        parts += [*_leg(stature, clothes, side, sign), *_arm(stature, clothes, side, sign)]
    return [(_scaled(mesh, stature.height_m), joint) for mesh, joint in parts]


def _scaled(mesh: Mesh, height_m: float) -> Mesh:
    return Mesh(corners_m=mesh.corners_m * height_m, texture_m=mesh.texture_m * height_m, surfaces=mesh.surfaces)


def _trunk(stature: Stature, clothes: Clothes) -> list[JointedMesh]:
    g = stature.girth
    pelvis = [
        (0.0, 0, 0.470, 0.045 * g, 0.070 * g), (-0.004, 0, 0.500, 0.064 * g, 0.096 * g),
        (-0.004, 0, 0.550, 0.066 * g, 0.100 * g), (0.0, 0, 0.610, 0.056 * g, 0.084 * g),
        (0.0, 0, 0.64, 0.04 * g, 0.06 * g),
    ]  # fmt: skip
    chest = [
        (-0.005, 0, 0.545, 0.076 * g, 0.108 * g), (-0.003, 0, 0.580, 0.073 * g, 0.104 * g),
        (0.002, 0, 0.64, 0.062 * g, 0.093 * g), (0.004, 0, 0.70, 0.068 * g, 0.104 * g),
        (0.002, 0, 0.770, 0.066 * g, 0.122 * g),
        (-0.002, 0, 0.815, 0.050 * g, 0.118 * g), (-0.002, 0, 0.842, 0.034 * g, 0.060 * g),
        (0.0, 0, 0.85, 0.030 * g, 0.034 * g),
    ]  # fmt: skip
    parts: list[JointedMesh] = [
        (loft(ellipses(pelvis, sides=12), clothes.bottom), "hips"),
        (loft(ellipses(chest, sides=12), clothes.top), "chest"),
    ]
    if clothes.skirt_to is not None:
        coat = clothes.skirt_to > 0.32
        ahead, deep = (0.018, 0.138) if coat else (0.024, 0.150)  # a thigh swings forward by 34 degrees, back by 20
        hem = [(ahead, 0, clothes.skirt_to, deep, 0.115 * g), (0.008, 0, 0.42, 0.109, 0.112 * g),
               (-0.004, 0, 0.50, 0.072 * g, 0.104 * g), (0.0, 0, 0.61, 0.060 * g, 0.088 * g)]  # fmt: skip
        parts.append((loft(ellipses(hem, sides=12), clothes.top if coat else clothes.bottom), "hips"))
    if clothes.backpack is not None:
        pack = np.array([(x, y, z) for x, half, low, high in ((-0.05, 0.085, 0.58, 0.82), (-0.15, 0.07, 0.60, 0.79))
                         for y in (-half, half) for z in (low, high)])  # fmt: skip
        parts.append((convex(pack, clothes.backpack), "chest"))
    return parts


def _head(stature: Stature, clothes: Clothes) -> list[JointedMesh]:
    size = stature.head
    middle = CHIN + 0.065
    neck = limb((0.002, 0, CHIN + 0.02), (0.0, 0, NECK - 0.02), (0.030, 0.032), clothes.skin)
    skull = rounded((0.010, 0, middle), np.array([0.052, 0.043, 0.066]) * size, clothes.skin)
    hair = rounded((-0.004, 0, middle + 0.016), np.array([0.053, 0.048, 0.057]) * size, clothes.hair)
    nose = box([0.016, 0.016, 0.022], [0.010 + 0.054 * size, 0, middle - 0.012], clothes.skin)
    return [(neck, "head"), (skull, "head"), (hair, "head"), (nose, "head")]


def _leg(stature: Stature, clothes: Clothes, side: str, sign: float) -> list[JointedMesh]:
    y, g = sign * HIP_Y, stature.girth
    below = clothes.skin if clothes.bare_legs else clothes.bottom
    loose = 1.0 if clothes.bare_legs else 1.12
    thigh = limb((0, y, HIP), (0, y, KNEE), [0.050 * g, 0.047 * g, 0.040 * g, 0.034 * g], clothes.bottom)
    shank = limb((0, y, KNEE), (-0.003, y, ANKLE), [r * g * loose for r in (0.033, 0.034, 0.026, 0.022)], below)
    return [
        (thigh, f"{side}_thigh"),
        (shank, f"{side}_shank"),
        (_shoe(y, clothes.shoes), f"{side}_foot"),
        (box([TOE - BALL + 0.012, 0.050, 0.024], [(TOE + BALL) / 2 - 0.004, y, 0.012], clothes.shoes), f"{side}_toes"),
    ]


def _shoe(y: float, surface: Surface) -> Mesh:
    outline = ((HEEL, 0.0), (HEEL - 0.004, 0.03), (-0.025, 0.055), (0.028, 0.055), (BALL, 0.026), (BALL, 0.0))
    widths = (0.019, 0.019, 0.02, 0.02, 0.025, 0.025)
    return convex([(x, y + s * w, z) for (x, z), w in zip(outline, widths, strict=True) for s in (-1, 1)], surface)


def _arm(stature: Stature, clothes: Clothes, side: str, sign: float) -> list[JointedMesh]:
    y, g = sign * SHOULDER_Y * (0.4 + 0.6 * max(stature.girth, 1.0)), stature.girth
    lower = clothes.skin if clothes.bare_arms else clothes.top
    upper_arm = limb((0, y, SHOULDER - 0.012), (0, y, ELBOW), [0.031 * g, 0.029 * g, 0.024 * g], clothes.top)
    forearm = limb((0, y, ELBOW), (0, y, WRIST), [0.024 * g, 0.023 * g, 0.017 * g], lower)
    hand = rounded((0.004, y, WRIST - HAND / 2), (0.020, 0.012, HAND / 2), clothes.skin, sides=6, rows=4)
    return [(upper_arm, f"{side}_upper_arm"), (forearm, f"{side}_forearm"), (hand, f"{side}_forearm")]


SHOULDER_SWING_RAD, SHOULDER_MEAN_RAD = np.radians(18.0), np.radians(3.0)
ELBOW_MEAN_RAD, ELBOW_SWING_RAD = np.radians(24.0), np.radians(12.0)
TRUNK_TURN_RAD = np.radians(4.5)  # hips to each side; the shoulders turn the other way


def pedestrian(stature: Stature, rng: np.random.Generator) -> Built:
    """A person who walks along x."""
    return person_parts(stature, drawn_clothes(rng)), walking_joints(stature.height_m, rng), STRIDE * stature.height_m


def walking_joints(height_m: float, rng: np.random.Generator) -> list[Joint]:
    """The joints of a walker; how far the arms swing and bend is drawn."""
    cycle_m, wave = STRIDE * height_m, np.cos(2 * np.pi * phases())
    vigour, bend = rng.uniform(0.6, 1.2), rng.uniform(0.6, 1.3)
    bob = np.zeros((len(wave), 3))
    bob[:, 2] = (hip_heights() - HIP) * height_m

    def joint(
        name: str, parent: str | None, pivot: tuple[float, float, float], angles_rad: NDArray[np.float64], *,
        about_z: bool = False, stationary_rad: float = 0.0, shifts_m: NDArray[np.float64] | None = None,
    ) -> Joint:  # fmt: skip
        return Joint(
            name=name, parent=parent, pivot_m=(pivot[0] * height_m, pivot[1] * height_m, pivot[2] * height_m),
            axis=(0.0, 0.0, 1.0) if about_z else (0.0, 1.0, 0.0), cycle_m=cycle_m, angles_rad=angles_rad,
            stationary_rad=stationary_rad, shifts_m=shifts_m,
        )  # fmt: skip

    # The left heel lands at phase 0: the left hip is then ahead (turned to the right), the left shoulder behind.
    joints = [
        joint("root", None, (0, 0, 0), still(), shifts_m=bob),
        joint("hips", "root", (0, 0, HIP), -TRUNK_TURN_RAD * wave, about_z=True),
        joint("chest", "hips", (0, 0, WAIST), 2 * TRUNK_TURN_RAD * wave, about_z=True),
        joint("head", "chest", (0, 0, NECK), -TRUNK_TURN_RAD * wave, about_z=True),
    ]
    leg = walking_leg()
    for side, sign in SIDES.items():
        behind = 0.0 if side == "left" else 0.5  # of a cycle
        thigh, shank, foot, toes = (
            _later(a, behind) for a in (leg.thigh_rad, leg.shank_rad, leg.foot_rad, leg.toes_rad)
        )
        opposite = _later(wave, behind)
        upper_arm = SHOULDER_MEAN_RAD - vigour * SHOULDER_SWING_RAD * opposite
        elbow = bend * (ELBOW_MEAN_RAD - ELBOW_SWING_RAD * opposite)
        y, shoulder_y = sign * HIP_Y, sign * SHOULDER_Y
        joints += [
            joint(f"{side}_thigh", "root", (0, y, HIP), -thigh),
            joint(f"{side}_shank", f"{side}_thigh", (0, y, KNEE), thigh - shank),
            joint(f"{side}_foot", f"{side}_shank", (0, y, ANKLE), shank - foot),
            joint(f"{side}_toes", f"{side}_foot", (BALL, y, 0), -toes),
            joint(f"{side}_upper_arm", "chest", (0, shoulder_y, SHOULDER), -upper_arm, stationary_rad=0.04),
            joint(f"{side}_forearm", f"{side}_upper_arm", (0, shoulder_y, ELBOW), -elbow, stationary_rad=-0.25),
        ]
    return joints


def _later(table: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return the cycle, begun a share of it later."""
    moved = np.roll(table[:-1], round(share * (len(table) - 1)))
    return np.append(moved, moved[0])


def moved_to(x_m: float, parts: Sequence[JointedMesh]) -> list[JointedMesh]:
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


def _pram(rng: np.random.Generator) -> list[JointedMesh]:
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
    parts: list[JointedMesh] = [(mesh, None) for mesh in solids]
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
