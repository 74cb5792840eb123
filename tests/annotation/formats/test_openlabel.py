"""OpenLABEL of other tools: files by hand in every way the standard leaves open, there and back, and hostile ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.annotation.formats import LabelOptions, LabelSet, import_labels, label_format
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import read_sweep
from bench.recordings import (
    GroundPolygon,
    ObjectState,
    PointIndices,
    SweepRef,
    Track,
    read_annotations,
    write_annotations,
)
from tests.annotation.formats import street
from tests.annotation.formats.same import assert_same_boxes, written
from tests.support.real import REAL, needs_real

PLAIN = LabelOptions()
OPENLABEL = label_format("openlabel")
BOX = [10.0, 2.0, -0.5, 0.0, 0.0, 0.0, 1.0, 4.5, 1.75, 1.5]
HALF = 0.5**0.5


def entry(val, system=None, name="box3D", **more):
    return {"name": name, "val": val, **({} if system is None else {"coordinate_system": system}), **more}


def document(frames, *, objects=None, systems=None, version="1.0.0", **more):
    root = {
        "metadata": {"schema_version": version, "tagged_file": "../x"},
        "objects": objects or {"0": {"name": "a", "type": "Car"}},
        "frames": frames,
        "coordinate_systems": {"vehicle": {"type": "local_cs", "parent": "", "children": []}}
        if systems is None
        else systems,
        **more,
    }
    return {"openlabel": root}


def frame(*cuboids, time=street.TIMES_NS[0], uid="0", **properties):
    if time is not None:
        properties["timestamp"] = time
    return {"frame_properties": properties, "objects": {uid: {"object_data": {"cuboid": list(cuboids)}}}}


def read(tmp_path, drive, content, options=PLAIN):
    file = tmp_path / "labels.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return import_labels("openlabel", file, drive, options)


def only(label_set):
    ((state,),) = (track.states for track in label_set.tracks)
    return state


def pose(state):
    return state.shape.vehicle_from_object


def test_ten_values_in_the_local_system(tmp_path, drive):
    turned = [10.0, 2.0, 0.5, 0.0, 0.0, HALF, HALF, 4.5, 1.75, 1.5]
    state = only(read(tmp_path, drive, document({"0": frame(entry(turned, "vehicle"))})))
    assert state.timestamp_ns == street.TIMES_NS[0]
    assert pose(state).translation_m == pytest.approx([10.0, 2.0, 0.5])
    assert pose(state).rotation == pytest.approx(RigidTransform.from_yaw(np.pi / 2).rotation)
    assert state.shape.size_m.tolist() == [4.5, 1.75, 1.5]


def test_nine_values_turn_about_x_then_y_then_z_as_they_stand(tmp_path, drive):
    angles = (0.1, -0.2, 0.5)
    state = only(
        read(tmp_path, drive, document({"0": frame(entry([1.0, 2.0, 3.0, *angles, 4.0, 2.0, 1.5], "vehicle"))}))
    )
    about_x, about_y, about_z = street.about_axes(*angles)
    assert pose(state).rotation == pytest.approx(about_z @ about_y @ about_x, abs=1e-12)


def poses(rotation, translation_m):
    """The same pose in the two ways of the standard."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation_m
    return [
        {"matrix4x4": matrix.ravel().tolist()},
        {"quaternion": rotation.as_quat().tolist(), "translation": list(translation_m)},
    ]


TOP = RigidTransform(Rotation.from_euler("xyz", [0.02, 0.1, -1.6]).as_matrix(), np.array([0.3, 0.1, -0.2]))


