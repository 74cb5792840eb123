"""The rosbag adapter: known scenes written as bags, read back."""

import copy
import pickle
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bench.adapters.rosbag.rig import Rig, RosbagOptions
from bench.cameras.model import RollingShutter
from bench.cameras.stored import camera_from_parameters
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.harness.digests import digest_file
from bench.recordings import load_card, read_image
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED
from tests.support import data_sets, tiny
from tests.support import tiny_rosbag as bags

REPOSITORY = Path(__file__).parents[2]


opened = partial(data_sets.opened, "rosbag", **bags.OPTIONS)


def rig_with(*, front=None, **changes):
    """The rig with other parts, and its camera with other keys."""
    rig = copy.deepcopy(bags.RIG) | changes
    rig["cameras"]["front"] |= front or {}
    return rig


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_images_sweeps_and_poses_come_back_as_they_were_written(tmp_path, storage):
    annotations = bags.write_data_set(tmp_path / "data", storage=storage)
    recording = opened(tmp_path / "data", annotations=annotations)
    camera = recording.cameras["front"]
    assert camera.model == tiny.lens()
    assert camera.vehicle_from_camera.matrix == pytest.approx(tiny.FRONT.matrix)
    assert camera.ego_body.sum() == camera.ego_body[40:, 10:50].sum() == 8 * 40
    assert [ref.timestamp_ns for ref in recording.images["front"]] == list(tiny.TIMES_NS)
    for i, ref in enumerate(recording.images["front"]):
        travelled = pickle.loads(pickle.dumps(ref))
        assert np.array_equal(read_image(travelled, camera), tiny.pixels(i))
        assert read_image(ref, camera, colour=True).shape == (tiny.HEIGHT, tiny.WIDTH, 3)
        assert (len(pickle.dumps(ref)) < 2000, ref.path.stem) == (True, str(tiny.TIMES_NS[i]))
        assert travelled.file == tmp_path / "data" / "drive" / f"drive.{storage}"
    assert len(recording.sweeps) == 2
    for i, ref in enumerate(recording.sweeps):
        sweep, true = ref.read(), tiny.sweep(i)
        assert np.array_equal(sweep.points_lidar, true.points_lidar)
        assert np.array_equal(sweep.time_offset_ns, true.time_offset_ns)
        assert sweep.timestamp_ns == true.timestamp_ns
    assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix)
    assert recording.trajectory.positions_m == pytest.approx(np.array([[0, 0, 0], [0.2, 0, 0], [0.4, 0, 0]]))
    assert recording.frame_interval_ns == tiny.STEP_NS
    assert recording.annotated == COMPLETELY
    assert {track.track_id for track in recording.tracks} == {"van", "walker"}
    bare = opened(tmp_path / "data")
    assert (bare.tracks, bare.annotated) == ((), NOT_ANNOTATED)


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_files_of_the_other_writer_of_mcap(tmp_path, compression):
    """With what ROS's recorder may add: an attachment, metadata, and topics in other languages or none."""
    root = bags.write_rig(tmp_path / "data")
    with (root / "drive.mcap").open("wb") as stream:
        writer = Writer(stream, 8000, compression=CompressionType[compression])
        writer.start(profile="ros2")
        protobuf = writer.register_schema("example.Log", "protobuf", b"\x0a\xff\xfe\x80")
        others = writer.register_channel("/log", "protobuf", protobuf), writer.register_channel("/json", "json", 0)
        channels = {}
        for topic, kind, time_ns, content in bags.drive():
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(bags.STORE.serialize_cdr(content, kind))
            writer.add_message(channels[topic], time_ns + bags.LATE_NS, data, time_ns)
            for other in others:
                writer.add_message(other, time_ns, b"\xff\xff", time_ns)
        writer.add_attachment(0, 0, "calibration", "application/octet-stream", bytes(5000))
        writer.add_metadata("rosbag2", {"ROS_DISTRO": "jazzy"})
        writer.finish()
    recording = opened(root)
    for i, ref in enumerate(recording.images["front"]):
        assert np.array_equal(read_image(ref, recording.cameras["front"]), tiny.pixels(i))
    assert [ref.read().points_lidar.tolist() for ref in recording.sweeps] == [
        tiny.sweep(i).points_lidar.tolist() for i in range(2)
    ]


