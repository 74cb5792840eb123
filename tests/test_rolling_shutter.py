"""A rendered drive of a camera with a rolling shutter: its truth, its reference and what methods make of it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.errors import UsageError
from bench.evaluation.protocol import load_protocol
from bench.harness.frames import FramePipeline
from bench.methods.registry import build_method
from bench.recordings import open_native, read_truth
from bench.reference.exposure import Exposure, visible_region
from bench.reporting.frame_pictures import SweepViewer
from bench.synthesis import read_scenario, synthesize
from bench.synthesis.ego import mounted_rig, own_body
from bench.synthesis.exact_flow import ExactFlowCaster
from bench.synthesis.imaging.faces import texture_atlas
from bench.synthesis.imaging.renderer import ImageRenderer, moment, readout_bands
from bench.synthesis.scene import FIRST_IMAGE_NS, build_scene

SCENARIO = """
name: rolling
licence: CC0-1.0
seed: 5
cameras:
  - name: left
    model: radial_polynomial
    width: 320
    height: 240
    parameters: {coefficients: [120.0, -10.0, 17.0, -3.0], principal_point: [159.5, 119.5], max_angle_rad: 1.25}
    position_m: [2.0, 1.0, 1.0]
    yaw_deg: 90
    pitch_down_deg: 10
    rolling_shutter: {readout_s: 0.025, direction: right}
lidar: {position_m: [1.2, 0.0, 1.8], rotation_hz: 10, max_range_m: 15}
recordings:
  - name: straight          # at 14 m/s, between a car ahead and one behind
    frames: 4
    host: {speed_kmh: [50.4]}
    street: {trees: 0, hedges: 0}
    actors:
      - {name: ahead, kind: car, at_s: 0.2, position_m: [8.5, 3.8]}
      - {name: behind, kind: car, at_s: 0.2, position_m: [-4.0, 3.8]}
  - name: turning
    frames: 4
    host: {speed_kmh: [30], yaw_rate_degps: [30]}
    street: {curvature_per_m: 0.0628}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rolling")
    (folder / "scenario.yaml").write_text(SCENARIO)
    synthesize(folder / "scenario.yaml", folder / "out", workers=1)
    return folder


def both_ways(folder, name="straight"):
    """A drive as it was rendered, and as if all rows were exposed at once."""
    drive = open_native(folder / "out" / name)
    yield drive
    yield replace(drive, cameras={"left": replace(drive.cameras["left"], rolling_shutter=None)})


@pytest.fixture
def prepared(folder):
    """The straight drive's scenario, scene and camera."""
    scenario = read_scenario(folder / "scenario.yaml")
    spec = scenario.recordings[0]
    return scenario, build_scene(scenario, spec), mounted_rig(scenario, spec).cameras["left"]


def last_exposure(drive):
    image, camera = drive.images["left"][-1], drive.cameras["left"]
    return image, camera, Exposure.at(image.timestamp_ns, recording=drive, camera=camera, valid=visible_region(camera))


def error_m(drive, scene, car):
    """By how much a standing car has to be shifted along the street for its surface to fit the exact mask best."""
    image, camera, exposure = last_exposure(drive)
    valid = visible_region(camera)
    scene_from_vehicle = scene.ego.at([image.timestamp_ns - FIRST_IMAGE_NS]).transform()
    corners = scene_from_vehicle.inverse().apply(car.mesh.corners_m.reshape(-1, 3))
    true, world_from_vehicle = read_truth(image) == car.instance_id, exposure.vehicle_from_world.inverse()
    shifts_m, overlaps = np.arange(-0.3, 0.31, 0.02), []
    for shift_m in shifts_m:
        shifted = corners + np.array([shift_m, 0.0, 0.0])
        triangles = exposure.project(world_from_vehicle.apply(shifted)).reshape(-1, 3, 2) * 5 + 2
        fine = np.zeros((5 * 240, 5 * 320), dtype=np.uint8)
        for triangle in triangles[np.isfinite(triangles).all(axis=(1, 2))]:
            cv2.fillConvexPoly(fine, np.rint(triangle).astype(np.int32), 1)
        shown = valid & (fine[2::5, 2::5] > 0)  # at the centres of the pixels
        overlaps.append((true & shown).sum() / (true | shown).sum())
    return float(shifts_m[np.argmax(overlaps)])


def test_an_image_is_off_by_what_is_driven_between_its_rows(folder, prepared):
    """0.35 m are driven in 25 ms at 14 m/s; two cars are seen by the first and the last sixth of the rows."""
    scene = prepared[1]
    with_rows, at_once = (
        [error_m(drive, scene, actor.placed(0)) for actor in scene.actors] for drive in both_ways(folder)
    )
    assert np.abs(with_rows).max() < 0.03
    assert abs(at_once[0] - at_once[1]) > 0.2


def test_lidar_points_are_drawn_at_their_rows(folder):
    pixels = []
    for drive in both_ways(folder):
        image, camera, exposure = last_exposure(drive)
        seen = SweepViewer(drive, camera).see(image)
        pixels.append(exposure.project(seen.points_world))
        assert np.allclose(seen.pixels, pixels[-1][camera.model.contains(pixels[-1])], atol=1e-6)
    assert np.nanmax(np.abs(pixels[0] - pixels[1])) > 3


def test_each_band_shows_the_scene_at_its_own_time(folder, prepared):
    scenario, scene, camera = prepared
    bands = readout_bands(camera.model, camera.rolling_shutter)
    assert len(bands) == 25
    assert sorted(u for (_, columns), _ in bands for u in range(320)[columns]) == list(range(320))
    assert [bands[0][1], bands[-1][1]] == pytest.approx([-12e6, 12e6], abs=0.05e6)
    image = open_native(folder / "out/straight").images["left"][-1]
    renderer = ImageRenderer(
        camera, own_body=own_body(), world=scene.world, atlas=texture_atlas(scenario.seed), light=scene.light,
        sensor=scenario.cameras[0].sensor,
    )  # fmt: skip

    def instances(offset_ns):
        then = moment(scene, image.timestamp_ns - FIRST_IMAGE_NS + offset_ns)
        return renderer.render(then, rng=np.random.default_rng(0)).instance_ids

    truth, middle, differing = read_truth(image), instances(0), 0
    for band, offset_ns in bands[3:-3:6]:
        assert np.array_equal(instances(offset_ns)[band], truth[band])
        differing += (middle[band] != truth[band]).sum()
    assert differing > 10


@pytest.mark.parametrize("name", ["straight", "turning"])
@pytest.mark.parametrize(
    ("method", "settings"), [("spherical", {"first_guess": True}), ("rigid-scene", {"refine_motion": False})]
)
def test_methods_that_are_told_mark_less_of_what_is_static(folder, name, method, settings):
    method, shares = build_method(method, settings), []
    for drive in both_ways(folder, name):
        pipeline = FramePipeline(drive, "left", method=method, protocol=load_protocol("paper-v1"))
        given = pipeline.method_input(3)
        assert given.rolling_shutter == drive.cameras["left"].rolling_shutter
        shares.append(method.segment(given).mask.mean())
    assert shares[0] < 0.6 * shares[1]


def test_exact_flow_refuses_a_rolling_shutter(prepared):
    _, scene, camera = prepared
    with pytest.raises(UsageError, match="rolling shutter"):
        ExactFlowCaster(scene, camera, valid=visible_region(camera))
