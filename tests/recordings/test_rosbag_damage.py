"""Bags that were cut short, damaged or made to hurt: what can be read is read, what is lost is told."""

import re
import struct
import tracemalloc
from functools import cache
from zlib import crc32

import numpy as np
import pytest
import yaml
from backports import zstd

from bench.errors import BenchError, DataError
from bench.recordings import read_image
from bench.recordings.rosbag.adapter import rosbag_recordings
from bench.recordings.rosbag.mcap import scan_mcap
from bench.recordings.rosbag.storage import ScanReport, Wanted
from tests.recordings import tiny
from tests.recordings import tiny_rosbag as bags

STEP_NS = 50_000_000
IMAGES = 60
BLOB = "std_msgs/msg/UInt8MultiArray"
CHUNK = 6


def pixels(index):
    return np.random.default_rng(index).integers(0, 256, (tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8)


def long_drive():
    """Sixty images and poses over three seconds, with messages of 100 kB between, so that there are several chunks."""
    layout = bags.message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    rows = []
    for i in range(IMAGES):
        time_ns = tiny.TIMES_NS[0] + i * STEP_NS
        filler = np.random.default_rng(i).integers(0, 256, 100_000, dtype=np.uint8)
        rows.append((bags.ODOM, bags.ODOMETRY, time_ns, bags.odometry(time_ns, (0.1 * i, 0.0, 0.0))))
        rows.append((bags.FRONT, bags.IMAGE, time_ns, bags.image(time_ns, pixels(i))))
        rows.append(("/blob", BLOB, time_ns, bags.message(BLOB, layout=layout, data=filler)))
        rows.append((bags.LIDAR, bags.CLOUD, time_ns, bags.cloud(time_ns, bags.sweep_points(0))))
    return rows


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Writes a bag that nothing is wrong with, once, and gives its file."""

    @cache
    def write(kind):
        storage, _, packed = kind.partition("-")
        root = bags.write_rig(tmp_path_factory.mktemp("whole") / "data")
        return bags.write_bag(root / "drive", long_drive(), storage=storage, compression="STORAGE" if packed else None)

    return write


@pytest.fixture(params=["mcap", "mcap-zstd", "db3"])
def whole(request, written):
    return written(request.param)


@pytest.fixture(params=["mcap", "mcap-zstd"])
def whole_mcap(request, written):
    return written(request.param)


def copied(file, tmp_path, content=None, *, metadata=True):
    """The bag again, with other content of its file."""
    root = bags.write_rig(tmp_path / "data")
    (root / "drive").mkdir(exist_ok=True)
    (root / "drive" / file.name).write_bytes(file.read_bytes() if content is None else content)
    if metadata:
        (root / "drive" / "metadata.yaml").write_bytes((file.parent / "metadata.yaml").read_bytes())
    return root


def handle_of(root, **options):
    (handle,) = rosbag_recordings(root, options=bags.OPTIONS | options, card=root / "card.yaml", annotations=None)
    return handle


def indices(recording):
    """Which images are there, each of them compared with what was written."""
    found = [(ref.timestamp_ns - tiny.TIMES_NS[0]) // STEP_NS for ref in recording.images["front"]]
    for i, ref in zip(found, recording.images["front"], strict=True):
        assert np.array_equal(read_image(ref, recording.cameras["front"]), pixels(i))
    return found


def test_nothing_is_wrong_with_a_whole_bag(whole, tmp_path):
    root = copied(whole, tmp_path)
    assert indices(handle_of(root).open()) == list(range(IMAGES))
    assert handle_of(root).salvager().faults == ()


@pytest.mark.parametrize("share", [0.3, 0.7, 0.999])
def test_a_bag_that_was_cut_short(whole, tmp_path, share):
    content = whole.read_bytes()
    root = copied(whole, tmp_path, content[: int(len(content) * share)])
    with pytest.raises(DataError, match=r"accept_losses: true to use the rest") as caught:
        handle_of(root).open()
    assert whole.name in str(caught.value)
    found = indices(handle_of(root, accept_losses=True).open())
    assert found == list(range(len(found)))
    assert len(found) >= IMAGES * share - 12  # a packed chunk is lost as a whole: ten images
    salvaged = handle_of(root).salvager()
    assert len(salvaged.recording.images["front"]) == len(found)
    told = "\n".join(map(str, salvaged.faults))
    if len(found) < IMAGES:
        assert f"{bags.FRONT}: expected {IMAGES} messages, as metadata.yaml says, got {len(found)}" in told
        last_ns = tiny.TIMES_NS[0] + (len(found) - 1) * STEP_NS + bags.LATE_NS
        after_ns = int(re.search(r"after (\d+)", told)[1])
        assert last_ns <= after_ns <= last_ns + STEP_NS


def test_a_recorder_that_died_left_no_summary_and_no_metadata(whole, tmp_path):
    content = whole.read_bytes()
    if whole.suffix == ".mcap":
        content = content[: content.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")]
    root = copied(whole, tmp_path, content, metadata=False)
    told = "\n".join(map(str, handle_of(root).salvager().faults))
    assert "metadata.yaml: expected the metadata that a recorder writes last, got no such file" in told
    if whole.suffix == ".mcap":
        assert "the end of the file without the summary that a recorder writes last" in told
    assert indices(handle_of(root, accept_losses=True).open()) == list(range(IMAGES))


def chunks_of(content):
    """Where chunks begin and end."""
    place, found = 8, []
    while content[place] not in (0x0F, 0x02):
        (length,) = struct.unpack_from("<Q", content, place + 1)
        if content[place] == CHUNK:
            found.append((place, place + 9 + length))
        place += 9 + length
    return found


def test_a_damaged_chunk_in_the_middle(whole_mcap, tmp_path):
    """Flipped bytes: told by the chunk's checksum, or by the packer."""
    content = bytearray(whole_mcap.read_bytes())
    begin, end = chunks_of(content)[2]
    compression_length = struct.unpack_from("<I", content, begin + 9 + 28)[0]
    data = begin + 9 + 28 + 4 + compression_length + 8
    unpacked = zstd.decompress(content[data:end]) if compression_length else content[data:end]
    struct.pack_into("<I", content, begin + 9 + 24, crc32(unpacked))
    content[(data + end) // 2] ^= 0xFF
    content[(data + end) // 2 + 1] ^= 0xFF
    root = copied(whole_mcap, tmp_path, bytes(content))
    salvaged = handle_of(root).salvager()
    told = "\n".join(map(str, salvaged.faults))
    assert f"chunk at byte {begin}: expected a whole chunk, got " in told
    assert " messages from " in told
    found = indices(salvaged.recording)
    assert found[:5] == [0, 1, 2, 3, 4]
    assert found[-5:] == [55, 56, 57, 58, 59]
    assert 35 <= len(found) < IMAGES


def test_a_wrong_length_is_bridged_with_the_summary(whole_mcap, tmp_path):
    content = bytearray(whole_mcap.read_bytes())
    begin, _ = chunks_of(content)[1]
    struct.pack_into("<Q", content, begin + 1, 2**61)
    salvaged = handle_of(copied(whole_mcap, tmp_path, bytes(content))).salvager()
    assert "what lies up to the chunk at byte" in "\n".join(map(str, salvaged.faults))
    assert indices(salvaged.recording)[-20:] == list(range(40, 60))


def test_overwritten_pages_of_a_database(written, tmp_path):
    whole = written("db3")
    content = bytearray(whole.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 40 * 4096] = bytes(40 * 4096)
    root = copied(whole, tmp_path, bytes(content))
    salvaged = handle_of(root).salvager()
    assert salvaged.faults
    assert salvaged.recording is not None
    read = 0
    for ref in salvaged.recording.images["front"]:
        index = (ref.timestamp_ns - tiny.TIMES_NS[0]) // STEP_NS
        image = read_image(ref, salvaged.recording.cameras["front"])
        read += np.array_equal(image, pixels(index))
    assert read >= 25


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_random_damage_is_told_and_never_a_bug(tmp_path, storage):
    small = bags.write_bag(tmp_path / "small", bags.drive(), storage=storage)
    content = small.read_bytes()
    random = np.random.default_rng(5)
    told = 0
    for _ in range(40):
        damaged = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 30)):
            damaged[place] = random.integers(0, 256)
        if random.random() < 0.3:
            damaged = damaged[: random.integers(1, len(content))]
        root = copied(small, tmp_path, bytes(damaged))
        for salvage in (False, True):
            handle = handle_of(root, accept_losses=True)
            try:
                recording = handle.salvager().recording if salvage else handle.open()
                for ref in recording.images["front"] if recording else ():
                    read_image(ref, recording.cameras["front"])
                for ref in recording.sweeps if recording else ():
                    ref.read()
            except BenchError:
                told += 1
    assert told > 10


def record(kind, content):
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def text(value):
    return text_bytes(value.encode())


def text_bytes(value):
    return struct.pack("<I", len(value)) + value


def chunk(data, *, packed=None, size=None, compression="zstd"):
    packed = zstd.compress(data) if packed is None else packed
    head = struct.pack("<QQQI", 0, 1, len(data) if size is None else size, 0) + text(compression)
    return record(CHUNK, head + struct.pack("<Q", len(packed)) + packed)


HEADER_RECORD = record(1, text("ros2") + text("test"))
BOMB = zstd.compress(bytes(1 << 30), level=1)


HOSTILE_RECORDS = [
    (chunk(b"", packed=BOMB, size=1 << 20), "more than 1048576 bytes when unpacked"),
    (chunk(b"", packed=BOMB, size=1 << 30), "where 268435456 are the most"),
    (chunk(b"abc", size=10), "3 bytes when unpacked, where 10 are told"),
    (chunk(b"abc", compression="rar"), "the unknown compression 'rar'"),
    (chunk(b"abc", packed=b"abc", compression="lz4"), "lz4 data that is cut short"),
    (chunk(b"abc", packed=b"abcdefgh" * 9, compression="lz4"), "lz4 data that cannot be unpacked"),
    (chunk(chunk(b"abc")), "a chunk inside a chunk"),
    (chunk(record(5, struct.pack("<HIQQ", 7, 0, 1, 1))), "a message of channel 7, which nothing describes"),
    (record(5, b""), "a message of -22 bytes"),
    (b"\x05" + struct.pack("<Q", 2**63), "a record of 9223372036854775808 bytes"),
    (b"\x03" + struct.pack("<Q", 1 << 40), "a record of 1099511627776 bytes, where 4194304 are the most"),
    (record(3, struct.pack("<HI", 1, 2**32 - 1)), "a text of 4294967295 bytes"),
    (record(6, struct.pack("<QQQI", 0, 1, 5, 0) + struct.pack("<I", 2**32 - 1)), "a text of 4294967295 bytes"),
    (bytes(100), "a record of kind 0"),
    (chunk(bytes(range(1, 100))), "of it: expected a row of records"),
]


def test_definitions_in_other_languages_than_ros_damage_nothing(tmp_path):
    """Loggers put channels of other kinds beside those of ROS; their definitions are no text."""
    schemas = record(3, struct.pack("<H", 1) + text("example.Log") + text("protobuf") + text_bytes(b"\x0a\xff\xfe\x80"))
    schemas += record(3, struct.pack("<H", 2) + text(bags.IMU) + text("ros2msg") + text(""))
    channels = record(4, struct.pack("<HH", 1, 1) + text("/log") + text("protobuf") + text(""))
    channels += record(4, struct.pack("<HH", 2, 2) + text("/imu") + text("cdr") + text(""))
    channels += record(4, struct.pack("<HH", 3, 0) + text("/json") + text("json") + text(""))
    messages = b"".join(record(5, struct.pack("<HIQQ", channel, 0, 7, 7) + b"payload") for channel in (1, 2, 3))
    data = b"\x89MCAP0\r\n" + HEADER_RECORD + schemas + channels + chunk(messages) + record(15, bytes(4))
    summary = schemas + channels
    footer = record(2, struct.pack("<QQI", len(data), 0, 0)) + b"\x89MCAP0\r\n"
    file = tmp_path / "mixed.mcap"
    file.write_bytes(data + summary + footer)
    report = ScanReport()
    (found,) = scan_mcap(file, Wanted(heads=frozenset({"/imu"}), whole=frozenset()), report)
    assert found.payload == b"payload"
    assert report.losses == []
    assert report.counts == {"/log": 1, "/imu": 1, "/json": 1}


@pytest.mark.parametrize(
    ("content", "told"),
    HOSTILE_RECORDS,
)
def test_hostile_records_are_told_and_take_little_memory(tmp_path, content, told):
    file = tmp_path / "hostile.mcap"
    file.write_bytes(b"\x89MCAP0\r\n" + HEADER_RECORD + content)
    report = ScanReport()
    tracemalloc.start()
    try:
        assert list(scan_mcap(file, Wanted(heads=frozenset(), whole=frozenset()), report)) == []
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert told in "\n".join(map(str, report.losses))
    assert peak < 10_000_000


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"SQLite format 3\0" + bytes(84), b"PK\x03\x04" + bytes(96)])
@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_files_that_are_no_bags(tmp_path, content, suffix):
    root = bags.write_rig(tmp_path / "data")
    (root / f"drive{suffix}").write_bytes(content)
    with pytest.raises(DataError, match=rf"drive{suffix}"):
        handle_of(root, accept_losses=True).open()


