"""OpenLABEL of other tools: files by hand in every way the standard leaves open, there and back, and hostile ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras import PinholeCamera, RadialPolynomialCamera, UnifiedCamera
from bench.errors import DataError
from bench.geometry import RigidTransform, RoadPlane
from bench.labels import LabelOptions, LabelSet, calibration_text, label_format
from bench.labels.openlabel_calibration import lens_properties, read_lens
from bench.labels.openlabel_file import StreamProperties
from bench.lidar import read_sweep
from bench.recordings import (
    GroundPolygon,
    MountedCamera,
    ObjectState,
    PointIndices,
    SweepRef,
    Track,
    read_annotations,
    write_annotations,
)
from bench.recordings.schema import CameraHead, LidarHead
from tests.labels import street
from tests.labels.same import assert_same_boxes
from tests.support.lenses import LENSES
from tests.support.real import REAL, needs_real

PLAIN = LabelOptions()
OPENLABEL = label_format("openlabel")
BOX = [10.0, 2.0, -0.5, 0.0, 0.0, 0.0, 1.0, 4.5, 1.75, 1.5]
HALF = 0.5**0.5
SQUARE_PIXELS = RadialPolynomialCamera(
    width=1280, height=966, coefficients=(339.7, -31.9, 48.2, -7.2), principal_point=(643.4, 479.3)
)
FEW = {"radial_polynomial": (200.0, 3.0), "kannala_brandt": (0.1, -0.02, 0.001)}  # coefficients, fewer than are usual
CAMERAS = {
    "front": SQUARE_PIXELS,
    "lidar": replace(LENSES["radial_polynomial"], coefficients=FEW["radial_polynomial"]),
    "rear": replace(LENSES["kannala_brandt"], coefficients=FEW["kannala_brandt"]),
    "left": LENSES["unified"],
    "right": LENSES["pinhole"],
    "narrow": LENSES["brown_conrady"],
}


def entry(val, system=None, name="box3D", **more):
    return {"name": name, "val": val, **({} if system is None else {"coordinate_system": system}), **more}


def document(frames, *, objects=None, systems=None, version="1.0.0", **more):
    root = {
        "metadata": {"schema_version": version, "tagged_file": "../x"},
        "objects": objects or {"0": {"name": "a", "type": "Car"}},
        "frames": frames,
        "coordinate_systems": {"base": {"type": "local_cs", "parent": "", "children": []}}
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
    return OPENLABEL.read(file, drive, options)


def only(label_set):
    ((state,),) = (track.states for track in label_set.tracks)
    return state


def pose(state):
    return state.shape.vehicle_from_object


def test_ten_values_in_the_local_system(tmp_path, drive):
    turned = [10.0, 2.0, 0.5, 0.0, 0.0, HALF, HALF, 4.5, 1.75, 1.5]
    state = only(read(tmp_path, drive, document({"0": frame(entry(turned, "base"))})))
    assert state.timestamp_ns == street.TIMES_NS[0]
    assert pose(state).translation_m == pytest.approx([10.0, 2.0, 0.5])
    assert pose(state).rotation == pytest.approx(RigidTransform.from_yaw(np.pi / 2).rotation)
    assert state.shape.size_m.tolist() == [4.5, 1.75, 1.5]


def test_nine_values_turn_about_x_then_y_then_z_as_they_stand(tmp_path, drive):
    angles = (0.1, -0.2, 0.5)
    state = only(read(tmp_path, drive, document({"0": frame(entry([1.0, 2.0, 3.0, *angles, 4.0, 2.0, 1.5], "base"))})))
    about_x, about_y, about_z = street.about_axes(*angles)
    assert pose(state).rotation == pytest.approx(about_z @ about_y @ about_x, abs=1e-12)


def poses(rotation, translation_m):
    """The same pose in the three ways of the standard, and as drafts had it."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation_m
    return [
        {"matrix4x4": matrix.ravel().tolist()},
        {"quaternion": rotation.as_quat().tolist(), "translation": list(translation_m)},
        {"euler_angles": rotation.as_euler("ZYX").tolist(), "translation": list(translation_m)},
        {"euler_angles": rotation.as_euler("XYZ").tolist(), "sequence": "XYZ", "translation": list(translation_m)},
        matrix.ravel().tolist(),
    ]


