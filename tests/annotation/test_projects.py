"""Projects for labelling tools, by the command, and back by the import of the tool's labels."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from bench.annotation import store
from bench.annotation.decisions import decide
from bench.annotation.export import to_tracks
from bench.labels.projects import pinhole_views, write_project
from bench.recordings import Cuboid, read_annotations
from bench.reference.clusters import object_cluster
from bench.reference.sweeps import pose_sweep
from tests.labels.same import assert_same_boxes
from tests.support.commands import called_here, error_line
from tests.support.reviews import DRIVE, MADE, proposed_from, stored

FORMATS = {"sustechpoints": "sustechpoints", "cvat": "cvat-tracklets", "labelcloud": "labelcloud-centroid-abs"}
CLOUDS = {"sustechpoints": "lidar", "cvat": "pointcloud", "labelcloud": "pointclouds"}
CAMERAS = {
    "sustechpoints": "camera/front_middle/{}.jpg", "cvat": "related_images/{}_pcd/front.jpg",
    "labelcloud": "pointclouds/{}.jpg",
}  # fmt: skip


@pytest.fixture
def unfinished(card, drive):
    """A review in which one track was rejected and the others are open."""
    review = proposed_from(drive)
    review = decide(review, store.Reject(**MADE, tracks=(review.tracks[-1].id,)))
    stored(card, review)
    return review


@pytest.mark.parametrize("tool", FORMATS)
def test_a_project_comes_back_with_its_boxes(card, drive, unfinished, tool, tmp_path):
    out = tmp_path / "projects"
    ended = called_here("annotate", "export", card, "--out", out, "--labelling", tool)
    assert ended.returncode == 0, ended.stderr
    assert f"annotations import {FORMATS[tool]} {out / DRIVE}" in ended.stdout + ended.stderr
    clouds = sorted((out / DRIVE / CLOUDS[tool]).glob("*.pcd"))
    assert [len(replace(ref, path=cloud).read().points_lidar) for ref, cloud in zip(drive.sweeps, clouds, strict=True)]
    frames = [cloud.stem for cloud in clouds]
    assert all((out / DRIVE / CAMERAS[tool].format(frame)).stat().st_size > 1000 for frame in frames)
    back = tmp_path / "back"
    ended = called_here(
        "annotations", "import", FORMATS[tool], out / DRIVE, "--dataset", card, "--recording", DRIVE, "--out", back
    )
    assert ended.returncode == 0, ended.stderr
    found = read_annotations(back / f"{DRIVE}.json")
    expected = to_tracks(unfinished, drive, unreviewed=True)
    assert len(expected) == len(drive.tracks) - 1
    if tool == "labelcloud":  # numbers no objects
        found = sorted(found, key=lambda track: [np.round(place(state), 2).tolist() for state in track.states])
        expected = sorted(expected, key=lambda track: [np.round(place(state), 2).tolist() for state in track.states])
    assert_same_boxes(found, expected, names=tool != "labelcloud", within=1e-3)


def place(state):
    return state.shape.vehicle_from_object.translation_m


def points_in_boxes(drive, folder, tracks):
    """Points of each frame's cloud inside of its boxes, lidar frame."""
    count = 0
    for ref, file in zip(drive.sweeps, sorted(folder.iterdir()), strict=True):
        points = drive.vehicle_from_lidar.apply(replace(ref, path=file).read().points_lidar.astype(np.float64))
        for track in tracks:
            for state in track.states:
                if state.timestamp_ns == ref.timestamp_ns and isinstance(state.shape, Cuboid):
                    local = np.abs(state.shape.vehicle_from_object.inverse().apply(points))
                    count += int((local <= state.shape.size_m / 2).all(axis=1).sum())
    return count


