"""Each mistake of a camera is named: on drawn flow of a drive that brakes and turns, and on a rendered turn."""

import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.model import ray_grid
from bench.geometry import RigidTransform
from bench.recordings.native import open_native
from bench.validation.findings import Finding, Severity, Undecided
from bench.validation.fits import cameras
from bench.validation.fits.flow import FARTHEST_PX, SECTORS, SeenFlow, mirrored
from bench.validation.fits.scan_matching import MeasuredMotion
from bench.validation.report import CHECKS
from tests.support import drive, tiny
from tests.support.planting import change_head, change_mounting

WIDTH, HEIGHT, PAIRS, POINTS = 320, 240, 7, 80
FAR_M = 40.0
NO_EDGES = np.full((SECTORS, HEIGHT, WIDTH, 2), int(FARTHEST_PX), np.int16)


def large(camera):
    """The small drive's camera with images in which a degree is two pixels."""
    return replace(camera, model=camera.model.scaled(WIDTH, HEIGHT), ego_body=None)


@pytest.fixture(scope="module")
def street(clean, tmp_path_factory):
    """The clean drive with a camera that looks down a little, so that its quaternion tells the order of its numbers."""
    root = shutil.copytree(clean, tmp_path_factory.mktemp("street") / "drive")
    change_mounting(root, quaternion_wxyz=drive.quaternion_wxyz(tiny.FRONT, Rotation.from_rotvec([-0.2, 0.0, 0.0])))
    return root


@pytest.fixture
def root(street, tmp_path):
    return shutil.copytree(street, tmp_path / "drive")


