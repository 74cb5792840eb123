from __future__ import annotations

import numpy as np
import pytest

from bench.geometry import cross, dot
from bench.synthesis.actors import BODIES, make_body
from bench.synthesis.mesh import Mesh, Surface, ball, box, slab, tube

GREY = Surface(albedo=0.5, contrast=0.1)


def volume_m3(mesh: Mesh) -> float:
    """By the divergence theorem: positive only if every face looks outwards."""
    a, b, c = (mesh.corners_m[:, k] for k in range(3))
    return float(dot(a, cross(b, c)).sum() / 6)


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


def test_ball_is_nearly_round() -> None:
    assert 0.8 * 4 / 3 * np.pi < volume_m3(ball([1, 1, 1], [1, 1, 1], GREY)) < 4 / 3 * np.pi


@pytest.mark.parametrize("kind", BODIES)
def test_body_stays_in_its_box_in_every_posture(kind: str) -> None:
    body = make_body(kind, np.random.default_rng(1))
    half_m = body.size_m / 2
    for way_m in np.linspace(0, body.cycle_m, 37):
        corners_m = body.corners_at(float(way_m)).reshape(-1, 3) - [0, 0, half_m[2]]
        assert (np.abs(corners_m) <= half_m + 0.01).all()
    assert body.object_class in {"pedestrian", "cyclist", "vehicle"}
    assert body.corners_at(0.0).shape == body.mesh.corners_m.shape


def test_legs_move_and_cars_do_not() -> None:
    walker, car = (make_body(kind, np.random.default_rng(1)) for kind in ("adult", "car"))
    assert np.abs(walker.corners_at(0.35) - walker.corners_at(0.0)).max() > 0.2
    assert np.ptp(car.corners_at(0.5).reshape(-1, 3), axis=0) == pytest.approx(car.size_m, abs=0.02)