@pytest.mark.parametrize("way", range(5))
def test_boxes_in_a_camera_reach_the_vehicle_over_the_lidar(tmp_path, drive, way):
    """The recording says where its lidar is; the file says where the camera is on the lidar."""
    rotation, place_m = Rotation.from_euler("xyz", [-1.5, 0.1, -1.6]), [0.3, 0.1, -0.2]
    lidar_from_camera = RigidTransform(rotation.as_matrix(), np.array(place_m))
    systems = {
        "base": {"type": "local_cs", "parent": "", "children": ["VELO_TOP"]},
        "VELO_TOP": {
            "type": "sensor_cs",
            "parent": "base",
            "pose_wrt_parent": poses(Rotation.identity(), [9, 9, 9])[0],
        },
        "CAM": {"type": "sensor_cs", "parent": "VELO_TOP", "pose_wrt_parent": poses(rotation, place_m)[way]},
    }
    camera_from_box = RigidTransform(Rotation.from_euler("y", 0.4).as_matrix(), np.array([3.0, 1.0, 12.0]))
    w, x, y, z = camera_from_box.quaternion_wxyz.tolist()
    val = [3.0, 1.0, 12.0, x, y, z, w, 4.0, 1.5, 1.75]
    label_set = read(tmp_path, drive, document({"0": frame(entry(val, "CAM"))}, systems=systems))
    vehicle_from_box = drive.vehicle_from_lidar @ lidar_from_camera @ camera_from_box
    state = only(label_set)
    assert pose(state).translation_m == pytest.approx(vehicle_from_box.translation_m, abs=1e-9)
    assert pose(state).rotation[:, 0] == pytest.approx(vehicle_from_box.rotation[:, 0], abs=1e-9)
    assert pose(state).rotation[2, 2] > 0.9
    assert state.shape.size_m.tolist() == [4.0, 1.75, 1.5]
    assert label_set.lost == ("1 boxes whose height is not along their own z: their axes are renamed",)


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
    (track,) = read(tmp_path, drive, document(frames, systems=systems)).tracks
    assert [pose(state).translation_m[0] for state in track.states] == pytest.approx([10.0, 9.0, 8.0])


def test_a_box_of_the_head_holds_in_the_frames_of_its_object(tmp_path, drive):
    wall = {"name": "wall", "type": "car", "frame_intervals": [{"frame_start": 1, "frame_end": 2}]}
    objects = {"0": wall | {"object_data": {"cuboid": [entry(BOX, "base")]}}}
    frames = {str(i): {"frame_properties": {"timestamp": street.TIMES_NS[i]}} for i in range(4)}
    own = [*BOX[:1], 5.0, *BOX[2:]]
    frames["2"] = frame(entry(own, "base"), time=street.TIMES_NS[2])
    (track,) = read(tmp_path, drive, document(frames, objects=objects)).tracks
    assert [(s.timestamp_ns, pose(s).translation_m[1]) for s in track.states] == [
        (street.TIMES_NS[1], 2.0),
        (street.TIMES_NS[2], 5.0),
    ]


@pytest.mark.parametrize(
    "written",
    [
        street.TIMES_NS[1],
        str(street.TIMES_NS[1]),
        street.TIMES_NS[1] // 1000,
        street.TIMES_NS[1] // 1_000_000,
        street.TIMES_NS[1] / 1e9,
        f"{street.TIMES_NS[1] / 1e9:.6f}",
        "2023-11-14 22:13:20.100000",
        "2023-11-14T22:13:20.100+00:00",
        "2023-11-14T23:13:20.100+01:00",
    ],
)
def test_times_are_read_in_any_unit(tmp_path, drive, written):
    state = only(read(tmp_path, drive, document({"7": frame(entry(BOX, "base"), time=written)})))
    assert state.timestamp_ns == street.TIMES_NS[1]