def metadata(root, change):
    file = root / "drive" / "metadata.yaml"
    content = yaml.safe_load(file.read_text())
    change(content["rosbag2_bagfile_information"])
    file.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize("path", ["../drive.mcap", "/etc/drive.mcap", "..", "C:\\x.mcap", "secret.txt"])
def test_metadata_that_names_files_elsewhere(tmp_path, path):
    root = bags.write_rig(tmp_path / "data")
    bags.write_bag(root / "drive", bags.drive())
    metadata(root, lambda content: content.update(relative_file_paths=[path]))
    with pytest.raises(
        DataError, match=r"metadata\.yaml: rosbag2_bagfile_information\.relative_file_paths\.0: expected"
    ):
        handle_of(root, accept_losses=True).open()


def test_links_that_lead_outside(tmp_path):
    root = bags.write_rig(tmp_path / "data")
    file = bags.write_bag(root / "drive", bags.drive())
    file.rename(tmp_path / "elsewhere.mcap")
    file.symlink_to(tmp_path / "elsewhere.mcap")
    with pytest.raises(DataError, match=r"a link that leads outside"):
        handle_of(root, accept_losses=True).open()
    file.unlink()
    (root / "drive" / "metadata.yaml").unlink()
    (root / "drive").rmdir()
    (root / "drive.mcap").symlink_to(tmp_path / "elsewhere.mcap")
    with pytest.raises(DataError, match=r"a link that leads outside"):
        handle_of(root, accept_losses=True).open()


