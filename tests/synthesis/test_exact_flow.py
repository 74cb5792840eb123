"""The exact flow against what geometry says by other ways."""

from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from bench.cameras.model import ray_grid
from bench.methods.spherical.constraints import deviations
from bench.recordings import open_native, read_truth
from bench.reference.exposure import visible_region
from bench.synthesis import read_scenario, synthesize
from bench.synthesis.exact_flow import ExactFlowCaster
from bench.synthesis.scene import build_scene
from tests.synthesis.conftest import MINIATURE

TWICE_AS_FINE = {
    "width": 320,
    "height": 240,
    "parameters": {"coefficients": [85.0, -7.5, 12.0, -2.0], "principal_point": [159.5, 119.5], "max_angle_rad": 1.7},
}


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """The last pair of images of the first recording, and their exact flow."""
    folder = tmp_path_factory.mktemp("exact")
    content = yaml.safe_load(MINIATURE)
    content["cameras"][0] |= TWICE_AS_FINE
    content["recordings"] = content["recordings"][:1]
    (folder / "scenario.yaml").write_text(yaml.safe_dump(content))
    scenario = read_scenario(folder / "scenario.yaml")
    (root,) = synthesize(folder / "scenario.yaml", folder / "out", workers=1)
    recording, scene = open_native(root), build_scene(scenario, scenario.recordings[0])
    camera, images = recording.cameras["front"], recording.images["front"][-2:]
    times = {"previous_ns": images[0].timestamp_ns, "current_ns": images[1].timestamp_ns}
    caster = ExactFlowCaster(scene, camera, valid=visible_region(camera))
    shown = {"before": read_truth(images[0]), "now": read_truth(images[1])}
    pixels, found = ray_grid(camera.model).pixels, caster.flow(**times)
    return SimpleNamespace(scene=scene, camera=camera, times=times, caster=caster, found=found, pixels=pixels, **shown)


def test_cells_see_what_the_truth_images_show(drive):
    shown = visible_region(drive.camera)
    cast, rendered = drive.found.instance_ids[shown], drive.now[shown]
    objects = (cast > 0) | (rendered > 0)
    assert objects.sum() > 500
    assert (cast != rendered)[objects].mean() < 0.02  # the renderer may place a ray that grazes an edge otherwise
    assert {1, 2} <= set(np.unique(drive.found.instance_ids).tolist())


def test_static_points_deviate_from_nothing(drive):
    previous, valid = drive.camera.model.unproject((drive.pixels + drive.found.flow).reshape(-1, 2))
    rays_previous = previous.reshape(*drive.found.visible.shape, 3)
    found = deviations(
        rays_previous,
        ray_grid(drive.camera.model).rays_camera,
        current_from_previous=drive.caster.motion(**drive.times),
        road=drive.caster.road(drive.times["current_ns"]),
    )
    static = valid.reshape(drive.found.visible.shape) & (drive.found.instance_ids == 0) & visible_region(drive.camera)
    assert static.mean() > 0.5
    assert found.epipolar[static].max() < 1e-9
    assert found.positive_depth[static].max() < 1e-9
    moving = drive.found.instance_ids == 1
    assert np.median(found.epipolar[moving & found.defined]) > 1e-4


def test_road_moves_as_the_road_plane_says(drive):
    rays = ray_grid(drive.camera.model).rays_camera
    reach_m = drive.caster.road(drive.times["current_ns"]).distance_m(rays)
    motion = drive.caster.motion(**drive.times)
    reached_m = drive.camera.vehicle_from_camera.apply(rays * np.where(reach_m < 3.0, reach_m, np.nan)[..., None])
    lane = np.abs(reached_m[..., 1]) < 1.0  # off the kerb
    near = lane & (drive.found.instance_ids == 0) & visible_region(drive.camera)
    pixels, valid = drive.camera.model.project(motion.inverse().apply(rays[near] * reach_m[near, None]))
    expected = pixels - drive.pixels[near]
    assert valid.all()
    assert near.sum() > 1000
    length, off = np.linalg.norm(expected, axis=1), np.linalg.norm(drive.found.flow[near] - expected, axis=1)
    assert length.max() > 3.0
    assert (off < 0.01 * length + 0.01).all()  # patches and lids lie some millimetres high


def test_a_visible_point_is_seen_where_the_flow_says(drive):
    before = drive.before
    aims = np.rint(drive.pixels + np.nan_to_num(drive.found.flow)).astype(int)
    inside = drive.camera.model.contains(aims.reshape(-1, 2).astype(float)).reshape(aims.shape[:2])
    seen = inside & np.isfinite(drive.found.flow[..., 0]) & visible_region(drive.camera)
    column, row = np.where(inside[..., None], aims, 0).transpose(2, 0, 1)
    same = before[row, column] == drive.found.instance_ids
    shown, hidden = seen & drive.found.visible, seen & ~drive.found.visible
    assert same[shown].mean() > 0.98
    assert hidden.any()
    # What was hidden by an actor has come out from behind it: it was where the actor is seen in the image before.
    static = drive.found.instance_ids == 0
    behind = before[row, column] > 0
    assert behind[hidden & static].mean() > 0.1
    assert behind[shown & static].mean() < 0.005
    assert drive.found.visible.mean() > 0.5


def test_coarse_cells_are_the_fine_ones_at_their_centres(drive):
    caster = ExactFlowCaster(drive.scene, drive.camera, valid=visible_region(drive.camera), cell_size_px=5)
    coarse = caster.flow(**drive.times)
    np.testing.assert_allclose(coarse.flow, drive.found.flow[2::5, 2::5], atol=1e-7)
    assert np.array_equal(coarse.visible, drive.found.visible[2::5, 2::5])
