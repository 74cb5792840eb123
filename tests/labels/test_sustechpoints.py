"""SUSTechPOINTS: label files by hand, there and back, and what is no label file."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.labels import LabelOptions, LabelSet, label_format
from bench.recordings import Cuboid, GroundPolygon, ObjectState, Track, load_card, open_dataset
from tests.labels import street
from tests.labels.same import assert_same_boxes
from tests.support.real import needs_real

PLAIN = LabelOptions()


@pytest.fixture
def sustech():
    return label_format("sustechpoints")


def box(obj_id="1", *, at=(10.0, 2.0, -0.8), size=(4.5, 1.8, 1.5), turn=(0.0, 0.0, 0.0), kind="Car", **more):
    """An entry as the tool writes it."""
    named = [dict(zip("xyz", vector, strict=True)) for vector in (at, size, turn)]
    psr = dict(zip(("position", "scale", "rotation"), named, strict=True))
    return {"psr": psr, "obj_type": kind, "obj_id": obj_id, **more}


def put(folder, stem, content):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.json").write_text(content if isinstance(content, str) else json.dumps(content))


def test_a_file_as_the_tool_writes_it(tmp_path, drive, sustech):
    """By hand: the lidar sits at (1, 0, 2) and looks to the left; a box ahead of it is left of the vehicle."""
    drive = replace(drive, vehicle_from_lidar=RigidTransform.from_yaw(np.pi / 2, (1.0, 0.0, 2.0)))
    text = (
        '[{"psr": {"position": {"x": 10, "y": 2.0, "z": -1.25}, "scale": {"x": 4.5, "y": 1.75, "z": 1.5}, '
        '"rotation": {"x": 0, "y": 0, "z": -1.5707963267948966}}, "obj_type": "Car", "obj_id": "8", "annotator": "i", '
        '"follows": "7", "obj_attr": "door open,crossing"}]'
    )
    put(tmp_path / "scene/label", "000002", text)
    put(tmp_path / "scene/label", "000003", [])
    label_set = sustech.read(tmp_path / "scene", drive, PLAIN)
    assert label_set.timestamps_ns == (street.TIMES_NS[2], street.TIMES_NS[3])
    (track,) = label_set.tracks
    (state,) = track.states
    assert (track.track_id, track.object_class, state.timestamp_ns) == ("8", "vehicle", street.TIMES_NS[2])
    assert state.shape.vehicle_from_object.translation_m == pytest.approx([-1.0, 10.0, 0.75], abs=1e-12)
    assert state.shape.vehicle_from_object.rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert state.shape.size_m.tolist() == [4.5, 1.75, 1.5]
    assert (state.category, state.unclear) == ("crossing", False)
    assert np.isnan(state.velocity_mps).all()
    assert label_set.lost == ("1 attributes 'door open': no field for them here",)


def test_angles_turn_about_the_boxs_own_x_then_y_then_z(tmp_path, drive, sustech):
    x, y, z = 0.3, -0.2, 1.1
    about_x, about_y, about_z = street.about_axes(x, y, z)
    put(tmp_path / "label", "000000", [box(turn=(x, y, z))])
    still = replace(drive, vehicle_from_lidar=RigidTransform.identity())
    (track,) = sustech.read(tmp_path / "label", still, PLAIN).tracks
    assert track.states[0].shape.vehicle_from_object.rotation == pytest.approx(about_x @ about_y @ about_z, abs=1e-12)


def test_boxes_of_one_id_are_one_object_that_moves(tmp_path, drive, sustech):
    for i in range(street.SWEEPS):
        pose = street.lidar_from_object("car", i)
        turn = (0.0, 0.0, 0.0)
        put(tmp_path / "label", f"{i:06d}", {"objs": [box(17, at=pose.translation_m.tolist(), turn=turn)]})
    (track,) = sustech.read(tmp_path, drive, PLAIN).tracks
    assert (track.track_id, len(track.states)) == ("17", street.SWEEPS)
    for state in track.states:
        world = drive.trajectory.world_from_vehicle(state.timestamp_ns).rotate(state.velocity_mps)
        assert world == pytest.approx(street.CAR_MPS, abs=1e-6)


def test_static_is_a_word_of_the_tool(tmp_path, drive, sustech):
    put(tmp_path, "000000", [box(obj_attr="static")])
    put(tmp_path, "000001", [box(at=(10.5, 2.0, -0.8), obj_attr=" unclear , static")])
    (track,) = sustech.read(tmp_path, drive, PLAIN).tracks
    assert [state.velocity_mps.tolist() for state in track.states] == [[0, 0, 0], [0, 0, 0]]
    assert [state.unclear for state in track.states] == [False, True]


def test_boxes_without_id_things_and_doubtful_ones(tmp_path, drive, sustech):
    entries = [box(""), box("", kind="Pedestrian"), box("3", kind="Cone"), box("4", kind="DontCare"), box(None)]
    put(tmp_path, "000000", entries)
    label_set = sustech.read(tmp_path, drive, PLAIN)
    assert [(t.track_id, t.object_class, t.states[0].unclear) for t in label_set.tracks] == [
        ("unnamed-000000-0", "vehicle", False),
        ("unnamed-000000-1", "pedestrian", False),
        ("4", "vehicle", True),
        ("unnamed-000000-4", "vehicle", False),
    ]
    assert label_set.lost == (
        "1 boxes of class 'Cone', which does not move by itself: left out",
        "3 boxes without obj_id: each one is an object of its own, seen once",
        "1 boxes of class 'DontCare', which does not say what they are: unclear, so not scored",
    )
    asked = LabelOptions(classes={"DontCare": None, "cone": "animal", "Car": None})
    label_set = sustech.read(tmp_path, drive, asked)
    assert [(t.track_id, t.object_class) for t in label_set.tracks] == [
        ("unnamed-000000-1", "pedestrian"),
        ("3", "animal"),
    ]
    assert label_set.lost[:2] == (
        "2 objects of class 'Car', left out as asked",
        "1 objects of class 'DontCare', left out as asked",
    )


def test_unknown_classes_are_named_all_at_once(tmp_path, drive, sustech):
    put(tmp_path, "000000", [box("1", kind="Hovercraft"), box("2", kind="Sleigh")])
    with pytest.raises(DataError, match=r"'Hovercraft', 'Sleigh'; .*--class"):
        sustech.read(tmp_path, drive, PLAIN)


def test_there_and_back(tmp_path, drive, sustech):
    tracks = tuple(marked(street.box_track(name, told=False)) for name in street.SIZES_M)
    label_set = LabelSet(tracks=tracks, timestamps_ns=street.TIMES_NS)
    assert sustech.write(label_set, drive, tmp_path / "scene", PLAIN) == ()
    assert sorted(path.name for path in (tmp_path / "scene/label").iterdir()) == [
        f"{i:06d}.json" for i in range(street.SWEEPS)
    ]
    read = sustech.read(tmp_path / "scene", drive, PLAIN)
    assert (read.timestamps_ns, read.lost) == (street.TIMES_NS, ())
    assert_same_boxes(by_name(read.tracks), by_name(tracks))
    for one, other in zip(by_name(read.tracks), by_name(tracks), strict=True):
        assert [(s.category, s.unclear) for s in one.states] == [(s.category, s.unclear) for s in other.states]


def by_name(tracks):
    return sorted(tracks, key=lambda track: track.track_id)


def marked(track):
    """Each mark that the tool has a place for, once."""
    first, second, *rest = track.states
    marks = (replace(first, category="static_ego"), replace(second, category="crossing", unclear=True), *rest)
    return replace(track, states=marks)


length = st.floats(-200, 200)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    wxyz=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    place=st.tuples(length, length, length),
    size=st.tuples(*[st.floats(0.05, 30)] * 3),
)
def test_any_box_comes_back(tmp_path, drive, wxyz, place, size):
    shape = Cuboid(vehicle_from_object=RigidTransform.from_quaternion(wxyz, place), size_m=np.array(size))
    state = ObjectState(timestamp_ns=street.TIMES_NS[1], shape=shape, velocity_mps=np.full(3, np.nan))
    track = Track(track_id="box", object_class="animal", states=(state,))
    form = label_format("sustechpoints")
    form.write(LabelSet(tracks=(track,), timestamps_ns=()), drive, tmp_path / "out", PLAIN)
    # Near pitch 90 degrees two of three angles are one, and they hold half of the digits.
    assert_same_boxes(form.read(tmp_path / "out", drive, PLAIN).tracks, (track,), within=1e-7)


def test_what_the_format_cannot_hold_is_told(tmp_path, drive, sustech):
    car = street.box_track("car")
    between = replace(car.states[0], timestamp_ns=street.TIMES_NS[0] + 5)
    outline = GroundPolygon(outline_m=np.array([[4.0, 1.0], [5.0, 1.0], [5.0, 2.0]]), bottom_m=0.0, top_m=1.7)
    walker = Track(
        track_id="walker",
        object_class="pedestrian",
        states=(ObjectState(timestamp_ns=street.TIMES_NS[1], shape=outline, velocity_mps=np.zeros(3)),),
    )
    tracks = (replace(car, states=(car.states[0], between, *car.states[1:3])), walker)
    lost = sustech.write(LabelSet(tracks=tracks, timestamps_ns=()), drive, tmp_path, PLAIN)
    assert lost == (
        "1 states that are ground outlines: the format has none",
        "1 states at 1 times at which there is no sweep",
        "5 velocities: no field for them",
        "4 yaw rates: no field for them",
    )
    assert sorted(path.stem for path in (tmp_path / "label").iterdir()) == ["000000", "000001", "000002"]
    assert json.loads((tmp_path / "label/000000.json").read_text())[0]["obj_type"] == "Car"


def test_frames_are_called_as_the_sweeps_or_counted(tmp_path, sustech):
    names = tuple(str(t) for t in street.TIMES_NS)
    drive = street.recording(tmp_path / "drive", names=names)
    label_set = street.label_set("car", told=False)
    for folder, options, first in (("a", PLAIN, names[0]), ("b", LabelOptions(first_frame=950), "000950")):
        sustech.write(label_set, drive, tmp_path / folder, options)
        assert min(path.stem for path in (tmp_path / folder / "label").iterdir()) == first
        assert_same_boxes(sustech.read(tmp_path / folder, drive, options).tracks, label_set.tracks)


def faulty(**changes):
    entry = box()
    for path, value in changes.items():
        *parents, last = path.split("__")
        inner = entry
        for name in parents:
            inner = inner[name]
        inner[last] = value
    return [entry]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "expected JSON"),
        ("null", "expected a valid array"),
        ("[" * 100_000, "expected JSON, got recursion limit exceeded"),
        ('{"objs": 3}', "objs: expected a valid array"),
        ('{"objects": []}', "objs: expected a value, got nothing"),
        ("[1]", "expected"),
        ([{}], "0.psr: expected a value, got nothing"),
        (faulty(psr__scale__x=0), "psr.scale.x: expected greater than 0"),
        (faulty(psr__scale__x=-1.0), "psr.scale.x: expected greater than 0"),
        (faulty(psr__position__z="1"), "psr.position.z: expected a valid number"),
        (faulty(psr__position__z=None), "psr.position.z: expected a valid number"),
        ('[{"psr": {"position": {"x": NaN}}}]', "x: expected a finite number"),
        ('[{"psr": {"position": {"x": 1e999}}}]', "x: expected a finite number"),
        (faulty(obj_type=""), "obj_type: expected"),
        (faulty(obj_id=1.5), "obj_id"),
        (faulty(obj_attr="crossing, overtaking"), "obj_attr: expected one kind of motion, got crossing and overtaking"),
        (faulty(vertices=[1, 2, 3]), "no `vertices`: boxes of the tool's early versions"),
        ([box("5"), box("6"), box("5")], "2.obj_id: expected each object once in a frame, got '5' twice"),
    ],
)
def test_what_is_no_label_file(tmp_path, drive, sustech, content, message):
    put(tmp_path / "label", "000000", content)
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        sustech.read(tmp_path, drive, PLAIN)
    assert "000000.json" in str(caught.value)


def test_an_object_that_changes_its_class(tmp_path, drive, sustech):
    put(tmp_path, "000000", [box("5", kind="Car")])
    put(tmp_path, "000001", [box("5", kind="Van")])
    put(tmp_path, "000002", [box("5", kind="Child")])
    with pytest.raises(
        DataError, match=r"000002.json: 0.obj_type: expected '5' to stay Car, as in 000000.json, got Child"
    ):
        sustech.read(tmp_path, drive, PLAIN)


def test_files_beyond_any_size(tmp_path, drive, sustech, monkeypatch):
    monkeypatch.setattr("bench.labels.frames.LARGEST_BYTES", 100)
    put(tmp_path, "000000", [box()])
    with pytest.raises(DataError, match="expected at most 100 bytes"):
        sustech.read(tmp_path, drive, PLAIN)


def test_frames_that_do_not_pair(tmp_path, drive, sustech):
    put(tmp_path, "000000", [box()])
    put(tmp_path, "000006", [box()])
    with pytest.raises(DataError, match="got 000006"):
        sustech.read(tmp_path, drive, PLAIN)


def test_old_frames_do_not_pass_for_new_ones(tmp_path, drive, sustech):
    whole = street.label_set("car")
    sustech.write(whole, drive, tmp_path, PLAIN)
    sustech.write(whole, drive, tmp_path, PLAIN)
    two = LabelSet(tracks=(), timestamps_ns=street.TIMES_NS[:2])
    with pytest.raises(
        DataError, match=r"expected no frames but the 2 that are written, got 4 others, as 000002\.json"
    ):
        sustech.write(two, drive, tmp_path, PLAIN)
    assert len(json.loads((tmp_path / "label/000000.json").read_text())) == 1  # nothing was touched
    (tmp_path / "out").mkdir()
    (tmp_path / "out/label").symlink_to(tmp_path / "label")
    with pytest.raises(DataError, match="a link that leads outside"):
        sustech.write(whole, drive, tmp_path / "out", PLAIN)


@needs_real
def test_real_boxes_come_back(tmp_path, sustech):
    (handle,) = open_dataset(load_card(Path(__file__).parents[2] / "datasets/aimotive-sample.yaml"))
    real = handle.open()
    times_ns = {sweep.timestamp_ns for sweep in real.sweeps}
    tracks = [replace(t, states=tuple(s for s in t.states if s.timestamp_ns in times_ns)) for t in real.tracks]
    sustech.write(LabelSet(tracks=real.tracks, timestamps_ns=tuple(sorted(times_ns))), real, tmp_path, PLAIN)
    found = sustech.read(tmp_path, real, PLAIN)
    assert len(found.timestamps_ns) == 16
    assert_same_boxes(by_name(found.tracks), by_name(track for track in tracks if track.states))
