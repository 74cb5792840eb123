"""Pedestrians: people who walk, or stand when they do not go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.joints import Joint, still
from bench.synthesis.bodies.looks import dressed
from bench.synthesis.bodies.person import (
    ELBOW,
    HIP,
    HIP_Y,
    KNEE,
    NECK,
    SHOULDER,
    SHOULDER_Y,
    SIDES,
    WAIST,
    Figure,
    person_parts,
)
from bench.synthesis.bodies.walking import ANKLE, BALL, STRIDE, hip_heights, phases, walking_leg

SHOULDER_SWING_RAD, SHOULDER_MEAN_RAD = np.radians(18.0), np.radians(3.0)
ELBOW_MEAN_RAD, ELBOW_SWING_RAD = np.radians(24.0), np.radians(12.0)
TRUNK_TURN_RAD = np.radians(4.5)  # hips to each side; the shoulders turn the other way

Built = tuple[list[Part], list[Joint], float]  # parts, joints, and the way after which their postures repeat


def pedestrian(figure: Figure, rng: np.random.Generator) -> Built:
    """A person who walks along x."""
    return person_parts(figure, dressed(rng)), walking_joints(figure.height_m, rng), STRIDE * figure.height_m


def walking_joints(height_m: float, rng: np.random.Generator) -> list[Joint]:
    """The joints of a walker; how far the arms swing and bend is drawn."""
    cycle_m, wave = STRIDE * height_m, np.cos(2 * np.pi * phases())
    vigour, bend = rng.uniform(0.6, 1.2), rng.uniform(0.6, 1.3)
    bob = np.zeros((len(wave), 3))
    bob[:, 2] = (hip_heights() - HIP) * height_m

    def joint(
        name: str, parent: str | None, pivot: tuple[float, float, float], angles_rad: NDArray[np.float64], *,
        about_z: bool = False, standing_rad: float = 0.0, shifts_m: NDArray[np.float64] | None = None,
    ) -> Joint:  # fmt: skip
        return Joint(
            name=name, parent=parent, pivot_m=(pivot[0] * height_m, pivot[1] * height_m, pivot[2] * height_m),
            axis=(0.0, 0.0, 1.0) if about_z else (0.0, 1.0, 0.0), cycle_m=cycle_m, angles_rad=angles_rad,
            standing_rad=standing_rad, shifts_m=shifts_m,
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
            joint(f"{side}_upper_arm", "chest", (0, shoulder_y, SHOULDER), -upper_arm, standing_rad=0.04),
            joint(f"{side}_forearm", f"{side}_upper_arm", (0, shoulder_y, ELBOW), -elbow, standing_rad=-0.25),
        ]
    return joints


def _later(table: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The same cycle, begun a share of it later."""
    moved = np.roll(table[:-1], round(share * (len(table) - 1)))
    return np.append(moved, moved[0])
