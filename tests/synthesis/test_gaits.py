"""Feet stay where they stand, pedals have feet on them, and limbs do not move together."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from bench.synthesis.bodies import Body, make_body
from bench.synthesis.bodies.gait import STANCE, hip_heights, walking_leg
from tests.support.meshes import of_joint

WALKERS = ["adult", "short_adult", "tall_adult", "stout_adult", "child", "small_child", "large_adult"]
CYCLISTS = ["cyclist", "tall_cyclist", "short_cyclist", "racing_cyclist", "child_cyclist"]
MOTORCYCLISTS = ["motorcyclist", "scooter_rider"]
STEP_M = 0.004


def body_of(kind: str) -> Body:
    return make_body(kind, np.random.default_rng(3))


def over_a_cycle(body: Body, joint: str, count: int = 120) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of a part (W, N, 3) over the ground, and the ways (W,)."""
    ways_m = np.linspace(0, body.cycle_m, count, endpoint=False)
    corners = np.array([of_joint(body, joint, body.corners_at(float(way_m))) for way_m in ways_m])
    return corners + ways_m[:, None, None] * [1.0, 0.0, 0.0], ways_m


@pytest.mark.parametrize(("kind", "side"), [("adult", "left"), ("small_child", "right"), ("with_pram", "left")])
def test_the_foot_on_the_ground_does_not_slide(kind: str, side: str) -> None:
    body = body_of(kind)
    speeds = []
    for way_m in np.linspace(0, body.cycle_m, 96, endpoint=False):
        now, later = (
            np.concatenate([of_joint(body, f"{side}_{part}", body.corners_at(float(w))) for part in ("foot", "toes")])
            for w in (way_m, way_m + STEP_M)
        )
        assert now[:, 2].min() > -0.003  # never in the ground
        lowest = np.argsort(now[:, 2])[:6]
        if now[lowest[0], 2] < 0.002:
            slip_m = (later - now)[lowest, 0] + STEP_M
            speeds.append(np.abs(slip_m).min() / STEP_M)
    # Each foot is down for more than half of the cycle; its lowest point then moves at a small part of the pace.
    assert len(speeds) > 0.5 * 96
    assert np.median(speeds) < 0.02
    assert np.quantile(speeds, 0.9) < 0.25


@pytest.mark.parametrize("kind", WALKERS)
def test_one_foot_is_always_on_the_ground(kind: str) -> None:
    body = body_of(kind)
    lowest_m = [body.corners_at(float(w))[:, :, 2].min() for w in np.linspace(0, body.cycle_m, 50)]
    assert np.abs(lowest_m).max() < 0.003


def test_knees_and_trunk_move_as_in_gait_analysis() -> None:
    leg, hips = walking_leg(), hip_heights()
    knee_deg = np.degrees(leg.thigh_rad - leg.shank_rad)
    phases = np.linspace(0, 1, len(knee_deg))
    assert (knee_deg >= -0.5).all()  # never beyond straight
    assert 45 < knee_deg[phases > STANCE].max() < 70
    assert 20 < np.degrees(leg.thigh_rad.max()) < 40
    assert -30 < np.degrees(leg.thigh_rad.min()) < -8
    assert 0.030 < np.ptp(hips) * 1.75 < 0.055


@pytest.mark.parametrize("kind", ["adult", "child"])
def test_body_parts_do_not_move_together(kind: str) -> None:
    body = body_of(kind)
    size = body.size_m[2]
    head, hand, foot = (over_a_cycle(body, joint)[0].mean(axis=1) for joint in ("head", "left_forearm", "left_foot"))
    ways_m = np.linspace(0, body.cycle_m, len(head), endpoint=False)
    excursion = {name: np.ptp(place[:, 0] - ways_m) for name, place in (("head", head), ("hand", hand), ("foot", foot))}
    assert excursion["head"] < 0.02 * size
    assert 0.06 * size < excursion["hand"] < 0.30 * size
    assert 0.35 * size < excursion["foot"] < 0.60 * size
    # The arm goes back while the leg of the same side goes forward.
    assert np.corrcoef(hand[:, 0] - ways_m, foot[:, 0] - ways_m)[0, 1] < -0.7


@pytest.mark.parametrize("kind", [*WALKERS, "dog"])
def test_who_does_not_go_stands(kind: str) -> None:
    body = body_of(kind)
    standing = body.corners_at(0.0, speed_mps=0.0)
    assert np.array_equal(standing, body.corners_at(0.37, speed_mps=0.0))  # wherever the way has ended
    paws = ["left_hind_paw", "right_hind_paw", "left_front_paw", "right_front_paw"]
    feet = paws if kind == "dog" else ["left_foot", "right_foot"]
    for foot in feet:
        assert of_joint(body, foot, standing)[:, 2].min() == pytest.approx(0.0, abs=0.015)
    lengths = [of_joint(body, foot, standing)[:, 0].mean() for foot in feet]
    if kind != "dog":
        assert abs(lengths[0] - lengths[1]) < 0.03
        assert standing[:, :, 2].max() == pytest.approx(body.size_m[2], abs=0.01)