@pytest.mark.parametrize(
    "content",
    [
        "rosbag2_bagfile_information: !!python/object/apply:os.system [true]\n",
        "rosbag2_bagfile_information: [1, 2]\n",
        "- 1\n",
        "{" * 2000,
        "a: &a [x, x]\nb: &b [*a, *a]\nrosbag2_bagfile_information: {relative_file_paths: *b}\n",
    ],
    ids=["tag", "list", "no keys", "nested", "aliases"],
)
def test_metadata_that_is_none(tmp_path, content):
    root = bags.write_rig(tmp_path / "data")
    bags.write_bag(root / "drive", bags.drive())
    (root / "drive" / "metadata.yaml").write_text(content)
    with pytest.raises(DataError, match=r"metadata\.yaml"):
        handle_of(root, accept_losses=True).open()


def test_a_missing_part_of_several(tmp_path):
    root = bags.write_rig(tmp_path / "data")
    bags.write_bag(root / "drive", bags.drive())
    metadata(root, lambda content: content["relative_file_paths"].append("drive_1.mcap"))
    with pytest.raises(DataError, match=r"drive_1\.mcap: expected a file of messages, as metadata\.yaml says, got no"):
        handle_of(root).open()
    assert indices_of_tiny(handle_of(root, accept_losses=True).open()) == [0, 1, 2]