PACKED = [
    ("FILE", r"drive\.db3\.zstd'; unpack it: unzstd drive/\*\.zstd, then ros2 bag"),
    ("MESSAGE", r"compression_mode: expected none, got 'message'; write it again without: ros2 bag convert"),
    (None, r"expected a bag of ROS 2, got one of ROS 1; convert it: rosbags-convert"),
]


@pytest.mark.parametrize(("compression", "told"), PACKED)
def test_what_is_packed_by_itself_or_of_ros_1_is_refused_with_what_to_do(tmp_path, compression, told):
    root = bags.write_rig(tmp_path / "data")
    if compression is None:
        (root / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    else:
        bags.write_bag(root / "drive", bags.drive(), storage="db3", compression=compression)
    with pytest.raises(DataError, match=told):
        opened(root)


def test_a_single_file_and_a_root_that_is_a_bag(tmp_path):
    root = bags.write_rig(tmp_path / "data")
    file = bags.write_bag(tmp_path / "made", bags.drive())
    file.rename(root / "evening.mcap")
    assert opened(root).name == "evening"
    inside = tmp_path / "inside"
    bags.write_bag(inside, bags.drive())
    bags.write_rig(inside)
    assert opened(inside).name == "inside"


def test_the_clock_is_the_cards_and_offsets_and_a_rolling_shutter_are_the_rigs(tmp_path):
    root = bags.data_set(tmp_path, bags.drive())
    assert opened(root, clock="bag").images["front"][0].timestamp_ns == tiny.TIMES_NS[0] + bags.LATE_NS
    shutter = {"readout_s": 0.02, "direction": "up"}
    rig = rig_with(front={"time_offset_ns": -7_000_000, "rolling_shutter": shutter})
    rig["lidar"]["time_offset_ns"] = 2_000_000
    bags.write_rig(root, rig)
    recording = opened(root)
    assert recording.cameras["front"].rolling_shutter == RollingShutter(**shutter)
    assert recording.images["front"][0].timestamp_ns == tiny.TIMES_NS[0] - 7_000_000
    sweep = recording.sweeps[0].read()
    assert sweep.times_ns.tolist() == (tiny.sweep(0).times_ns + 2_000_000).tolist()


def test_mountings_from_frames(tmp_path):
    body_from_mast = RigidTransform.from_yaw(0.5, (1.0, 0.0, 2.0))
    rig = rig_with()
    for sensor, frame in ((rig["cameras"]["front"], "front_optical"), (rig["lidar"], "velodyne")):
        del sensor["vehicle_from_sensor"]
        sensor["frame"] = frame
    rig["vehicle"]["frame"] = "body"
    rows = [row for row in bags.drive() if row[1] != bags.CLOUD]
    points = bags.cloud(tiny.TIMES_NS[0], bags.sweep_points(0), frame="velodyne")
    rows.append((bags.LIDAR, bags.CLOUD, tiny.TIMES_NS[0], points))
    tree = bags.frames(
        ("body", "mast", body_from_mast),
        ("mast", "velodyne", body_from_mast.inverse() @ tiny.VEHICLE_FROM_LIDAR),
        # Told from the sensor's side: its parent is below it in the tree of this vehicle.
        ("front_optical", "bumper", tiny.FRONT.inverse()),
        ("bumper", "other", RigidTransform.identity()),
    )
    joined = bags.frames(("other", "body", RigidTransform.identity()))
    rows = [("/tf_static", bags.FRAMES, tiny.TIMES_NS[0], m) for m in (tree, joined)] + rows
    root = bags.data_set(tmp_path, rows, rig)
    recording = opened(root)
    assert recording.cameras["front"].vehicle_from_camera.matrix == pytest.approx(tiny.FRONT.matrix)
    assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix)
    recording.sweeps[0].read()
    for frame, told in (
        ("mast", r"header\.frame_id: expected 'mast', as the rig file says, got 'velodyne'"),
        ("roof", r"rig\.yaml: lidar\.frame: expected the frame 'roof' in /tf_static, got body"),
    ):
        bags.write_rig(root, rig | {"lidar": rig["lidar"] | {"frame": frame}})
        with pytest.raises(DataError, match=told):
            opened(root).sweeps[0].read()


