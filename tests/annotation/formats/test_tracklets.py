"""KITTI's tracklets and CVAT's: files by hand, there and back, the real sample, and what is no such file."""

from dataclasses import replace

import numpy as np
import pytest

from bench.adapters.tracklets import DEEPEST, read_tracklets
from bench.annotation.formats import LabelOptions, LabelSet, import_labels, label_format
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import GroundPolygon, ObjectState, Track
from tests.annotation.formats import street
from tests.annotation.formats.same import assert_same_boxes, written
from tests.support.real import REAL, needs_real

PLAIN = LabelOptions()
HEAD = '<?xml version="1.0" encoding="UTF-8" standalone="true" ?>\n<!DOCTYPE boost_serialization>\n'


def pose(at=(10.0, 2.0, -1.75), rz=0.0, *, rx=0.0, ry=0.0, state=2, occlusion=0, truncation=0):
    values = {"tx": at[0], "ty": at[1], "tz": at[2], "rx": rx, "ry": ry, "rz": rz, "state": state}
    values |= {"occlusion": occlusion, "occlusion_kf": 0, "truncation": truncation, "amt_border_kf": -1}
    return "<item>" + "".join(f"<{name}>{value}</{name}>" for name, value in values.items()) + "</item>"


def item(*poses, kind="Car", h=1.5, w=1.75, length=4.5, first=0, count=None):
    """A tracklet as KITTI writes it."""
    count = len(poses) if count is None else count
    return (
        f"<item><objectType>{kind}</objectType><h>{h}</h><w>{w}</w><l>{length}</l><first_frame>{first}</first_frame>"
        f"<poses><count>{count}</count><item_version>2</item_version>{''.join(poses)}</poses><finished>1</finished></item>"
    )


def document(*items, count=None, head=HEAD):
    count = len(items) if count is None else count
    return (
        f'{head}<boost_serialization signature="serialization::archive" version="9"><tracklets class_id="0">'
        f"<count>{count}</count><item_version>1</item_version>{''.join(items)}</tracklets></boost_serialization>"
    )


def put(tmp_path, text):
    file = tmp_path / "tracklet_labels.xml"
    file.write_text(text)
    return file


def test_a_tracklet_by_hand(tmp_path, drive):
    """The lidar sits at (1, 0, 2) and looks to the left: its x is the vehicle's y. The box stands on tz = -1.75."""
    drive = replace(drive, vehicle_from_lidar=RigidTransform.from_yaw(np.pi / 2, (1.0, 0.0, 2.0)))
    file = put(tmp_path, document(item(pose(rz=-np.pi / 2), pose(at=(10.0, 2.5, -1.75), rz=-np.pi / 2), first=2)))
    label_set = import_labels("kitti-tracklets", file, drive, PLAIN)
    (track,) = label_set.tracks
    first, second = track.states
    assert (track.track_id, track.object_class) == ("tracklet-0", "vehicle")
    assert [first.timestamp_ns, second.timestamp_ns] == list(street.TIMES_NS[2:4])
    assert first.shape.vehicle_from_object.translation_m == pytest.approx([-1.0, 10.0, 2.0 - 1.75 + 0.75], abs=1e-12)
    assert first.shape.vehicle_from_object.rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert first.shape.size_m.tolist() == [4.5, 1.75, 1.5]
    assert label_set.timestamps_ns == street.TIMES_NS
    assert [line for line in label_set.lost if "frames without objects" not in line] == []