def indices_of_tiny(recording):
    return [tiny.TIMES_NS.index(ref.timestamp_ns) for ref in recording.images["front"]]


def test_parts_are_read_in_the_order_of_recording(tmp_path):
    """Without metadata drive_2 still comes before drive_10."""
    root = bags.write_rig(tmp_path / "data")
    rows = bags.drive()
    (root / "drive").mkdir()
    for number, part in ((2, rows[:4]), (10, rows[4:])):
        bags.write_bag(tmp_path / f"part{number}", part).rename(root / "drive" / f"drive_{number}.mcap")
    recording = handle_of(root, accept_losses=True).open()
    assert [ref.file.name for ref in recording.images["front"]] == ["drive_2.mcap", "drive_2.mcap", "drive_10.mcap"]


def with_stamps(*stamps_ns):
    """The drive with other stamps of its images."""
    rows = [row for row in bags.drive() if row[0] != bags.FRONT]
    for i, stamp_ns in enumerate(stamps_ns):
        rows.append((bags.FRONT, bags.IMAGE, tiny.TIMES_NS[i], bags.image(stamp_ns, tiny.pixels(i))))
    return rows


FIRST, SECOND, THIRD = tiny.TIMES_NS
STAMPS = [
    ((FIRST, FIRST - 10, THIRD), "/camera/front: expected times that increase, got 1 that do not", [0, 2]),
    ((FIRST, FIRST, THIRD), "expected times that increase, got 1 that do not", [0, 2]),
    ((FIRST, FIRST + 10**12, THIRD), "expected stamps of one clock, got 1 of 3 stamps that jump", [0, 2]),
    (
        (FIRST, SECOND, 0),
        "expected a time in the header, got none in 1 of 3 messages; set the card's option clock",
        [0, 1],
    ),
]