@pytest.mark.parametrize("said", ["stream", "option"])
@pytest.mark.parametrize("way", range(2))
def test_boxes_in_another_sensor_reach_the_vehicle_over_the_lidar(tmp_path, drive, way, said):
    """The recording says where its lidar is; the file says where the sensor is on the lidar, and which is the lidar."""
    systems = {
        "base": {"type": "local_cs", "parent": "", "children": ["VELO_TOP"]},
        "VELO_TOP": {
            "type": "sensor_cs",
            "parent": "base",
            "pose_wrt_parent": poses(Rotation.identity(), [9, 9, 9])[0],
        },
        "RADAR": {
            "type": "sensor_cs",
            "parent": "VELO_TOP",
            "pose_wrt_parent": poses(Rotation.from_matrix(TOP.rotation), TOP.translation_m)[way],
        },
    }
    sensor_from_box = RigidTransform(Rotation.from_euler("z", 0.4).as_matrix(), np.array([3.0, 1.0, 0.5]))
    w, x, y, z = sensor_from_box.quaternion_wxyz.tolist()
    content = document({"0": frame(entry([3.0, 1.0, 0.5, x, y, z, w, 4.0, 1.5, 1.75], "RADAR"))}, systems=systems)
    options = LabelOptions(frames={"VELO_TOP": "lidar"}) if said == "option" else PLAIN
    if said == "stream":
        content["openlabel"]["streams"] = {"VELO_TOP": {"type": "lidar", "uri": "", "description": ""}}
    state = only(read(tmp_path, drive, content, options))
    vehicle_from_box = drive.vehicle_from_lidar @ TOP @ sensor_from_box
    assert pose(state).translation_m == pytest.approx(vehicle_from_box.translation_m, abs=1e-9)
    assert pose(state).rotation == pytest.approx(vehicle_from_box.rotation, abs=1e-9)
    assert state.shape.size_m.tolist() == [4.0, 1.5, 1.75]
    if said == "option":
        with pytest.raises(
            DataError, match=r"cuboid.coordinate_system: expected a system that is, .* got 'RADAR'; say"
        ):
            read(tmp_path, drive, content)


def test_boxes_in_the_world_follow_the_pose_of_their_frame(tmp_path, drive):
    systems = {
        "odom": {"type": "scene_cs", "parent": "", "children": ["base"]},
        "base": {"type": "local_cs", "parent": "odom", "children": []},
    }
    frames = {}
    for i in range(3):
        moved = {
            "src": "base",
            "dst": "odom",
            "transform_src_to_dst": poses(Rotation.identity(), [float(i), 0.0, 0.0])[0],
        }
        frames[str(i)] = frame(entry(BOX, "odom"), time=street.TIMES_NS[i], transforms={"any name": moved})
    options = LabelOptions(frames={"base": "vehicle"})
    (track,) = read(tmp_path, drive, document(frames, systems=systems), options).tracks
    assert [pose(state).translation_m[0] for state in track.states] == pytest.approx([10.0, 9.0, 8.0])


