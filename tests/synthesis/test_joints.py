"""Lofts, linkages and two-link legs against numbers done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.synthesis.bodies.body import STEPS, Joint, Linkage, still, wheel
from bench.synthesis.bodies.gait import rotate_xz, two_links
from bench.synthesis.mesh import Surface, ellipses, limb, loft, ring, rounded
from tests.support.meshes import open_edges, volume_m3

GREY = Surface(albedo=0.5, contrast=0.1)
DARK = Surface(albedo=0.1, contrast=0.1)
SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2


def square_rings(heights: list[float]) -> np.ndarray:
    return np.array([[(x, y, z) for x, y in SQUARE] for z in heights])


@pytest.mark.parametrize("rings", [square_rings([0, 1, 3]), square_rings([3, 1, 0]), square_rings([0, 3])[:, ::-1]])
def test_loft_is_closed_and_faces_outwards_whichever_way_it_runs(rings: np.ndarray) -> None:
    mesh = loft(rings + np.array([7.0, -5.0, 2.0]), GREY)
    assert volume_m3(mesh) == pytest.approx(3.0)
    assert open_edges(mesh) == 0


def test_loft_drops_what_has_no_area_and_stays_closed() -> None:
    rings = square_rings([0, 1, 2])
    rings[0, 1] = rings[0, 0]
    mesh = loft(rings, GREY)
    assert open_edges(mesh) == 0
    assert len(mesh.corners_m) == 2 * 4 * 2 + 2 * 4 - 2


def test_painted_cells_wear_their_surface() -> None:
    mesh = loft(square_rings([0, 1, 2]), GREY, paint=[(slice(0, 1), slice(2, 3), DARK)])
    dark = mesh.surfaces[:, 0] == DARK.albedo
    assert dark.sum() == 2
    assert mesh.corners_m[dark][..., 1] == pytest.approx(0.5)
    assert mesh.corners_m[dark][..., 2].max() == pytest.approx(1.0)


def test_round_things_have_the_volume_of_what_they_stand_for() -> None:
    tyre = ring([1, 2, 3], 1.0, 0.1, GREY, sides=60)
    assert volume_m3(tyre) == pytest.approx(2 * np.pi * 0.9 * 2 * 0.1**2, rel=0.01)  # Pappus
    assert open_edges(tyre) == 0
    ball = rounded([1, 2, 3], [0.5, 1.0, 2.0], GREY, sides=40, rows=30)
    assert volume_m3(ball) == pytest.approx(4 / 3 * np.pi, rel=0.05)
    arm = limb([0, 0, 2], [0, 0, 0], [0.1, 0.1], GREY, sides=40)
    assert np.pi * 0.02 < volume_m3(arm) < np.pi * 0.02 * 1.1
    assert ellipses([(0, 0, 1, 2, 3)], sides=4)[0] == pytest.approx(
        np.array([(2, 3, np.sqrt(2)), (-2, 3, np.sqrt(2)), (-2, -3, np.sqrt(2)), (2, -3, np.sqrt(2))]) / np.sqrt(2)
    )


@given(
    angle=st.floats(-2.5, 2.5), bend=st.floats(0.05, 2.5), upper=st.floats(0.1, 0.6), lower=st.floats(0.1, 0.6),
    forward=st.booleans(),
)  # fmt: skip
def test_two_links_reach_what_they_can_reach(
    angle: float, bend: float, upper: float, lower: float, forward: bool
) -> None:
    second = angle - bend if forward else angle + bend
    reach = upper * np.array([np.sin(angle), -np.cos(angle)]) + lower * np.array([np.sin(second), -np.cos(second)])
    if np.linalg.norm(reach) < abs(upper - lower) / 0.99 + 1e-3:
        return
    first, last = two_links(reach, upper, lower, bends_forward=forward)
    got = upper * np.array([np.sin(first), -np.cos(first)]) + lower * np.array([np.sin(last), -np.cos(last)])
    assert got[:, 0] == pytest.approx(reach, abs=2e-3)
    assert (np.sin(first - last)[0] > 0) == forward


def test_what_is_too_far_away_is_pointed_at() -> None:
    upper, lower = two_links([(3.0, 0.0)], 0.4, 0.4, bends_forward=True)
    assert upper[0] == pytest.approx(np.pi / 2, abs=0.04)
    assert lower[0] == pytest.approx(np.pi / 2, abs=0.04)


def test_turning_a_vector_lifts_its_tip() -> None:
    assert rotate_xz((1.0, 0.0), np.array([np.pi / 2]))[0] == pytest.approx([0.0, 1.0], abs=1e-12)
    assert rotate_xz((0.0, -1.0), np.array([np.pi / 2]))[0] == pytest.approx([1.0, 0.0], abs=1e-12)


def test_joints_hang_on_each_other() -> None:
    # Shoulder at height 2, elbow at 1: shoulder and elbow each turn by 90 degrees over a quarter of the cycle.
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    joints = [
        Joint(name="shoulder", pivot_m=(0, 0, 2), cycle_m=4.0, angles_rad=-turn),
        Joint(name="elbow", parent="shoulder", pivot_m=(0, 0, 1), cycle_m=4.0, angles_rad=-turn),
    ]
    rotations, translations_m = Linkage(joints).transforms(1.0, 1.0)
    hand = rotations[1] @ np.array([0.0, 0.0, 0.0]) + translations_m[1]
    # The upper arm points forward, the forearm up.
    assert hand == pytest.approx([1.0, 0.0, 3.0], abs=1e-9)
    x, y, z = 5.0, 0.0, 1.0
    moved = Linkage([replace(joint, pivot_m=(x, y, joint.pivot_m[2] + z)) for joint in joints])
    rotations, translations_m = moved.transforms(1.0, 1.0)
    assert rotations[1] @ np.array([5.0, 0.0, 1.0]) + translations_m[1] == pytest.approx([6.0, 0.0, 4.0], abs=1e-9)


def test_standing_is_what_a_joint_says_and_wheels_do_not_care() -> None:
    arm = Joint(name="arm", pivot_m=(0, 0, 1), cycle_m=2.0, angles_rad=still(0.8), stationary_rad=0.2)
    linkage = Linkage([arm, wheel("wheel", 3.0, 0.5)])
    for going, expected in ((0.0, 0.2), (0.5, 0.5), (1.0, 0.8)):
        rotations, _ = linkage.transforms(0.25, going)
        assert np.arctan2(rotations[0][0, 2], rotations[0][0, 0]) == pytest.approx(expected)
        assert np.arctan2(rotations[1][0, 2], rotations[1][0, 0]) == pytest.approx(0.5)  # way over radius
