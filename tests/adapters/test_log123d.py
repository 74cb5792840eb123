"""The adapter of 123D: a drive as a log, written by pyarrow and by the library's own writer, reads as itself."""

import fcntl
from functools import partial

import numpy as np
import pyarrow as pa
import pytest

from bench.adapters.log123d import CLASSES, CameraHead, log123d_recordings
from bench.cameras.angular import RadialPolynomialCamera
from bench.cameras.model import RollingShutter
from bench.cameras.spheres import UnifiedCamera
from bench.errors import DataError, ShapeError
from bench.recordings import list_cards, read_image
from bench.recordings.cards import shipped_folder
from bench.records.recording import Cuboid
from bench.records.reference import OBJECT_CLASSES
from tests.support import data_sets, log123d


@pytest.fixture(scope="session")
def library(tmp_path_factory, worker_id):
    """The library 123D where only its own programs find it, one for all processes that run tests."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "py123d"
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return folder if folder.exists() else log123d.install_library(folder)


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    return log123d.tiny_recording(tmp_path_factory.mktemp("native"))


opened = partial(data_sets.opened, "123d", **log123d.OPTIONS)


def assert_same(found, native):
    """The same cameras, images, poses, boxes and points, times to a microsecond."""
    (camera,), (own,) = found.cameras.values(), native.cameras.values()
    assert isinstance(camera.model, RadialPolynomialCamera)
    rays = np.random.default_rng(3).normal(size=(500, 3))
    np.testing.assert_allclose(camera.model.project(rays)[0], own.model.project(rays)[0], atol=1e-9)
    np.testing.assert_allclose(camera.vehicle_from_camera.matrix, own.vehicle_from_camera.matrix, atol=1e-9)
    np.testing.assert_allclose(camera.road.height_m, own.road.height_m, atol=1e-9)
    for image, before in zip(found.images["ftcam_f0"], native.images["front"], strict=True):
        assert abs(image.timestamp_ns - before.timestamp_ns) <= 500
        np.testing.assert_array_equal(read_image(image, camera), read_image(before, own))
    times_ns = native.trajectory.timestamps_ns[1:-1]
    for now, then in zip(found.trajectory.at(times_ns), native.trajectory.at(times_ns), strict=True):
        np.testing.assert_allclose(now, then, atol=1e-5)
    for ref, before in zip(found.sweeps, native.sweeps, strict=True):
        sweep, then = ref.read(), before.read()
        assert np.abs(sweep.times_ns - then.times_ns).max() <= 500
        points = found.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
        expected = native.vehicle_from_lidar.apply(then.points_lidar.astype(np.float64))
        np.testing.assert_allclose(points, expected, atol=1e-5)
    mounting = native.vehicle_from_lidar @ native.lidar_from_sensor
    np.testing.assert_allclose((found.vehicle_from_lidar @ found.lidar_from_sensor).matrix, mounting.matrix, atol=1e-9)
    boxed = {t.track_id: t for t in native.tracks if any(isinstance(s.shape, Cuboid) for s in t.states)}
    assert {track.track_id for track in found.tracks} == {*boxed}
    for track in found.tracks:
        before = boxed[track.track_id]
        assert track.object_class == before.object_class
        for state, then in zip(track.states, before.states, strict=True):
            np.testing.assert_allclose(
                state.shape.vehicle_from_object.matrix, then.shape.vehicle_from_object.matrix, atol=1e-4
            )
            np.testing.assert_allclose(state.shape.size_m, then.shape.size_m)
            np.testing.assert_allclose(state.velocity_mps, then.velocity_mps, atol=1e-6)


@pytest.mark.parametrize("compression", [None, "zstd"])
def test_a_log_reads_as_the_recording_that_it_was_made_of(native, tmp_path, compression):
    log123d.write_log(native, tmp_path, compression=compression)
    found = opened(tmp_path, rolling_shutter={"ftcam_f0": {"readout_s": 0.02}})
    assert_same(found, native)
    assert found.cameras["ftcam_f0"].rolling_shutter == RollingShutter(readout_s=0.02)
    assert found.name == "drive"
    np.testing.assert_allclose(found.vehicle_outline_m.min(axis=0), [1.4 - 2.4, -0.9])


@pytest.mark.slow
def test_a_log_of_the_librarys_own_writer_reads_as_the_recording(native, tmp_path, library):
    settings = {"camera_store_option": "png_binary", "lidar_codec": "ipc_zstd"}
    log123d.write_log_by_library(native, tmp_path, library, **settings)
    assert_same(opened(tmp_path), native)


def rewritten(file, change):
    """The table with another content."""
    table = pa.ipc.open_file(file).read_all()
    changed = change(table).replace_schema_metadata(table.schema.metadata)
    with pa.ipc.new_file(str(file), changed.schema) as writer:
        writer.write_table(changed)


def changed_column(table, name, change):
    """The table with other rows in a column."""
    index = next(i for i, key in enumerate(table.schema.names) if key.endswith(f".{name}"))
    field = table.schema.field(index)
    return table.set_column(index, field, pa.array(map(change, table.column(index).to_pylist()), field.type))


def test_a_velocity_of_zero_is_unknown_where_the_writer_had_no_neighbour(native, tmp_path):
    file = log123d.write_log(native, tmp_path) / "box_detections_se3.arrow"
    still = [0.0, 0.0, 0.0]
    rewritten(file, lambda table: changed_column(table, "velocity_3d", lambda row: [still] * len(row)))
    for track in opened(tmp_path).tracks:
        np.testing.assert_array_equal([state.velocity_mps for state in track.states], 0.0)
    rewritten(file, lambda table: table.slice(0, 1))
    for track in opened(tmp_path).tracks:
        assert np.isnan([state.velocity_mps for state in track.states]).all()
    rewritten(file, lambda table: table.slice(0, 0))
    assert opened(tmp_path).tracks == ()


def test_of_several_boxes_of_an_object_at_a_time_the_first_counts(native, tmp_path):
    file = log123d.write_log(native, tmp_path) / "box_detections_se3.arrow"
    before = opened(tmp_path).tracks

    def twice(table):
        for name in ("track_token", "label", "velocity_3d"):
            table = changed_column(table, name, lambda row: row * 2)
        return changed_column(table, "bounding_box_se3", lambda row: [*row, *([x + 1, *rest] for x, *rest in row)])

    rewritten(file, twice)
    for track, own in zip(opened(tmp_path).tracks, before, strict=True):
        for state, then in zip(track.states, own.states, strict=True):
            np.testing.assert_array_equal(state.shape.vehicle_from_object.matrix, then.shape.vehicle_from_object.matrix)


def test_one_lidar_of_several_that_are_merged(native, tmp_path):
    file = log123d.write_log(native, tmp_path) / "lidar.lidar_top.arrow"
    table = pa.ipc.open_file(file).read_all()
    head = log123d.head_of(file)
    heads = {2: head, 5: head | {"lidar_name": "front", "lidar_id": 5, "lidar_to_imu_se3": [1.0, 0, 0, 1, 0, 0, 0]}}
    clouds = []
    for cell in table.column("lidar.lidar_top.data").to_pylist():
        batch = pa.ipc.open_stream(cell).read_next_batch()
        points = np.column_stack([batch.column(axis).to_numpy() for axis in "xyz"])
        clouds.append(log123d.cloud(points, {"ids": np.where(np.arange(len(points)) % 2, 2, 5).astype(np.uint8)}))
    names = ["lidar.lidar_merged." + name.rpartition(".")[2] for name in table.schema.names]
    merged = table.rename_columns(names).set_column(2, names[2], pa.array(clouds, pa.binary()))
    log123d.write_table(file.with_name("lidar.lidar_merged.arrow"), merged, heads)
    file.unlink()
    whole, top, front = (opened(tmp_path, **chosen) for chosen in ({}, {"lidar": "top"}, {"lidar": "front"}))
    points = whole.sweeps[0].read().points_lidar
    np.testing.assert_array_equal(top.sweeps[0].read().points_lidar, points[1::2])
    np.testing.assert_array_equal(front.sweeps[0].read().points_lidar, points[::2])
    np.testing.assert_array_equal(front.lidar_from_sensor.translation_m, [1.0, 0, 0])
    with pytest.raises(DataError, match="expected a lidar 'back', got lidars top, front"):
        opened(tmp_path, lidar="back")


def test_points_that_were_moved_to_a_time_are_of_that_time(native, tmp_path):
    log123d.write_log(native, tmp_path)
    for when, of_sweep in (("start", np.min), ("end", np.max)):
        for ref, before in zip(opened(tmp_path, motion_compensated=when).sweeps, native.sweeps, strict=True):
            assert abs(ref.timestamp_ns - of_sweep(before.read().times_ns)) <= 500
            assert ref.read().time_offset_ns is None


def test_logs_of_other_data_sets_in_the_same_folder_are_not_read(native, tmp_path):
    """As all conversions by default write into one."""
    folder = log123d.write_log(native, tmp_path)
    (tmp_path / "others_val").mkdir()
    folder.rename(tmp_path / "others_val" / "another")
    log123d.write_log(native, tmp_path)
    list_recordings = partial(log123d_recordings, tmp_path, card=tmp_path / "card.yaml", annotations=None)
    assert [handle.name for handle in list_recordings(options={})] == ["drive", "another"]
    assert [handle.name for handle in list_recordings(options={"log_splits": ["others_val"]})] == ["another"]
    with pytest.raises(DataError, match=r"drives_val/<log>/sync\.arrow, got none; convert .* set the card's root"):
        list_recordings(options={"log_splits": ["drives_val"]})
    with pytest.raises(DataError, match="log_splits"):
        list_recordings(options={"log_splits": ["../elsewhere"]})


CARDS = [card for card in list_cards(shipped_folder()) if card.content.adapter == "123d"]


@pytest.mark.slow
def test_cards_name_splits_and_cameras_as_the_library_writes_them(library):
    known = log123d.names_in_123d(library)["cards"]
    assert {*known} == {card.name for card in CARDS}
    for card in CARDS:
        splits, cameras = known[card.name]
        assert {*card.content.options["log_splits"]} <= {*splits}
        assert {*card.content.options["cameras"]} <= {*cameras}


def test_lenses_are_those_of_the_head():
    head = {"width": 1400, "height": 1400, "camera_to_imu_se3": (0, 0, 0, 1, 0, 0, 0)}
    mei = CameraHead(
        camera_model="fisheye_mei", mirror_parameter=2.2, distortion=(0.01, 0.02, 1e-3, 2e-3),
        projection=(1300.0, 1301.0, 700.0, 701.0), **head,
    ).model(None)  # fmt: skip
    assert isinstance(mei, UnifiedCamera)
    assert (mei.xi, mei.focal, mei.principal_point) == (2.2, (1300.0, 1301.0), (700.0, 701.0))
    pinhole = CameraHead(camera_model="pinhole", intrinsics=(900.0, 901.0, 700.0, 701.0, 0.0), **head).model(1.0)
    pixel, _ = pinhole.project(np.array([[0.1, 0.2, 1.0]]))
    np.testing.assert_allclose(pixel, [[790.0, 881.2]])
    with pytest.raises(ShapeError, match="no skew"):
        CameraHead(camera_model="pinhole", intrinsics=(900.0, 901.0, 700.0, 701.0, 2.0), **head).model(None)
    with pytest.raises(ShapeError, match="mirror_parameter: expected 1 numbers, got none"):
        CameraHead(camera_model="fisheye_mei", projection=(1.0, 1.0, 1.0, 1.0), **head).model(None)


@pytest.mark.slow
def test_labels_are_numbered_as_the_library_does(library):
    """And joined as its own default labels are, but for riders and people with or on small wheels."""
    assert {name for classes in CLASSES.values() for name in classes.values()} == {*OBJECT_CLASSES}
    known = log123d.names_in_123d(library)["labels"]
    assert {*CLASSES} <= {*known}
    own = {"VEHICLE": "vehicle", "TRAIN": "vehicle", "TWO_WHEELER": "cyclist", "PERSON": "pedestrian"}
    own |= {"ANIMAL": "animal"}
    riders = {"RIDER", "BICYCLIST", "MOTORCYCLIST"}
    wheels = {"STROLLER", "WHEELCHAIR", "WHEELED_DEVICE", "PERSONAL_MOBILITY_DEVICE"}
    for kind in CLASSES:
        for number, (name, default) in known[kind].items():
            expected = "cyclist" if name in riders else "pedestrian" if name in wheels else own.get(default)
            assert CLASSES[kind].get(int(number)) == expected, f"{kind}.{name}"


FRONT, CLOUDS, NOT_ARROW = "camera.ftcam_f0", "lidar.lidar_top", "an Arrow file of a 123D log"
NO_HEAD = pa.schema([("a", pa.int64())])
FAULTS = [  # of which table, what is done to its file or its content, what is said
    (FRONT, lambda file: file.write_bytes(file.read_bytes()[:300]), NOT_ARROW),
    ("ego_state_se3", lambda file: file.unlink(), NOT_ARROW),
    (FRONT, lambda file: pa.ipc.new_file(str(file), NO_HEAD).close(), "the head of a table"),
    (FRONT, partial(rewritten, change=lambda t: t.take([2, 1, 0])), "times that increase"),
    (CLOUDS, partial(rewritten, change=lambda t: t.drop_columns([f"{CLOUDS}.data"])), "data"),
    (
        CLOUDS,
        partial(rewritten, change=lambda t: changed_column(t, "data", lambda _: b"x")),
        "points as an Arrow stream",
    ),
]


@pytest.mark.parametrize(("name", "damage", "told"), FAULTS)
def test_a_damaged_table_is_one_clear_error(native, tmp_path, name, damage, told):
    file = log123d.write_log(native, tmp_path, compression=None) / f"{name}.arrow"
    damage(file)
    with pytest.raises(DataError, match=told) as caught:  # noqa: PT012 - where it is found depends on the fault
        for sweep in opened(tmp_path).sweeps:
            sweep.read()
    assert file.stem in str(caught.value)


@pytest.mark.parametrize("stored", [["images/1.png"] * 3, [0, 1, 2], [None] * 3], ids=["paths", "a video", "none"])
def test_images_that_are_not_in_the_log_are_refused_with_what_to_do(native, tmp_path, stored):
    file = log123d.write_log(native, tmp_path) / "camera.ftcam_f0.arrow"
    rewritten(file, lambda t: t.set_column(1, "camera.ftcam_f0.data", pa.array(stored)))
    recording = opened(tmp_path)
    with pytest.raises(DataError, match=r"ftcam_f0\.arrow: batch 0, row 1: expected data in the log.*; convert again"):
        read_image(recording.images["ftcam_f0"][1], recording.cameras["ftcam_f0"])
