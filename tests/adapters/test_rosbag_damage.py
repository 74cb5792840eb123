"""Bags that were cut short, damaged or made to hurt: one line says what is wrong and how to repair it."""

import shutil
import sqlite3
import struct
from contextlib import closing
from functools import cache, partial
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
from backports import zstd

from bench.adapters.rosbag.messages import read_message, stored_messages
from bench.errors import DataError
from bench.recordings import read_image
from tests.support import data_sets, tiny
from tests.support import tiny_rosbag as bags
from tests.support.limits import memory_below

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


@pytest.fixture
def whole(request, written):
    return written(request.param)


of_mcap = pytest.mark.parametrize("whole", ["mcap", "mcap-zstd"], indirect=True)
of_every_kind = pytest.mark.parametrize("whole", ["mcap", "mcap-zstd", "db3"], indirect=True)


def copied(file, tmp_path, content=None):
    """The bag again, with other content of its file."""
    root = bags.write_rig(tmp_path / "data")
    shutil.copytree(file.parent, root / "drive")
    if content is not None:
        (root / "drive" / file.name).write_bytes(content)
    return root


opened = partial(data_sets.opened, "rosbag", **bags.OPTIONS)


REPAIR = {
    ".mcap": "repair it, then replace it by the result: mcap recover drive.mcap -o drive-repaired.mcap",
    ".db3": "repair it, then replace it by the result: sqlite3 drive.db3 .recover | sqlite3 drive-repaired.db3",
}


@of_every_kind
@pytest.mark.parametrize("share", [0.3, 0.7, 0.999])
def test_a_bag_that_was_cut_short_says_how_to_repair_it_whatever_the_card_accepts(whole, tmp_path, share):
    content = whole.read_bytes()
    root = copied(whole, tmp_path, content[: int(len(content) * share)])
    for options in ({}, {"accept_losses": True}):
        with pytest.raises(DataError) as caught:
            opened(root, **options)
        assert str(caught.value).startswith(str(root / "drive" / whole.name))
        assert str(caught.value).endswith(REPAIR[whole.suffix])


LACKING = [  # what is done to the description of a bag, and what is said
    (Path.unlink, r"metadata\.yaml: expected the metadata that a recorder writes last, got no .*; .*ros2 bag reindex"),
    (
        lambda file: metadata(file, lambda content: content["relative_file_paths"].append("drive_1.mcap")),
        r"drive_1\.mcap: expected a file of messages, as metadata\.yaml says, got no such file; .*ros2 bag reindex",
    ),
]


@of_mcap
@pytest.mark.parametrize(("change", "told"), LACKING)
def test_a_bag_that_lacks_something_is_refused_whatever_the_card_accepts(whole, tmp_path, change, told):
    root = copied(whole, tmp_path)
    change(root / "drive/metadata.yaml")
    for options in ({}, {"accept_losses": True}):
        with pytest.raises(DataError, match=told):
            opened(root, **options)


def test_messages_that_a_database_has_not_merged(written, tmp_path):
    root = copied(written("db3"), tmp_path)
    (root / "drive" / "drive.db3-wal").write_bytes(b"log")
    with pytest.raises(DataError, match=r"last ones still in drive\.db3-wal; merge it: sqlite3 drive\.db3 'PRAGMA wal"):
        opened(root)


