"""Images and point clouds of ROS 2, in every layout that is read and in those that lie."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.adapters.rosbag.messages import NO_TIME, Position, Topic, header_stamp_ns
from bench.adapters.rosbag.rig import LidarRig
from bench.adapters.rosbag.sensors import BagImage, cloud_sweep
from bench.errors import DataError
from tests.support import tiny_rosbag as bags

NAME = Path("drive.mcap/front/1")
TIME_NS = 1_700_000_000_123_456_789
SIZE = (6, 4)
RED, GREEN, BLUE = (0, 0, 200), (0, 180, 0), (160, 0, 0)  # BGR
RIG = {"topic": "/lidar", "vehicle_from_sensor": {"quaternion_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 0]}}


def plain(colour_bgr):
    return np.full((SIZE[1], SIZE[0], 3), colour_bgr, dtype=np.uint8)


def image_on(kind, size_px, white_level):
    return BagImage(NAME.parents[1], Position(-1, 0, 0), Topic("/camera", kind), size_px, white_level, NAME)


def read(message, *, colour=True, white_level=65535):
    return image_on(bags.IMAGE, SIZE, white_level).decoded(message, colour=colour)


def mosaic(pattern, colour_bgr):
    """What a sensor with this colour filter measures of one colour."""
    values = {"b": colour_bgr[0], "g": colour_bgr[1], "r": colour_bgr[2]}
    cell = np.array([values[letter] for letter in pattern], dtype=np.uint8).reshape(2, 2)
    return np.tile(cell, (SIZE[1] // 2, SIZE[0] // 2))


def packed_yuv(colour_bgr, order):
    blue, green, red = (float(part) for part in colour_bgr)
    y = 16 + 0.257 * red + 0.504 * green + 0.098 * blue
    u = 128 - 0.148 * red - 0.291 * green + 0.439 * blue
    v = 128 + 0.439 * red - 0.368 * green - 0.071 * blue
    values = {"y": y, "u": u, "v": v}
    pair = np.array([values[letter] for letter in order]).round().astype(np.uint8)
    return np.tile(pair, (SIZE[1], SIZE[0] // 2)).reshape(SIZE[1], SIZE[0] * 2)


@pytest.mark.parametrize("colour_bgr", [RED, GREEN, BLUE], ids=["red", "green", "blue"])
@pytest.mark.parametrize("padding", [0, 5])
def test_colours_come_out_right(colour_bgr, padding):
    bgr = plain(colour_bgr)
    alpha = np.full((SIZE[1], SIZE[0], 1), 9, dtype=np.uint8)
    cases = {
        "bgr8": bgr,
        "rgb8": bgr[..., ::-1],
        "bgra8": np.concatenate([bgr, alpha], axis=2),
        "rgba8": np.concatenate([bgr[..., ::-1], alpha], axis=2),
        "bayer_rggb8": mosaic("rggb", colour_bgr),
        "bayer_bggr8": mosaic("bggr", colour_bgr),
        "bayer_gbrg8": mosaic("gbrg", colour_bgr),
        "bayer_grbg8": mosaic("grbg", colour_bgr),
        "yuv422": packed_yuv(colour_bgr, "uyvy"),
        "yuv422_yuy2": packed_yuv(colour_bgr, "yuyv"),
    }
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    for encoding, pixels in cases.items():
        message = bags.image(TIME_NS, pixels, encoding, padding=padding)
        message.width = SIZE[0]
        seen = read(message)
        assert seen.shape == (4, 6, 3)
        # The border of a mosaic is interpolated from one side.
        assert np.abs(seen[1:-1, 1:-1].astype(int) - colour_bgr).max() <= 4, encoding
        got = read(message, colour=False)
        assert got.shape == (4, 6)
        limit = 25 if encoding.startswith("yuv") else 4  # their grey is the sensor's own, from 16 to 235
        assert np.abs(got[1:-1, 1:-1].astype(int) - grey[1:-1, 1:-1]).max() <= limit, encoding


@pytest.mark.parametrize("big", [False, True])
def test_grey_of_16_bits_is_scaled_by_a_fixed_level(big):
    values = np.arange(24, dtype=np.uint16).reshape(4, 6) * 200
    message = bags.image(TIME_NS, values.astype(">u2" if big else "<u2"), "mono16", big=big, padding=2)
    twelve_bits = np.minimum(np.round(values * (255 / 4095)), 255)
    assert np.array_equal(read(message, colour=False, white_level=4095), twelve_bits)
    assert np.array_equal(read(message, colour=False), np.round(values * (255 / 65535)))
    assert read(message).shape == (4, 6, 3)


BILLIONS, NO_DATA = 2**32 - 1, np.zeros(0, dtype=np.uint8)
LIES = [
    ({"encoding": "32FC1"}, "encoding: expected one of mono8, .*, got '32FC1'"),
    ({"width": BILLIONS, "height": BILLIONS}, "expected 6 x 4 px, as the rig file says, got 4294967295 x"),
    ({"height": 0, "data": NO_DATA}, "image size: expected 6 x 4"),
    ({"step": 5}, "step: expected at least 6 bytes a row, got 5"),
    ({"data": np.zeros(23, dtype=np.uint8)}, "data: expected 24 bytes for 4 rows of 6, got 23"),
    ({"encoding": "rgb8"}, "step: expected at least 18 bytes a row, got 6"),
]


@pytest.mark.parametrize(("changes", "told"), LIES)
def test_images_that_lie(changes, told):
    message = bags.image(TIME_NS, np.zeros((4, 6), dtype=np.uint8))
    assert read(message, colour=False).base is None  # what is read does not hold the message
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(DataError, match=told):
        read(message)


def compressed(message, *, colour=False, white_level=65535):
    return image_on(bags.COMPRESSED, (64, 48), white_level).decoded(message, colour=colour)


def test_compressed_images():
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    assert np.array_equal(compressed(bags.compressed(TIME_NS, pixels), colour=True), pixels)
    soft = cv2.GaussianBlur(pixels, (0, 0), 4)
    seen = compressed(bags.compressed(TIME_NS, soft, ".jpg", "bgr8; jpeg compressed bgr8"), colour=True)
    assert np.abs(seen.astype(int) - soft).max() < 25
    assert compressed(bags.compressed(TIME_NS, soft, ".jpg")).shape == (48, 64)
    deep = pixels[..., 0].astype(np.uint16) * 16
    message = bags.compressed(TIME_NS, deep, ".png", "mono16; png compressed ")
    assert np.array_equal(compressed(message, white_level=255 * 16), pixels[..., 0])
    assert np.array_equal(compressed(message, white_level=255 * 16, colour=True)[..., 2], pixels[..., 0])


def test_compressed_images_that_lie():
    pixels = np.zeros((48, 64), dtype=np.uint8)
    with pytest.raises(DataError, match="image size: expected 64 x 48 px, as the rig file says, got 60 x 48"):
        compressed(bags.compressed(TIME_NS, pixels[:, :60]))
    with pytest.raises(DataError, match=r"format: expected JPEG or PNG, got '16UC1; compressedDepth png'"):
        compressed(bags.compressed(TIME_NS, pixels, ".png", "16UC1; compressedDepth png"))


def test_stamps():
    little = b"\x00\x01\x00\x00" + (17).to_bytes(4, "little") + (5).to_bytes(4, "little")
    big = b"\x00\x00\x00\x00" + (17).to_bytes(4, "big") + (5).to_bytes(4, "big")
    assert header_stamp_ns(little) == header_stamp_ns(big) == 17_000_000_005
    assert header_stamp_ns(little[:11]) == NO_TIME
    assert header_stamp_ns(b"\x00\x07" + little[2:]) == NO_TIME
    assert header_stamp_ns(little[:4] + b"\xff\xff\xff\xff" + little[8:]) == NO_TIME
    assert header_stamp_ns(little[:4] + bytes(8)) == NO_TIME  # what a driver leaves that sets none
    assert header_stamp_ns(little[:8] + (10**9).to_bytes(4, "little")) == NO_TIME


def points_of(layout, count=5, **columns):
    points = np.zeros(count, dtype=layout)
    for axis in "xyz":
        points[axis] = np.arange(count) + 1
    for name, values in columns.items():
        points[name] = values
    return points


def swept(points, *, stamp_ns=TIME_NS, **rig):
    big = points.dtype["x"].str[0] == ">"
    message = bags.cloud(stamp_ns, points, big=big)
    return cloud_sweep(message, TIME_NS, stamp_ns=stamp_ns, rig=LidarRig(**RIG | rig), name=NAME)


def xyz(order="<", kind="f4"):
    return [(axis, f"{order}{kind}") for axis in "xyz"]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_any_order_of_bytes_and_fields_and_any_filling(order, kind):
    size = int(kind[1])
    layout = np.dtype(
        {
            "names": ["label", "z", "y", "x"],
            "formats": [f"{order}u2", *[f"{order}{kind}"] * 3],
            "offsets": [1, 8, 8 + size, 8 + 2 * size],
            "itemsize": 48,
        }
    )
    cloud = swept(points_of(layout, z=-1.5))
    assert cloud.points_lidar.dtype == np.dtype(f"={kind}")
    assert cloud.points_lidar.tolist() == [[i, i, -1.5] for i in range(1, 6)]
    assert (cloud.time_offset_ns, cloud.unread_fields) == (None, ("label",))


def test_rows_of_an_ordered_cloud_with_padding():
    points = points_of(xyz(), count=12)
    message = bags.cloud(TIME_NS, points, height=3, row_padding=7)
    assert (message.height, message.width, message.row_step) == (3, 4, 55)
    cloud = cloud_sweep(message, TIME_NS, stamp_ns=TIME_NS, rig=LidarRig(**RIG), name=NAME)
    assert cloud.points_lidar[:, 1].tolist() == list(range(1, 13))


def test_points_that_are_none_are_left_out_and_an_empty_cloud_is_an_empty_sweep():
    points = points_of(xyz())
    points["y"][1] = np.nan
    for axis in "xyz":
        points[axis][4] = 0.0
    assert swept(points).stored_rows.tolist() == [0, 2, 3, 4]
    assert swept(points, drop_origin=True).stored_rows.tolist() == [0, 2, 3]
    assert len(swept(points_of([*xyz(), ("t", "<u4")], count=0)).points_lidar) == 0


SEC = TIME_NS / 1e9
TIMES = [  # of any unit: tests/lidar
    ("t", "<u4", [0, 1000, 99_999_999], {}, [0, 1000, 99_999_999]),
    ("timestamp", ">f8", [SEC, SEC - 0.05, SEC - 0.1], {}, [0, -50_000_000, -100_000_000]),
    ("stamp_of_point", "<f4", [0, 50, 100], {"time_field": "stamp_of_point", "time_unit": "ms"}, [0, 5e7, 1e8]),
]


@pytest.mark.parametrize(("name", "kind", "values", "rig", "offsets_ns"), TIMES)
def test_times_of_points(name, kind, values, rig, offsets_ns):
    order = kind[0] if kind[0] in "<>" else "<"
    cloud = swept(points_of([*xyz(order), (name, kind)], count=3, **{name: values}), **rig)
    assert cloud.time_offset_ns == pytest.approx(np.array(offsets_ns), abs=500)
    assert cloud.time_offset_ns.dtype == np.int64


BAD_TIMES = [
    ("t", "<u4", [0, 1, 2**32 - 1], {}, "t: expected times .* apart, .* got 0 to 4294967295; set time_unit of"),
    ("time", "<f4", [0, 0, 0], {"time_field": "when"}, "expected the time field when, got time"),
]


@pytest.mark.parametrize(("name", "kind", "values", "rig", "told"), BAD_TIMES)
def test_times_that_cannot_be(name, kind, values, rig, told):
    with pytest.raises(DataError, match=told):
        swept(points_of([*xyz(), (name, kind)], count=3, **{name: values}), **rig)


CLOUD_LIES = [  # what of the message, or of its second field, is another
    ({"width": BILLIONS}, {}, "data: expected 51539607540 bytes for 1 rows of 4294967295 points, got 60"),
    ({"width": 6}, {}, "data: expected 72 bytes for 1 rows of 6 points, got 60"),
    ({"height": 5, "width": 1, "row_step": 3}, {}, "row_step: expected at least"),
    ({"point_step": 0}, {}, "fields, x: expected an offset inside the point, got byte 0 of points of 0"),
    ({}, {"offset": BILLIONS}, "fields, y: expected an offset inside the point"),
    ({}, {"datatype": 99}, "fields, y: expected a datatype from 1 to 8, got 99"),
    ({}, {"name": "height"}, "fields: expected y as float32 or float64, got x, height, z"),
]


@pytest.mark.parametrize(("changes", "field", "told"), CLOUD_LIES)
def test_clouds_that_lie(changes, field, told):
    message = bags.cloud(TIME_NS, points_of(xyz()))
    for name, value in field.items():
        setattr(message.fields[1], name, value)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(DataError, match=told):
        cloud_sweep(message, TIME_NS, stamp_ns=TIME_NS, rig=LidarRig(**RIG), name=NAME)
