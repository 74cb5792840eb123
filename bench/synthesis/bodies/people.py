"""People: the solids of a person, and the joints of a pedestrian who walks, or stands still at speed 0.

The solids are upright with hanging arms. Lengths are shares of the body height (D. A. Winter, *Biomechanics and Motor
Control of Human Movement*, figure 4.1, after Drillis and Contini 1966); a child's head is larger in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies.body import Built, Joint, Part, still
from bench.synthesis.bodies.gait import ANKLE, BALL, HEEL, SHANK, STRIDE, THIGH, TOE, hip_heights, phases, walking_leg
from bench.synthesis.bodies.looks import Clothes, drawn_clothes
from bench.synthesis.mesh import Mesh, Surface, box, convex, ellipses, limb, loft, rounded

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


def person_parts(stature: Stature, clothes: Clothes) -> list[Part]:
    """All solids of a person.

    Returns:
        Parts on the joints `hips`, `chest`, `head`, and `thigh`, `shank`, `foot`, `toes`, `upper_arm`, `forearm` with
        `left_` and `right_` before them.
    """
    parts: list[Part] = [*_trunk(stature, clothes), *_head(stature, clothes)]
    for side, sign in SIDES.items():
        parts += [*_leg(stature, clothes, side, sign), *_arm(stature, clothes, side, sign)]
    return [(_scaled(mesh, stature.height_m), joint) for mesh, joint in parts]


def _scaled(mesh: Mesh, height_m: float) -> Mesh:
    return Mesh(corners_m=mesh.corners_m * height_m, texture_m=mesh.texture_m * height_m, surfaces=mesh.surfaces)


def _trunk(stature: Stature, clothes: Clothes) -> list[Part]:
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
    parts: list[Part] = [
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


def _head(stature: Stature, clothes: Clothes) -> list[Part]:
    size = stature.head
    middle = CHIN + 0.065
    neck = limb((0.002, 0, CHIN + 0.02), (0.0, 0, NECK - 0.02), (0.030, 0.032), clothes.skin)
    skull = rounded((0.010, 0, middle), np.array([0.052, 0.043, 0.066]) * size, clothes.skin)
    hair = rounded((-0.004, 0, middle + 0.016), np.array([0.053, 0.048, 0.057]) * size, clothes.hair)
    nose = box([0.016, 0.016, 0.022], [0.010 + 0.054 * size, 0, middle - 0.012], clothes.skin)
    return [(neck, "head"), (skull, "head"), (hair, "head"), (nose, "head")]


def _leg(stature: Stature, clothes: Clothes, side: str, sign: float) -> list[Part]:
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


def _arm(stature: Stature, clothes: Clothes, side: str, sign: float) -> list[Part]:
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
    """The same cycle, begun a share of it later."""
    moved = np.roll(table[:-1], round(share * (len(table) - 1)))
    return np.append(moved, moved[0])
