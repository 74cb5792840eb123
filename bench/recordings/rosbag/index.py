"""Where the messages of a bag lie, and at what times: made in one walk, without decoding an image or a point cloud."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings.rosbag.files import METADATA, BagFiles
from bench.recordings.rosbag.mcap import read_mcap_message, scan_mcap
from bench.recordings.rosbag.messages import has_header, header_stamp_ns
from bench.recordings.rosbag.sqlite import read_sqlite_message, scan_sqlite
from bench.recordings.rosbag.storage import (
    HEAD_BYTES,
    LARGEST_MESSAGE_BYTES,
    LARGEST_WHOLE_BYTES,
    Place,
    ScanReport,
    StoredMessage,
    Topic,
    Wanted,
)
from bench.recordings.rosbag.unpack import ZSTD, unpack, unpacked_start

COLUMNS = ("log_ns", "stamp_ns", "file", "chunk", "offset", "size")
NO_STAMP = -1
Consumer = Callable[[Topic, "Times", bytes, Path], None]


@dataclass(frozen=True, slots=True)
class Times:
    """The times of a message.

    Attributes:
        log_ns: when it was recorded.
        stamp_ns: what its header says; `NO_STAMP` where that is no time, None where the type has no header.
    """

    log_ns: int
    stamp_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TopicIndex:
    """The messages of a topic, in the order in which they were recorded.

    Attributes:
        topic: whose they are.
        log_ns: (N,) int64, when they were recorded.
        stamp_ns: (N,) int64, the times in their headers; `NO_STAMP` where there is none.
        places: (N, 4) int64: number of the file, chunk, offset, size.
    """

    topic: Topic
    log_ns: NDArray[np.int64]
    stamp_ns: NDArray[np.int64]
    places: NDArray[np.int64]


@dataclass(slots=True)
class BagIndex:
    """What is known of a bag after the walk.

    Attributes:
        files: of messages.
        topics: all of the bag's, by name.
        messages: of the topics that were asked for by their heads.
        losses: what could not be read.
        packed: each message is compressed for itself.
    """

    files: tuple[Path, ...]
    packed: bool
    topics: dict[str, Topic] = field(default_factory=dict)
    messages: dict[str, TopicIndex] = field(default_factory=dict)
    losses: list[DataError] = field(default_factory=list)


def index_bag(bag: BagFiles, *, heads: frozenset[str], whole: Mapping[str, Consumer]) -> BagIndex:
    """Walk through a bag once.

    Args:
        bag: its files.
        heads: topics whose messages are to be found again.
        whole: topics whose messages are handed over at once, in the order of the files.

    Raises:
        DataError: no file can be opened, a topic has messages of two types, or what a consumer raises.
    """
    index = BagIndex(files=bag.files, packed=bag.packed_messages)
    index.losses.extend(bag.losses)
    report = ScanReport()
    rows: dict[str, array[int]] = {name: array("q") for name in heads}
    expected = Wanted(heads=heads - frozenset(whole), whole=frozenset(whole))
    if bag.packed_messages:
        expected = Wanted(heads=frozenset(), whole=heads | frozenset(whole))
    opened = 0
    for number, file in enumerate(bag.files):
        try:
            for found in _scan(file, expected, report):
                _take(found, number, file, bag, report, rows, whole)
            opened += 1
        except _UnreadableError as unreadable:
            report.losses.append(unreadable.reason)
    if not opened:
        raise report.losses[0]
    for name, types in report.mixed.items():
        if name in heads or name in whole:
            got = " and ".join(sorted(types))
            raise DataError(bag.place, field=name, expected="messages of one type", got=got)
    index.topics = report.topics
    index.messages = {name: _topic_index(report.topics[name], rows[name]) for name in heads if name in report.topics}
    index.losses.extend(report.losses)
    index.losses.extend(_uncounted(bag, report))
    return index


def read_message(file: Path, place: Place, *, packed: bool) -> bytes:
    """Read one message of a bag.

    Args:
        file: that holds it.
        place: where.
        packed: it is compressed for itself.

    Raises:
        DataError: it cannot be read or unpacked.
    """
    data = (read_mcap_message if file.suffix == ".mcap" else read_sqlite_message)(file, place)
    return _unpacked(data, file, LARGEST_MESSAGE_BYTES) if packed else data


class _UnreadableError(Exception):
    """A file of which nothing can be read."""

    def __init__(self, reason: DataError) -> None:
        self.reason = reason


def _scan(file: Path, expected: Wanted, report: ScanReport) -> Iterator[StoredMessage]:
    try:
        yield from (scan_mcap if file.suffix == ".mcap" else scan_sqlite)(file, expected, report)
    except DataError as error:
        raise _UnreadableError(error) from error


def _take(
    found: StoredMessage,
    number: int,
    file: Path,
    bag: BagFiles,
    report: ScanReport,
    rows: Mapping[str, array[int]],
    whole: Mapping[str, Consumer],
) -> None:
    topic, payload = report.topics[found.topic], found.payload
    if found.topic in whole:
        if found.place.size > LARGEST_WHOLE_BYTES:
            got = f"{found.place.size} bytes of {topic.message_type}"
            raise DataError(file, field=topic.name, expected=f"messages up to {LARGEST_WHOLE_BYTES} bytes", got=got)
        if bag.packed_messages:
            payload = _unpacked(payload, file, LARGEST_WHOLE_BYTES)
    elif bag.packed_messages:
        payload = unpacked_start(payload, count=HEAD_BYTES)
    stamp_ns: int | None = None
    if has_header(topic, file=file):
        stamp_ns = header_stamp_ns(payload[:HEAD_BYTES])
        stamp_ns = stamp_ns or NO_STAMP  # 0 is what a driver leaves that sets none
    if found.topic in whole:
        whole[found.topic](topic, Times(found.log_ns, stamp_ns), payload, file)
    if found.topic in rows:
        place = found.place
        stored_stamp = NO_STAMP if stamp_ns is None else stamp_ns
        rows[found.topic].extend((found.log_ns, stored_stamp, number, place.chunk, place.offset, place.size))


def _unpacked(data: bytes, file: Path, most_bytes: int) -> bytes:
    unpacked = unpack(data, ZSTD, most_bytes=most_bytes)
    if unpacked.fault is not None:
        raise DataError(file, expected="messages packed with zstd", got=unpacked.fault)
    return unpacked.data


def _topic_index(topic: Topic, rows: array[int]) -> TopicIndex:
    table = np.frombuffer(rows, dtype=np.int64).reshape(-1, len(COLUMNS))
    table = table[np.argsort(table[:, 0], kind="stable")]
    return TopicIndex(topic=topic, log_ns=table[:, 0].copy(), stamp_ns=table[:, 1].copy(), places=table[:, 2:].copy())


def _uncounted(bag: BagFiles, report: ScanReport) -> Iterator[DataError]:
    """Topics with fewer messages than the metadata says."""
    for name, count in (bag.counts or {}).items():
        found = report.counts.get(name, 0)
        if found < count:
            yield DataError(
                bag.place, field=name[:80], expected=f"{count} messages, as {METADATA} says", got=str(found)
            )
