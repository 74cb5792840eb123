"""Bodies: closed solids of everyday size, linkages, and feet that stay where they stand."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from bench.geometry import cross
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.bodies.body import STEPS, Joint, Linkage, still, wheel
from bench.synthesis.bodies.gait import STANCE, hip_heights, two_links, walking_leg
from bench.synthesis.mesh import box, slab, tube
from tests.synthesis.pictures import GREY, volume_m3


def open_edges(mesh):
    """Edges that no other triangle runs along the other way."""
    corners = np.round(mesh.corners_m * 1e7).astype(np.int64)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)]).reshape(-1, 6)
    _, back = np.unique(np.concatenate([edges, edges[:, [3, 4, 5, 0, 1, 2]]]), axis=0, return_inverse=True)
    count = np.bincount(back.ravel()[: len(edges)], minlength=back.max() + 1)
    reverse = np.bincount(back.ravel()[len(edges) :], minlength=back.max() + 1)
    return int(np.abs(count - reverse).sum())


def of_joint(body, name, corners_m):
    """Corners (N, 3) of what hangs on a joint."""
    row = [joint.name for joint in body.linkage.joints].index(name)
    start, end, _ = next(part for part in body.linkage.parts if part[2] == row)
    return corners_m[start:end].reshape(-1, 3)


WALKERS = ["adult", "short_adult", "tall_adult", "stout_adult", "child", "small_child", "large_adult"]
VEHICLES = [kind for kind, (object_class, _) in BODIES.items() if object_class == "vehicle"]
# Length, width with mirrors or elbows, height: everyday dimensions, m.
SIZES_M = {
    "car": ((4.2, 4.5), (1.9, 2.25), (1.4, 1.55)),
    "city_car": ((3.5, 3.8), (1.8, 2.1), (1.4, 1.6)),
    "saloon": ((4.6, 4.9), (1.9, 2.3), (1.4, 1.5)),
    "estate": ((4.6, 4.9), (1.9, 2.3), (1.4, 1.55)),
    "suv": ((4.4, 4.7), (2.0, 2.3), (1.6, 1.75)),
    "van": ((5.2, 5.6), (2.2, 2.45), (2.2, 2.5)),
    "minibus": ((4.8, 5.2), (2.1, 2.4), (1.85, 2.05)),
    "lorry": ((6.2, 6.8), (2.4, 2.65), (3.2, 3.5)),
    "bus": ((11.7, 12.3), (2.5, 3.0), (2.9, 3.2)),
    "coach": ((12.6, 13.0), (2.5, 3.0), (3.5, 3.7)),
    "articulated_lorry": ((13.4, 13.8), (2.4, 2.65), (3.9, 4.05)),
    "tanker": ((13.4, 13.8), (2.4, 2.65), (3.4, 3.6)),
    "pickup": ((5.2, 5.5), (2.1, 2.4), (1.75, 1.95)),
    "cyclist": ((1.7, 1.95), (0.5, 0.7), (1.75, 1.95)),
    "tall_cyclist": ((1.8, 2.1), (0.5, 0.7), (1.85, 2.1)),
    "short_cyclist": ((1.6, 1.8), (0.5, 0.7), (1.6, 1.8)),
    "racing_cyclist": ((1.6, 1.8), (0.45, 0.65), (1.65, 1.85)),
    "child_cyclist": ((1.25, 1.5), (0.4, 0.55), (1.3, 1.5)),
    "motorcyclist": ((1.9, 2.2), (0.75, 0.95), (1.65, 1.85)),
    "scooter_rider": ((1.75, 1.95), (0.7, 0.85), (1.6, 1.8)),
    "adult": ((0.9, 1.2), (0.45, 0.65), (1.72, 1.80)),
    "short_adult": ((0.8, 1.1), (0.4, 0.6), (1.57, 1.65)),
    "tall_adult": ((1.0, 1.25), (0.45, 0.65), (1.87, 1.95)),
    "stout_adult": ((0.9, 1.2), (0.55, 0.8), (1.67, 1.75)),
    "child": ((0.6, 0.9), (0.3, 0.5), (1.18, 1.27)),
    "small_child": ((0.5, 0.75), (0.25, 0.45), (0.96, 1.08)),
    "large_adult": ((1.05, 1.35), (0.6, 0.85), (1.95, 2.06)),
    "with_pram": ((1.8, 2.05), (0.5, 0.7), (1.64, 1.74)),
    "dog": ((1.1, 1.4), (0.2, 0.4), (0.7, 0.85)),
}


def test_solids_are_closed_and_face_outwards():
    for mesh, wanted_m3 in (
        (box([1, 2, 3], [5, -4, 2], GREY), 6.0),
        (slab([(0, 0), (2, 0), (2, 1), (0, 1)], 0.5, GREY), 2.0),
        (tube([0, 0, 0], [0, 0, 2], 1.0, GREY, sides=4), 4.0),
    ):
        assert volume_m3(mesh) == pytest.approx(wanted_m3)
        assert open_edges(mesh) == 0


@pytest.mark.parametrize("kind", BODIES)
def test_every_part_is_a_closed_solid(kind):
    parts, _, _ = BODIES[kind][1](np.random.default_rng(1))
    for mesh, joint in parts:
        assert open_edges(mesh) == 0, joint
        assert volume_m3(mesh) > 0, joint


@pytest.mark.parametrize("kind", BODIES)
def test_body_is_of_everyday_size(kind):
    body = make_body(kind, np.random.default_rng(5))
    for size_m, (least, most) in zip(body.size_m, SIZES_M[kind], strict=True):
        assert least < size_m < most
    rolls = body.object_class in {"vehicle", "cyclist"} or kind == "with_pram"
    limit = 3600 if rolls else 1800
    if body.object_class == "vehicle":
        limit += 700 * (len(body.linkage.joints) - 2)  # for each axle beyond two
    assert 500 < len(body.mesh.corners_m) < limit
    a, b, c = (body.mesh.corners_m[:, k] for k in range(3))
    assert np.linalg.norm(cross(b - a, c - a), axis=1).min() > 0  # every face has a normal
    assert ((body.mesh.surfaces[:, 0] > 0) & (body.mesh.surfaces[:, 0] < 0.9)).all()


@pytest.mark.parametrize("speed_mps", [0.0, 0.2, 3.0])
@pytest.mark.parametrize("kind", BODIES)
def test_body_stays_in_its_box_in_every_posture(kind, speed_mps):
    body = make_body(kind, np.random.default_rng(1))
    half_m = body.size_m / 2
    for way_m in np.linspace(0, body.cycle_m, 19):
        corners_m = body.corners_at(float(way_m), speed_mps=speed_mps).reshape(-1, 3) - [0, 0, half_m[2]]
        assert (np.abs(corners_m[:, :2]) <= half_m[:2] + 0.01).all()
        # Between standing and going the feet are on the ground, the head up to 3 cm above.
        assert corners_m[:, 2].min() >= -half_m[2] - 0.003
        if kind in WALKERS:  # one foot is always on the ground
            assert corners_m[:, 2].min() <= -half_m[2] + 0.003
        assert corners_m[:, 2].max() <= half_m[2] + (0.01 if speed_mps in {0.0, 3.0} else 0.03)


def test_starting_to_go_is_smooth():
    postures = [body_of("adult").corners_at(0.2, speed_mps=float(speed)) for speed in np.linspace(0, 1, 101)]
    assert max(np.abs(b - a).max() for a, b in pairwise(postures)) < 0.02
    assert np.array_equal(postures[50], postures[100])


@pytest.mark.parametrize("kind", ["adult", "cyclist", "motorcyclist", "dog", "van"])
def test_posture_repeats_and_has_no_jumps(kind):
    body = make_body(kind, np.random.default_rng(1))
    if body.object_class not in {"cyclist", "vehicle"}:  # whose wheels have cycles of their own
        assert body.corners_at(0.3) == pytest.approx(body.corners_at(0.3 + 3 * body.cycle_m), abs=1e-9)
    for way_m in np.linspace(-1.0, 1.0, 41):
        step = np.abs(body.corners_at(float(way_m) + 0.002) - body.corners_at(float(way_m))).max()
        assert step < 0.015  # no point of a body moves several times as fast as the body


def test_looks_are_drawn_and_repeatable():
    same = [make_body("adult", np.random.default_rng(4)) for _ in range(2)]
    other = make_body("adult", np.random.default_rng(9))
    assert np.array_equal(same[0].corners_at(0.7), same[1].corners_at(0.7))
    assert np.array_equal(same[0].mesh.surfaces, same[1].mesh.surfaces)
    assert not np.array_equal(np.unique(same[0].mesh.surfaces), np.unique(other.mesh.surfaces))
    assert same[0].start_m != other.start_m


@pytest.mark.parametrize("kind", VEHICLES)
def test_vehicles_keep_their_shape_and_their_wheels_roll(kind):
    body = make_body(kind, np.random.default_rng(1))
    for axle in ("axle_0", "axle_1"):
        start = of_joint(body, axle, body.corners_at(0.0))
        later = of_joint(body, axle, body.corners_at(0.01))
        assert start[:, 2].min() == pytest.approx(0.0, abs=0.02)
        low, high = np.argmin(start[:, 2]), np.argmax(start[:, 2])
        # The ground is still, the top goes twice as fast: in the body's frame one way back and one way forward.
        assert (later - start)[low, 0] == pytest.approx(-0.01, abs=0.002)
        assert (later - start)[high, 0] == pytest.approx(0.01, abs=0.002)
    apart_m = np.abs(body.corners_at(0.4) - body.corners_at(0.0)).reshape(len(body.mesh.corners_m), -1)
    turning = apart_m.max(axis=1) > 1e-9
    still = sum(end - start for start, end, _ in body.linkage.parts)
    assert 0 < turning.sum() <= still


@pytest.mark.parametrize("kind", VEHICLES)
def test_vehicles_have_panes_that_mirror_and_lamps_that_glow(kind):
    body = make_body(kind, np.random.default_rng(1))
    albedo, _, _, mirror, glow, _ = body.mesh.surfaces.T
    corners = body.mesh.corners_m
    areas_m2 = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    high = corners[:, :, 2].min(axis=1) > min(0.4 * body.size_m[2], 1.35)
    assert areas_m2[(mirror > 0.03) & (albedo < 0.06) & high].sum() > 1.0
    middle_x = corners.mean(axis=1)[:, 0]
    assert (middle_x[glow > 0.3] > 0.3 * body.size_m[0]).all()  # white ahead
    assert (middle_x[(glow > 0) & (glow < 0.3)] < 0.4 * body.size_m[0]).any()  # red behind


@given(
    angle=st.floats(-2.5, 2.5), bend=st.floats(0.05, 2.5), upper=st.floats(0.1, 0.6), lower=st.floats(0.1, 0.6),
    forward=st.booleans(),
)  # fmt: skip
def test_two_links_reach_what_they_can_reach(angle, bend, upper, lower, forward):
    second = angle - bend if forward else angle + bend
    reach = upper * np.array([np.sin(angle), -np.cos(angle)]) + lower * np.array([np.sin(second), -np.cos(second)])
    if np.linalg.norm(reach) < abs(upper - lower) / 0.99 + 1e-3:
        return
    first, last = two_links(reach, upper, lower, bends_forward=forward)
    got = upper * np.array([np.sin(first), -np.cos(first)]) + lower * np.array([np.sin(last), -np.cos(last)])
    assert got[:, 0] == pytest.approx(reach, abs=2e-3)
    assert (np.sin(first - last)[0] > 0) == forward
    too_far = two_links([(3.0, 0.0)], 0.4, 0.4, bends_forward=True)  # is pointed at
    assert np.array(too_far)[:, 0] == pytest.approx(np.full(2, np.pi / 2), abs=0.04)


def test_joints_hang_on_each_other():
    # Shoulder at height 3, elbow at 2, hand at 1: both joints turn by 90 degrees over a quarter of the cycle.
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    joints = [
        Joint(name="shoulder", pivot_m=(5, 0, 3), cycle_m=4.0, angles_rad=-turn),
        Joint(name="elbow", parent="shoulder", pivot_m=(5, 0, 2), cycle_m=4.0, angles_rad=-turn),
    ]
    rotations, translations_m = Linkage(joints).transforms(1.0, 1.0)
    hand = rotations[1] @ np.array([5.0, 0.0, 1.0]) + translations_m[1]
    # The upper arm points forward, the forearm up.
    assert hand == pytest.approx([6.0, 0.0, 4.0], abs=1e-9)


def test_standing_is_what_a_joint_says_and_wheels_do_not_care():
    arm = Joint(name="arm", pivot_m=(0, 0, 1), cycle_m=2.0, angles_rad=still(0.8), stationary_rad=0.2)
    linkage = Linkage([arm, wheel("wheel", 3.0, 0.5)])
    for going, expected in ((0.0, 0.2), (0.5, 0.5), (1.0, 0.8)):
        rotations, _ = linkage.transforms(0.25, going)
        assert np.arctan2(rotations[0][0, 2], rotations[0][0, 0]) == pytest.approx(expected)
        assert np.arctan2(rotations[1][0, 2], rotations[1][0, 0]) == pytest.approx(0.5)  # way over radius


CYCLISTS = ["cyclist", "tall_cyclist", "short_cyclist", "racing_cyclist", "child_cyclist"]
MOTORCYCLISTS = ["motorcyclist", "scooter_rider"]
STEP_M = 0.004


def body_of(kind):
    return make_body(kind, np.random.default_rng(3))


def over_a_cycle(body, joint, count=120):
    """Corners of a part (W, N, 3) over the ground, and the ways (W,)."""
    ways_m = np.linspace(0, body.cycle_m, count, endpoint=False)
    corners = np.array([of_joint(body, joint, body.corners_at(float(way_m))) for way_m in ways_m])
    return corners + ways_m[:, None, None] * [1.0, 0.0, 0.0], ways_m


@pytest.mark.parametrize(("kind", "side"), [("adult", "left"), ("small_child", "right"), ("with_pram", "left")])
def test_the_foot_on_the_ground_does_not_slide(kind, side):
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


def test_knees_and_trunk_move_as_in_gait_analysis():
    leg, hips = walking_leg(), hip_heights()
    knee_deg = np.degrees(leg.thigh_rad - leg.shank_rad)
    phases = np.linspace(0, 1, len(knee_deg))
    assert (knee_deg >= -0.5).all()  # never beyond straight
    assert 45 < knee_deg[phases > STANCE].max() < 70
    assert 20 < np.degrees(leg.thigh_rad.max()) < 40
    assert -30 < np.degrees(leg.thigh_rad.min()) < -8
    assert 0.030 < np.ptp(hips) * 1.75 < 0.055


@pytest.mark.parametrize("kind", [*WALKERS, "dog"])
def test_who_does_not_go_stands(kind):
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


@pytest.mark.parametrize(
    ("kind", "side"), [("cyclist", "left"), ("racing_cyclist", "right"), ("child_cyclist", "left")]
)
def test_feet_follow_the_pedals(kind, side):
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
def test_hands_are_on_the_grips_and_do_not_move(kind):
    body = body_of(kind)
    ways_m = np.linspace(0, body.cycle_m, 20)
    hands = np.array([of_joint(body, "left_forearm", body.corners_at(float(w))) for w in ways_m])
    assert np.abs(hands - hands[0]).max() < 1e-9
    thigh = np.array([of_joint(body, "left_thigh", body.corners_at(float(w))) for w in ways_m])
    assert np.ptp(thigh[..., 2], axis=0).max() > 0.15 * body.size_m[2]


@pytest.mark.parametrize("kind", [*MOTORCYCLISTS, "with_pram"])
def test_hands_are_on_the_bar_and_who_sits_stops_with_the_feet_on_the_ground(kind):
    body = body_of(kind)
    bar = body.mesh.corners_m[: body.linkage.parts[0][0]].reshape(-1, 3)  # on no joint
    for side in ("left", "right"):
        hand = of_joint(body, f"{side}_forearm", body.corners_at(0.2))
        ahead = hand[hand[:, 0] > hand[:, 0].max() - 0.12]  # the hand, without the forearm
        assert cdist(ahead[:, [0, 2]], bar[:, [0, 2]]).min() < 0.02
    if kind in MOTORCYCLISTS:
        riding, later, standing = body.corners_at(0.1), body.corners_at(0.5), body.corners_at(0.5, speed_mps=0.0)
        for joint in ("head", "left_forearm", "right_foot"):
            assert np.array_equal(of_joint(body, joint, riding), of_joint(body, joint, later))
        for foot in ("left_foot", "right_foot"):
            assert of_joint(body, foot, riding)[:, 2].min() > 0.2
            assert of_joint(body, foot, standing)[:, 2].min() == pytest.approx(0.0, abs=0.003)


@pytest.mark.parametrize("leg", ["left_hind", "right_front"])
def test_a_trotting_paw_on_the_ground_does_not_slide(leg):
    paw, _ = over_a_cycle(body_of("dog"), f"{leg}_paw", count=200)
    low = paw[..., 2].min(axis=1) < 0.002
    assert 0.25 < low.mean() < 0.55
    both = low[:-1] & low[1:]
    slip = np.abs(np.diff(paw.mean(axis=1)[:, 0]))[both] / (0.88 / 200)
    assert np.median(slip) < 0.15