def test_the_same_tags_of_cvat_mean_something_else(tmp_path, drive):
    """The middle, w along x, h along y, l along z, and three angles about the box's own axes."""
    drive = replace(drive, vehicle_from_lidar=RigidTransform.identity())
    angles = (0.1, -0.2, 0.5)
    tag = pose(at=(10.0, 2.0, 0.75), rx=angles[0], ry=angles[1], rz=angles[2])
    file = put(tmp_path, document(item(tag, w=4.5, h=1.75, length=1.5)))
    ((state,),) = (track.states for track in import_labels("cvat", file, drive, PLAIN).tracks)
    assert state.shape.vehicle_from_object.translation_m.tolist() == [10.0, 2.0, 0.75]
    about_x, about_y, about_z = street.about_axes(*angles)
    assert state.shape.vehicle_from_object.rotation == pytest.approx(about_x @ about_y @ about_z, abs=1e-12)
    assert state.shape.size_m.tolist() == [4.5, 1.75, 1.5]
    with pytest.raises(DataError, match=r"item 0, frame 0\.rx, ry: expected 0, got 0.1 and -0.2; files of CVAT"):
        import_labels("kitti-tracklets", file, drive, PLAIN)


def test_gaps_that_cvat_fills_stay_gaps(tmp_path, drive):
    poses = (pose(), pose(occlusion=-1, truncation=2), pose())
    file = put(tmp_path, document(item(*poses)))
    (track,) = import_labels("cvat", file, drive, PLAIN).tracks
    assert [state.timestamp_ns for state in track.states] == [street.TIMES_NS[0], street.TIMES_NS[2]]
    assert len(import_labels("kitti-tracklets", file, drive, PLAIN).tracks[0].states) == 3


def test_what_has_no_place_is_told(tmp_path, drive):
    poses = (pose(state=1, occlusion=2), pose(state=0), pose(truncation=99))
    file = put(tmp_path, document(item(*poses), item(pose(), kind="Misc")))
    label_set = import_labels("kitti-tracklets", file, drive, LabelOptions(classes={"Misc": None}))
    told = "\n".join(label_set.lost)
    for line in (
        "1 places of class 'Misc', left out as asked",
        "1 poses that are unset or outside, left out",
        "1 poses that are interpolated",
        "1 marks of occlusion",
        "1 marks of truncation",
        "all 6 sweeps count as annotated",
    ):
        assert line in told
    assert [len(track.states) for track in label_set.tracks] == [2]


def test_counts_and_shares_of_truncation_as_in_parsers_examples(tmp_path, drive):
    """No counts, wrong counts, a share of truncation, and a tracklet without poses."""
    bare = document(item(pose(truncation=0.1)), item(pose(), count=3), item()).replace("<count>1</count>", "")
    label_set = read(put(tmp_path, bare.replace("<count>3</count><item_v", "<item_v", 1)), drive)
    assert [len(track.states) for track in label_set.tracks] == [1, 1]
    assert {"1 tracklets without poses, left out", "1 marks of truncation: no field for them"} <= set(label_set.lost)


def listed(tmp_path, *lines):
    (tmp_path / "frame_list.txt").write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("name", ["kitti-tracklets", "cvat"])
def test_frames_of_a_list_pair_by_name_and_never_by_number(tmp_path, drive, name):
    """The task began at the fourth sweep: its frame 0 is 000003, not 000000."""
    file = put(tmp_path, document(item(pose(), pose(), first=0)))
    listed(tmp_path, "0 lidar/000003", "1 000004.pcd", "2 lidar\\000005.bin")
    label_set = import_labels(name, file, drive, PLAIN)
    assert [state.timestamp_ns for state in label_set.tracks[0].states] == list(street.TIMES_NS[3:5])
    assert label_set.timestamps_ns == street.TIMES_NS[3:]
    assert not any("all 6 sweeps" in line for line in label_set.lost)