@pytest.mark.parametrize("wxyz", [(np.nan, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (np.inf, 1.0, 0.0, 0.0)])
def test_a_frame_that_is_no_transform_matters_where_it_is_asked_for(tmp_path, wxyz):
    tree = bags.frames(("base_link", "imu", RigidTransform.identity()), ("imu", "tip", RigidTransform.identity()))
    tree.transforms[0].transform.rotation = bags.quaternion(wxyz)
    rows = [("/tf_static", bags.FRAMES, tiny.TIMES_NS[0], tree), *bags.drive()]
    root = bags.data_set(tmp_path, rows)
    assert opened(root).vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix)
    rig = rig_with()
    del rig["lidar"]["vehicle_from_sensor"]
    bags.write_rig(root, rig | {"lidar": rig["lidar"] | {"frame": "tip"}})
    with pytest.raises(DataError, match=r"/tf_static, imu: expected a transform"):
        opened(root)


def test_what_of_a_bag_is_read_and_what_is_not_whether_topics_have_a_slash_or_not(tmp_path):
    rig = rig_with(front={"topic": bags.FRONT.lstrip("/")})
    rig["ego_motion"]["odometry"]["topic"] = bags.ODOM.lstrip("/")
    rows = [*bags.drive(), ("/imu", bags.ODOMETRY, tiny.TIMES_NS[0], bags.odometry(tiny.TIMES_NS[0], (0.0, 0.0, 0.0)))]
    contents = {content.what: content for content in opened(bags.data_set(tmp_path, rows, rig)).contents}
    assert contents[f"topic {bags.FRONT}"].read_as == "images of front"
    assert (contents["topic /imu"].count, contents["topic /imu"].why) == (1, "not named in rig.yaml")


def test_poses_of_a_frame_beside_the_vehicles(tmp_path):
    """A child frame 1 m ahead of the vehicle that turns left by 90 degrees: the vehicle swings around it."""
    ahead = {"quaternion_wxyz": [1, 0, 0, 0], "translation_m": [1, 0, 0]}
    rig = rig_with(ego_motion={"odometry": {"topic": bags.ODOM, "vehicle_from_child": ahead}})
    half = np.sqrt(0.5)
    rows = [row for row in bags.drive() if row[0] != bags.ODOM]
    for time_ns, wxyz in ((tiny.TIMES_NS[0], (1, 0, 0, 0)), (tiny.TIMES_NS[2], (half, 0, 0, half))):
        rows.append((bags.ODOM, bags.ODOMETRY, time_ns, bags.odometry(time_ns, (1.0, 0.0, 0.0), wxyz)))
    positions_m = opened(bags.data_set(tmp_path, rows, rig)).trajectory.positions_m
    assert positions_m == pytest.approx(np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 0.0]]), abs=1e-12)


SIGNALS = {
    "speed": {"topic": bags.SPEED, "field": "twist.linear.x"},
    "yaw_rate": {"topic": bags.YAW, "field": "angular_velocity.z"},
}