@pytest.mark.parametrize(
    ("written", "unit_ns"),
    [
        (street.TIMES_NS[1], 1),
        (str(street.TIMES_NS[1]), 1),
        (street.TIMES_NS[1] // 1000, 1000),
        (street.TIMES_NS[1] // 1_000_000, 1_000_000),
        (street.TIMES_NS[1] / 1e9, 10**9),
        (f"{street.TIMES_NS[1] / 1e9:.6f}", 10**9),
    ],
)
def test_times_are_in_the_unit_that_the_user_says(tmp_path, drive, written, unit_ns):
    content = document({"7": frame(entry(BOX, "vehicle"), time=written)})
    assert only(read(tmp_path, drive, content, LabelOptions(unit_ns=unit_ns))).timestamp_ns == street.TIMES_NS[1]
    if unit_ns > 1:
        with pytest.raises(DataError, match=r"frames: timestamp: expected times of the recording.*--time-unit"):
            read(tmp_path, drive, content)


def test_frames_without_times_pair_by_their_numbers(tmp_path, drive):
    plain = document({"3": frame(entry(BOX, "vehicle"), time=None)})
    assert only(read(tmp_path, drive, plain)).timestamp_ns == street.TIMES_NS[3]  # 000003.npz
    plain = document({"12": frame(entry(BOX, "vehicle"), time=5)})
    assert only(read(tmp_path, drive, plain, LabelOptions(first_frame=10))).timestamp_ns == street.TIMES_NS[2]


def test_boxes_without_a_frame_are_asked_for(tmp_path, drive):
    content = document({"0": frame(entry(BOX))}, systems={})
    with pytest.raises(DataError, match=r"coordinate_system: expected .* got none; say what it is with --frame"):
        read(tmp_path, drive, content)
    state = only(read(tmp_path, drive, content, LabelOptions(frames={"": "lidar"})))
    assert pose(state).translation_m == pytest.approx(drive.vehicle_from_lidar.apply(np.array(BOX[:3])))


def test_boxes_whose_height_is_not_along_z_are_refused(tmp_path, drive):
    """As those that are labelled in the axes of a camera."""
    lying = [10.0, 2.0, 0.5, -np.pi / 2, 0.0, 0.0, 4.5, 1.5, 1.75]
    with pytest.raises(DataError, match=r"cuboid.val: expected a box whose z points up, got one at 90 degrees"):
        read(tmp_path, drive, document({"0": frame(entry(lying, "vehicle"))}))


@needs_real
def test_the_example_of_the_standard_is_read(drive):
    """141 frames, some with the time of another; its frames are counted, and its boxes are in a vehicle frame."""
    file = REAL / "labels/openlabel/asam_example_cuboids.json"
    options = LabelOptions(classes={"egocar": None}, frames={"vehicle-iso8855": "vehicle"}, unit_ns=10**9)
    sweeps = tuple(
        SweepRef(timestamp_ns=street.FIRST_NS + i * street.STEP_NS, path=Path(f"{i}.bin"), reader=read_sweep)
        for i in range(538, 679)
    )
    drive = replace(drive, sweeps=sweeps)
    with pytest.raises(DataError, match="frames: timestamp: expected"):
        OPENLABEL.read(file, drive, options)
    label_set = import_labels("openlabel", file, drive, replace(options, first_frame=538))
    assert len(label_set.timestamps_ns) == 141
    assert sum(len(track.states) for track in label_set.tracks) > 326


def test_what_has_no_place_is_told(tmp_path, drive):
    attributes = {"text": [{"name": "occlusion", "val": "partly"}]}
    shown = frame(entry(BOX, "vehicle", attributes=attributes), entry(BOX, "vehicle"))
    shown["objects"]["0"]["object_data"] |= {
        "bbox": [{"name": "b", "val": [1, 2, 3, 4]}],
        "boolean": [{"name": "is_moving", "val": True}],
        "text": [{"name": "category", "val": "vehicle.car"}],
        "poly2d": [{"name": "outline", "val": [1, 2], "mode": "MODE_POLY2D_ABSOLUTE", "closed": True}],
    }
    objects = {"0": {"name": "a", "type": "Car"}, "1": {"name": "b", "type": "Sign"}, "2": {"name": "c", "type": "Car"}}
    content = document({"0": shown}, objects=objects, actions={"0": {"name": "", "type": "moves"}})
    label_set = read(tmp_path, drive, content, LabelOptions(classes={"Sign": None}))
    assert {
        "1 bbox 'b': no field for it",
        "1 poly2d 'outline': no field for it",
        "1 boolean 'is_moving': no field for it",
        "1 text 'category' that is no kind of motion: no field for it",
        "1 text attributes of cuboid: no field for them",
        "1 cuboid 'box3D': no field for it",
        "2 objects without any cuboid or outline in a frame, left out",
        "actions: no field for them",
    } <= set(label_set.lost)


def full_layer():
    """Everything that annotations can say."""
    car = street.box_track("car")
    first = replace(car.states[0], category="crossing", unclear=True)
    outline = GroundPolygon(outline_m=np.array([[4.0, 1.0], [5.0, 1.0], [5.0, 2.0]]), bottom_m=0.1, top_m=1.7)
    indexed = PointIndices(indices=np.array([3, 1, 4]), sweep_timestamp_ns=street.TIMES_NS[1])
    between_ns = street.TIMES_NS[1] + 33_000_000
    unknown = np.full(3, np.nan)
    walker = (
        ObjectState(timestamp_ns=street.TIMES_NS[1], shape=outline, velocity_mps=np.array([0.0, 1.0, 0.0])),
        ObjectState(timestamp_ns=between_ns, shape=indexed, velocity_mps=unknown),
    )
    tracks = (
        replace(car, states=(first, *car.states[1:]), instance_id=9),
        Track(track_id="the walker", object_class="pedestrian", states=walker),
    )
    return LabelSet(tracks=tracks, timestamps_ns=tuple(sorted({*street.TIMES_NS, between_ns})))


def test_everything_comes_back(tmp_path, drive):
    label_set = full_layer()
    assert written(OPENLABEL, label_set, drive, tmp_path / "out") == ()
    found = import_labels("openlabel", tmp_path / "out", drive, PLAIN)
    assert found.lost == ()
    assert found.timestamps_ns == label_set.timestamps_ns
    assert_same_boxes(found.tracks[:1], label_set.tracks[:1])
    assert [track.instance_id for track in found.tracks] == [9, None]
    for one, other in zip(found.tracks, label_set.tracks, strict=True):
        for state, true in zip(one.states, other.states, strict=True):
            assert np.array_equal(state.velocity_mps, true.velocity_mps, equal_nan=True)
            assert (state.category, state.unclear) == (true.category, true.unclear)
            assert state.yaw_rate_radps == true.yaw_rate_radps
    outline, indexed = (state.shape for state in found.tracks[1].states)
    assert outline.outline_m.tolist() == [[4.0, 1.0], [5.0, 1.0], [5.0, 2.0]]
    assert (outline.bottom_m, outline.top_m) == (0.1, 1.7)
    assert (indexed.indices.tolist(), indexed.sweep_timestamp_ns) == ([3, 1, 4], street.TIMES_NS[1])


def test_the_written_file_keeps_to_the_standard(tmp_path, drive):
    written(OPENLABEL, full_layer(), drive, tmp_path / "out", LabelOptions(classes={"Car": "vehicle"}))
    root = json.loads((tmp_path / "out/openlabel.json").read_text())["openlabel"]
    assert set(root) <= {"metadata", "coordinate_systems", "objects", "frames", "frame_intervals"}
    assert all(uid.isdigit() for uid in root["objects"])
    assert {item["name"]: item["type"] for item in root["objects"].values()} == {
        "car": "Car",
        "the walker": "pedestrian",
    }
    for item in root["objects"].values():
        assert set(item) <= {"name", "type", "object_data"}
    for shown in root["frames"].values():
        assert set(shown["objects"]) <= set(root["objects"])
    for name, system in root["coordinate_systems"].items():
        assert set(system) >= {"type", "parent"}
        assert all(root["coordinate_systems"][child]["parent"] == name for child in system["children"])
    lidar = root["coordinate_systems"]["lidar"]["pose_wrt_parent"]
    assert lidar["translation"] == pytest.approx([1.2, 0.1, 1.8])


def test_our_own_annotation_files_are_read(tmp_path, drive):
    label_set = full_layer()
    write_annotations(tmp_path / "street.json", label_set.tracks, timestamps_ns=label_set.timestamps_ns)
    found = import_labels("openlabel", tmp_path / "street.json", drive, PLAIN)
    assert_same_boxes(found.tracks[:1], label_set.tracks[:1])
    write_annotations(tmp_path / "again.json", found.tracks, timestamps_ns=found.timestamps_ns)
    assert [track.track_id for track in read_annotations(tmp_path / "again.json")] == ["car", "the walker"]


ONE = {"0": frame(entry(BOX, "vehicle"))}
LOOP = {
    "a": {"type": "scene_cs", "parent": "b", "pose_wrt_parent": {"matrix4x4": np.eye(4).ravel().tolist()}},
    "b": {"type": "scene_cs", "parent": "a", "pose_wrt_parent": {"matrix4x4": np.eye(4).ravel().tolist()}},
    "vehicle": {"type": "local_cs", "parent": ""},
}


def systems(posed):
    return {
        "vehicle": {"type": "local_cs", "parent": ""},
        "c": {"type": "sensor_cs", "parent": "vehicle", "pose_wrt_parent": posed},
    }


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "expected JSON"),
        ("[" * 100_000, "expected JSON"),
        ({"vcd": {}}, "openlabel: expected a value, got nothing"),
        (document({}, version="0.3.0"), "metadata.schema_version: expected .*, got '0.3.0'"),
        (document({"x": frame()}), "frames"),
        (document({"0": frame(entry(BOX), uid="5")}), "frames.0.objects.5: expected an object listed"),
        (document({"0": frame(entry(BOX[:8], "vehicle"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:9], "1"], "vehicle"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (
            document({"0": frame(entry([*BOX[:9], -1.0], "vehicle"))}),
            "cuboid.0.val: expected numbers 8 to 10 to be",
        ),
        (document({"0": frame(entry([*BOX[:9], 1e400], "vehicle"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:9], 10**400], "vehicle"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:6], 2.0, *BOX[7:]], "vehicle"))}), "quaternion x, y, z, w of length 1"),
        (document({"0": frame(entry(BOX, "moon"))}), "cuboid.coordinate_system: expected .*, got 'moon'"),
        (
            document({"0": frame(entry(BOX, "a"))}, systems=LOOP),
            "one of vehicle, lidar, world, got 'a'",
        ),
        (
            document(ONE, systems=systems({"matrix4x4": [1.0] * 15})),
            "matrix4x4: expected 16 numbers, the last",
        ),
        (
            document(ONE, systems=systems({"matrix4x4": [1.0] * 16})),
            "matrix4x4: expected 16 numbers, the last",
        ),
        (document(ONE, systems=systems({"matrix4x4": [10**400] * 16})), "matrix4x4.0: expected a finite number"),
        (document(ONE, systems=systems({"quaternion": [0, 0, 0, 0], "translation": [0, 0, 0]})), "of length 1"),
        (
            document(ONE, systems=systems({"quaternion": [0, 0, 0, 1]})),
            "or a quaternion with a translation",
        ),
        (document(ONE, systems=systems({"euler_angles": [0, 0, 0], "translation": [0, 0, 0]})), "got neither"),
        (document({"0": frame(entry(BOX), time=5)}), "expected times of the recording, .* got 5"),
        (document({"0": frame(entry(BOX), time="noon")}), "expected a number in each frame, got 'noon'"),
        (document({"0": frame(entry(BOX), time="nan")}), "expected a number in each frame, got 'nan'"),
        (document({"0": frame(entry(BOX), time="9" * 70)}), "expected a number in each frame"),
        (
            document({"0": frame(entry(BOX), time="1E+999999999")}),
            r"a number in each frame, got '1E\+999999999'",
        ),
        (document({"0": frame(entry(BOX)), "1": frame(entry(BOX), time=None)}), "frames.1.frame_properties.timestamp"),
        (
            document({"0": frame(entry(BOX)), "1": frame(entry(BOX))}),
            "expected one frame for each time",
        ),
        (document({}), "openlabel.frames: expected frames, to pair with sweeps, got none"),
        (document({"99": frame(entry(BOX), time=None)}), "frames: expected frames named like the 6 sweeps"),
        (document(ONE, objects={"0": {"name": "a", "type": "Yeti"}}), "got 'Yeti'"),
    ],
)
def test_every_fault_has_its_place(tmp_path, drive, content, told):
    with pytest.raises(DataError, match=told):
        read(tmp_path, drive, content)