@pytest.mark.parametrize(
    ("lines", "first_frame", "told"),
    [
        (["0 000000"], None, r"frame_list\.txt: expected a line for each frame that tracklets have, got none for 1"),
        (
            ["0 cloud_000", "1 cloud_001"],
            None,
            "expected frames named like the 6 sweeps, 000000 to 000005, got cloud_000",
        ),
        (
            ["0 000000", "1 1000001"],
            None,
            "expected frames named like the 6 sweeps, 000000 to 000005, got 1000001; name",
        ),
        (["0 000000", "1 000000"], None, "line 2: expected number and name of a frame, each once, got '1 000000'"),
        (["0 000000", "1 0"], None, "expected one frame for each sweep, got '000000' and '0'"),
        (["0 000000", "000001"], None, "line 2: expected number and name of a frame, each once, got '000001'"),
        (["0 000000", "0 000001"], None, "line 2: expected number and name of a frame, each once, got '0 000001'"),
        (["0 000000", "1 000001"], 1, "expected frames by name or by number, got --first-frame 1 as well"),
    ],
)
def test_lists_that_cannot_be_paired_are_refused(tmp_path, drive, lines, first_frame, told):
    file = put(tmp_path, document(item(pose(), pose())))
    listed(tmp_path, *lines)
    with pytest.raises(DataError, match=told):
        read(file, drive, first_frame=first_frame)


def read(file, drive, **options):
    return import_labels("kitti-tracklets", file, drive, LabelOptions(**options))


def by_cvat(label_set, drive, folder, options=PLAIN):
    """What does not come back; the files are read with the same options."""
    return written(label_format("cvat"), label_set, drive, folder, options)


def test_boxes_of_a_leaning_lidar_come_back_as_they_went(tmp_path, drive):
    label_set = street.label_set()
    by_cvat(label_set, drive, tmp_path / "out")
    found = import_labels("cvat", tmp_path / "out", drive, PLAIN)
    assert_same_boxes(found.tracks, label_set.tracks)
    assert found.timestamps_ns == label_set.timestamps_ns


def test_velocities_come_from_the_places_in_the_world(tmp_path, drive):
    """The walker moves on a straight line at one speed: differences are exact; the ego vehicle turns meanwhile."""
    label_set = street.label_set("walker")
    by_cvat(label_set, drive, tmp_path / "out")
    (track,) = import_labels("cvat", tmp_path / "out", drive, PLAIN).tracks
    for state, true in zip(track.states, label_set.tracks[0].states, strict=True):
        assert state.velocity_mps == pytest.approx(true.velocity_mps, abs=1e-6)
        assert abs(state.yaw_rate_radps) < 1e-9


def test_what_the_format_cannot_hold_is_told(tmp_path, drive):
    car = street.box_track("car")
    states = list(car.states)
    states[1] = replace(states[1], category="crossing", unclear=True)
    size_m = np.array([5.0, 1.8, 1.5])
    states[2] = replace(states[2], shape=replace(states[2].shape, size_m=size_m))
    states[4] = replace(states[4], timestamp_ns=states[4].timestamp_ns + 1)
    outline = GroundPolygon(outline_m=np.array([[0.0, 0], [1, 0], [1, 1]]), bottom_m=0.0, top_m=1.0)
    walker = ObjectState(timestamp_ns=street.TIMES_NS[0], shape=outline, velocity_mps=np.full(3, np.nan))
    tracks = (
        replace(car, states=tuple(states), instance_id=7),
        Track(track_id="walker", object_class="pedestrian", states=(walker,)),
    )
    label_set = LabelSet(tracks=tracks, timestamps_ns=street.TIMES_NS)
    assert set(by_cvat(label_set, drive, tmp_path / "out")) == {
        "1 ground outlines: no field for them",
        "1 states at times at which there is no sweep",
        "1 objects change their size: each has its median one",
        "1 kinds of motion (category): no field for them",
        "1 marks of unclear objects: no field for them",
        "6 velocities: no field for them",
        "6 yaw rates: no field for them",
        "1 numbers in truth images (instance_id): no field for them",
    }
    found = read_tracklets(tmp_path / "out" / "tracklet_labels.xml")
    assert [(tracklet.poses[0].number, len(tracklet.poses)) for tracklet in found] == [(0, 4), (5, 1)]


