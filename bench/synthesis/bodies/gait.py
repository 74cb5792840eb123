"""Gait of people: tables of angles over one stride, from where the feet have to be.

A foot on the ground stays where it is: it lands on the heel, lies flat, and rolls off over the ball. The ankle's path
follows from that, the hip rides as high as the legs allow, and thigh and shank follow from both.

Everything in units of the body height. Sources: D. A. Winter, *Biomechanics and Motor Control of Human Movement* (after
Drillis and Contini 1966) for the lengths; J. Perry, *Gait Analysis*, for phases and angles: a foot is on the ground for
60 % of a cycle, its heel rises from about 30 %, the knee bends by 60 degrees in swing, shoulders swing 30 to 40
degrees in all, hips and shoulders turn by some 4 degrees against each other, the trunk rises and falls by 4 to 5 cm
twice a stride. A stride (two steps) of 0.8 body heights is a walk of about 1.3 m/s.

Two-link legs and arms: the angles that bring their end to a point.

Angles of links are measured in the plane of x and z from straight down, positive when the lower end swings forward (to
x); a joint about the y axis turns the other way round, hence the minus where tables are made.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.synthesis.bodies.body import STEPS

LONGEST = 0.9995  # of the stretched length: the angle of a stretched knee changes without bound


def two_links(
    reach_xz_m: ArrayLike, upper_m: float, lower_m: float, *, bends_forward: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles of two links from their root to a point.

    Args:
        reach_xz_m: (N, 2), m, from the root to the lower end; what lies too far away is pointed at, stretched.
        upper_m: length of the upper link.
        lower_m: length of the lower link.
        bends_forward: a human knee; an elbow bends backward.

    Returns:
        upper_rad: (N,) angle of the upper link.
        lower_rad: (N,) angle of the lower link.

    Source:
        The law of cosines.
    """
    reach = np.atleast_2d(np.asarray(reach_xz_m, dtype=np.float64))
    length = np.linalg.norm(reach, axis=1)
    shortest = abs(upper_m - lower_m) / LONGEST
    reach = reach * (np.clip(length, shortest, LONGEST * (upper_m + lower_m)) / length)[:, None]
    length = np.linalg.norm(reach, axis=1)
    opening = np.arccos((upper_m**2 + length**2 - lower_m**2) / (2 * upper_m * length))
    upper = np.arctan2(reach[:, 0], -reach[:, 1]) + (opening if bends_forward else -opening)
    knee = upper_m * np.stack([np.sin(upper), -np.cos(upper)], axis=1)
    rest = reach - knee
    return upper, np.arctan2(rest[:, 0], -rest[:, 1])