@of_mcap
def test_a_chunk_that_is_damaged_after_opening(whole, tmp_path):
    root = copied(whole, tmp_path)
    recording = opened(root)
    camera, images = recording.cameras["front"], recording.images["front"]
    assert [ref.timestamp_ns for ref in images] == [tiny.TIMES_NS[0] + i * STEP_NS for i in range(IMAGES)]
    assert all(np.array_equal(read_image(ref, camera), pixels(i)) for i, ref in enumerate(images))
    content = whole.read_bytes()
    (root / "drive" / "drive.mcap").write_bytes(content[: len(content) // 3] + bytes(len(content) * 2 // 3))
    assert np.array_equal(read_image(images[3], camera), pixels(3))
    with pytest.raises(DataError, match=r"drive\.mcap: expected a message of 3120 bytes, got .*: mcap recover"):
        read_image(images[25], camera)
    (root / "drive" / "drive.mcap").unlink()
    with pytest.raises(DataError, match=r"drive\.mcap: expected a readable file, got No such file"):
        read_image(images[3], camera)


def record(kind, content):
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def text(value):
    """A text, or bytes in the place of one, with its length before it."""
    content = value if isinstance(value, bytes) else value.encode()
    return struct.pack("<I", len(content)) + content


def chunk(data, *, packed=None, size=None, checksum=0, compression="zstd"):
    packed = zstd.compress(data) if packed is None else packed
    head = struct.pack("<QQQI", 0, 1, len(data) if size is None else size, checksum) + text(compression)
    return record(CHUNK, head + struct.pack("<Q", len(packed)) + packed)


MAGIC = b"\x89MCAP0\r\n"
BOMB = zstd.compress(bytes(1 << 30), level=1)
LZ4_BOMB = lz4.frame.compress(bytes(1 << 28))
STATES_240 = record(11, struct.pack("<QHIIIIQQI", 240, *[0] * 8))


def indexed(content, summary=b"", *, has_summary=True):
    """A file with a record of any kind, and a summary whose index says that it is a chunk."""
    begin = MAGIC + record(1, text("ros2") + text("test"))
    entry = struct.pack("<QQQQIQ", 0, 1, len(begin), len(content), 0, 0) + text("zstd") + struct.pack("<QQ", 0, 0)
    start = len(begin) + len(content) if has_summary else 0
    return begin + content + record(8, entry) + summary + record(2, struct.pack("<QQI", start, 0, 0)) + MAGIC


HOSTILE_RECORDS = [
    (indexed(chunk(b"", packed=BOMB, size=1 << 20)), "zstd data of more than 1048576 bytes"),
    (indexed(chunk(b"", packed=BOMB, size=1 << 30)), "a chunk of 1073741824 bytes, where 268435456 are the most"),
    (indexed(chunk(b"abc", checksum=1)), "crc validation failed in Chunk"),
    (indexed(chunk(b"abc", packed=b"no zstd")), "Unknown frame descriptor"),
    (indexed(chunk(b"abc", size=10)), "a chunk of 3 bytes, where it states 10"),
    (indexed(chunk(b"abc", compression="rar")), "the unknown compression 'rar'"),
    (indexed(chunk(b"", packed=LZ4_BOMB, size=1 << 20, compression="lz4")), "lz4 data of more than 1048576 bytes"),
    (indexed(b"\x06" + struct.pack("<Q", 1 << 40)), "a record of kind 6 with 1099511627776 bytes"),
    (indexed(bytes(99)), "a record of kind 0 with 0 bytes at byte 33, where its index has a chunk"),
    (indexed(chunk(record(3, struct.pack("<HI", 1, 2**32 - 1)))), "the end in the middle of it"),
    (indexed(chunk(record(0x7F, b"")), STATES_240), "0 messages in chunks with an index, where its statistics say 240"),
    (indexed(chunk(b""), has_summary=False), "no summary with an index, which a recorder writes last"),
]


@pytest.mark.parametrize(("content", "told"), HOSTILE_RECORDS)
def test_hostile_records_are_told_and_take_little_memory(tmp_path, content, told):
    file = tmp_path / "hostile.mcap"
    file.write_bytes(content)
    with memory_below(10_000_000), pytest.raises(DataError) as caught:
        list(stored_messages(file, {}))
    assert told in str(caught.value)


def database(file, *statements):
    """A database with the tables of a bag, a topic and a message, changed by statements."""
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
        connection.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        connection.execute(f"INSERT INTO topics VALUES (1, '/imu', '{bags.IMU}', 'cdr')")
        connection.execute("INSERT INTO messages VALUES (5, 1, 7, x'6162')")
        for statement in statements:
            connection.execute(statement)
        connection.commit()


GENERATED = "CREATE TABLE {} (id INTEGER PRIMARY KEY, {} AS ({}))"
TOPICS = GENERATED.format("topics", "name, type, serialization_format", "hex(zeroblob(500000))")
MESSAGES = GENERATED.format("messages", "topic_id, timestamp, data", "zeroblob(900000000)")
MANY = "WITH RECURSIVE n(i) AS (SELECT 2 UNION ALL SELECT i + 1 FROM n WHERE i < 100000) INSERT INTO topics"
HOSTILE_DATABASES = [
    (["INSERT INTO messages VALUES (6, 2, 8, x'61')"], r"the row \(6, 2, 8, 1\) of the table messages"),
    (["DROP TABLE topics"], "expected the tables topics and messages, as in a bag of ROS 2, got messages"),
    (["DROP TABLE topics", TOPICS, f"{MANY} SELECT i, 'a', 'b' FROM n"], "definitions of more than 33554432 bytes"),
    (["DROP TABLE messages", MESSAGES, "INSERT INTO messages VALUES (5, 1, 7)"], "too big"),
]


@pytest.mark.parametrize(("statements", "told"), HOSTILE_DATABASES)
def test_hostile_databases_are_told_and_take_little_memory(tmp_path, statements, told):
    file = tmp_path / "hostile.db3"
    database(file)
    ((_, _, position, start),) = stored_messages(file, {"/imu": 1})
    assert start == b"a"
    assert read_message(file, position) == b"ab"
    file.unlink()
    database(file, *statements)
    with memory_below(60_000_000), pytest.raises(DataError, match=told) as caught:
        list(stored_messages(file, {}))
    assert str(file) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"SQLite format 3\0" + bytes(84), b"PK\x03\x04" + bytes(96)])