def test_frames_are_counted_and_named_in_the_list(tmp_path):
    drive = street.recording(tmp_path / "drive", names=tuple(f"{5 * i + 3:010d}" for i in range(street.SWEEPS)))
    label_set = street.label_set("parked")
    options = LabelOptions(first_frame=10, classes={"Van": "vehicle"})
    for folder, chosen, first in (("a", PLAIN, 0), ("b", options, 10)):
        by_cvat(label_set, drive, tmp_path / folder, chosen)
        (tracklet,) = read_tracklets(tmp_path / folder / "tracklet_labels.xml")
        assert [pose.number for pose in tracklet.poses] == list(range(first, first + street.SWEEPS))
        assert (tmp_path / folder / "frame_list.txt").read_text().startswith(f"{first} 0000000003\n")
        assert_same_boxes(import_labels("cvat", tmp_path / folder, drive, PLAIN).tracks, label_set.tracks)
    assert tracklet.label == "Van"
    (tmp_path / "b/frame_list.txt").unlink()  # the user says by --first-frame which frames these are
    assert_same_boxes(import_labels("cvat", tmp_path / "b", drive, options).tracks, label_set.tracks)


def test_names_and_classes_may_hold_anything(tmp_path, drive):
    (track,) = street.label_set("parked").tracks
    odd = replace(track, track_id="<&>'\"é")
    by_cvat(
        LabelSet(tracks=(odd,), timestamps_ns=()), drive, tmp_path / "out", LabelOptions(classes={"A<&>": "vehicle"})
    )
    (tracklet,) = read_tracklets(tmp_path / "out" / "tracklet_labels.xml")
    assert (tracklet.name, tracklet.label) == (odd.track_id, "A<&>")


def test_ids_in_attributes_join_what_is_one_object(tmp_path, drive):
    """CVAT writes attributes at each pose; a copy of an object has its id and is another one."""
    named = "<attributes><attribute><name>id</name><value>p003</value></attribute></attributes>"
    tags = [item(pose().replace("</item>", f"{named}</item>"), first=first) for first in (0, 2, 2)]
    tags.append(item(pose().replace("</item>", f"{named}</item>"), first=3, kind="Pedestrian"))
    found = import_labels("cvat", put(tmp_path, document(*tags)), drive, PLAIN)
    assert [(track.track_id, len(track.states)) for track in found.tracks] == [
        ("p003", 2),
        ("p003-2", 1),
        ("p003-3", 1),
    ]
    assert not any("further attributes" in line for line in found.lost)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (document(item(pose(at=("nan", 0, 0)))), "item 0.poses.item 0.tx: expected finite numbers, got 'nan'"),
        (document(item(pose(at=("1 2", 0, 0)))), "item 0.poses.item 0.tx: expected 1 numbers, got 2"),
        (document(item(pose(), h=0)), r"item 0.h, w, l: expected sizes above 0, got \(0.0, 1.75, 4.5\)"),
        (document(item(pose(), h="1e999")), "item 0.h: expected finite numbers"),
        (document(item(pose(), kind=" ")), "item 0.objectType: expected a class, got nothing"),
        (document(item(pose(), first="1.5")), "item 0.first_frame: expected a whole number, got '1.5'"),
        (document(item(pose(), first=9 * 10**9)), "first_frame: expected a whole number"),
        (document(item(pose(), first=9)), "frames: expected frames named like the 6 sweeps"),
        (document(item(pose(), kind="Yeti")), "classes: expected classes that map to one of .*got 'Yeti'"),
        (document("<item><objectType>Car</objectType></item>"), "item 0.h: expected 1 numbers, got 0"),
        ("<a/>", "expected boost_serialization with tracklets, got a"),
        ("<boost_serialization><b/></boost_serialization>", "expected boost_serialization with tracklets"),
        ("<boost_serialization/>", "tracklets: expected tracklets, or a count of 0, got neither"),
        (document(count=3), "tracklets: expected tracklets, or a count of 0, got neither"),
        (document(item(pose()))[:-30], "expected well-formed XML"),
        ("", "expected well-formed XML"),
        ("\0\1\2", "expected well-formed XML"),
    ],
)
def test_every_fault_has_its_place(tmp_path, drive, text, told):
    with pytest.raises(DataError, match=told):
        read(put(tmp_path, text), drive)