def rotate_xz(vector_xz: ArrayLike, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """A vector rotated by (N,) angles, positive from down to forward and from forward to up: (N, 2)."""
    x, z = np.asarray(vector_xz, dtype=np.float64)
    cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
    return np.stack([x * cosine - z * sine, x * sine + z * cosine], axis=-1)


THIGH, SHANK, ANKLE = 0.245, 0.246, 0.039  # lengths; height of the ankle above the sole
HEEL, BALL, TOE = -0.040, 0.072, 0.112  # along the foot, ahead of the ankle
STRIDE = 0.8  # distance of two steps
STANCE = 0.60  # share of a cycle that a foot is on the ground
LANDING = 0.15  # where the heel lands, ahead of the hip
FLAT = (0.08, 0.32)  # the foot lies flat between these shares of a cycle
LANDS_RAD, LEAVES_RAD = np.radians(18.0), np.radians(-50.0)  # pitch of the foot, toes up
RISE = 0.011  # half of the trunk's rise and fall
CLEARANCE = 0.010  # of the toes in mid swing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WalkingLeg:
    """One leg over one cycle, (STEPS + 1,) each, that begins when the heel lands.

    Attributes:
        thigh_rad: from straight down, forward positive.
        shank_rad: likewise.
        foot_rad: toes up positive.
        toes_rad: of the toes against the foot, up positive.
    """

    thigh_rad: NDArray[np.float64]
    shank_rad: NDArray[np.float64]
    foot_rad: NDArray[np.float64]
    toes_rad: NDArray[np.float64]


def phases() -> NDArray[np.float64]:
    """Shares of a cycle, (STEPS + 1,)."""
    return np.linspace(0.0, 1.0, STEPS + 1)


@cache
def hip_heights() -> NDArray[np.float64]:
    """Height of the hip over one cycle: highest over the standing foot, low enough for both legs."""
    phase = phases()
    ankle, _ = _ankle(phase)
    reach = 0.998 * (THIGH + SHANK)
    highest = np.where(phase <= STANCE, ankle[:, 1] + np.sqrt(reach**2 - ankle[:, 0] ** 2), np.inf)
    wave = RISE * np.cos(4 * np.pi * (phase - STANCE / 2))
    return np.asarray((highest - wave).min() + wave)


@cache
def walking_leg() -> WalkingLeg:
    """The leg of a walker over one stride."""
    phase = phases()
    ankle, foot = _ankle(phase)
    hip = np.stack([np.zeros_like(phase), hip_heights()], axis=1)
    thigh, shank = two_links(ankle - hip, THIGH, SHANK, bends_forward=True)
    return WalkingLeg(thigh_rad=thigh, shank_rad=shank, foot_rad=foot, toes_rad=_toes(phase, foot))


def _ankle(phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position of the ankle below the hip, (N, 2), and pitch of the foot, (N,)."""
    share = np.clip((phase - STANCE) / (1 - STANCE), 0.0, 1.0)
    foot = np.where(phase <= STANCE, _stance_pitch(phase), _swing_pitch(share))
    leaves, lands = _stance_ankle(np.array([STANCE]))[0], _stance_ankle(np.array([0.0]))[0]
    step = 1e-4
    speeds = [
        (_stance_ankle(np.array([at + step])) - _stance_ankle(np.array([at]))) / step for at in (STANCE - step, 0.0)
    ]
    swinging = _hermite(share, leaves, lands, *((1 - STANCE) * speed[0] for speed in speeds))
    swinging[:, 1] += _clearance(phase, share, foot, swinging[:, 1])
    return np.where((phase <= STANCE)[:, None], _stance_ankle(phase), swinging), foot


def _clearance(
    phase: NDArray[np.float64], share: NDArray[np.float64], foot: NDArray[np.float64], ankle_z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Height by which the ankle has to swing higher: the toes pass the ground at `CLEARANCE`."""
    heel, ball = (rotate_xz((x, -ANKLE), foot)[:, 1] for x in (HEEL, BALL))
    toe = ball + (TOE - BALL) * np.sin(foot + _toes(phase, foot))
    lowest = np.minimum.reduce([heel, ball, toe])
    bump, late = np.sin(np.pi * share) ** 2, share > 0.3
    expected = CLEARANCE * np.sin(np.pi * share) - lowest
    lacking = np.maximum(expected - ankle_z, 0.0)
    bump *= (lacking[late] / np.maximum(bump[late], 0.2)).max()
    return np.asarray(bump + np.maximum(expected - ankle_z - bump, 0.0))


def _stance_ankle(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ankle above a foot that rolls over its heel, then its ball, both fixed to the ground."""
    pitch = _stance_pitch(phase)
    heel_x = LANDING - STRIDE * phase
    over_heel = rotate_xz((-HEEL, ANKLE), pitch) + np.stack([heel_x, np.zeros_like(phase)], axis=1)
    over_ball = rotate_xz((-BALL, ANKLE), pitch) + np.stack([heel_x + BALL - HEEL, np.zeros_like(phase)], axis=1)
    return np.where((pitch > 0)[:, None], over_heel, over_ball)


def _stance_pitch(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    landing = LANDS_RAD * np.clip(1 - phase / FLAT[0], 0.0, 1.0)
    leaving = LEAVES_RAD * np.clip((phase - FLAT[1]) / (STANCE - FLAT[1]), 0.0, 1.0) ** 1.7
    return np.asarray(landing + leaving)


def _swing_pitch(share: NDArray[np.float64]) -> NDArray[np.float64]:
    share_done = np.clip(share / 0.75, 0.0, 1.0)
    return np.asarray(LEAVES_RAD + (LANDS_RAD - LEAVES_RAD) * share_done**2 * (3 - 2 * share_done))


def _toes(phase: NDArray[np.float64], foot_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The toes stay on the ground while the heel rises, and come back early in swing."""
    return np.maximum(-foot_rad, 0.0) * np.clip(1 - (phase - STANCE) / 0.12, 0.0, 1.0)


def _hermite(
    share: NDArray[np.float64],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    start_speed: NDArray[np.float64],
    end_speed: NDArray[np.float64],
) -> NDArray[np.float64]:
    t = share[:, None]
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * start_speed
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * end_speed
    )
