"""labelCloud: its three ways of writing boxes, which box is which object, and what is no label file."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.labels import LabelOptions, LabelSet, label_format
from tests.labels import street
from tests.labels.same import assert_same_boxes

PLAIN = LabelOptions()
WAYS = ("centroid-abs", "centroid-rel", "vertices")


def put(folder, stem, content):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.json").write_text(content if isinstance(content, str) else json.dumps(content))


def still(drive):
    return replace(drive, vehicle_from_lidar=RigidTransform.identity())


def labelled(*objects):
    """A file as the tool writes it."""
    return {"folder": "pointclouds", "filename": "a.ply", "path": "pointclouds/a.ply", "objects": list(objects)}


def by_middle(turn, *, name="car", at=(1.0, 2.0, 3.0)):
    return {
        "name": name,
        "centroid": dict(zip("xyz", at, strict=True)),
        "dimensions": {"length": 4.0, "width": 2.0, "height": 1.5},
        "rotations": dict(zip("xyz", turn, strict=True)),
    }


# A box of 4 x 2 x 1.5 m at (1, 2, 3) that is turned to the left by a right angle: its length lies along y.
CORNERS = [
    [2.0, 0.0, 2.25],
    [0.0, 0.0, 2.25],
    [0.0, 4.0, 2.25],
    [2.0, 4.0, 2.25],
    [2.0, 0.0, 3.75],
    [0.0, 0.0, 3.75],
    [0.0, 4.0, 3.75],
    [2.0, 4.0, 3.75],
]


@pytest.mark.parametrize(
    ("way", "entry"),
    [
        ("centroid-abs", by_middle((0, 0, 90))),
        ("centroid-rel", by_middle((0, 0, np.pi / 2))),
        ("vertices", {"name": "car", "vertices": CORNERS}),
    ],
)
def test_a_box_by_hand(tmp_path, drive, way, entry):
    put(tmp_path / "labels", "000001", labelled(entry))
    put(tmp_path / "labels", "000002", labelled())
    label_set = label_format(f"labelcloud-{way}").read(tmp_path, still(drive), PLAIN)
    assert label_set.timestamps_ns == street.TIMES_NS[1:3]
    (track,) = label_set.tracks
    shape = track.states[0].shape
    assert (track.track_id, track.object_class) == ("car-1", "vehicle")
    assert shape.size_m == pytest.approx([4.0, 2.0, 1.5])
    assert shape.vehicle_from_object.translation_m == pytest.approx([1.0, 2.0, 3.0])
    assert shape.vehicle_from_object.rotation == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12)


def test_angles_turn_about_x_then_the_fixed_y_then_the_fixed_z(tmp_path, drive):
    x, y, z = 0.3, -0.2, 1.1
    about_x, about_y, about_z = street.about_axes(x, y, z)
    put(tmp_path, "000000", labelled(by_middle((x, y, z))))
    (track,) = label_format("labelcloud-centroid-rel").read(tmp_path, still(drive), PLAIN).tracks
    assert track.states[0].shape.vehicle_from_object.rotation == pytest.approx(about_z @ about_y @ about_x, abs=1e-12)


def test_areas_that_nobody_looked_at_are_ignored(tmp_path, drive):
    put(tmp_path, "000000", labelled(by_middle((0, 0, 0), name="DontCare"), by_middle((0, 0, 0), at=(20.0, 2.0, 3.0))))
    label_set = label_format("labelcloud-centroid-rel").read(tmp_path, drive, PLAIN)
    assert {track.track_id: track.states[0].unclear for track in label_set.tracks} == {
        "DontCare-1": True,
        "car-1": False,
    }


@pytest.mark.parametrize("way", WAYS)
def test_there_and_back(tmp_path, drive, way):
    """The tool numbers no objects: those that come back are followed, and called after their class."""
    form = label_format(f"labelcloud-{way}")
    tracks = street.label_set().tracks
    lost = form.write(street.label_set(), drive, tmp_path / "out", PLAIN)
    assert lost == (
        "which boxes are one object: labelCloud numbers none of the 3",
        "18 velocities: no field for them",
        "6 yaw rates: no field for them",
    )
    label_set = form.read(tmp_path / "out", drive, PLAIN)
    assert label_set.timestamps_ns == street.TIMES_NS
    assert label_set.lost == ("labelCloud numbers no objects: 18 boxes followed by proximity make 3 objects",)
    renamed = {"pedestrian-1": "walker", "vehicle-1": "car", "vehicle-2": "parked"}
    back = {renamed[track.track_id]: replace(track, track_id=renamed[track.track_id]) for track in label_set.tracks}
    assert_same_boxes([back[track.track_id] for track in tracks], tracks)
    for state in back["car"].states:
        world = drive.trajectory.world_from_vehicle(state.timestamp_ns).rotate(state.velocity_mps)
        assert world == pytest.approx(street.CAR_MPS, abs=1e-6)


def test_the_class_definition(tmp_path, drive):
    form = label_format("labelcloud-centroid-rel")
    options = LabelOptions(classes={"lorry": "vehicle"})
    form.write(LabelSet(tracks=(street.box_track("car"),), timestamps_ns=()), drive, tmp_path, options)
    told = json.loads((tmp_path / "labels/_classes.json").read_text())
    assert [(c["name"], c["id"]) for c in told["classes"]] == [
        ("pedestrian", 0),
        ("cyclist", 1),
        ("lorry", 2),
        ("animal", 3),
    ]
    assert all(re.fullmatch("#[0-9A-F]{6}", c["color"]) for c in told["classes"])
    assert (told["default"], told["type"], told["format"]) == (0, "object_detection", "centroid_rel")
    file = json.loads((tmp_path / "labels/000000.json").read_text())
    assert (file["folder"], file["filename"], file["path"]) == ("pointclouds", "000000.npz", "pointclouds/000000.npz")
    assert [entry["name"] for entry in file["objects"]] == ["lorry"]
    with pytest.raises(
        DataError,
        match="format: expected centroid_abs, as asked for, got centroid_rel; read it as labelcloud-centroid-rel",
    ):
        label_format("labelcloud-centroid-abs").read(tmp_path, drive, options)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"classes": [], "type": "semantic_segmentation", "format": "ndarray"}, "type: expected object_detection"),
        ({"classes": [], "type": "object_detection", "format": "kitti"}, "got kitti; export the labels"),
        ({"classes": []}, "type: expected a value"),
        ("{", "expected JSON"),
    ],
)
def test_definitions_of_other_labels(tmp_path, drive, content, message):
    put(tmp_path, "_classes", content)
    put(tmp_path, "000000", labelled())
    with pytest.raises(DataError, match=message):
        label_format("labelcloud-centroid-abs").read(tmp_path, drive, PLAIN)


def test_two_that_pass_each_other_keep_their_names(tmp_path, drive):
    """At 3 m/s against each other, a metre apart where they meet."""
    for i, time_ns in enumerate(street.TIMES_NS):
        vehicle_from_world = drive.trajectory.world_from_vehicle(time_ns).inverse()
        places = [np.array([10.0, 0.75 - 0.3 * i, 1.0]), np.array([11.0, -0.75 + 0.3 * i, 1.0])]
        entries = [by_middle((0, 0, 0), name="walker", at=vehicle_from_world.apply(place).tolist()) for place in places]
        put(tmp_path, f"{i:06d}", labelled(*(entries if i % 2 else reversed(entries))))
    label_set = label_format("labelcloud-centroid-abs").read(
        tmp_path, still(drive), LabelOptions(classes={"walker": "pedestrian"})
    )
    assert sorted(len(track.states) for track in label_set.tracks) == [6, 6]
    for track in label_set.tracks:
        speeds = [drive.trajectory.world_from_vehicle(s.timestamp_ns).rotate(s.velocity_mps)[1] for s in track.states]
        assert np.abs(speeds) == pytest.approx(np.full(6, 3.0), abs=1e-6)
        assert len(set(np.sign(speeds))) == 1


def test_what_is_far_away_is_another(tmp_path, drive):
    put(tmp_path, "000000", labelled(by_middle((0, 0, 0))))
    put(tmp_path, "000001", labelled(by_middle((0, 0, 0), at=(1.0, 9.0, 3.0))))
    label_set = label_format("labelcloud-centroid-abs").read(tmp_path, still(drive), PLAIN)
    assert [(t.track_id, len(t.states)) for t in label_set.tracks] == [("car-1", 1), ("car-2", 1)]
    assert np.isnan(label_set.tracks[0].states[0].velocity_mps).all()


def mirrored():
    return [[x, -y, z] for x, y, z in CORNERS]


@pytest.mark.parametrize(
    ("way", "content", "message"),
    [
        ("centroid-abs", "[]", "expected"),
        ("centroid-abs", {"objects": [{"name": "car", "vertices": CORNERS}]}, "objects.0.centroid: expected a value"),
        ("centroid-abs", labelled(by_middle((0, 0, -1))), "objects.0.rotations: expected degrees from 0 to 360"),
        ("centroid-abs", labelled(by_middle((0, 0, 361))), "objects.0.rotations: expected degrees from 0 to 360"),
        ("centroid-rel", labelled(by_middle((0, 0, 90))), "objects.0.rotations: expected radians from -pi to pi"),
        (
            "centroid-abs",
            json.dumps(labelled(by_middle((0, 0, 0)))).replace("4.0", "0"),
            "length: expected greater than 0",
        ),
        (
            "centroid-abs",
            json.dumps(labelled(by_middle((0, 0, 0)))).replace("4.0", "NaN"),
            "length: expected a finite number",
        ),
        ("centroid-abs", labelled(by_middle((0, 0, 0), name="")), "name: expected"),
        ("centroid-abs", "{" * 100_000, "expected JSON"),
        ("vertices", labelled({"name": "car", "vertices": CORNERS[:7]}), "vertices: expected"),
        (
            "vertices",
            labelled({"name": "car", "vertices": [*CORNERS[:7], [2.0, 4.0, 4.75]]}),
            "vertices: expected the corners of a box",
        ),
        ("vertices", labelled({"name": "car", "vertices": mirrored()}), "mirrored or slanted"),
        (
            "vertices",
            labelled({"name": "car", "vertices": [CORNERS[0]] * 8}),
            "vertices: expected the corners of a box",
        ),
        (
            "vertices",
            labelled({"name": "car", "vertices": [[x + y / 9, y, z] for x, y, z in CORNERS]}),
            "mirrored or slanted",
        ),
    ],
)
def test_what_is_no_label_file(tmp_path, drive, way, content, message):
    put(tmp_path, "000000", content)
    with pytest.raises(DataError, match=message) as caught:
        label_format(f"labelcloud-{way}").read(tmp_path, drive, PLAIN)
    assert "000000.json" in str(caught.value)


def test_rounded_corners_are_still_a_box(tmp_path, drive):
    """labelCloud rounds to as many decimals as it is told, eight by default."""
    pose = RigidTransform.from_quaternion((0.9, 0.1, -0.05, 0.4), (12.0, -7.0, 0.5))
    corners = pose.apply((np.array(CORNERS) - [1, 2, 3]) @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]))
    put(tmp_path, "000000", labelled({"name": "car", "vertices": corners.round(4).tolist()}))
    (track,) = label_format("labelcloud-vertices").read(tmp_path, still(drive), PLAIN).tracks
    assert track.states[0].shape.vehicle_from_object.matrix == pytest.approx(pose.matrix, abs=1e-3)
    assert track.states[0].shape.size_m == pytest.approx([4.0, 2.0, 1.5], abs=1e-3)