def test_points_are_moved_to_the_time_of_their_sweep(drive, tmp_path):
    returns = 0
    for ref in drive.sweeps:
        placed = pose_sweep(ref.read(), drive.trajectory, drive.vehicle_from_lidar, drive.lidar_from_sensor)
        world = drive.trajectory.world_from_vehicle(ref.timestamp_ns)
        for track in drive.tracks:
            for state in track.states:
                if state.timestamp_ns == ref.timestamp_ns:
                    velocity = world.rotate(state.velocity_mps)
                    cluster = object_cluster(
                        placed, state, velocity_world_mps=velocity, world_from_vehicle=world,
                        exposure_ns=ref.timestamp_ns, clearance_m=0.1,
                    )  # fmt: skip
                    returns += len(cluster.rows)
    for points in ("deskewed", "recorded"):
        write_project(drive, tmp_path / points, tool="cvat", points=points)
    moved, left = (points_in_boxes(drive, tmp_path / p / "pointcloud", drive.tracks) for p in ("deskewed", "recorded"))
    assert moved >= 0.98 * returns > 0
    assert moved > left
    first = drive.sweeps[0]
    raw = first.read().points_lidar
    kept = replace(first, path=min((tmp_path / "recorded/pointcloud").iterdir())).read().points_lidar
    np.testing.assert_allclose(kept, raw, atol=1e-4)


def test_calibration_of_sustechpoints_fits_its_images(drive, tmp_path):
    """What `intrinsic` and `extrinsic` put at a pixel of a view is what the lens put at the place it was taken from."""
    write_project(drive, tmp_path / "scene", tool="sustechpoints")
    name, camera = next(iter(drive.cameras.items()))
    views = pinhole_views(camera)
    assert [view.name for view in views] == [f"{name}_{side}" for side in ("left", "middle", "right")]
    camera_from_lidar = camera.vehicle_from_camera.inverse() @ drive.vehicle_from_lidar
    axes = []
    for view in views:
        calibration = json.loads((tmp_path / "scene/calib/camera" / f"{view.name}.json").read_text())
        extrinsic = np.array(calibration["extrinsic"]).reshape(4, 4)
        intrinsic = np.array(calibration["intrinsic"]).reshape(3, 3)
        u, v = camera.model.width // 3, camera.model.height // 2
        point_lidar = np.linalg.inv(extrinsic) @ [*(8.0 * np.linalg.inv(intrinsic) @ [u, v, 1.0]), 1.0]
        (pixel,), (valid,) = camera.model.project(camera_from_lidar.apply(point_lidar[None, :3]))
        assert valid
        np.testing.assert_allclose(view.positions[v, u], pixel, atol=0.01)
        axes.append(np.linalg.inv(extrinsic)[:3, 2])
    assert all(a @ b < np.cos(np.radians(50)) for a, b in combinations(axes, 2))


def test_the_task_of_cvat_has_labels_that_carry_ids(drive, tmp_path):
    write_project(drive, tmp_path / "task", tool="cvat")
    labels = json.loads((tmp_path / "task/labels.json").read_text())
    written = (tmp_path / "task/tracklet_labels.xml").read_text()
    assert all(label["attributes"][0]["name"] == "id" for label in labels)
    assert all(f"<value>{track.track_id}</value>" in written for track in drive.tracks)


def test_a_project_that_is_there_is_not_touched(card, unfinished, tmp_path, monkeypatch, capsys):
    out = tmp_path / "projects"
    (out / DRIVE / "label").mkdir(parents=True)
    (out / DRIVE / "label" / "work.json").write_text("[]")
    words = ("annotate", "export", card, "--out", out, "--labelling")
    assert "a new or an empty folder" in error_line(monkeypatch, capsys, *words, "sustechpoints")
    assert [path.name for path in out.rglob("*") if path.is_file()] == ["work.json"]
    assert [path.name for path in out.iterdir()] == [DRIVE]
    assert "--labels as well" in error_line(monkeypatch, capsys, *words, "cvat", "--labels", "openlabel")


def test_a_project_that_cannot_be_finished_leaves_nothing(drive, tmp_path):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"no sweep")
    drive = replace(drive, sweeps=(*drive.sweeps[:-1], replace(drive.sweeps[-1], path=broken)))
    with pytest.raises(store.DataError, match="broken"):
        write_project(drive, tmp_path / "out" / "scene", tool="labelcloud")
    assert list((tmp_path / "out").iterdir()) == []