@pytest.fixture(scope="module")
def flows(street):
    """What the true camera sees of the street without its road users, pair by pair."""
    camera, path, boxes = large(open_native(street).cameras["front"]), drive.winding_path(), drive.scenery()[:25]
    model = camera.model.scaled(WIDTH // 2, HEIGHT // 2)
    grid = ray_grid(model)
    pixels, rays = grid.pixels.reshape(-1, 2), np.nan_to_num(grid.rays_camera).reshape(-1, 3)
    drawn = []
    for i in range(PAIRS):
        now_ns = drive.START_NS + (3 * i + 1) * drive.IMAGE_NS
        now, before = (
            path.world_from_vehicle(time_ns) @ camera.vehicle_from_camera
            for time_ns in (now_ns, now_ns - drive.IMAGE_NS)
        )
        reach_m = np.minimum(drive.cast(now.translation_m, now.rotate(rays), boxes), FAR_M)
        places = now.apply(rays * reach_m[:, None])
        pixels_before, valid = model.project(before.inverse().apply(places))
        flow, seen = pixels_before - pixels, valid & grid.valid.ravel() & (reach_m < FAR_M)
        flow[~seen] = np.nan
        at_size = 2 * cv2.resize(flow.reshape(model.height, model.width, 2).astype(np.float32), (WIDTH, HEIGHT))
        points = places[np.random.default_rng(i).permutation(np.flatnonzero(seen))[:POINTS]]
        drawn.append(
            SeenFlow(
                current_ns=now_ns,
                previous_ns=now_ns - drive.IMAGE_NS,
                flow=at_size,
                points_world=points,
                edges_world=np.empty((2, 0, 3)),
                edge_offsets=NO_EDGES,
            )
        )
    return drawn


def measured(flows):
    times_ns = np.array([(flow.current_ns + flow.previous_ns) // 2 for flow in flows])
    return MeasuredMotion(middle_ns=times_ns, errors=np.zeros((PAIRS, 6)), path_m=np.full(PAIRS, 0.5))


def verdict(monkeypatch, root, flows):
    monkeypatch.setattr(cameras, "seen_flows", lambda *_: flows)
    monkeypatch.setattr(cameras, "scan_steps", lambda _: ())
    monkeypatch.setattr(cameras, "measured_motion", lambda *_: measured(flows))
    recording = replace(open_native(root), trajectory=drive.winding_path())
    return cameras.camera_verdict(recording, large(recording.cameras["front"]))


def late(flows, milliseconds):
    offset_ns = milliseconds * 1_000_000
    return [
        replace(flow, current_ns=flow.current_ns + offset_ns, previous_ns=flow.previous_ns + offset_ns)
        for flow in flows
    ]


def test_a_right_camera_passes(monkeypatch, street, flows):
    assert cameras.check_cameras in [check for check, _ in CHECKS]
    assert verdict(monkeypatch, street, flows) is None


def mounted(root, change):
    """The camera's mounting changed, its rotation and place."""
    stated = open_native(root).cameras["front"].vehicle_from_camera
    changed = change(stated)
    change_mounting(
        root, quaternion_wxyz=changed.quaternion_wxyz.tolist(), translation_m=changed.translation_m.tolist()
    )


def turned_by(degrees):
    """To the left."""
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return lambda root: mounted(root, lambda stated: RigidTransform(turn @ stated.rotation, stated.translation_m))


def raised(root):
    mounted(root, lambda stated: RigidTransform(stated.rotation, stated.translation_m + np.array([0.0, 0.0, 0.3])))


def reordered(root):
    w, *xyz = open_native(root).cameras["front"].vehicle_from_camera.quaternion_wxyz.tolist()
    change_mounting(root, quaternion_wxyz=[*xyz, w])


def lens(change):
    return lambda root: change_head(root, lambda head: change(head["cameras"]["front"]["model"]))


def zoomed(factor):
    return lens(lambda model: model.update(coefficients=[factor * number for number in model["coefficients"]]))


def shifted(model):
    model["principal_point"][0] += 20.0


def mirror(root):
    for path in (root / "images" / "front").iterdir():
        cv2.imwrite(str(path), cv2.flip(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), 1))


@pytest.mark.parametrize(
    ("plant", "named"),
    [
        (reordered, "quaternion"),
        (turned_by(3.0), r"camera-calibration .* turned against .* up, \+2\.9 .* degrees to its right"),
        pytest.param(raised, "translation_m.*up", marks=pytest.mark.slow),
        (zoomed(0.95), "focal length"),
        (zoomed(2.0), "focal length"),
        pytest.param(lens(shifted), "principal.point", marks=pytest.mark.slow),
    ],
)
def test_a_planted_mistake_is_named(monkeypatch, root, flows, plant, named):
    plant(root)
    finding = verdict(monkeypatch, root, flows)
    assert isinstance(finding, Finding), finding
    text = f"{finding.check} {finding.field} {finding.got} {finding.hint}"
    assert re.search(named, text), text


def test_mirrored_images(monkeypatch, street, flows):
    assert "with the images mirrored" in verdict(monkeypatch, street, mirrored(flows)).got


@pytest.mark.slow
@pytest.mark.parametrize(("milliseconds", "got", "hint"), [(50, "5. ms late", "subtract"), (-20, "early", "add")])
def test_images_on_another_clock(monkeypatch, street, flows, milliseconds, got, hint):
    finding = verdict(monkeypatch, street, late(flows, milliseconds))
    assert finding.check == "image-clock"
    assert re.search(got, finding.got), finding.got
    assert finding.hint.startswith(hint)


def test_where_little_of_the_flow_fits_images_that_are_clearly_late_are_told_as_a_doubt(monkeypatch, street, flows):
    monkeypatch.setattr(cameras, "SURE", 1.01)
    clean = verdict(monkeypatch, street, flows)
    assert isinstance(clean, Undecided)
    assert "of the flow is that of a static world" in clean.why
    finding = verdict(monkeypatch, street, late(flows, 50))
    assert (finding.check, finding.severity) == ("image-clock", Severity.WARNING)
    assert re.match(r"perhaps images [45]\d ms late .*of the flow is that of a static world", finding.got)
    assert finding.hint.startswith("subtract")


def test_flow_that_no_calibration_predicts_is_a_warning(monkeypatch, street, flows):
    monkeypatch.setattr(cameras, "LEAST_STATIC", 1.01)
    finding = verdict(monkeypatch, street, flows)
    assert (finding.check, finding.severity) == ("camera-flow", Severity.WARNING)
    assert re.fullmatch(r"\d+ % of it; \d+ % by the calibration or clock that fits best", finding.got)


def test_a_drive_without_sweeps_says_why_it_cannot_tell(clean):
    recording = open_native(clean)
    told = cameras.camera_verdict(replace(recording, sweeps=()), recording.cameras["front"])
    assert isinstance(told, Undecided)
    assert told.why == "no lidar"


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "named"), [(None, ""), (mirror, "mirrored"), (turned_by(1.0), "turned against")])
def test_a_rendered_turn_is_clean_and_a_planted_mistake_is_named(turning, tmp_path, plant, named):
    root = shutil.copytree(turning, tmp_path / turning.name)
    if plant is not None:
        plant(root)
    recording = open_native(root)
    finding = cameras.camera_verdict(recording, recording.cameras["front"])
    assert finding is None if plant is None else re.search(named, finding.got)
