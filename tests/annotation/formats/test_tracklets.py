"""CVAT's tracklets: files by hand, and what is no such file."""

from dataclasses import replace

import numpy as np
import pytest

from bench.adapters.kitti_raw import DEEPEST
from bench.annotation.formats.conversion import LabelOptions, import_labels
from bench.errors import DataError
from bench.geometry import RigidTransform
from tests.annotation.formats import street

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


def read(file, drive, **options):
    return import_labels("cvat", file, drive, LabelOptions(**options))


def test_a_tracklet_by_hand(tmp_path, drive):
    """The middle, w along x, h along y, l along z, and three angles about the box's own axes."""
    drive = replace(drive, vehicle_from_lidar=RigidTransform.from_yaw(np.pi / 2, (1.0, 0.0, 2.0)))
    angles = (0.1, -0.2, 0.5)
    tag = pose(at=(10.0, 2.0, 0.75), rx=angles[0], ry=angles[1], rz=angles[2])
    label_set = read(put(tmp_path, document(item(tag, tag, w=4.5, h=1.75, length=1.5, first=2))), drive)
    (track,) = label_set.tracks
    assert (track.track_id, track.object_class) == ("tracklet-0", "vehicle")
    assert [state.timestamp_ns for state in track.states] == list(street.TIMES_NS[2:4])
    shape = track.states[0].shape
    about_x, about_y, about_z = street.about_axes(*angles)
    lidar_from_box = RigidTransform(about_x @ about_y @ about_z, np.array([10.0, 2.0, 0.75]))
    expected = drive.vehicle_from_lidar @ lidar_from_box  # it looks to the left: its x is the vehicle's y
    assert shape.vehicle_from_object.matrix == pytest.approx(expected.matrix, abs=1e-12)
    assert shape.vehicle_from_object.translation_m == pytest.approx([-1.0, 10.0, 2.75])
    assert shape.size_m.tolist() == [4.5, 1.75, 1.5]
    assert label_set.timestamps_ns == street.TIMES_NS


def test_gaps_that_cvat_fills_stay_gaps(tmp_path, drive):
    poses = (pose(), pose(occlusion=-1, truncation=2), pose())
    (track,) = read(put(tmp_path, document(item(*poses))), drive).tracks
    assert [state.timestamp_ns for state in track.states] == [street.TIMES_NS[0], street.TIMES_NS[2]]


def test_what_has_no_place_is_told(tmp_path, drive):
    """Counts that are wrong or missing, as in examples of parsers, and a share of truncation, are no matter."""
    poses = (pose(state=1, occlusion=2), pose(state=0), pose(truncation=99), pose(truncation=0.1))
    text = document(item(*poses, count=9), item(pose(), kind="Misc"), item(), count=7).replace("<count>1</count>", "")
    label_set = read(put(tmp_path, text), drive, classes={"Misc": None})
    assert {
        "places of class 'Misc': left out as asked (1)",
        "tracklets without poses, left out (1)",
        "poses that are unset or outside, left out (1)",
        "marks of occlusion: no field for them (1)",
        "marks of truncation: no field for them (2)",
        "frames without objects: without frame_list.txt all 6 sweeps count as annotated",
    } <= set(label_set.lost)
    assert [len(track.states) for track in label_set.tracks] == [3]


def listed(tmp_path, *lines):
    (tmp_path / "frame_list.txt").write_text("\n".join(lines) + "\n")


def test_frames_of_a_list_pair_by_name_and_never_by_number(tmp_path, drive):
    """The task began at the fourth sweep: its frame 0 is 000003, not 000000."""
    file = put(tmp_path, document(item(pose(), pose(), first=0)))
    listed(tmp_path, "0 lidar/000003", "1 000004.pcd", "2 lidar\\000005.bin")
    label_set = read(file, drive)
    assert [state.timestamp_ns for state in label_set.tracks[0].states] == list(street.TIMES_NS[3:5])
    assert label_set.timestamps_ns == street.TIMES_NS[3:]
    assert not any("all 6 sweeps" in line for line in label_set.lost)


@pytest.mark.parametrize(
    ("lines", "first_frame", "told"),
    [
        (["0 000000"], None, r"frame_list\.txt: expected a line for each frame that tracklets have, got none for 1"),
        (["0 cloud_000", "1 cloud_001"], None, "expected frames named like the 6 sweeps, .*, got cloud_000"),
        *((["0 000000", line], None, f"line 2: expected number and name of a frame, each once, got '{line}'")
          for line in ("1 000000", "000001", "0 000001")),
        (["0 000000", "1 000001"], 1, "expected frames by name or by number, got --first-frame 1 as well"),
    ],
)  # fmt: skip
def test_lists_that_cannot_be_paired_are_refused(tmp_path, drive, lines, first_frame, told):
    file = put(tmp_path, document(item(pose(), pose())))
    listed(tmp_path, *lines)
    with pytest.raises(DataError, match=told):
        read(file, drive, first_frame=first_frame)


def test_ids_in_attributes_join_what_is_one_object(tmp_path, drive):
    """CVAT writes attributes at each pose; a copy of an object has its id and is another one."""
    named = "<attributes><attribute><name>id</name><value>p003</value></attribute></attributes>"
    tags = [item(pose().replace("</item>", f"{named}</item>"), first=first) for first in (0, 2, 2)]
    tags.append(item(pose().replace("</item>", f"{named}</item>"), first=3, kind="Pedestrian"))
    found = read(put(tmp_path, document(*tags)), drive)
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


@pytest.mark.parametrize(
    ("begin", "part", "count", "told"),
    [
        ("", "<item>" * 170_000, 100, f"at most {DEEPEST} levels"),
        ("<item><poses>", "<item></item>" * 80_000, 10, "tracklets of at most 8000000 bytes"),
    ],
    ids=["deep nesting", "an item without end"],
)
def test_a_hundred_megabytes_are_put_aside_early(tmp_path, drive, begin, part, count, told):
    file = tmp_path / "tracklet_labels.xml"
    with file.open("w") as out:
        out.write(f"<boost_serialization><tracklets>{begin}")
        for _ in range(count):
            out.write(part)
    with pytest.raises(DataError, match=told):
        read(file, drive)