def test_frames_without_times_pair_by_what_the_lidar_says(tmp_path, drive):
    streams = {"LIDAR_TOP": {"type": "lidar", "uri": "", "description": ""}}

    def told(number, said):
        shown = frame(entry(BOX, "base"), time=None, streams={"LIDAR_TOP": said})
        return read(tmp_path, drive, document({number: shown}, streams=streams))

    assert only(told("0", {"uri": "some/where/000003.pcd"})).timestamp_ns == street.TIMES_NS[3]
    said = {"stream_properties": {"sync": {"timestamp": street.TIMES_NS[4] / 1e9}}}
    assert only(told("0", said)).timestamp_ns == street.TIMES_NS[4]
    assert only(told("0", {"stream_properties": {"sync": {"frame_stream": 2}}})).timestamp_ns == street.TIMES_NS[2]
    assert only(told("5", {})).timestamp_ns == street.TIMES_NS[5]
    plain = document({"12": frame(entry(BOX, "base"), time=None)})
    assert only(read(tmp_path, drive, plain, LabelOptions(first_frame=10))).timestamp_ns == street.TIMES_NS[2]


def test_a_file_without_systems_speaks_of_the_lidar_and_is_told(tmp_path, drive):
    label_set = read(tmp_path, drive, document({"0": frame(entry(BOX))}, systems={}))
    assert pose(only(label_set)).translation_m == pytest.approx(drive.vehicle_from_lidar.apply(np.array(BOX[:3])))
    assert label_set.lost[0] == "the file names no coordinate system: read in the frame of the lidar"


def timed(box, time_s):
    return entry(box, "base", attributes={"num": [{"name": "score", "val": 0.9}, {"name": "timestamp", "val": time_s}]})


def test_frames_that_share_a_time_take_that_of_their_boxes(tmp_path, drive):
    """As in the standard's own example: the pose of the vehicle came late, so that three frames have its time."""
    frames = {
        str(538 + i): frame(timed([10.0 + i, *BOX[1:]], time_ns / 1e9), time=street.TIMES_NS[max(i, 2)] / 1e9)
        for i, time_ns in enumerate(street.TIMES_NS)
    }
    label_set = read(tmp_path, drive, document(frames))
    assert label_set.timestamps_ns == street.TIMES_NS
    places = [pose(state).translation_m[0] for state in label_set.tracks[0].states]
    assert places == pytest.approx([10.0 + i for i in range(6)])


def test_of_few_frames_of_one_time_the_last_is_read_and_that_is_told(tmp_path, drive):
    times_ns = [street.TIMES_NS[i] for i in (0, 1, 1, 2)]
    frames = {str(i): frame(entry([10.0 + i, *BOX[1:]], "base"), time=t) for i, t in enumerate(times_ns)}
    label_set = read(tmp_path, drive, document(frames))
    assert [pose(state).translation_m[0] for state in label_set.tracks[0].states] == pytest.approx([10.0, 12.0, 13.0])
    assert "1 frames of the same time as a later one, left out" in label_set.lost


def test_boxes_in_the_only_local_system_need_no_pose_of_the_lidar(tmp_path, drive):
    systems = {
        "map": {"type": "geo_utm", "parent": "", "children": ["base"]},
        "base": {"type": "local_cs", "parent": "map", "children": ["LIDAR"]},
        "LIDAR": {"type": "sensor_cs", "parent": "base", "children": []},
    }
    shown = frame(entry(BOX, "base"))
    shown["objects"]["1"] = {"object_data": {"cuboid": [entry(BOX, "LIDAR")]}}
    objects = {uid: {"name": uid, "type": "Car"} for uid in "01"}
    label_set = read(tmp_path, drive, document({"0": shown}, objects=objects, systems=systems))
    near, far = (pose(track.states[0]).translation_m for track in label_set.tracks)
    assert near == pytest.approx(BOX[:3])
    assert far == pytest.approx(drive.vehicle_from_lidar.apply(np.array(BOX[:3])))
    assert any("does not say where 'LIDAR' lies: 'base' is taken for the vehicle frame" in x for x in label_set.lost)
    systems["LIDAR"]["pose_wrt_parent"] = poses(Rotation.identity(), [0.0, 0.0, 0.0])[0]
    again = read(tmp_path, drive, document({"0": shown}, objects=objects, systems=systems))
    assert pose(again.tracks[0].states[0]).translation_m == pytest.approx(far)
    assert not any("is taken for" in line for line in again.lost)


