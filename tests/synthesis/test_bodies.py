from __future__ import annotations

import numpy as np
import pytest

from bench.geometry import cross
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.mesh import Mesh, Surface, box, slab, tube
from tests.support.meshes import of_joint, open_edges, volume_m3

GREY = Surface(albedo=0.5, contrast=0.1)
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


@pytest.mark.parametrize(
    ("mesh", "wanted_m3"),
    [
        (box([1, 2, 3], [5, -4, 2], GREY), 6.0),
        (slab([(0, 0), (2, 0), (2, 1), (0, 1)], 0.5, GREY), 2.0),
        (tube([0, 0, 0], [0, 0, 2], 1.0, GREY, sides=4), 4.0),
    ],
)
def test_solids_are_closed_and_face_outwards(mesh: Mesh, wanted_m3: float) -> None:
    assert volume_m3(mesh) == pytest.approx(wanted_m3)
    assert open_edges(mesh) == 0


@pytest.mark.parametrize("kind", BODIES)
def test_every_part_is_a_closed_solid(kind: str) -> None:
    parts, _, _ = BODIES[kind][1](np.random.default_rng(1))
    for mesh, joint in parts:
        assert open_edges(mesh) == 0, joint
        assert volume_m3(mesh) > 0, joint


@pytest.mark.parametrize("kind", BODIES)
def test_body_is_of_everyday_size(kind: str) -> None:
    body = make_body(kind, np.random.default_rng(5))
    for size_m, (least, most) in zip(body.size_m, SIZES_M[kind], strict=True):
        assert least < size_m < most
    rolls = body.object_class in {"vehicle", "cyclist"} or kind == "with_pram"
    limit = 3600 if rolls else 1800
    assert 500 < len(body.mesh.corners_m) < limit
    a, b, c = (body.mesh.corners_m[:, k] for k in range(3))
    assert np.linalg.norm(cross(b - a, c - a), axis=1).min() > 0  # every face has a normal
    assert ((body.mesh.surfaces[:, 0] > 0) & (body.mesh.surfaces[:, 0] < 0.9)).all()


def test_sizes_are_known_of_every_kind() -> None:
    assert SIZES_M.keys() == BODIES.keys()


@pytest.mark.parametrize("speed_mps", [0.0, 0.2, 3.0])
@pytest.mark.parametrize("kind", BODIES)
def test_body_stays_in_its_box_in_every_posture(kind: str, speed_mps: float) -> None:
    body = make_body(kind, np.random.default_rng(1))
    half_m = body.size_m / 2
    for way_m in np.linspace(0, body.cycle_m, 37):
        corners_m = body.corners_at(float(way_m), speed_mps=speed_mps).reshape(-1, 3) - [0, 0, half_m[2]]
        assert (np.abs(corners_m[:, :2]) <= half_m[:2] + 0.01).all()
        # Between standing and going the feet are on the ground, the head up to 3 cm above.
        assert corners_m[:, 2].min() >= -half_m[2] - 0.003
        assert corners_m[:, 2].max() <= half_m[2] + (0.01 if speed_mps in {0.0, 3.0} else 0.03)
    assert body.object_class in {"pedestrian", "cyclist", "vehicle", "animal"}
    assert body.corners_at(0.0).shape == body.mesh.corners_m.shape


@pytest.mark.parametrize("kind", ["adult", "cyclist", "motorcyclist", "dog", "van"])
def test_posture_repeats_and_has_no_jumps(kind: str) -> None:
    body = make_body(kind, np.random.default_rng(1))
    wheels_too = body.object_class in {"cyclist", "vehicle"}
    if not wheels_too:
        assert body.corners_at(0.3) == pytest.approx(body.corners_at(0.3 + 3 * body.cycle_m), abs=1e-9)
    for way_m in np.linspace(-1.0, 1.0, 41):
        step = np.abs(body.corners_at(float(way_m) + 0.002) - body.corners_at(float(way_m))).max()
        assert step < 0.015  # no point of a body moves several times as fast as the body


def test_looks_are_drawn_and_repeatable() -> None:
    same = [make_body("adult", np.random.default_rng(4)) for _ in range(2)]
    other = make_body("adult", np.random.default_rng(9))
    assert np.array_equal(same[0].corners_at(0.7), same[1].corners_at(0.7))
    assert np.array_equal(same[0].mesh.surfaces, same[1].mesh.surfaces)
    assert not np.array_equal(np.unique(same[0].mesh.surfaces), np.unique(other.mesh.surfaces))
    assert same[0].start_m != other.start_m


@pytest.mark.parametrize("kind", VEHICLES)
def test_vehicles_keep_their_shape_and_their_wheels_roll(kind: str) -> None:
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
def test_vehicles_have_panes_that_mirror_and_lamps_that_glow(kind: str) -> None:
    body = make_body(kind, np.random.default_rng(1))
    albedo, _, _, mirror, glow, _ = body.mesh.surfaces.T
    corners = body.mesh.corners_m
    areas_m2 = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert (
        areas_m2[(mirror > 0.03) & (albedo < 0.06) & (corners[:, :, 2].min(axis=1) > 0.4 * body.size_m[2])].sum() > 1.0
    )
    middle_x = corners.mean(axis=1)[:, 0]
    assert (middle_x[glow > 0.3] > 0.3 * body.size_m[0]).all()  # white ahead
    assert (middle_x[(glow > 0) & (glow < 0.3)] < 0.4 * body.size_m[0]).any()  # red behind
