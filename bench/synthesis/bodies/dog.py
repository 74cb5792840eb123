"""A dog that trots, the size of a Labrador.

Diagonal legs go together, each paw on the ground for somewhat less than half of a cycle, as in a trot; withers at
0.57 m (breed standard: 0.55 to 0.57 m) and a stride of one and a half times that (a medium trot in Hildebrand's gait
diagrams).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.synthesis.bodies.body import HAIRS, Built, Joint, JointedMesh, still
from bench.synthesis.bodies.gait import phases, rotate_xz, two_links
from bench.synthesis.mesh import Mesh, Surface, box, convex, ellipses, limb, loft, rounded

STRIDE_M, STANCE = 0.88, 0.42  # of a cycle that a paw is on the ground
LIFT_M, BOB_M = 0.085, 0.012
PAW_M = 0.035  # height of the lowest joint


@dataclass(frozen=True, slots=True, kw_only=True)
class DogLeg:
    """A pair of legs.

    Attributes:
        x_m: hip or shoulder joint.
        z_m: its height when standing.
        y_m: half of the distance between left and right.
        links_m: lengths of thigh, shank and foot, or upper arm, forearm and hand.
        knee_forward: a hind leg's knee; an elbow bends backward.
        radii_m: at the top of each link, and of the last one's end.
        foot_rad: angle of the last link when it lands, stands, leaves and is drawn up.
        ahead_m: where the paw is in the middle of its time on the ground, ahead of the upper joint.
    """

    x_m: float
    z_m: float
    y_m: float
    links_m: tuple[float, float, float]
    knee_forward: bool
    radii_m: tuple[float, float, float, float]
    foot_rad: tuple[float, float, float, float]
    ahead_m: float


HIND = DogLeg(
    x_m=-0.30, z_m=0.48, y_m=0.075, links_m=(0.22, 0.22, 0.135), knee_forward=True, radii_m=(0.075, 0.05, 0.024, 0.020),
    foot_rad=(0.35, 0.10, -0.55, -0.75), ahead_m=-0.03,
)  # fmt: skip
FRONT = DogLeg(
    x_m=0.24, z_m=0.43, y_m=0.08, links_m=(0.175, 0.20, 0.095), knee_forward=False,
    radii_m=(0.055, 0.036, 0.023, 0.022), foot_rad=(0.30, 0.05, -0.50, -1.20), ahead_m=0.0,
)  # fmt: skip
LEGS = {
    "left_hind": (HIND, 1.0, 0.0),
    "right_hind": (HIND, -1.0, 0.5),
    "left_front": (FRONT, 1.0, 0.5),
    "right_front": (FRONT, -1.0, 0.0),
}


def dog(rng: np.random.Generator) -> Built:
    """A trotting dog with a coat of some shade and a collar."""
    coat = Surface(albedo=float(rng.choice([*HAIRS, 0.45, 0.62])), contrast=0.30, texel_m=0.004)
    collar = Surface(albedo=float(rng.choice([0.10, 0.70])), contrast=0.10)
    parts = _trunk(coat, collar)
    wave = np.cos(2 * np.pi * phases())
    bob = np.zeros((len(wave), 3))
    bob[:, 2] = BOB_M * np.cos(4 * np.pi * phases())
    joints = [
        Joint(name="trunk", pivot_m=(0, 0, 0), cycle_m=STRIDE_M, angles_rad=still(), shifts_m=bob, stationary_rad=0.0),
        Joint(name="head", parent="trunk", pivot_m=(0.30, 0, 0.50), cycle_m=STRIDE_M,
              angles_rad=0.05 * np.cos(4 * np.pi * phases() - 0.6), stationary_rad=-0.10),
        Joint(name="tail", parent="trunk", pivot_m=(-0.37, 0, 0.54), axis=(0, 0, 1), cycle_m=STRIDE_M,
              angles_rad=0.25 * wave, stationary_rad=0.0),
    ]  # fmt: skip
    for name, (leg, sign, behind) in LEGS.items():
        parts += _leg_parts(name, leg, sign * leg.y_m, coat)
        joints += _leg_joints(name, leg, sign * leg.y_m, behind, bob[:, 2])
    return parts, joints, STRIDE_M


def _trunk(coat: Surface, collar: Surface) -> list[JointedMesh]:
    body = [(-0.41, 0.50, 0.045, 0.05), (-0.37, 0.49, 0.085, 0.085), (-0.25, 0.47, 0.115, 0.10),
            (-0.08, 0.455, 0.115, 0.105), (0.12, 0.44, 0.145, 0.115), (0.25, 0.45, 0.13, 0.10),
            (0.33, 0.47, 0.085, 0.07)]  # fmt: skip
    throat = [(0.24, 0.49, 0.085, 0.07), (0.35, 0.58, 0.070, 0.058), (0.44, 0.655, 0.060, 0.05)]
    band = [(0.355, 0.575, 0.077, 0.064), (0.385, 0.600, 0.075, 0.063)]
    ears = [convex([(0.43, s * 0.05, 0.745), (0.48, s * 0.06, 0.735), (0.44, s * 0.092, 0.635), (0.47, s * 0.085, 0.65),
                    (0.45, s * 0.06, 0.69)], coat) for s in (-1, 1)]  # fmt: skip
    return [
        (_along(body, coat), "trunk"),
        (_along(throat, coat), "head"),
        (_along(band, collar), "head"),
        (rounded((0.47, 0, 0.70), (0.095, 0.065, 0.065), coat, sides=8, rows=5), "head"),
        (_along([(0.52, 0.695, 0.042, 0.042), (0.60, 0.675, 0.035, 0.034), (0.645, 0.67, 0.024, 0.024)], coat), "head"),
        (box([0.02, 0.03, 0.024], [0.65, 0, 0.682], Surface(albedo=0.04, contrast=0.05)), "head"),
        *((ear, "head") for ear in ears),
        (_along([(-0.66, 0.60, 0.014, 0.014), (-0.52, 0.55, 0.024, 0.022), (-0.36, 0.54, 0.03, 0.028)], coat), "tail"),
    ]


def _along(levels: Sequence[tuple[float, float, float, float]], surface: Surface) -> Mesh:
    """Upright rings along x: (x, z of the middle, half height, half width)."""
    rings = ellipses([(-z, 0.0, x, tall, wide) for x, z, tall, wide in levels], sides=10)
    return loft(np.stack([rings[..., 2], rings[..., 1], -rings[..., 0]], axis=-1), surface)


def _leg_parts(name: str, leg: DogLeg, y: float, coat: Surface) -> list[JointedMesh]:
    """Links that hang straight down from the upper joint, which is where it is when standing."""
    heights = leg.z_m - np.concatenate([[0.0], np.cumsum(leg.links_m)])
    parts: list[JointedMesh] = []
    for k, joint in enumerate(("upper", "lower", "foot")):
        ends = (leg.x_m, y, heights[k]), (leg.x_m, y, heights[k + 1])
        parts.append((limb(*ends, [leg.radii_m[k], leg.radii_m[k + 1]], coat, sides=6), f"{name}_{joint}"))
    paw = box([0.085, 0.052, PAW_M + 0.006], [leg.x_m + 0.018, y, heights[3] - PAW_M / 2 + 0.003], coat)
    return [*parts, (paw, f"{name}_paw")]


def _leg_joints(name: str, leg: DogLeg, y: float, behind: float, bob_m: NDArray[np.float64]) -> list[Joint]:
    phase = (phases() + behind) % 1.0
    foot = _foot(leg, phase)
    tables = _links(leg, _paw(leg, phase), foot, leg.z_m + bob_m)
    stood = np.array([leg.foot_rad[1]])
    standing = _links(leg, np.array([[leg.ahead_m, PAW_M]]), stood, np.array([leg.z_m]))
    heights = leg.z_m - np.concatenate([[0.0], np.cumsum(leg.links_m)])
    parents = ("trunk", f"{name}_upper", f"{name}_lower", f"{name}_foot")
    joints, above, stood_above = [], np.zeros_like(foot), np.zeros(1)
    for link, parent, z, angles, stands in zip(
        ("upper", "lower", "foot", "paw"),
        parents,
        heights,
        (*tables, _tip(phase)),
        (*standing, np.zeros(1)),
        strict=True,
    ):
        joints.append(
            Joint(name=f"{name}_{link}", parent=parent, pivot_m=(leg.x_m, y, float(z)), cycle_m=STRIDE_M,
                  angles_rad=above - angles, stationary_rad=float((stood_above - stands)[0]))
        )  # fmt: skip
        above, stood_above = angles, stands
    return joints


def _links(
    leg: DogLeg, paw: ArrayLike, foot: NDArray[np.float64], joint_z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Angles of the three links from straight down, for a paw (N, 2) ahead of the upper joint and above the ground."""
    hock = np.asarray(paw) - leg.links_m[2] * rotate_xz((0.0, -1.0), foot)
    reach = hock - np.stack([np.zeros_like(joint_z), joint_z], axis=1)
    upper, lower = two_links(reach, *leg.links_m[:2], bends_forward=leg.knee_forward)
    return upper, lower, foot