@needs_real
def test_the_example_of_the_standard_is_read(drive):
    """141 frames, of which 5 have the time of another; two of these have boxes of another time."""
    file = REAL / "labels/openlabel/asam_example_cuboids.json"
    frames = json.loads(file.read_text())["openlabel"]["frames"].values()
    boxes = [next(iter(frame["objects"].values()))["object_data"]["cuboid"][0] for frame in frames]
    times_ns = sorted({round(box["attributes"]["num"][1]["val"] * 1e9) for box in boxes})
    sweeps = tuple(SweepRef(timestamp_ns=t, path=Path(f"{t}.bin"), reader=read_sweep) for t in times_ns)
    drive = replace(drive, sweeps=sweeps)
    label_set = OPENLABEL.read(file, drive, LabelOptions(classes={"egocar": None}))
    assert len(label_set.timestamps_ns) == 138
    assert sum(len(track.states) for track in label_set.tracks) == 326


def test_what_has_no_place_is_told(tmp_path, drive):
    attributes = {"text": [{"name": "occlusion", "val": "partly"}]}
    shown = frame(entry(BOX, "base", attributes=attributes), entry(BOX, "base"))
    shown["objects"]["0"]["object_data"] |= {
        "bbox": [{"name": "b", "val": [1, 2, 3, 4]}],
        "boolean": [{"name": "is_moving", "val": True}],
        "text": [{"name": "category", "val": "vehicle.car"}],
        "poly2d": [{"name": "outline", "val": [1, 2], "mode": "MODE_POLY2D_ABSOLUTE", "closed": True}],
    }
    objects = {"0": {"name": "a", "type": "Car"}, "1": {"name": "b", "type": "Sign"}, "2": {"name": "c", "type": "Car"}}
    content = document({"0": shown}, objects=objects, actions={"0": {"name": "", "type": "moves"}})
    label_set = read(tmp_path, drive, content, LabelOptions(classes={"Sign": None}))
    assert set(label_set.lost) == {
        "1 objects of class 'Sign', left out as asked",
        "1 bbox of images: no field for them",
        "1 poly2d of images: no field for them",
        "1 boolean 'is_moving': no field for it",
        "1 text 'category' that is no kind of motion: no field for it",
        "1 text 'occlusion' of cuboids: no field for it",
        "1 further cuboids of an object in a frame: the first is read",
        "1 objects without any cuboid or outline, left out",
        "1 actions: no field for them",
    }


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


def with_cameras(drive):
    mounted = RigidTransform.from_quaternion((0.5, -0.5, 0.5, -0.5), (3.7, 0.0, 0.65))
    cameras = {
        name: MountedCamera(
            name=name,
            model=lens,
            vehicle_from_camera=mounted,
            road=RoadPlane.below(mounted),
            stored_size_px=(lens.width, lens.height),
        )
        for name, lens in CAMERAS.items()
    }
    return replace(drive, cameras=cameras)


def test_everything_comes_back(tmp_path, drive):
    """One of the cameras is called lidar on purpose."""
    drive, label_set = with_cameras(drive), full_layer()
    assert OPENLABEL.write(label_set, drive, tmp_path / "out", PLAIN) == ()
    found = OPENLABEL.read(tmp_path / "out", drive, PLAIN)
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
    OPENLABEL.write(full_layer(), with_cameras(drive), tmp_path / "out", LabelOptions(classes={"Car": "vehicle"}))
    root = json.loads((tmp_path / "out/openlabel.json").read_text())["openlabel"]
    assert set(root) <= {"metadata", "coordinate_systems", "streams", "objects", "frames", "frame_intervals"}
    assert all(uid.isdigit() for uid in root["objects"])
    assert {item["name"]: item["type"] for item in root["objects"].values()} == {
        "car": "Car",
        "the walker": "pedestrian",
    }
    for item in root["objects"].values():
        assert set(item) <= {"name", "type", "frame_intervals", "object_data"}
    assert root["objects"]["1"]["frame_intervals"] == [{"frame_start": 1, "frame_end": 2}]
    for shown in root["frames"].values():
        assert set(shown["objects"]) <= set(root["objects"])
    for name, system in root["coordinate_systems"].items():
        assert set(system) >= {"type", "parent"}
        assert all(root["coordinate_systems"][child]["parent"] == name for child in system["children"])
    assert root["streams"]["lidar_sensor"]["type"] == "lidar"
    fisheye = root["streams"]["front"]["stream_properties"]["intrinsics_fisheye"]
    assert fisheye["lens_coeffs"] == [339.7, -31.9, 48.2, -7.2]
    place_and_size = [fisheye[key] for key in ("center_x_px", "center_y_px", "width_px", "height_px")]
    assert place_and_size == [643.4, 479.3, 1280, 966]
    assert len(root["streams"]["right"]["stream_properties"]["intrinsics_pinhole"]["camera_matrix"]) == 12


