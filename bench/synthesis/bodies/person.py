"""The solids of a person, upright with hanging arms, and where the joints are.

Lengths are shares of the body height (D. A. Winter, *Biomechanics and Motor Control of Human Movement*, figure 4.1,
after Drillis and Contini 1966); a child's head is larger in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.loft import ellipses, limb, loft, rounded
from bench.synthesis.bodies.looks import Clothes
from bench.synthesis.bodies.walking import ANKLE, BALL, HEEL, SHANK, THIGH, TOE
from bench.synthesis.mesh import Mesh, Surface, box, convex

HIP, KNEE = ANKLE + SHANK + THIGH, ANKLE + SHANK  # heights
WAIST, SHOULDER, NECK, CHIN = 0.60, 0.815, 0.845, 0.87
HIP_Y, SHOULDER_Y = 0.050, 0.122  # half of the distance between the joints
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.09
ELBOW, WRIST = SHOULDER - UPPER_ARM, SHOULDER - UPPER_ARM - FOREARM
SIDES = {"left": 1.0, "right": -1.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """Height and build.

    Attributes:
        height_m: without shoes.
        girth: thickness of trunk and limbs relative to an average adult's.
        head: size of the head relative to an adult's of that height.
    """

    height_m: float
    girth: float = 1.0
    head: float = 1.0


def person_parts(figure: Figure, clothes: Clothes) -> list[Part]:
    """All solids of a person.

    Returns:
        Parts on the joints `hips`, `chest`, `head`, and `thigh`, `shank`, `foot`, `toes`, `upper_arm`, `forearm` with
        `left_` and `right_` before them.
    """
    parts: list[Part] = [*_trunk(figure, clothes), *_head(figure, clothes)]
    for side, sign in SIDES.items():
        parts += [*_leg(figure, clothes, side, sign), *_arm(figure, clothes, side, sign)]
    return [(_scaled(mesh, figure.height_m), joint) for mesh, joint in parts]


def _scaled(mesh: Mesh, height_m: float) -> Mesh:
    return Mesh(corners_m=mesh.corners_m * height_m, texture_m=mesh.texture_m * height_m, surfaces=mesh.surfaces)


def _trunk(figure: Figure, clothes: Clothes) -> list[Part]:
    g = figure.girth
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


def _head(figure: Figure, clothes: Clothes) -> list[Part]:
    size = figure.head
    middle = CHIN + 0.065
    neck = limb((0.002, 0, CHIN + 0.02), (0.0, 0, NECK - 0.02), (0.030, 0.032), clothes.skin)
    skull = rounded((0.010, 0, middle), np.array([0.052, 0.043, 0.066]) * size, clothes.skin)
    hair = rounded((-0.004, 0, middle + 0.016), np.array([0.053, 0.048, 0.057]) * size, clothes.hair)
    nose = box([0.016, 0.016, 0.022], [0.010 + 0.054 * size, 0, middle - 0.012], clothes.skin)
    return [(neck, "head"), (skull, "head"), (hair, "head"), (nose, "head")]


def _leg(figure: Figure, clothes: Clothes, side: str, sign: float) -> list[Part]:
    y, g = sign * HIP_Y, figure.girth
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


def _arm(figure: Figure, clothes: Clothes, side: str, sign: float) -> list[Part]:
    y, g = sign * SHOULDER_Y * (0.4 + 0.6 * max(figure.girth, 1.0)), figure.girth
    lower = clothes.skin if clothes.bare_arms else clothes.top
    upper_arm = limb((0, y, SHOULDER - 0.012), (0, y, ELBOW), [0.031 * g, 0.029 * g, 0.024 * g], clothes.top)
    forearm = limb((0, y, ELBOW), (0, y, WRIST), [0.024 * g, 0.023 * g, 0.017 * g], lower)
    hand = rounded((0.004, y, WRIST - HAND / 2), (0.020, 0.012, HAND / 2), clothes.skin, sides=6, rows=4)
    return [(upper_arm, f"{side}_upper_arm"), (forearm, f"{side}_forearm"), (hand, f"{side}_forearm")]