@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_files_that_are_no_bags(tmp_path, content, suffix):
    root = bags.write_rig(tmp_path / "data")
    (root / f"drive{suffix}").write_bytes(content)
    with pytest.raises(DataError, match=rf"drive{suffix}"):
        opened(root, accept_losses=True)


def metadata(file, change):
    content = yaml.safe_load(file.read_text())
    change(content["rosbag2_bagfile_information"])
    file.write_text(yaml.safe_dump(content))


NAMED = r"metadata\.yaml: rosbag2_bagfile_information\.relative_file_paths\.0: expected"


@pytest.mark.parametrize("path", ["../drive.mcap", "/etc/drive.mcap", "secret.txt"])
def test_metadata_that_names_files_elsewhere(tmp_path, path):
    root = bags.data_set(tmp_path, bags.drive())
    metadata(root / "drive/metadata.yaml", lambda content: content.update(relative_file_paths=[path]))
    with pytest.raises(DataError, match=NAMED):
        opened(root, accept_losses=True)


def test_parts_are_read_in_the_order_of_recording(tmp_path):
    rows, names = bags.drive(), ["drive_2.mcap", "drive_10.mcap"]
    root = bags.data_set(tmp_path, rows[:4])
    (root / "drive/drive.mcap").rename(root / "drive" / names[0])
    bags.write_bag(tmp_path / "later", rows[4:]).rename(root / "drive" / names[1])
    metadata(root / "drive/metadata.yaml", lambda content: content.update(relative_file_paths=names))
    recording = opened(root)
    assert [ref.file.name for ref in recording.images["front"]] == ["drive_2.mcap", "drive_2.mcap", "drive_10.mcap"]


def with_stamps(*stamps_ns):
    """The drive with other stamps of its images."""
    rows = [row for row in bags.drive() if row[0] != bags.FRONT]
    for i, stamp_ns in enumerate(stamps_ns):
        rows.append((bags.FRONT, bags.IMAGE, tiny.TIMES_NS[i], bags.image(stamp_ns, tiny.pixels(i))))
    return rows