def test_speed_and_yaw_rate_at_their_own_times(tmp_path):
    root = bags.data_set(tmp_path, [*bags.drive(), *bags.signals()], rig_with(ego_motion=SIGNALS))
    trajectory = opened(root).trajectory
    turned = trajectory.world_from_vehicle(tiny.TIMES_NS[0]).inverse() @ trajectory.world_from_vehicle(tiny.TIMES_NS[2])
    seconds = (tiny.TIMES_NS[2] - tiny.TIMES_NS[0]) / 1e9
    assert np.arctan2(turned.rotation[1, 0], turned.rotation[0, 0]) == pytest.approx(bags.TURN_RADPS * seconds)
    radius_m = bags.SPEED_MPS / bags.TURN_RADPS
    assert turned.translation_m[0] == pytest.approx(radius_m * np.sin(bags.TURN_RADPS * seconds))
    assert trajectory.timestamps_ns[0] == tiny.TIMES_NS[0] - 95_000_000  # the first yaw rate between two speeds


def test_factor_mean_of_fields_and_reverse(tmp_path):
    speed = {"topic": bags.SPEED, "field": ["twist.linear.x", "twist.linear.x"], "factor": 0.5}
    reverse = {"topic": "/gear", "field": "data", "values": [-1, 7]}
    rig = rig_with(ego_motion=SIGNALS | {"speed": speed, "reverse": reverse})
    kind = "std_msgs/msg/Int8"
    gears = [("/gear", kind, tiny.TIMES_NS[i], bags.message(kind, data=data)) for i, data in ((0, 7), (1, 3))]
    rows = [*bags.drive(), *bags.signals(), *gears]
    trajectory = opened(bags.data_set(tmp_path, rows, rig, late_ns=0)).trajectory
    before, after = (trajectory.velocity_vehicle_mps(time_ns) for time_ns in tiny.TIMES_NS[0:3:2])
    assert before[0] == pytest.approx(-bags.SPEED_MPS / 2, rel=1e-3)
    assert after[0] == pytest.approx(bags.SPEED_MPS / 2, rel=1e-3)


def test_a_message_type_of_ones_own(tmp_path):
    kind = "my_car/msg/Wheels"
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("std_msgs/Header header\nfloat32[4] kmh\n", kind))
    rows = [
        (row[0], kind, row[2], store.types[kind](header=row[3].header, kmh=np.full(4, 36.0, dtype=np.float32)))
        if row[0] == bags.SPEED
        else row
        for row in bags.signals()
    ]
    speed = {"topic": bags.SPEED, "field": ["kmh.2", "kmh.3"], "factor": 1 / 3.6}
    rig = rig_with(ego_motion=SIGNALS | {"speed": speed})
    root = bags.data_set(tmp_path, [*bags.drive(), *rows], rig, store=store)
    assert opened(root).trajectory.velocity_vehicle_mps(tiny.TIMES_NS[1])[0] == pytest.approx(10.0, rel=1e-3)


def test_a_gap_in_one_signal_is_a_gap_in_the_path(tmp_path):
    middle = tiny.TIMES_NS[1]
    rows = [row for row in bags.signals() if row[0] != bags.SPEED or abs(row[2] - middle) > 40_000_000]
    rig = rig_with(ego_motion=SIGNALS | {"max_gap_ns": 50_000_000})
    root = bags.data_set(tmp_path, [*bags.drive(), *rows], rig)
    _, _, valid = opened(root).trajectory.at(np.array(tiny.TIMES_NS))
    assert valid.tolist() == [True, False, True]


def test_each_recording_may_have_a_rig_and_one_elsewhere_or_with_tags_is_refused(tmp_path):
    root = bags.data_set(tmp_path, bags.drive())
    bags.write_rig(root / "drive", rig_with(front={"time_offset_ns": 5_000_000}))
    (first, *_) = opened(root, rig="{recording}/rig.yaml").images["front"]
    assert first.timestamp_ns == tiny.TIMES_NS[0] + 5_000_000
    with pytest.raises(DataError, match=r"options\.rig: expected a relative path without '\.\.', got '\.\./rig\.yaml'"):
        opened(root, rig="../rig.yaml")
    (root / "rig.yaml").write_text("vehicle: !!python/object/apply:os.getcwd []\n")
    with pytest.raises(DataError, match=r"rig\.yaml: expected YAML, got could not determine a constructor"):
        opened(root)