def test_our_own_annotation_files_are_read(tmp_path, drive):
    label_set = full_layer()
    write_annotations(tmp_path / "street.json", label_set.tracks, timestamps_ns=label_set.timestamps_ns)
    found = OPENLABEL.read(tmp_path / "street.json", drive, PLAIN)
    assert_same_boxes(found.tracks[:1], label_set.tracks[:1])
    write_annotations(tmp_path / "again.json", found.tracks, timestamps_ns=found.timestamps_ns)
    assert [track.track_id for track in read_annotations(tmp_path / "again.json")] == ["car", "the walker"]


@pytest.mark.parametrize("lens", CAMERAS.values(), ids=CAMERAS)
def test_lenses_come_back(tmp_path, lens):
    written = json.loads(json.dumps(lens_properties(lens)))
    assert read_lens(StreamProperties(**written), tmp_path, "x") == lens
    schema_only = {key: value for key, value in written.items() if key != "intrinsics_custom"}
    if not isinstance(lens, UnifiedCamera):
        pixels = np.array([[160.0, 120.0], [300.0, 200.0], [321.0, 241.0]])
        found = read_lens(StreamProperties(**schema_only), tmp_path, "x")
        assert found.unproject(pixels)[0] == pytest.approx(lens.unproject(pixels)[0], abs=1e-9)


def fisheye(**values):
    return StreamProperties(intrinsics_fisheye={"width_px": 640, "height_px": 480, **values})


def test_both_spellings_of_the_fisheye_are_one_lens(tmp_path):
    schema = fisheye(center_x_px=320.0, center_y_px=240.0, lens_coeffs=[200.0, 1.0, 2.0, 3.0])
    library = fisheye(center_x=320.0, center_y=240.0, lens_coeffs_1x4=[200.0, 1.0, 2.0, 3.0], fov_deg=0.0)
    later = fisheye(center_x=320.0, center_y=240.0, lens_coeffs_1xN=[200.0, 1.0, 2.0, 3.0], model="radial_poly")
    lens = read_lens(schema, tmp_path, "x")
    assert lens == RadialPolynomialCamera(
        width=640, height=480, coefficients=(200.0, 1.0, 2.0, 3.0), principal_point=(320.0, 240.0)
    )
    assert lens == read_lens(library, tmp_path, "x") == read_lens(later, tmp_path, "x")


def test_what_coefficients_mean_depends_on_the_focal_length_and_their_number(tmp_path):
    centre = {"center_x_px": 320.0, "center_y_px": 240.0}
    four = fisheye(**centre, lens_coeffs=[0.1, 0.0, 0.0, 0.0], focal_length_x=200.0, focal_length_y=200.0)
    five = fisheye(**centre, lens_coeffs=[2.0, 0.2, 0.0, 0.0, 0.0], focal_length_x=100.0)
    ray = np.array([[np.sin(0.5), 0.0, np.cos(0.5)]])
    for properties in (four, five):
        lens = read_lens(properties, tmp_path, "x")
        assert lens.project(ray)[0] == pytest.approx(np.array([[320.0 + 200.0 * (0.5 + 0.1 * 0.5**3), 240.0]]))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"lens_coeffs": [1, 2, 3, 4], "center_x_px": -0.3, "center_y_px": -3.4}, "a centre in the image of 640 x 480"),
        ({"lens_coeffs": "x", "center_x_px": 1, "center_y_px": 1}, "lens_coeffs: expected finite numbers, got 'x'"),
        ({"lens_coeffs": [1, 2, 3, 4], "center_x_px": None, "center_y_px": 1}, "center_x_px: expected a finite number"),
        (
            {"lens_coeffs": [10**400, 0, 0, 0], "center_x_px": 1, "center_y_px": 1},
            "lens_coeffs: expected finite numbers",
        ),
        ({"lens_coeffs": [True], "center_x_px": 1, "center_y_px": 1}, "lens_coeffs: expected finite numbers"),
        (
            {"lens_coeffs": [9], "center_x_px": 9, "center_y_px": 9, "width_px": float("nan")},
            "width_px: expected a finite number",
        ),
        (
            {"lens_coeffs": [9], "center_x_px": 9, "center_y_px": 9, "width_px": 99.5},
            "width_px: expected a whole number",
        ),
        (
            {"lens_coeffs": [1, 2, 3, 4], "center_x_px": 9, "center_y_px": 9, "model": "f-theta"},
            "expected radial_poly, kannala or opencv_fisheye, got 'f-theta'",
        ),
    ],
)
def test_lenses_that_are_none(tmp_path, values, told):
    with pytest.raises(DataError, match=told):
        read_lens(fisheye(**values), tmp_path, "x")