FIRST, SECOND, THIRD = tiny.TIMES_NS
STAMPS = [
    ((FIRST, FIRST, THIRD), "one message for each time, got others at the time of one before", SECOND, [0, 2]),
    ((FIRST, FIRST + 10**12, THIRD), "stamps of one clock, got jumps", SECOND, [0, 2]),
    ((FIRST, SECOND, 0), "a time in the header, got none", THIRD, [0, 1]),
]


@pytest.mark.parametrize(("stamps_ns", "told", "bad_ns", "kept"), STAMPS)
def test_stamps_that_no_clock_gives(tmp_path, stamps_ns, told, bad_ns, kept):
    root = bags.data_set(tmp_path, with_stamps(*stamps_ns))
    with pytest.raises(DataError) as caught:
        opened(root)
    told += f" in 1 of 3 messages, the first recorded at {bad_ns + bags.LATE_NS} ns"
    assert f"/camera/front: expected {told}" in str(caught.value)
    assert ("clock: bag" in str(caught.value)) == (0 in stamps_ns)
    times_ns = [ref.timestamp_ns for ref in opened(root, accept_losses=True).images["front"]]
    assert times_ns == [stamps_ns[i] for i in kept]
    assert len(opened(root, clock="bag").images["front"]) == 3


def test_messages_out_of_order_are_sorted_and_a_pose_that_was_recorded_twice_counts_once(tmp_path):
    rows = with_stamps(SECOND, FIRST, THIRD)
    again = [(topic, kind, log_ns + 7, message) for topic, kind, log_ns, message in rows if topic == bags.ODOM]
    recording = opened(bags.data_set(tmp_path, [*rows, *again]))
    refs = recording.images["front"]
    assert [ref.timestamp_ns for ref in refs] == [FIRST, SECOND, THIRD]
    assert np.array_equal(read_image(refs[0], recording.cameras["front"]), tiny.pixels(1))
    assert recording.trajectory.timestamps_ns.tolist() == list(tiny.TIMES_NS)


@pytest.mark.parametrize("rate", [0.2, 1.0, 25.0])
def test_a_simulated_clock_may_be_slower_or_faster_than_the_recorders(tmp_path, rate):
    """Stamps of a simulation that begins at 1 s; the recorder has the wall's clock."""
    count, wall_ns, rows = 60, 1_700_000_000_000_000_000, []
    for i in range(count):
        log_ns, stamp_ns = wall_ns + i * 500_000_000, 10**9 + round(i * 500_000_000 * rate)
        rows.append((bags.FRONT, bags.IMAGE, log_ns, bags.image(stamp_ns, tiny.pixels(i % 3))))
        rows.append((bags.LIDAR, bags.CLOUD, log_ns, bags.cloud(stamp_ns, bags.sweep_points(0))))
        rows.append((bags.ODOM, bags.ODOMETRY, log_ns, bags.odometry(stamp_ns, (0.1 * i, 0.0, 0.0))))
    recording = opened(bags.data_set(tmp_path, rows))
    assert len(recording.images["front"]) == len(recording.sweeps) == len(recording.trajectory.timestamps_ns) == count


def test_numbers_that_are_none_in_poses(tmp_path):
    rows, time_ns = [*bags.drive()], tiny.TIMES_NS[1] + 1_000_000
    rows.append((bags.ODOM, bags.ODOMETRY, time_ns, bags.odometry(time_ns, (np.nan, 0.0, 0.0))))
    rows.append((bags.ODOM, bags.ODOMETRY, time_ns + 1, bags.odometry(time_ns + 1, (0.0, 0.0, 0.0), (0, 0, 0, 0))))
    root = bags.data_set(tmp_path, rows)
    told = r"/odom: expected finite numbers, got NaN or infinity in 1 of 5.*1 more faults"
    with pytest.raises(DataError, match=told):
        opened(root)
    assert len(opened(root, accept_losses=True).trajectory.timestamps_ns) == 3