def _paw(leg: DogLeg, phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position of the paw's joint: still on the ground for `STANCE`, then forward through the air."""
    share = np.clip((phase - STANCE) / (1 - STANCE), 0.0, 1.0)
    half, speed = STANCE * STRIDE_M / 2, -(1 - STANCE) * STRIDE_M
    t = share
    swing = -half * (2 * t**3 - 3 * t**2 + 1) + half * (3 * t**2 - 2 * t**3) + speed * (2 * t**3 - 3 * t**2 + t)
    x = np.where(phase <= STANCE, half - STRIDE_M * phase, swing)
    return np.stack([leg.ahead_m + x, PAW_M + LIFT_M * np.sin(np.pi * share) ** 2], axis=1)


def _foot(leg: DogLeg, phase: NDArray[np.float64]) -> NDArray[np.float64]:
    lands, stands, leaves, drawn = leg.foot_rad
    at = [0.0, STANCE / 2, STANCE, STANCE + 0.4 * (1 - STANCE), STANCE + 0.9 * (1 - STANCE), 1.0]
    return np.asarray(np.interp(phase, at, [lands, stands, leaves, drawn, lands, lands]))


def _tip(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """The paw lies flat on the ground and hangs down in the air."""
    share = np.clip((phase - STANCE) / (1 - STANCE), 0.0, 1.0)
    return np.asarray(-0.7 * np.sin(np.pi * share) ** 2)