def test_starting_to_go_is_smooth() -> None:
    body = body_of("adult")
    postures = [body.corners_at(0.2, speed_mps=float(speed)) for speed in np.linspace(0, 1, 101)]
    assert max(np.abs(b - a).max() for a, b in pairwise(postures)) < 0.02
    assert np.array_equal(postures[50], postures[100])


@pytest.mark.parametrize(
    ("kind", "side"), [("cyclist", "left"), ("racing_cyclist", "right"), ("child_cyclist", "left")]
)
def test_feet_follow_the_pedals(kind: str, side: str) -> None:
    body = body_of(kind)
    pedals = over_a_cycle(body, f"{side}_pedal")[0]
    toes, feet = (over_a_cycle(body, f"{side}_{part}")[0] for part in ("toes", "foot"))
    middles = pedals.mean(axis=1)
    # The toes begin at the ball, which is over the axle; the pedal stays level.
    away = np.concatenate([toes, feet], axis=1) - middles[:, None]
    nearest = np.linalg.norm(away[..., [0, 2]], axis=-1).min(axis=1)
    assert nearest.max() < 0.045
    assert np.ptp(pedals[..., 2] - middles[:, None, 2], axis=1) == pytest.approx(0.022, abs=2e-3)
    assert 0.2 < np.ptp(middles[:, 2]) < 0.38


@pytest.mark.parametrize("kind", CYCLISTS)
def test_hands_are_on_the_grips_and_do_not_move(kind: str) -> None:
    body = body_of(kind)
    ways_m = np.linspace(0, body.cycle_m, 20)
    hands = np.array([of_joint(body, "left_forearm", body.corners_at(float(w))) for w in ways_m])
    assert np.abs(hands - hands[0]).max() < 1e-9
    thigh = np.array([of_joint(body, "left_thigh", body.corners_at(float(w))) for w in ways_m])
    assert np.ptp(thigh[..., 2], axis=0).max() > 0.15 * body.size_m[2]


@pytest.mark.parametrize("kind", MOTORCYCLISTS)
def test_a_motorcyclist_sits_still_and_stops_with_the_feet_on_the_ground(kind: str) -> None:
    body = body_of(kind)
    riding, later, standing = body.corners_at(0.1), body.corners_at(0.5), body.corners_at(0.5, speed_mps=0.0)
    for joint in ("head", "left_forearm", "right_foot"):
        assert np.array_equal(of_joint(body, joint, riding), of_joint(body, joint, later))
    for foot in ("left_foot", "right_foot"):
        assert of_joint(body, foot, riding)[:, 2].min() > 0.2
        assert of_joint(body, foot, standing)[:, 2].min() == pytest.approx(0.0, abs=0.003)


@pytest.mark.parametrize("kind", [*MOTORCYCLISTS, "with_pram"])
def test_hands_are_on_the_bar(kind: str) -> None:
    body = body_of(kind)
    hands = [of_joint(body, f"{side}_forearm", body.corners_at(0.2)) for side in ("left", "right")]
    bar = body.mesh.corners_m[: body.linkage.parts[0][0]].reshape(-1, 3)  # on no joint
    for hand in hands:
        ahead = hand[hand[:, 0] > hand[:, 0].max() - 0.12]  # the hand, without the forearm
        assert cdist(ahead[:, [0, 2]], bar[:, [0, 2]]).min() < 0.02


@pytest.mark.parametrize("leg", ["left_hind", "right_front"])
def test_a_trotting_paw_on_the_ground_does_not_slide(leg: str) -> None:
    paw, _ = over_a_cycle(body_of("dog"), f"{leg}_paw", count=200)
    low = paw[..., 2].min(axis=1) < 0.002
    assert 0.25 < low.mean() < 0.55
    both = low[:-1] & low[1:]
    slip = np.abs(np.diff(paw.mean(axis=1)[:, 0]))[both] / (0.88 / 200)
    assert np.median(slip) < 0.15


def test_diagonal_legs_of_a_trot_go_together() -> None:
    body = body_of("dog")
    ways_m = np.linspace(0, body.cycle_m, 60, endpoint=False)
    x = {leg: over_a_cycle(body, f"{leg}_paw", count=60)[0].mean(axis=1)[:, 0] - ways_m
         for leg in ("left_hind", "right_front", "right_hind")}  # fmt: skip
    assert np.corrcoef(x["left_hind"], x["right_front"])[0, 1] > 0.9
    assert np.corrcoef(x["left_hind"], x["right_hind"])[0, 1] < -0.7