def test_a_distorted_pinhole_is_read_and_what_goes_beyond_five_coefficients_refused(tmp_path):
    matrix = [500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    values = {"width_px": 640, "height_px": 480, "camera_matrix_3x4": matrix}

    def lens_of(coefficients, **more):
        pinhole = values | more | {"distortion_coeffs_1xN": coefficients}
        return read_lens(StreamProperties(intrinsics_pinhole=pinhole), tmp_path, "x")

    lens = lens_of([-0.3, 0.08, 1e-3, 2e-3, -0.01])
    assert (lens.radial, lens.tangential, lens.focal) == ((-0.3, 0.08, -0.01), (1e-3, 2e-3), (500.0, 500.0))
    assert lens_of([-0.3, 0.08, 1e-3, 2e-3]) == lens_of([-0.3, 0.08, 1e-3, 2e-3, 0.0, 0.0, 0.0, 0.0])
    assert isinstance(lens_of([0.0] * 5), PinholeCamera)
    with pytest.raises(DataError, match=r"distortion_coeffs: expected k1, k2, p1, p2 and k3, got 8 coefficients"):
        lens_of([-0.3, 0, 0, 0, 0, 0.1, 0, 0])
    with pytest.raises(DataError, match="expected a pinhole without skew, got skew"):
        lens_of([], camera_matrix_3x4=[500.0, 2.0, *matrix[2:]])


@pytest.mark.parametrize("coefficients", [3, "abc", [0, None], [10**400]])
def test_a_distortion_that_is_none_is_refused(tmp_path, coefficients):
    values = {"width_px": 64, "height_px": 48, "camera_matrix": [50.0, 0.0, 32.0, 0.0, 50.0, 24.0, 0.0, 0.0, 1.0]}
    assert read_lens(StreamProperties(intrinsics_pinhole=values | {"distortion_coeffs": []}), tmp_path, "x") is not None
    with pytest.raises(DataError, match=r"intrinsics_pinhole\.distortion_coeffs: expected finite numbers"):
        read_lens(StreamProperties(intrinsics_pinhole=values | {"distortion_coeffs": coefficients}), tmp_path, "x")


def test_a_lens_of_ours_that_lacks_something_says_what_it_has(tmp_path):
    lens = {"model": "pinhole", "width": 64, "focal": [50.0, 50.0]}
    told = "expected width, height and the parameters of the camera model, got model, width, focal"
    with pytest.raises(DataError, match=told):
        read_lens(StreamProperties(intrinsics_custom=lens), tmp_path, "x")


def test_the_calibration_comes_as_parts_of_a_head(tmp_path, drive):
    drive = with_cameras(drive)
    OPENLABEL.write(full_layer(), drive, tmp_path, PLAIN)
    head = json.loads(calibration_text(tmp_path / "openlabel.json"))
    assert set(head["cameras"]) == set(drive.cameras)
    for entry_ in head["cameras"].values():
        CameraHead.model_validate_json(json.dumps(entry_), strict=True)
    LidarHead.model_validate_json(json.dumps(head["lidar"]), strict=True)
    assert head["lidar"]["vehicle_from_lidar"]["translation_m"] == pytest.approx([1.2, 0.1, 1.8])


LOOP = {
    "a": {"type": "scene_cs", "parent": "b", "pose_wrt_parent": {"matrix4x4": np.eye(4).ravel().tolist()}},
    "b": {"type": "scene_cs", "parent": "a", "pose_wrt_parent": {"matrix4x4": np.eye(4).ravel().tolist()}},
    "base": {"type": "local_cs", "parent": ""},
}


def systems(posed):
    return {
        "base": {"type": "local_cs", "parent": ""},
        "c": {"type": "sensor_cs", "parent": "base", "pose_wrt_parent": posed},
    }


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "expected JSON"),
        ("[" * 100_000, "expected JSON"),
        ('{"openlabel": {"metadata": {"schema_version": "1.0.0"}, "objects": ' + '{"a":' * 100_000, "expected JSON"),
        ({"vcd": {}}, "openlabel: expected a value, got nothing"),
        (document({}, version="0.3.0"), "schema_version: expected 1.0.0, got '0.3.0'"),
        (document({"x": frame()}), "frames"),
        (document({"0": frame(entry(BOX), uid="5")}), "frames.0.objects.5: expected an object listed"),
        (document({"0": frame(entry(BOX[:8], "base"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:9], "1"], "base"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:9], -1.0], "base"))}), "cuboid.val: expected a box of sizes above 0"),
        (document({"0": frame(entry([*BOX[:9], 1e400], "base"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:9], 10**400], "base"))}), "cuboid.val: expected 9 or 10 finite numbers"),
        (document({"0": frame(entry([*BOX[:6], 2.0, *BOX[7:]], "base"))}), "quaternion x, y, z, w of length 1"),
        (document({"0": frame(entry(BOX, "moon"))}), "coordinate_systems: expected one of base, got 'moon'"),
        (document({"0": frame(entry(BOX, "a"))}, systems=LOOP), "expected poses from 'a' to 'base', got none"),
        (document({}, systems=systems({"matrix4x4": [1.0] * 15})), "matrix4x4: expected 16 numbers, got 15"),
        (document({}, systems=systems({"matrix4x4": [1.0] * 16})), "last row of 0, 0, 0, 1"),
        (document({}, systems=systems({"matrix4x4": [10**400] * 16})), "matrix4x4.0: expected a valid number"),
        (document({}, systems=systems({"quaternion": [0, 0, 0, 0], "translation": [0, 0, 0]})), "of length 1"),
        (document({}, systems=systems({"quaternion": [0, 0, 0, 1]})), "translation: expected 3 numbers, got none"),
        (document({}, systems=systems({})), "expected one of matrix4x4, quaternion and euler_angles, got none"),
        (
            document({}, systems=systems({"euler_angles": [0, 0, 0], "sequence": "XXY", "translation": [0, 0, 0]})),
            "sequence: expected three axes",
        ),
        (document({}, systems={"a": {"type": "scene_cs", "parent": ""}}), "expected one system of a lidar"),
        (document({"0": frame(entry(BOX), time=5)}), "expected times of the recording, .* got 5"),
        (document({"0": frame(entry(BOX), time="noon")}), "expected a number, or a date and time, got 'noon'"),
        (document({"0": frame(entry(BOX), time="nan")}), "expected a time, got nan"),
        (document({"0": frame(entry(BOX), time="9" * 70)}), "expected a time"),
        (document({"0": frame(entry(BOX), time="1E+999999999")}), r"expected a time, got 1E\+999999999"),
        (
            document({"0": frame(entry(BOX), time=street.FIRST_NS / 1e9), "1": frame(entry(BOX), time=4e18)}),
            r"frames.1.frame_properties.timestamp: expected a time of this recording, in the unit of .*, got 4E\+18",
        ),
        (document({"0": frame(entry(BOX)), "1": frame(entry(BOX), time=None)}), "frames.1.frame_properties.timestamp"),
        (document({"0": frame(entry(BOX)), "1": frame(entry(BOX))}), "frames.0: expected one frame for each time"),
        (document({}), "openlabel.frames: expected frames, to pair with sweeps, got none, and 1 objects"),
        (document({"99": frame(entry(BOX), time=None)}), "frames: expected frames named like the 6 sweeps"),
        (document({}, objects={"0": {"name": "a", "type": "Yeti"}}), "got 'Yeti'"),
    ],
)
def test_every_fault_has_its_place(tmp_path, drive, content, told):
    with pytest.raises(DataError, match=told):
        read(tmp_path, drive, content)


def test_a_hundred_megabytes_of_nesting_are_refused(tmp_path, drive):
    file = tmp_path / "labels.json"
    with file.open("w") as out:
        out.write('{"openlabel": {"metadata": {"schema_version": "1.0.0"}, "contexts": {"0":')
        for _ in range(100):
            out.write("[" * 1_000_000)
    with pytest.raises(DataError, match="expected JSON"):
        OPENLABEL.read(file, drive, PLAIN)