def test_a_billion_laughs_are_not_told(tmp_path, drive):
    entities = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
    head = f'<?xml version="1.0"?><!DOCTYPE boost_serialization [<!ENTITY a0 "ha">{entities}]>'
    with pytest.raises(DataError, match="expected XML without entities"):
        read(put(tmp_path, document(item(pose(), kind="&a9;"), head=head)), drive)


@pytest.mark.parametrize("where", ["file:///etc/hostname", "http://127.0.0.1:9/x"])
def test_nothing_outside_is_read(tmp_path, drive, where):
    head = f'<?xml version="1.0"?><!DOCTYPE boost_serialization [<!ENTITY out SYSTEM "{where}">]>'
    with pytest.raises(DataError, match="expected XML without entities"):
        read(put(tmp_path, document(item(pose(), kind="&out;"), head=head)), drive)


def test_deep_nesting_ends_early(tmp_path, drive):
    """A hundred megabytes of opened elements; the file is put aside after a dozen."""
    file = tmp_path / "tracklet_labels.xml"
    with file.open("w") as out:
        out.write("<boost_serialization><tracklets>")
        for _ in range(100):
            out.write("<item>" * 170_000)
    with pytest.raises(DataError, match=f"at most {DEEPEST} levels"):
        read(file, drive)


def test_an_item_without_end_is_put_aside(tmp_path, drive):
    file = tmp_path / "tracklet_labels.xml"
    with file.open("w") as out:
        out.write("<boost_serialization><tracklets><item><poses>")
        for _ in range(10):
            out.write("<item></item>" * 80_000)
    with pytest.raises(DataError, match="tracklets of at most 8000000 bytes"):
        read(file, drive)


def test_a_missing_file_is_named(tmp_path, drive):
    with pytest.raises(DataError, match=r"nowhere\.xml: expected a file of tracklets, got No such file"):
        read(tmp_path / "nowhere.xml", drive)


@needs_real
def test_the_real_sample_stands_on_the_road(tmp_path):
    """15 tracklets of drive 1: the lidar is 1.73 m above the road, so that bottoms of cars lie about -1.73 m."""
    (file,) = REAL.glob("kitti_raw/*/*/tracklet_labels.xml")
    drive = street.recording(tmp_path / "drive")
    first = drive.sweeps[0]
    sweeps = tuple(
        replace(first, timestamp_ns=first.timestamp_ns + i * street.STEP_NS, path=tmp_path / f"{i:010d}.bin")
        for i in range(108)
    )
    drive = replace(drive, sweeps=sweeps, vehicle_from_lidar=RigidTransform.from_yaw(0.0, (0.76, 0.0, 1.73)))
    label_set = read(file, drive)
    assert [track.object_class for track in label_set.tracks] == ["vehicle"] * 10 + ["cyclist"] * 2 + ["vehicle"] * 3
    assert sum(len(track.states) for track in label_set.tracks) == 572
    cars = [
        track for track in label_set.tracks if track.states[0].shape.size_m[2] < 2.5 and track.object_class == "vehicle"
    ]
    bottoms = [
        state.shape.vehicle_from_object.translation_m[2] - state.shape.size_m[2] / 2 for t in cars for state in t.states
    ]
    assert abs(np.median(bottoms)) < 0.15
    by_cvat(label_set, drive, tmp_path / "out")
    assert_same_boxes(import_labels("cvat", tmp_path / "out", drive, PLAIN).tracks, label_set.tracks)
