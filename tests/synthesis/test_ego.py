"""The ego vehicle as its own cameras see it."""

from __future__ import annotations

import numpy as np
import pytest

from bench.synthesis.ego import mounted_camera, own_body
from bench.synthesis.scenario import CameraSpec

LENS = {"coefficients": [170.0, -15.0, 24.0, -4.0], "principal_point": [319.5, 239.5], "max_angle_rad": 1.7}
MOUNTINGS = {
    "front": {"position_m": (3.7, 0.0, 0.66), "pitch_down_deg": 20},
    "rear": {"position_m": (-1.05, 0.0, 0.93), "yaw_deg": 180, "pitch_down_deg": 30},
    "left": {"position_m": (1.95, 0.97, 0.97), "yaw_deg": 90, "pitch_down_deg": 45},
    "right": {"position_m": (1.95, -0.97, 0.97), "yaw_deg": -90, "pitch_down_deg": 45},
}


@pytest.mark.parametrize("name", MOUNTINGS)
def test_every_surround_view_camera_sees_a_part_of_the_ego_vehicle_at_its_lower_edge(name: str) -> None:
    spec = CameraSpec(
        name=name,
        model="radial_polynomial",
        width=640,
        height=480,
        parameters=LENS,
        **MOUNTINGS[name],  # type: ignore[arg-type]
    )
    body = mounted_camera(spec).ego_body
    assert body is not None
    assert 0.05 < body.mean() < 0.3
    assert body[400:].mean() > 5 * body[:240].mean()
    assert not body[200:280, 300:340].any()


def test_the_ego_vehicle_is_as_wide_to_the_left_as_to_the_right_and_faces_outwards() -> None:
    corners_m = own_body().corners_m
    assert corners_m[..., 1].max() == pytest.approx(-corners_m[..., 1].min())
    assert corners_m[..., 2].min() >= -1e-9
    # Closed parts that face outwards: the volume by the divergence theorem is that of a car.
    a, b, c = (corners_m[:, k] for k in range(3))
    assert 5 < (a * np.cross(b, c)).sum() / 6 < 9
