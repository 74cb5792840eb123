"""OpenLABEL of other tools: files by hand in every way the standard leaves open, there and back, and hostile ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.annotation.formats.conversion import LabelOptions, import_labels, label_format
from bench.errors import DataError
from bench.lidar.files import read_sweep
from bench.recordings import SweepRef
from tests.annotation.formats import street
from tests.annotation.formats.street import assert_same_boxes, written
from tests.support.real import REAL, needs_real

PLAIN = LabelOptions()
OPENLABEL = label_format("openlabel")
BOX = [10.0, 2.0, -0.5, 0.0, 0.0, 0.0, 1.0, 4.5, 1.75, 1.5]


def entry(val, system=None, name="box3D", **more):
    return {"name": name, "val": val, **({} if system is None else {"coordinate_system": system}), **more}


def document(frames, *, objects=None, version="1.0.0", **more):
    root = {
        "metadata": {"schema_version": version, "tagged_file": "../x"},
        "objects": objects or {"0": {"name": "a", "type": "Car"}},
        "frames": frames,
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


def test_nine_values_turn_about_x_then_y_then_z_as_they_stand(tmp_path, drive):
    angles = (0.1, -0.2, 0.5)
    box = [1.0, 2.0, 3.0, *angles, 4.0, 2.0, 1.5]
    state = only(read(tmp_path, drive, document({"0": frame(entry(box, "vehicle"))})))
    about_x, about_y, about_z = street.about_axes(*angles)
    assert pose(state).rotation == pytest.approx(about_z @ about_y @ about_x, abs=1e-12)


@pytest.mark.parametrize(("system", "frames"), [("lidar", {}), ("VELO", {"VELO": "lidar"}), (None, {"": "lidar"})])
def test_boxes_of_the_lidar_by_whatever_name(tmp_path, drive, system, frames):
    content = document({"0": frame(entry(BOX, system))})
    state = only(read(tmp_path, drive, content, LabelOptions(frames=frames)))
    assert pose(state).translation_m == pytest.approx(drive.vehicle_from_lidar.apply(np.array(BOX[:3])))
    if frames:
        got = repr(system) if system else "none"
        with pytest.raises(DataError, match=f"coordinate_system: expected one of .* got {got}; say with --frame"):
            read(tmp_path, drive, content)


SECOND_TIME = street.TIMES_NS[1]


@pytest.mark.parametrize(
    ("written", "unit_ns"),
    [
        (SECOND_TIME, 1), (str(SECOND_TIME), 1), (SECOND_TIME // 1000, 1000), (SECOND_TIME // 1_000_000, 1_000_000),
        (SECOND_TIME / 1e9, 10**9), (f"{SECOND_TIME / 1e9:.6f}", 10**9),
    ],
)  # fmt: skip
def test_times_are_in_the_unit_that_the_user_says(tmp_path, drive, written, unit_ns):
    content = document({"7": frame(entry(BOX, "vehicle"), time=written)})
    assert only(read(tmp_path, drive, content, LabelOptions(unit_ns=unit_ns))).timestamp_ns == SECOND_TIME
    if unit_ns > 1:
        with pytest.raises(DataError, match=r"frames: timestamp: expected times of the recording.*--time-unit"):
            read(tmp_path, drive, content)


def test_frames_without_times_pair_by_their_numbers(tmp_path, drive):
    plain = document({"3": frame(entry(BOX, "vehicle"), time=None)})
    assert only(read(tmp_path, drive, plain)).timestamp_ns == street.TIMES_NS[3]  # 000003.npz
    plain = document({"12": frame(entry(BOX, "vehicle"), time=5)})
    assert only(read(tmp_path, drive, plain, LabelOptions(first_frame=10))).timestamp_ns == street.TIMES_NS[2]


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


def test_what_is_not_read_is_told(tmp_path, drive):
    attributes = {"text": [{"name": "occlusion", "val": "partly"}]}
    shown = frame(entry(BOX, "vehicle", attributes=attributes), entry(BOX, "vehicle"))
    shown["objects"]["0"]["object_data"] |= {
        "bbox": [{"name": "b", "val": [1, 2, 3, 4]}],
        "boolean": [{"name": "is_moving", "val": True}, {"name": "is_parked", "val": False}],
    }
    objects = {"0": {"name": "a", "type": "Car"}, "1": {"name": "b", "type": "Sign"}, "2": {"name": "c", "type": "Car"}}
    content = document({"0": shown}, objects=objects, actions={"0": {"name": "", "type": "moves"}})
    label_set = read(tmp_path, drive, content, LabelOptions(classes={"Sign": None}))
    assert {
        "bbox: no field for them (1)",
        "boolean: no field for them (2)",
        "further cuboids of an object at one time (1)",
        "cuboids with attributes: no field for them (1)",
        "objects without any cuboid in a frame: left out (2)",
        "actions: no field for them (1)",
    } <= set(label_set.lost)


def test_a_file_holds_everything_by_the_standard_and_its_boxes_come_back(tmp_path, drive):
    tracks = street.full_tracks()
    assert written(OPENLABEL, tracks, drive, tmp_path / "out") == []
    found = import_labels("openlabel", tmp_path / "out", drive, PLAIN)
    assert_same_boxes(found.tracks, tracks[:1])
    assert found.timestamps_ns == tuple(sorted({*street.TIMES_NS, tracks[1].states[1].timestamp_ns}))
    told = "\n".join(found.lost)
    for kind in ("text", "boolean", "poly2d", "vec", "num"):
        assert f"{kind}: no field for them (" in told
    root = json.loads((tmp_path / "out/openlabel.json").read_text())["openlabel"]
    kinds = {kind for shown in root["frames"].values() for o in shown["objects"].values() for kind in o["object_data"]}
    assert kinds == {"cuboid", "poly2d", "num", "vec", "text", "boolean"}
    assert set(root) <= {"metadata", "coordinate_systems", "objects", "frames", "frame_intervals"}
    assert all(uid.isdigit() for uid in root["objects"])
    types = {item["name"]: item["type"] for item in root["objects"].values()}
    assert types == {"car": "vehicle", "the walker": "pedestrian"}
    for item in root["objects"].values():
        assert set(item) <= {"name", "type", "object_data"}
    for shown in root["frames"].values():
        assert set(shown["objects"]) <= set(root["objects"])
    for name, system in root["coordinate_systems"].items():
        assert set(system) >= {"type", "parent"}
        assert all(root["coordinate_systems"][child]["parent"] == name for child in system["children"])
    lidar = root["coordinate_systems"]["lidar"]["pose_wrt_parent"]
    assert lidar["translation"] == pytest.approx([1.2, 0.1, 1.8])


def changed(*values, at=-1):
    """The box with other values from an index on, as an entry of a frame."""
    return {"0": frame(entry([*BOX[:at], *values, *BOX[at + len(values) or len(BOX) :]], "vehicle"))}


FAULTS = [
    ("", "expected JSON"),
    ("[" * 100_000, "expected JSON"),
    ({"vcd": {}}, "openlabel: expected a value, got nothing"),
    (document({}, version="0.3.0"), "metadata.schema_version: expected .*, got '0.3.0'"),
    (document({"x": frame()}), "frames"),
    (document({}), "openlabel.frames: expected"),
    (document({"0": frame(entry(BOX), uid="5")}), "frames.0.objects.5: expected an object listed"),
    (document({"0": frame(entry(BOX[:8], "vehicle"))}), "cuboid.0.val: expected"),
    (document(changed("1")), "cuboid.0.val.9: expected"),
    (document(changed(1e400)), "cuboid.0.val.9: expected"),
    (document(changed(10**400)), "cuboid.0.val.9: expected"),
    (document(changed(-1.0)), "cuboid.val: expected sizes above 0"),
    (document(changed(2.0, at=6)), "quaternion x, y, z, w of length 1"),
    (document({"0": frame(entry(BOX, "moon"))}), "cuboid.coordinate_system: expected .*, got 'moon'"),
    (document({"0": frame(entry(BOX), time=5)}), "expected times of the recording, .* got 5"),
    *[
        (document({"0": frame(entry(BOX), time=time)}), "frames.0.frame_properties.timestamp: expected")
        for time in ("noon", "nan", "9" * 70, "1E+999999999")
    ],
    (document({"0": frame(entry(BOX)), "1": frame(entry(BOX), time=None)}), "frames.1.frame_properties.timestamp"),
]


@pytest.mark.parametrize(("content", "told"), FAULTS, ids=range(len(FAULTS)))
def test_every_fault_has_its_place(tmp_path, drive, content, told):
    with pytest.raises(DataError, match=told):
        read(tmp_path, drive, content)
