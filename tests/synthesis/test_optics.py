"""Lens and sensor: vignetting, noise, motion blur and JPEG, each by its stated units."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.cameras import PinholeCamera, RadialPolynomialCamera
from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter
from bench.synthesis.ego import AHEAD_FROM_CAMERA
from bench.synthesis.imaging.exposure import Sensor
from bench.synthesis.imaging.renderer import Moment
from bench.synthesis.imaging.visibility import lens_of
from bench.synthesis.mesh import PlacedMesh, Surface, box, quads
from bench.synthesis.scenario import SensorSpec
from tests.synthesis.pictures import EXACT, mounted, renderer_of, road

CAMERA = PinholeCamera(width=160, height=120, focal=(80, 80), principal_point=(79.5, 59.5))
GREY = np.full((120, 160), 0.4, dtype=np.float32)
AHEAD = RigidTransform(AHEAD_FROM_CAMERA, np.array([0.0, 0.0, 1.0]))


def test_edge_of_the_lens_gets_its_share_of_the_light() -> None:
    lens = lens_of(CAMERA)
    spec = EXACT.model_copy(update={"edge_light": 0.5})
    pixels = Sensor(spec, lens, gain=1.0).expose(GREY, np.random.default_rng(0))
    assert pixels[59, 79] == 102
    assert pixels[0, 0] == pytest.approx(51, abs=1)


@pytest.mark.parametrize(("gain", "grey"), [(1.0, 0.4), (4.0, 0.4), (1.0, 0.1)])
def test_noise_has_its_variance(gain: float, grey: float) -> None:
    spec = SensorSpec(edge_light=1.0, read_noise_grey=1.5, full_well_electrons=8000.0)
    pixels = Sensor(spec, lens_of(CAMERA), gain=gain).expose(GREY * (grey / 0.4), np.random.default_rng(0))
    # Electrons follow Poisson's law; rounding adds a twelfth.
    variance = (1.5 * gain) ** 2 + 255 * grey * 255 * gain / 8000.0 + 1 / 12
    assert pixels.mean() == pytest.approx(255 * grey, abs=0.2)
    assert pixels.var() == pytest.approx(variance, rel=0.05)


def test_stripe_is_smeared_by_its_way_in_the_image() -> None:
    # A white stripe 8 m ahead moves 0.8 m to the left while the shutter is open: 0.8 / 8 * 80 px = 8 px.
    black, white = Surface(albedo=0.02, contrast=0.0), Surface(albedo=0.7, contrast=0.0)
    wall = quads([[9, 30, -20], [9, -30, -20], [9, -30, 20], [9, 30, 20]], black)
    renderer = renderer_of(mounted(CAMERA, AHEAD), world=wall)

    def at(y_m: float) -> Moment:
        stripe = box([0.02, 2.0, 4], [8.01, y_m, 1], white)
        return Moment(placed=[PlacedMesh(mesh=stripe, instance_id=3)], world_from_vehicle=RigidTransform.identity())

    still = renderer.render(at(0.0), rng=np.random.default_rng(0))
    moved = renderer.render(at(0.0), shutter=(at(-0.4), at(0.4)), rng=np.random.default_rng(0))
    assert np.array_equal(still.instance_ids, moved.instance_ids)
    middle = moved.pixels[60].astype(float)
    inside = moved.instance_ids[60] == 3
    # Half of the smear lies on the stripe: at its edge the pixel was covered for half of the time.
    first = int(np.flatnonzero(inside)[0])
    low, high = middle[~inside].min(), middle.max()
    assert middle[first] == pytest.approx((low + high) / 2, abs=0.12 * (high - low))
    assert middle[first + 5] == pytest.approx(high, abs=2)
    assert (np.diff(middle[first : first + 5]) > 0.05 * (high - low)).all()


def test_ego_vehicle_that_turns_leaves_its_own_body_sharp() -> None:
    camera_model = RadialPolynomialCamera(
        width=160, height=120, coefficients=(42.0, -3.0, 5.0, -0.8), principal_point=(79.5, 59.5)
    )
    rough = Surface(albedo=0.5, contrast=0.4, texel_m=0.02)
    own_body = box([2, 4, 0.2], [0.3, 0, 0.3], rough)
    renderer = renderer_of(mounted(camera_model, AHEAD), world=road(rough), own_body=own_body)
    moments = [Moment(placed=[], world_from_vehicle=RigidTransform.from_yaw(0, [x_m, 0, 0])) for x_m in (-0.8, 0, 0.8)]
    still = renderer.render(moments[1], rng=np.random.default_rng(0))
    moved = renderer.render(moments[1], shutter=(moments[0], moments[2]), rng=np.random.default_rng(0))
    own = np.zeros((120, 160), dtype=bool)
    own[100:, 60:100] = True
    ground = np.zeros_like(own)
    ground[68:75, 20:140] = True
    assert (still.distances_m[own] < 1.5).all()
    assert np.array_equal(still.pixels[own], moved.pixels[own])
    assert moved.pixels[ground].std() < 0.9 * still.pixels[ground].std()


def test_jpeg_is_written_beside_no_png(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)
    RecordingWriter(tmp_path).image("front", 5, pixels, jpeg_quality=90)
    files = sorted((tmp_path / "images" / "front").iterdir())
    assert [file.name for file in files] == ["5.jpg"]
    assert cv2.imread(str(files[0]), cv2.IMREAD_GRAYSCALE).shape == (48, 64)