@pytest.mark.parametrize(("stamps_ns", "told", "kept"), STAMPS)
def test_stamps_that_no_clock_gives(tmp_path, stamps_ns, told, kept):
    root = bags.write_rig(tmp_path / "data")
    bags.write_bag(root / "drive", with_stamps(*stamps_ns))
    with pytest.raises(DataError) as caught:
        handle_of(root).open()
    assert told in str(caught.value)
    assert indices_of_tiny(handle_of(root, accept_losses=True).open()) == kept
    assert len(handle_of(root, clock="bag").open().images["front"]) == 3


def test_numbers_that_are_none_in_poses(tmp_path):
    root = bags.write_rig(tmp_path / "data")
    rows = [*bags.drive()]
    time_ns = tiny.TIMES_NS[1] + 1_000_000
    rows.append((bags.ODOM, bags.ODOMETRY, time_ns, bags.odometry(time_ns, (np.nan, 0.0, 0.0))))
    rows.append((bags.ODOM, bags.ODOMETRY, time_ns + 1, bags.odometry(time_ns + 1, (0.0, 0.0, 0.0), (0, 0, 0, 0))))
    bags.write_bag(root / "drive", rows)
    with pytest.raises(
        DataError, match=r"/odom: expected finite numbers, got NaN or infinity in 1 of 5.*1 more faults"
    ):
        handle_of(root).open()
    assert len(handle_of(root, accept_losses=True).open().trajectory.timestamps_ns) == 3


def test_a_lost_trajectory_leaves_the_rest(tmp_path):
    root = bags.write_rig(tmp_path / "data")
    bags.write_bag(root / "drive", [row for row in bags.drive() if row[0] != bags.ODOM])
    with pytest.raises(DataError, match=r"/odom: expected messages of the ego-motion, got none"):
        handle_of(root, accept_losses=True).open()
    salvaged = handle_of(root).salvager()
    assert "trajectory" in salvaged.lost
    assert indices_of_tiny(salvaged.recording) == [0, 1, 2]


def test_memory_does_not_grow_with_the_length(tmp_path):
    """Four times the messages, 12 MB more: the index grows by some bytes for each, and nothing else."""

    def peak(name, rounds):
        root = bags.write_rig(tmp_path / name)
        noise = np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)
        rows = []
        for i in range(rounds):
            time_ns = tiny.TIMES_NS[0] + i * STEP_NS
            rows.append((bags.FRONT, bags.IMAGE, time_ns, bags.image(time_ns, noise)))
            rows.append((bags.ODOM, bags.ODOMETRY, time_ns, bags.odometry(time_ns, (0.1 * i, 0.0, 0.0))))
        for_lidar = (bags.LIDAR, bags.CLOUD, tiny.TIMES_NS[0], bags.cloud(tiny.TIMES_NS[0], bags.sweep_points(0)))
        bags.write_bag(root / "drive", [for_lidar, *rows])
        rig = yaml.safe_load((root / "rig.yaml").read_text())
        rig["cameras"]["front"]["image_size"] = [320, 240]
        rig["cameras"]["front"]["model"]["principal_point"] = [160, 120]
        bags.write_rig(root, rig)
        handle_of(root).open()  # what is loaded once
        tracemalloc.start()
        try:
            recording = handle_of(root).open()
            for ref in recording.images["front"]:
                read_image(ref, recording.cameras["front"])
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    short, long = peak("short", 50), peak("long", 200)
    assert long - short < 150 * 4000
    assert long < 8_000_000