COVARIANCE = {"topic": "/imu", "field": "orientation_covariance", "values": [1]}


def speed_of(field):
    return {"ego_motion": SIGNALS | {"speed": {"topic": bags.SPEED, "field": field}}}


def odometry_on(topic, **signals):
    return {"ego_motion": {"odometry": {"topic": topic}} | signals}


RIGS = [
    ({"colour": 1}, r"rig\.yaml: colour: expected no such key, got 1"),
    ({"front": {"topic": "a b"}}, r"rig\.yaml: cameras\.front\.topic: expected String should match"),
    ({"front": {"frame": "x"}}, r"rig\.yaml: .*one of vehicle_from_sensor, the mounting, and frame"),
    ({"front": {"model": bags.LENS | {"model": "egg"}}}, r"rig\.yaml: cameras\.front\.model\.model: expected one of"),
    ({"front": {"topic": bags.LIDAR}}, r"rig\.yaml: .*each topic for one sensor, /lidar is named twice"),
    (odometry_on(bags.ODOM, **SIGNALS), r"rig\.yaml: .*either odometry, or speed and yaw_rate"),
    ({"ego_motion": {}}, r"rig\.yaml: .*either odometry, or speed and yaw_rate"),
    ({"front": {"topic": "/rear"}}, r"cameras\.front\.topic: expected messages on /rear, .* /camera/front"),
    ({"front": {"topic": bags.YAW}}, r"/imu: expected messages .*Image.*, got sensor_msgs/msg/Imu"),
    (odometry_on("/nowhere"), "/nowhere: expected messages of the ego-motion, got none"),
    (odometry_on("/imu"), r"/imu: expected messages nav_msgs/msg/Odometry"),
    (speed_of("twist.linear.w"), r"the field twist\.linear\.w, got none called 'w'; there are x, y, z"),
    (speed_of("header.frame_id"), r"header\.frame_id: expected a number, got str"),
    ({"ego_motion": SIGNALS | {"reverse": COVARIANCE}}, r"orientation_covariance: expected a number, got ndarray"),
]


@pytest.mark.parametrize(("changes", "told"), RIGS)
def test_rigs_that_cannot_be_or_do_not_fit_the_bag(tmp_path, changes, told):
    root = bags.data_set(tmp_path, [*bags.drive(), *bags.signals()], rig_with(**changes))
    with pytest.raises(DataError, match=told):
        opened(root)


def test_the_example_card_shows_a_rig_that_is_one():
    text = (REPOSITORY / "datasets" / "rosbag-example.yaml").read_text()
    shown = text.split("# rig.yaml:\n#\n")[1].split("\nname:")[0]
    rig = validated(Rig, yaml.safe_load("\n".join(line[4:] for line in shown.splitlines())), file=REPOSITORY)
    camera = rig.cameras["front"]
    parameters = dict(camera.model)
    assert camera_from_parameters(parameters.pop("model"), width=1280, height=960, **parameters).width == 1280
    card = load_card(REPOSITORY / "datasets" / "rosbag-example.yaml")
    validated(RosbagOptions, card.content.options, file=card.file)


def test_what_a_reference_stands_for_changes_with_content_and_with_its_decoding(tmp_path):
    """Results that are kept by content must not be found for another image of the same file."""
    root = bags.data_set(tmp_path, bags.drive())
    contents = {ref.stored.content() for ref in opened(root).images["front"]}
    assert len(contents) == 3
    assert {ref.stored.content() for ref in opened(root).images["front"]} == contents
    bags.write_rig(root, rig_with(front={"white_level": 4095}))
    assert contents.isdisjoint(ref.stored.content() for ref in opened(root).images["front"])
    assert len({digest_file(ref.path, ref.stored) for ref in opened(root).images["front"]}) == 3
